use super::*;
use crate::tissue::viscoelastic::HistoryError;

const LIVER: Point = Point {
    body: Rheology::SpringPot {
        order: 0.1,
        modulus_kpa: 0.4,
    },
    knee: Knee {
        strain: 0.35,
        stiffening: 5.0,
    },
    structure: Structure::Rate,
};
const METHODS: [Method; 5] = [
    Method::Rectangle,
    Method::TimeScaledTrapezoid,
    Method::Trapezoid,
    Method::GruenwaldLetnikov,
    Method::Exponentials,
];

fn zener(order: f64) -> Rheology {
    Rheology::Zener {
        order,
        modulus_kpa: 3.0,
        modulus_inf_kpa: 1.0,
        tau_s: 2.0,
    }
}

fn loading(control: Control, time_s: &[f64], value: &[f64]) -> Loading {
    Loading {
        control,
        time_s: time_s.to_vec(),
        value: value.to_vec(),
    }
}

/// A loading of one time has no span for a sum of exponentials.
#[test]
fn a_single_time_is_the_response_of_that_moment() {
    let at_once = loading(Control::Strain, &[0.0], &[0.2]);
    for method in METHODS {
        let response = LIVER.respond(&at_once, method).expect("a response");
        assert!(response.strain.iter().all(|strain| *strain == 0.2), "{method:?}");
    }
}

#[test]
fn numbers_are_checked() {
    let wrong = |point: Point, wanted: &str| {
        let response = point.respond(&loading(Control::Stress, &[0.0], &[1.0]), Method::Trapezoid);
        assert!(
            matches!(response, Err(HistoryError::Number(error)) if error.key == wanted),
            "{wanted}"
        );
    };
    for order in [-0.1, 1.01, f64::NAN] {
        wrong(
            Point {
                body: zener(order),
                ..LIVER
            },
            "order",
        );
    }
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let body = |modulus_kpa, tau_s| Rheology::Zener {
            order: 0.5,
            modulus_kpa,
            modulus_inf_kpa: 0.0,
            tau_s,
        };
        wrong(
            Point {
                body: body(value, 1.0),
                ..LIVER
            },
            "modulus_kpa",
        );
        wrong(
            Point {
                body: body(1.0, value),
                ..LIVER
            },
            "tau_s",
        );
    }
    let knee = |strain, stiffening| Point {
        knee: Knee { strain, stiffening },
        ..LIVER
    };
    wrong(knee(-0.1, 1.0), "knee_strain");
    wrong(knee(f64::NAN, 1.0), "knee_strain");
    wrong(knee(0.1, -1.0), "stiffening");
    wrong(knee(0.1, f64::INFINITY), "stiffening");
}

#[test]
fn histories_are_checked() {
    let error_of = |times: &[f64], values: &[f64], method| {
        LIVER
            .respond(&loading(Control::Stress, times, values), method)
            .unwrap_err()
    };
    let wrong = |times: &[f64], values: &[f64], wanted: &str, index: Option<usize>| {
        let error = error_of(times, values, Method::Trapezoid);
        let key = index.map_or(wanted.to_owned(), |index| format!("{wanted}[{index}]"));
        assert!(
            matches!(&error, HistoryError::Number(error) if error.key == key),
            "{error:?}"
        );
    };
    wrong(&[0.0, 0.0], &[1.0; 2], "time_s", Some(1));
    wrong(&[0.0, 2.0, 1.0], &[1.0; 3], "time_s", Some(2));
    wrong(&[f64::NAN], &[1.0], "time_s", Some(0));
    wrong(&[0.0, 1.0], &[1.0, f64::INFINITY], "value", Some(1));
    wrong(&[-1.7e308, 1.7e308], &[1.0; 2], "time_s", None);
    assert!(matches!(
        error_of(&[], &[], Method::Trapezoid),
        HistoryError::Lengths { .. }
    ));
    assert!(matches!(
        error_of(&[0.0], &[], Method::Trapezoid),
        HistoryError::Lengths { .. }
    ));
    let uneven = error_of(&[0.0, 1.0, 3.0], &[1.0; 3], Method::GruenwaldLetnikov);
    assert!(uneven.to_string().contains("equally far apart"), "{uneven}");
    let stiff = Point {
        body: Rheology::SpringPot {
            order: 0.1,
            modulus_kpa: 1e308,
        },
        ..LIVER
    };
    let huge = stiff.respond(&loading(Control::Strain, &[0.0, 1.0], &[0.0, 1e10]), Method::Trapezoid);
    assert!(matches!(huge, Err(HistoryError::Overflow { .. })), "{huge:?}");
    // Overflow at the start, where only a spring-pot may have infinite stress.
    let body = zener(0.5);
    for structure in [Structure::Rate, Structure::LoadIntegral] {
        let point = Point {
            body,
            structure,
            ..LIVER
        };
        let huge = point.respond(&loading(Control::Strain, &[0.0, 1.0], &[1e300, 0.0]), Method::Trapezoid);
        assert!(matches!(huge, Err(HistoryError::Overflow { .. })), "{huge:?}");
    }
}

#[test]
fn the_start_is_elastic() {
    for method in METHODS {
        let jump = |body, control| {
            let point = Point {
                body,
                knee: Knee::INFINITE,
                structure: Structure::Rate,
            };
            let response = point
                .respond(&loading(control, &[5.0, 6.0], &[2.0, 2.0]), method)
                .unwrap();
            (response.strain[0], response.stress_kpa[0])
        };
        let pot = |order| Rheology::SpringPot {
            order,
            modulus_kpa: 4.0,
        };
        assert_eq!(jump(pot(0.5), Control::Stress), (0.0, Some(2.0)));
        assert_eq!(jump(pot(0.5), Control::Strain), (2.0, None));
        assert_eq!(jump(pot(0.0), Control::Strain), (2.0, Some(8.0)));
        assert_eq!(jump(zener(0.5), Control::Strain), (2.0, Some(8.0)));
        assert_eq!(jump(zener(0.5), Control::Stress), (0.5, Some(2.0)));
        // A spring-pot of order 0 is a spring: the branch is half as stiff.
        assert_eq!(jump(zener(0.0), Control::Strain), (2.0, Some(5.0)));
    }
}

#[test]
fn stress_and_strain_lead_back_to_each_other() {
    let times: Vec<f64> = (0..=20).map(|step| 0.1 * step as f64).collect();
    let stress: Vec<f64> = times.iter().map(|t| 1.5 * (2.0 * t).sin()).collect();
    for body in [
        zener(0.4),
        Rheology::SpringPot {
            order: 0.4,
            modulus_kpa: 2.0,
        },
    ] {
        for structure in [Structure::Rate, Structure::LoadIntegral] {
            let point = Point {
                body,
                structure,
                knee: LIVER.knee,
            };
            for method in METHODS {
                let strain = point
                    .respond_in(&loading(Control::Stress, &times, &stress), method, 32)
                    .unwrap();
                let back = point
                    .respond_in(&loading(Control::Strain, &times, &strain.strain), method, 32)
                    .unwrap();
                let difference = back.stress_kpa.iter().zip(&stress).map(|(a, b)| (a.unwrap() - b).abs());
                // The strain is not linear between the times, as the reverse computation assumes.
                let worst = difference.fold(0.0, f64::max);
                assert!(worst < 0.05, "{body:?} {structure:?} {method:?}: {worst}");
                assert!(strain.iterations <= 30);
            }
        }
    }
}

#[test]
fn opposite_loads_have_opposite_responses() {
    let times = [0.0, 0.3, 1.0, 1.2];
    let values = [0.5, 2.0, -1.0, 0.7];
    let opposite = values.map(|value: f64| -value);
    for structure in [Structure::Rate, Structure::LoadIntegral] {
        let point = Point { structure, ..LIVER };
        for control in [Control::Stress, Control::Strain] {
            let response = point
                .respond_in(&loading(control, &times, &values), Method::Trapezoid, 16)
                .unwrap();
            let mirrored = point
                .respond_in(&loading(control, &times, &opposite), Method::Trapezoid, 16)
                .unwrap();
            assert!(response.strain.iter().zip(&mirrored.strain).all(|(a, b)| *a == -b));
        }
    }
}

#[test]
fn the_two_structures_part_beyond_the_knee_only() {
    let times: Vec<f64> = (0..=10).map(|step| step as f64).collect();
    let response = |structure, stress: f64| {
        let point = Point { structure, ..LIVER };
        let loading = loading(Control::Stress, &times, &vec![stress; times.len()]);
        *point
            .respond(&loading, Method::Exponentials)
            .unwrap()
            .strain
            .last()
            .unwrap()
    };
    let low = [Structure::Rate, Structure::LoadIntegral].map(|structure| response(structure, 0.05));
    assert!((low[0] - low[1]).abs() < 1e-12);
    // Under the load integral, the current stiffness also acts on past loads.
    let high = [Structure::Rate, Structure::LoadIntegral].map(|structure| response(structure, 0.5));
    assert!(high[1] < high[0] - 1e-3, "{high:?}");
}
