//! The knee in other measures of strain, its slope, and the two structures of stiffening tissue.

use insonify_mechanics::tissue::viscoelastic::point::{Control, Knee, Loading, Method, Point, Rheology, Structure};

const LIVER: Rheology = Rheology::SpringPot {
    order: 0.1,
    modulus_kpa: 0.4,
};

/// e_r = sqrt(((e1-e2)^2 + (e2-e3)^2 + (e3-e1)^2) / 2) of principal strains (Kobayashi et al. 2010, equation 6).
fn relative([a, b, c]: [f64; 3]) -> f64 {
    (((a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2)) / 2.0).sqrt()
}

#[test]
fn a_knee_in_shear_is_one_in_relative_strain() {
    let shear = Knee {
        strain: 0.35,
        stiffening: 6.0,
    };
    let share = 3f64.sqrt() / 2.0;
    let other = Knee {
        strain: share * 0.35,
        stiffening: 8.0,
    };
    for gamma in [0.0, 0.2, 0.35, 0.4, 1.0] {
        // The principal strains of simple shear are +-gamma / 2.
        let e = relative([0.5 * gamma, -0.5 * gamma, 0.0]);
        assert!((e - share * gamma).abs() < 1e-15);
        assert!((shear.factor(gamma) / other.factor(e) - 1.0).abs() < 1e-14);
    }
    assert!((share * 0.35 - 0.303).abs() < 2e-4);
}

#[test]
fn the_slope_of_the_knee_is_its_derivative() {
    let knee = Knee {
        strain: 0.35,
        stiffening: 6.0,
    };
    for gamma in [-1.0, -0.4, -0.2, 0.0, 0.2, 0.5, 3.0] {
        let h = 1e-6;
        let quotient = (knee.factor(gamma + h) - knee.factor(gamma - h)) / (2.0 * h);
        // The function is quadratic: what is left is rounding.
        assert!((knee.slope(gamma) - quotient).abs() < 1e-7);
    }
}

#[test]
fn the_two_structures_differ_by_when_stiffness_counts() {
    // A load held from the start: under the load integral, G(strain) strain is the integral of it, exactly.
    let knee = Knee {
        strain: 0.35,
        stiffening: 8.0,
    };
    let loading = Loading {
        control: Control::Stress,
        time_s: vec![0.0, 1.0, 10.0, 100.0],
        value: vec![0.25; 4],
    };
    let strain = |structure, knee| {
        let point = Point {
            body: LIVER,
            knee,
            structure,
        };
        point.respond(&loading, Method::Exponentials).unwrap().strain
    };
    let linear = strain(Structure::Rate, Knee::INFINITE);
    let load = strain(Structure::LoadIntegral, knee);
    let rate = strain(Structure::Rate, knee);
    for at in 1..4 {
        assert!((load[at] * knee.factor(load[at]) / linear[at] - 1.0).abs() < 1e-12);
        assert!(
            rate[at] > load[at] * 1.0005 && rate[at] < load[at] * 1.02,
            "{} {}",
            rate[at],
            load[at]
        );
    }
}
