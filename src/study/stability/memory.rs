//! Cases of fading memory, and of stiffening at a knee.

use super::record::{Record, Unexpected, largest};
use super::{Group, HardCase};
use crate::fractional::{of_power, of_sine};
use insonify_mechanics::tissue::viscoelastic::point::{Control, Knee, Loading, Method, Point, Rheology, Structure};
use insonify_mechanics::tissue::viscoelastic::{History, HistoryError, Operator, Rule, Span};

/// Group of fading-memory cases.
pub(crate) const GROUP: Group = Group {
    name: "Fading memory",
    cases: &[
        HardCase {
            name: "equal steps",
            criterion: "k = 0, 1e-3, 0.1, 0.5, 0.999, 1 over 1e5 steps: within 1e-6 of the exact integrals of t^p and of a sine under the \
                        trapezoid and the exponentials, bounded by 1e-3 under the rules of order 1",
            covers: &["cpu f64"],
            seed: 81,
            run: equal,
        },
        HardCase {
            name: "steps from 1e-6 to 1e3 s",
            criterion: "the same orders in one history of 1e5 steps that grow from 1e-6 to 1e3 s: within 1e-6 of the exact integrals",
            covers: &["cpu f64"],
            seed: 82,
            run: growing,
        },
        HardCase {
            name: "steps that jump by 1e9",
            criterion: "1e-6 and 1e3 s in turn and at random: what is linear in time stays within 1e-9 of its exact integral",
            covers: &["cpu f64"],
            seed: 83,
            run: jumping,
        },
        HardCase {
            name: "reversals at every step",
            criterion: "1e5 steps of +1 and -1: the integral never above 1.13 h^k, the derivative never above 4 h^-k: no growth",
            covers: &["cpu f64"],
            seed: 84,
            run: reversals,
        },
        HardCase {
            name: "wrong histories",
            criterion: "orders outside 0 to 1, invalid steps, unequal steps under Gruenwald and Letnikov, values that are not finite, \
                        times outside a span: refused by name, the history as before",
            covers: &["cpu f64"],
            seed: 85,
            run: refused,
        },
        HardCase {
            name: "knee crossed at every step",
            criterion: "both structures, stiffening 0.1 to 1e6: Newton converges within 30 iterations, strains finite, and stresses come \
                        back from them",
            covers: &["cpu f64"],
            seed: 86,
            run: crossing,
        },
    ],
};

/// Applies a stress that takes the strain far below and far above the knee, and to its other side.
pub(super) fn crossing(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let steps = record.effort().pick(500, 3000);
    let bodies = [
        (
            "spring-pot",
            Rheology::SpringPot {
                order: 0.1,
                modulus_kpa: 0.4,
            },
        ),
        (
            "zener",
            Rheology::Zener {
                order: 0.3,
                modulus_kpa: 0.4,
                modulus_inf_kpa: 0.1,
                tau_s: 0.05,
            },
        ),
    ];
    let loading = Loading {
        control: Control::Stress,
        time_s: (0..=steps).map(|step| 1e-3 * f64::from(step)).collect(),
        value: (0..=steps)
            .map(|step| [0.02, 0.5, -0.02, 0.16, -0.5][step as usize % 5])
            .collect(),
    };
    for (name, body) in bodies {
        for (structure, word) in [(Structure::Rate, "rate"), (Structure::LoadIntegral, "load-integral")] {
            let (mut iterations, mut crossings, mut non_finite) = (0, usize::MAX, 0);
            let mut differences = Vec::new();
            for stiffening in [0.1, 8.0, 1e3, 1e6] {
                let knee = Knee {
                    strain: 0.35,
                    stiffening,
                };
                let point = Point { body, knee, structure };
                let response = point.respond_in(&loading, Method::Trapezoid, 1)?;
                iterations = iterations.max(response.iterations);
                non_finite += response.strain.iter().filter(|strain| !strain.is_finite()).count();
                let above = |strain: &f64| strain.abs() > knee.strain;
                let pairs = response.strain.windows(2);
                crossings = crossings.min(pairs.filter(|pair| above(&pair[0]) != above(&pair[1])).count());
                // For a spring-pot the reverse control uses a different rule, summing strains instead of stresses.
                if matches!(body, Rheology::Zener { .. }) {
                    let reversed = Loading {
                        control: Control::Strain,
                        value: response.strain.clone(),
                        ..loading.clone()
                    };
                    let reversed = point.respond_in(&reversed, Method::Trapezoid, 1)?;
                    let stresses = reversed.stress_kpa.iter().zip(&loading.value);
                    differences.push(largest(stresses.map(|(a, b)| a.unwrap_or(f64::NAN) - b)));
                }
            }
            record.under(format!("{name}, {word}: most iterations"), iterations as f64, 30.0);
            record.report(format!("{name}, {word}: fewest crossings"), crossings as f64);
            record.zero(
                format!("{name}, {word}: strains that are not finite"),
                non_finite as f64,
            );
            if !differences.is_empty() {
                record.under(
                    format!("{name}, {word}: stress that comes back, kPa off"),
                    largest(differences),
                    1e-9,
                );
            }
        }
    }
    Ok(())
}

const ORDERS: [f64; 6] = [0.0, 1e-3, 0.1, 0.5, 0.999, 1.0];
const FULL: [(&str, Rule); 4] = [
    ("rectangle", Rule::Rectangle),
    ("time-scaled trapezoid", Rule::TimeScaledTrapezoid),
    ("trapezoid", Rule::Trapezoid),
    ("Gruenwald-Letnikov", Rule::GruenwaldLetnikov),
];

/// Name, function of time, and its integral of some order.
type Load<'a> = (&'a str, &'a dyn Fn(f64) -> f64, &'a dyn Fn(f64, f64) -> f64);

fn exponentials(shortest_s: f64, longest_s: f64) -> (&'static str, Rule) {
    let tolerance = 1e-9;
    let span = Span {
        shortest_s,
        longest_s,
        tolerance,
    };
    ("exponentials", Rule::Exponentials(span))
}

/// Returns the largest error over the steps `evaluated`, relative to the largest integral there.
fn error(rule: &Rule, k: f64, steps: &[f64], evaluated: &[usize], load: &Load<'_>) -> Result<f64, HistoryError> {
    let (_, value, exact) = load;
    let mut history = rule.start(Operator::Integral(k), &[value(0.0)])?;
    let (mut t, mut worst, mut scale) = (0.0, 0.0f64, 0.0f64);
    let mut evaluated = evaluated.iter().peekable();
    for (index, step) in steps.iter().enumerate() {
        t += step;
        if evaluated.next_if(|step| **step == index + 1).is_some() {
            let mut past = [0.0];
            let integral = history.predict(*step, &mut past)? * value(t) + past[0];
            let exact = exact(k, t);
            worst = largest([worst, integral - exact]);
            scale = scale.max(exact.abs());
        }
        history.commit(*step, &[value(t)])?;
    }
    Ok(worst / scale)
}

/// Returns the evaluated steps: eight in the last three quarters.
fn evaluated(steps: usize) -> Vec<usize> {
    (1..=8).map(|part| steps / 4 + steps * 3 * part / 32).collect()
}

/// Tests 1e5 equal steps.
pub(super) fn equal(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let count = record.effort().pick(10_000, 100_000);
    let length = 10.0;
    // Five periods.
    let w = 10.0 * std::f64::consts::PI / length;
    let steps = vec![length / count as f64; count];
    let loads: [Load<'_>; 3] = [
        ("t^1.5", &|t| t.powf(1.5), &|k, t| of_power(k, 1.5, t)),
        ("t^3", &|t| t.powi(3), &|k, t| of_power(k, 3.0, t)),
        ("sine", &|t| (w * t).sin(), &|k, t| of_sine(k, w, t)),
    ];
    let rules = FULL.into_iter().chain([exponentials(steps[0], length)]);
    for (index, (name, rule)) in rules.enumerate() {
        let second = matches!(rule, Rule::Trapezoid | Rule::Exponentials(_));
        // Order 1: half a step's change, at most the sine's slope (w h / 2), over the steps of a quick run.
        let limit = if second { 1e-6 } else { record.effort().pick(1e-2, 1e-3) };
        for load in &loads {
            let mut worst = 0.0f64;
            for k in ORDERS {
                let error = error(&rule, k, &steps, &evaluated(count), load)?;
                worst = largest([worst, error]);
            }
            record.under(format!("{name}, {}: error", load.0), worst, limit);
        }
        record.done((index + 1) as f64 / 5.0);
    }
    Ok(())
}

/// Tests 1e5 steps from 1e-6 to 1e3 s.
fn growing(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let count = record.effort().pick(40_000, 100_000);
    let steps: Vec<f64> = (0..count)
        .map(|index| 10f64.powf(9.0 * index as f64 / (count - 1) as f64 - 6.0))
        .collect();
    let length: f64 = steps.iter().sum();
    // Half a period: steps are long at the end.
    let w = std::f64::consts::PI / length;
    let loads: [Load<'_>; 3] = [
        ("t^0.5", &|t| t.sqrt(), &|k, t| of_power(k, 0.5, t)),
        ("t^2", &|t| t * t, &|k, t| of_power(k, 2.0, t)),
        ("sine", &|t| (w * t).sin(), &|k, t| of_sine(k, w, t)),
    ];
    let rules = [("trapezoid", Rule::Trapezoid), exponentials(1e-6, length)];
    for (index, (name, rule)) in rules.into_iter().enumerate() {
        for load in &loads {
            let mut worst = 0.0f64;
            for k in ORDERS {
                // Eight evaluated steps, each ten times as late as the one before, ending with the last step.
                let evaluated: Vec<usize> = (1..=8).map(|part| count - (8 - part) * count / 9).collect();
                for end in &evaluated {
                    let error = error(&rule, k, &steps[..*end], &[*end], load)?;
                    worst = largest([worst, error]);
                }
            }
            record.under(format!("{name}, {}: error", load.0), worst, 1e-6);
        }
        record.done((index + 1) as f64 / 2.0);
    }
    record.report("seconds of the history", length);
    Ok(())
}

/// Tests steps that alternate between 1e-6 and 1e3 s.
fn jumping(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let count = record.effort().pick(400, 2000);
    let turns = (0..count).map(|index| if index % 2 == 0 { 1e-6 } else { 1e3 });
    let random: Vec<f64> = (0..count as u64)
        .map(|index| 10f64.powf(4.5 * record.noise(index) - 1.5))
        .collect();
    let load: Load<'_> = ("1 + t", &|t| 1.0 + t, &|k, t| of_power(k, 0.0, t) + of_power(k, 1.0, t));
    for (name, steps) in [("in turn", turns.collect()), ("at random", random)] {
        let steps: Vec<f64> = steps;
        let length: f64 = steps.iter().sum();
        let evaluated: Vec<usize> = (1..=count).collect();
        for (rule, history) in [("trapezoid", Rule::Trapezoid), exponentials(1e-6, length * 1.01)] {
            let mut worst = 0.0f64;
            for k in ORDERS {
                let error = error(&history, k, &steps, &evaluated, &load)?;
                worst = largest([worst, error]);
            }
            record.under(format!("{name}, {rule}: error"), worst, 1e-9);
        }
    }
    Ok(())
}

/// Returns the largest magnitude of the result for values alternating between +1 and -1.
fn highest(rule: &Rule, operator: Operator, step: f64, count: usize) -> Result<f64, HistoryError> {
    let mut history = rule.start(operator, &[1.0])?;
    let mut worst = 0.0f64;
    for index in 1..=count {
        let value = if index % 2 == 0 { 1.0 } else { -1.0 };
        let mut past = [0.0];
        let magnitude = (history.predict(step, &mut past)? * value + past[0]).abs();
        worst = largest([worst, magnitude]);
        history.commit(step, &[value])?;
    }
    Ok(worst)
}

/// Tests loads that reverse at every step.
fn reversals(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let step = 1e-3;
    let many = record.effort().pick(10_000, 100_000);
    let fewer_steps = record.effort().pick(1000, 10_000);
    let rules = FULL.into_iter().chain([exponentials(step, 2.0 * step * many as f64)]);
    for (index, (name, rule)) in rules.enumerate() {
        let count = if matches!(rule, Rule::Exponentials(_)) {
            many
        } else {
            fewer_steps
        };
        let (mut integral, mut derivative) = (0.0f64, 0.0f64);
        for k in ORDERS {
            integral = largest([
                integral,
                highest(&rule, Operator::Integral(k), step, count)? / step.powf(k),
            ]);
            derivative = largest([
                derivative,
                highest(&rule, Operator::Derivative(k), step, count)? * step.powf(k),
            ]);
        }
        // The newest value has the weight h^k / Gamma(1 + k), and Gamma(1 + k) is at least 0.8856.
        record.under(format!("{name}: integral over h^k"), integral, 1.13);
        record.under(format!("{name}: derivative over h^-k"), derivative, 4.0);
        record.done((index + 1) as f64 / 5.0);
    }
    Ok(())
}

/// Tests histories that must be refused.
pub(super) fn refused(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let rules = FULL.into_iter().chain([exponentials(0.1, 1.0)]);
    for (name, rule) in rules {
        for order in [-1e-9, 1.0 + 1e-9, f64::NAN] {
            let answer = rule.start(Operator::Integral(order), &[0.0]).map(drop);
            record.refused(format!("{name}, order {order}"), answer, |e| {
                matches!(e, HistoryError::Order { .. })
            });
        }
        let mut history = rule.start(Operator::Integral(0.5), &[1.0])?;
        history.commit(0.1, &[2.0])?;
        // What the history would answer next: no refused step may leave a trace in it.
        let before = next(history.as_mut())?;
        for step in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let answer = history.commit(step, &[1.0]);
            record.refused(format!("{name}, step {step}"), answer, |e| {
                matches!(e, HistoryError::Step { .. })
            });
        }
        for value in [f64::NAN, f64::INFINITY] {
            let answer = history.commit(0.1, &[value]);
            record.refused(format!("{name}, value {value}"), answer, |e| {
                matches!(e, HistoryError::Value { .. })
            });
        }
        match rule {
            Rule::GruenwaldLetnikov => {
                let answer = history.commit(0.2, &[1.0]);
                record.refused(format!("{name}, unequal"), answer, |e| {
                    matches!(e, HistoryError::Uneven { .. })
                });
            }
            Rule::Exponentials(_) => {
                // The sum of exponentials fits the kernel from 0.1 s to 1 s only:
                // outside it would be silently wrong.
                let answer = history.commit(0.01, &[1.0]);
                record.refused(format!("{name}, short"), answer, |e| {
                    matches!(e, HistoryError::Short { .. })
                });
                let answer = history.commit(5.0, &[1.0]);
                record.refused(format!("{name}, long"), answer, |e| {
                    matches!(e, HistoryError::Long { .. })
                });
            }
            _ => {}
        }
        record.zero(
            format!("{name}: change by what was refused"),
            (next(history.as_mut())? - before).abs(),
        );
    }
    Ok(())
}

fn next(history: &mut dyn History) -> Result<f64, HistoryError> {
    let mut past = [0.0];
    Ok(history.predict(0.1, &mut past)? + past[0])
}
