//! Quadrature rules of fading memory: cost and error against the exact law, by number of steps.
//!
//! A spring-pot creeps under a stress that jumps to 1 at the start and then oscillates about it. Its strain is known in
//! closed form. Every rule follows the same stress over the same time in the requested number of steps and evaluates
//! the strain at each of them, as a simulation does; the complete run is timed. Steps are equal, or alternate between
//! two lengths (where a rule supports this).

mod report;

use std::f64::consts::TAU;
use std::time::Instant;

use super::Study;
use super::entry::{About, Backends, Context, Entry, StudyOption, all_ranged, ranged};
use crate::fractional::{of_power, of_sine};
use crate::stability::Effort;
use insonify_mechanics::tissue::viscoelastic::{HistoryError, Operator, Rule, Span};
use report::HistoryReport;

/// Options of the study.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HistoryOptions {
    /// Order of the spring-pot, 0 to 1 (default 0.1, liver).
    pub order: f64,
    /// Numbers of steps, each 10 or more (default 100 to 100,000).
    pub steps: Vec<usize>,
}

impl Default for HistoryOptions {
    fn default() -> Self {
        HistoryOptions {
            order: 0.1,
            steps: vec![100, 1000, 10_000, 100_000],
        }
    }
}

impl HistoryOptions {
    /// Returns the options for an effort: the default, or short histories.
    pub(crate) fn of(effort: Effort) -> Self {
        let usual = HistoryOptions::default();
        effort.pick(
            HistoryOptions {
                steps: vec![100, 1000],
                ..usual.clone()
            },
            usual,
        )
    }
}

/// Registration of this study.
pub(crate) const ENTRY: Entry<HistoryOptions> = Entry {
    about: About {
        name: "history",
        title: "Fading memory",
        question: "The stress of viscoelastic tissue depends on its whole history: which rule sums it fast enough and accurately enough?",
        help: "Quadrature rules for fading memory: error against the exact law, time and memory, for each rule and length of history",
        examples: "\
Examples:
  insonify tradeoff history --quick                             a first look, in a second
  insonify tradeoff history -o study                            histories of 100 to 100,000 steps, with plots
  insonify tradeoff history --order 0.5 --steps 1000,5000 --json

A row with a star is a best choice: no other is both faster and nearer to the exact law. A row that violates the
guarantee of its rule is marked WRONG.",
        backends: Backends::Cpu,
    },
    options: &[
        StudyOption::<HistoryOptions>::value(
            "order",
            "K",
            "Order k of the fractional integral, 0 to 1",
            |options, texts| {
                ranged(texts, 0.0..=1.0, "a number from 0 (a spring) to 1 (a dashpot)")
                    .map(|value| options.order = value)
            },
        )
        .shown(|options| options.order.to_string()),
        StudyOption::<HistoryOptions>::value(
            "steps",
            "N,...",
            "Steps of the histories [default: 100,1000,10000,100000; with --quick 100,1000]",
            |options, texts| {
                all_ranged(texts, 10..=1_000_000, "a number of steps from 10 to 1000000")
                    .map(|value| options.steps = value)
            },
        )
        .list(),
        StudyOption::quick("Short histories"),
    ],
    settings: HistoryOptions::of,
    in_report: HistoryOptions::of,
    run: |options, Context { progress, .. }| Ok(study(options, progress)?),
};

/// Duration of the history, s, and angular frequency of the stress, rad/s: five periods.
const LENGTH_S: f64 = 10.0;
const FREQUENCY: f64 = 5.0 * TAU / LENGTH_S;
/// Number of times at which the strain is compared.
const SAMPLES: usize = 40;
/// Relative deviation of unequal steps from their mean.
const UNEVEN: f64 = 0.3;
/// Maximum number of unequal steps for the rules that recompute all weights at each of them.
const MAX_UNEVEN: usize = 10_000;

/// Minimum total time over which a history is repeated, s.
const REPEATED_S: f64 = 0.05;

/// Step lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lengths {
    Equal,
    Unequal,
}

/// Rule with its step lengths and number of steps.
#[derive(Clone, Copy, Debug)]
struct Contender {
    name: &'static str,
    rule: Rule,
    lengths: Lengths,
    steps: usize,
}

/// Measurement of one contender.
#[derive(Clone, Copy, Debug)]
struct Measured {
    /// Largest error at the samples relative to the largest strain.
    error: f64,
    /// Total time of all steps in the fastest run, s.
    seconds: f64,
    /// Total time of all steps in the slowest run, s.
    slowest_s: f64,
    bytes: usize,
}

/// Names and tolerances of the sums of exponentials.
const EXPONENTIALS: [(&str, f64); 3] = [
    ("exponentials, 1e-4", 1e-4),
    ("exponentials, 1e-7", 1e-7),
    ("exponentials, 1e-10", 1e-10),
];
const FULL: [(&str, Rule); 4] = [
    ("rectangle", Rule::Rectangle),
    ("time-scaled trapezoid", Rule::TimeScaledTrapezoid),
    ("trapezoid", Rule::Trapezoid),
    ("Gruenwald-Letnikov", Rule::GruenwaldLetnikov),
];

/// Studies every rule. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`HistoryError`] for an order outside 0 to 1.
pub(crate) fn study(
    options: &HistoryOptions,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<Study, HistoryError> {
    let mut contenders = Vec::new();
    for &steps in &options.steps {
        for lengths in [Lengths::Equal, Lengths::Unequal] {
            let exponentials = EXPONENTIALS.map(|(name, tolerance)| (name, Rule::Exponentials(span(steps, tolerance))));
            // Gruenwald-Letnikov is defined for equal steps alone, and the full rules recompute all weights at each
            // unequal one.
            let takes = |rule: &Rule| {
                let full = !matches!(rule, Rule::Exponentials(_));
                lengths == Lengths::Equal || *rule != Rule::GruenwaldLetnikov && !(full && steps > MAX_UNEVEN)
            };
            let rules = FULL.into_iter().chain(exponentials);
            contenders.extend(rules.filter(|(_, rule)| takes(rule)).map(|(name, rule)| Contender {
                name,
                rule,
                lengths,
                steps,
            }));
        }
    }
    let samples: Vec<f64> = (1..=SAMPLES).map(|sample| sample as f64 / SAMPLES as f64).collect();
    let work: usize = contenders.iter().map(|contender| contender.steps).sum();
    let mut done = 0;
    let mut report = HistoryReport::new(options);
    for contender in contenders {
        progress(
            &format!("{} in {} steps", contender.name, contender.steps),
            done as f64 / work as f64,
        );
        let measured = contender.measure(options.order, &samples)?;
        done += contender.steps;
        report.push(contender, measured);
    }
    progress("done", 1.0);
    Ok(report.finish())
}

fn span(steps: usize, tolerance: f64) -> Span {
    Span {
        shortest_s: (1.0 - UNEVEN) * LENGTH_S / steps as f64,
        longest_s: LENGTH_S,
        tolerance,
    }
}

fn stress(t: f64) -> f64 {
    1.0 + (FREQUENCY * t).sin()
}

fn strain(order: f64, t: f64) -> f64 {
    of_power(order, 0.0, t) + of_sine(order, FREQUENCY, t)
}

impl Contender {
    /// Measures the contender; short histories are repeated and the fastest run counts.
    fn measure(&self, order: f64, samples: &[f64]) -> Result<Measured, HistoryError> {
        let mut best = self.follow(order, samples)?;
        let mut spent = best.seconds;
        while spent < REPEATED_S {
            let repeated = self.follow(order, samples)?;
            spent += repeated.seconds.max(REPEATED_S / 50.0);
            best.seconds = best.seconds.min(repeated.seconds);
            best.slowest_s = best.slowest_s.max(repeated.seconds);
        }
        Ok(best)
    }

    fn follow(&self, order: f64, samples: &[f64]) -> Result<Measured, HistoryError> {
        // Compared steps: unequal ones come in pairs, so that every second time equals that of equal steps.
        let compared: Vec<usize> = samples
            .iter()
            .map(|share| (share * self.steps as f64) as usize / 2 * 2)
            .collect();
        let mut computed = Vec::with_capacity(samples.len());
        let mut compare = compared.iter().peekable();
        let step_s = LENGTH_S / self.steps as f64;
        let started = Instant::now();
        let mut history = self.rule.start(Operator::Integral(order), &[stress(0.0)])?;
        for step in 1..=self.steps {
            let early = match self.lengths {
                Lengths::Equal => 0.0,
                Lengths::Unequal => UNEVEN,
            };
            let (length, t) = if step % 2 == 1 {
                ((1.0 - early) * step_s, (step as f64 - early) * step_s)
            } else {
                ((1.0 + early) * step_s, step as f64 * step_s)
            };
            let mut past = [0.0];
            let weight = history.predict(length, &mut past)?;
            let value = stress(t);
            if compare.next_if(|compared| **compared == step).is_some() {
                computed.push((t, weight * value + past[0]));
            }
            history.commit(length, &[value])?;
        }
        let seconds = started.elapsed().as_secs_f64();
        let (mut error, mut largest) = (0.0f64, 0.0f64);
        for (t, computed_strain) in computed {
            let exact = strain(order, t);
            error = error.max((computed_strain - exact).abs());
            largest = largest.max(exact.abs());
        }
        Ok(Measured {
            error: error / largest,
            seconds,
            slowest_s: seconds,
            bytes: history.bytes(),
        })
    }
}

#[cfg(test)]
mod tests;
