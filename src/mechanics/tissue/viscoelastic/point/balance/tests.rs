use super::*;

/// Returns numbers over many decades, of both signs.
fn many() -> Vec<f64> {
    let sizes = (-8..=4).map(|exponent| 10f64.powi(exponent));
    let mut values: Vec<f64> = sizes.flat_map(|size| [-3.0 * size, -size, size, 2.5 * size]).collect();
    values.extend([0.0, 0.35, -0.35, 0.35 + 1e-12]);
    values
}

#[test]
fn the_root_balances_within_thirty_iterations() {
    let mut max_iterations = 0;
    for stiffening in [0.0, 1e-6, 1.0, 12.5, 1e4, 1e8] {
        for strain in [0.0, 1e-9, 0.35, 2.0] {
            let knee = Knee { strain, stiffening };
            for c in many() {
                for r in many() {
                    let root = root(&knee, c, r);
                    let x = root.strain;
                    let miss = (x - c) * knee.factor(x) - r;
                    // Effect of rounding of x alone on the equation.
                    let slope = knee.factor(x) + ((x - c) * knee.slope(x)).abs();
                    let bound = 8.0 * f64::EPSILON * (x.abs().max(c.abs()) * slope + r.abs());
                    assert!(miss.abs() <= bound, "{knee:?} {c} {r}: {root:?}, {miss:e} > {bound:e}");
                    // Driven back against its past beyond the knee, there may be two more roots: bisection is then
                    // allowed.
                    let against = c * r < 0.0 && c.abs() > strain;
                    if !against {
                        max_iterations = max_iterations.max(root.iterations);
                    }
                }
            }
        }
    }
    assert!(max_iterations <= 30, "{max_iterations}");
}

#[test]
fn convergence_is_quadratic() {
    // Starting from the bound of the cube root, with everything of order 1.
    let knee = Knee {
        strain: 0.35,
        stiffening: 12.5,
    };
    let root = root(&knee, 0.2, 3.0);
    assert!(root.iterations <= 8, "{root:?}");
}

#[test]
fn structures_are_told_apart() {
    let knee = Knee {
        strain: 0.1,
        stiffening: 10.0,
    };
    let line = Line {
        slope: 0.5,
        offset: 0.2,
    };
    let rate = strain(&knee, Structure::Rate, &line, 1.0).strain;
    assert!(((rate - 0.2) * knee.factor(rate) - 0.5).abs() < 1e-15);
    let load = strain(&knee, Structure::LoadIntegral, &line, 1.0).strain;
    assert!((load * knee.factor(load) - 0.7).abs() < 1e-15);
    assert!(load < rate);
}
