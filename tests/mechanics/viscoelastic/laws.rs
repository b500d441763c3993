//! Creep and relaxation of bodies, from a jump at the start and from ramps.

use insonify_mechanics::tissue::viscoelastic::point::{Control, Knee, Loading, Method, Point, Rheology, Structure};
use libm::tgamma;

use super::mittag_leffler::mittag_leffler;

const ORDERS: [f64; 6] = [0.0, 1e-3, 0.1, 0.5, 0.999, 1.0];
const METHODS: [Method; 4] = [
    Method::Rectangle,
    Method::Trapezoid,
    Method::GruenwaldLetnikov,
    Method::Exponentials,
];

/// Times from 0 on: equally spaced, or in each decade from 1e-3 to 1e3 s.
fn times(method: Method) -> Vec<f64> {
    match method {
        Method::GruenwaldLetnikov => (0..=10).map(|at| 0.3 * f64::from(at)).collect(),
        _ => [0.0]
            .into_iter()
            .chain((-6..=6).map(|at| 10f64.powf(0.5 * f64::from(at))))
            .collect(),
    }
}

fn linear(body: Rheology) -> Point {
    Point {
        body,
        knee: Knee::INFINITE,
        structure: Structure::Rate,
    }
}

fn held(control: Control, value: f64, time_s: Vec<f64>) -> Loading {
    Loading {
        control,
        value: vec![value; time_s.len()],
        time_s,
    }
}

fn zener(order: f64) -> Rheology {
    Rheology::Zener {
        order,
        modulus_kpa: 3.0,
        modulus_inf_kpa: 1.0,
        tau_s: 0.7,
    }
}

#[test]
fn a_spring_pot_creeps_and_relaxes_as_a_power_of_time() {
    for order in ORDERS {
        let point = linear(Rheology::SpringPot {
            order,
            modulus_kpa: 4.0,
        });
        for method in METHODS {
            let creep = held(Control::Stress, 2.0, times(method));
            let relaxation = held(Control::Strain, 2.0, times(method));
            let strain = point.respond(&creep, method).unwrap().strain;
            let stress = point.respond(&relaxation, method).unwrap().stress_kpa;
            for (at, t) in times(method).into_iter().enumerate().skip(1) {
                let exact = 0.5 * t.powf(order) / tgamma(1.0 + order);
                assert!(
                    (strain[at] / exact - 1.0).abs() < 1e-9,
                    "{order} {method:?} {t}: {}",
                    strain[at]
                );
                let exact = if order == 1.0 {
                    0.0
                } else {
                    8.0 * t.powf(-order) / tgamma(1.0 - order)
                };
                let found = stress[at].unwrap();
                assert!(
                    (found - exact).abs() <= 1e-8 * exact,
                    "{order} {method:?} {t}: {found} {exact}"
                );
            }
        }
    }
}

#[test]
fn a_zener_body_relaxes_and_creeps_as_mittag_leffler_has_it() {
    for order in [0.1, 0.5, 0.9, 1.0] {
        let point = linear(zener(order));
        for method in METHODS {
            // Order 2 settles to 1e-7 where its cost allows; order 1 does not in as many steps.
            let bound = match method {
                Method::Rectangle | Method::TimeScaledTrapezoid | Method::GruenwaldLetnikov => 2e-3,
                Method::Trapezoid => 1e-5,
                Method::Exponentials => 3e-7,
            };
            let relaxation = held(Control::Strain, 0.2, times(method));
            let creep = held(Control::Stress, 0.2, times(method));
            let stress = point.respond(&relaxation, method).unwrap().stress_kpa;
            let strain = point.respond(&creep, method).unwrap().strain;
            for (at, t) in times(method).into_iter().enumerate() {
                let power = (t / 0.7).powf(order);
                let exact = 0.2 * (1.0 + 3.0 * mittag_leffler(order, power));
                let found = stress[at].unwrap();
                assert!(
                    (found / exact - 1.0).abs() < bound,
                    "{order} {method:?} {t}: {found} {exact}"
                );
                // From the transform of 1 / (1 + 3 z / (1 + z)), z = (s tau)^k.
                let exact = 0.2 * (0.25 + 0.75 * (1.0 - mittag_leffler(order, 0.25 * power)));
                assert!(
                    (strain[at] / exact - 1.0).abs() < bound,
                    "{order} {method:?} {t}: {}",
                    strain[at]
                );
            }
        }
    }
}

#[test]
fn a_zener_body_of_order_0_is_a_spring() {
    // E_0(-1) = 1/2: the branch is two springs of 3 kPa in series.
    for method in METHODS {
        let point = linear(zener(0.0));
        let response = point
            .respond(&held(Control::Strain, 0.2, times(method)), method)
            .unwrap();
        assert!(
            response
                .stress_kpa
                .iter()
                .all(|stress| (stress.unwrap() - 0.5).abs() < 1e-14)
        );
    }
}

#[test]
fn ramps_are_exact_where_a_rule_is_linear_between_times() {
    for order in [0.1, 0.5, 0.9] {
        let point = linear(Rheology::SpringPot {
            order,
            modulus_kpa: 4.0,
        });
        // Up to 1 at 2 s, down to -1 at 5 s: two ramps, the second starting at 2 s.
        let loading = |control| Loading {
            control,
            time_s: vec![0.0, 2.0, 5.0],
            value: vec![0.0, 1.0, -1.0],
        };
        let ramps = |exponent: f64| {
            let ramp = |t: f64| t.powf(exponent) / tgamma(1.0 + exponent);
            [0.5 * ramp(2.0), 0.5 * ramp(5.0) - (0.5 + 2.0 / 3.0) * ramp(3.0)]
        };
        for method in [Method::Trapezoid, Method::Exponentials] {
            let strain = point.respond_in(&loading(Control::Stress), method, 1).unwrap().strain;
            let stress = point
                .respond_in(&loading(Control::Strain), method, 1)
                .unwrap()
                .stress_kpa;
            for (at, exact) in ramps(1.0 + order).into_iter().enumerate() {
                assert!((strain[at + 1] - exact / 4.0).abs() < 1e-9, "{order} {method:?}");
            }
            for (at, exact) in ramps(1.0 - order).into_iter().enumerate() {
                assert!(
                    (stress[at + 1].unwrap() - exact * 4.0).abs() < 1e-8,
                    "{order} {method:?}"
                );
            }
        }
    }
}

#[test]
fn the_limits_of_the_order_are_a_spring_and_a_dashpot() {
    let time_s: Vec<f64> = (0..=20).map(|at| 0.1 * f64::from(at)).collect();
    let value: Vec<f64> = time_s.iter().map(|t| (3.0 * t).sin()).collect();
    let loading = Loading {
        control: Control::Stress,
        time_s,
        value,
    };
    for method in METHODS {
        let strain = |order| {
            let point = linear(Rheology::SpringPot {
                order,
                modulus_kpa: 4.0,
            });
            point.respond_in(&loading, method, 8).unwrap().strain
        };
        for (limit, near) in [(0.0, 1e-6), (1.0, 1.0 - 1e-6)] {
            let (limit, near) = (strain(limit), strain(near));
            let difference = limit.iter().zip(&near).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            // Continuous in the order: the difference is of its size.
            assert!(difference < 1e-5 && difference > 0.0, "{method:?}: {difference}");
        }
        let elastic = strain(0.0);
        assert!(
            elastic
                .iter()
                .zip(&loading.value)
                .all(|(a, b)| (a - b / 4.0).abs() < 1e-12)
        );
    }
}

#[test]
fn dynamic_moduli_are_those_of_the_law() {
    // G* = G (i w)^k.
    let pot = Rheology::SpringPot {
        order: 0.5,
        modulus_kpa: 2.0,
    };
    let [storage, loss] = pot.dynamic_kpa(4.0);
    let both = 2.0 * 2.0 / 2f64.sqrt();
    assert!((storage - both).abs() < 1e-14 && (loss - both).abs() < 1e-14);
    // Order 1: G_inf + G w^2 tau^2 / (1 + w^2 tau^2), and G w tau / (1 + w^2 tau^2).
    let [storage, loss] = zener(1.0).dynamic_kpa(2.0 / 0.7);
    assert!((storage - 1.0 - 3.0 * 0.8).abs() < 1e-14 && (loss - 3.0 * 0.4).abs() < 1e-14);
}
