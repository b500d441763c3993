//! A linear foundation has a closed form (M. Hetenyi, "Beams on Elastic Foundation"): within it the deflection is a sum
//! of `exp(-b y) cos(b y)` and `exp(-b y) sin(b y)` from either end, with `4 b^4 = k/EI`; before it a cubic.

use nalgebra::{SMatrix, SVector};

use insonify_mechanics::needle::beam::material::NeoHookean;
use insonify_mechanics::needle::beam::{Compression, Material, Problem};

use super::case::{PSM, base, distance, layer, problem, solve};

/// Tissue that no needle compresses noticeably: its modulus is 3 mu throughout.
fn linear(control_mm: f64, depth_mm: f64, mu_kpa: f64) -> Problem {
    let mut layer = layer(
        (Material::NeoHookean(NeoHookean { mu_kpa }), Compression::UTru),
        depth_mm,
    );
    layer.initial_length_mm = f64::INFINITY;
    problem(control_mm, vec![layer])
}

/// The closed form for a base displacement (mm) and slope.
fn exact(problem: &Problem, mu_kpa: f64, displacement: f64, slope: f64) -> impl Fn(f64) -> f64 + use<> {
    let (s, l) = (problem.control_distance_mm, problem.inserted_mm);
    let b = (3e-3 * mu_kpa / (4.0 * problem.bending_nmm2)).powf(0.25);
    // The n-th derivatives by y of the two functions, of the second as the derivative of the first: each derivative
    // turns the phase by 3/4 of pi and multiplies by sqrt(2) b.
    let wave = move |y: f64, n: usize| {
        let size = (2.0f64.sqrt() * b).powi(n as i32) * (-b * y).exp();
        let phase = b * y + 0.75 * std::f64::consts::PI * n as f64;
        [size * phase.cos(), size * phase.sin()]
    };
    // Unknown: curvature and its change of the cubic, two waves from the entry, two from the tip.
    let inside = move |x: f64, n: usize| {
        let ([a, b], [c, d]) = (wave(x, n), wave(l - x, n));
        let sign = if n.is_multiple_of(2) { 1.0 } else { -1.0 };
        [a, b, sign * c, sign * d]
    };
    let before = [[s * s, s.powi(3)], [2.0 * s, 3.0 * s * s], [2.0, 6.0 * s], [0.0, 6.0]];
    let known = [displacement + slope * s, slope, 0.0, 0.0];
    let (mut matrix, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for n in 0..4 {
        let here = inside(0.0, n);
        for j in 0..4 {
            matrix[(n, 2 + j)] = here[j];
        }
        for j in 0..2 {
            matrix[(n, j)] = -before[n][j];
        }
        right[n] = known[n];
    }
    for n in 2..4 {
        let tip = inside(l, n);
        (0..4).for_each(|j| matrix[(n + 2, 2 + j)] = tip[j]);
    }
    let c = matrix.lu().solve(&right).expect("a closed form");
    move |x| {
        let y = x + s;
        if x < 0.0 {
            displacement + slope * y + c[0] * y * y + c[1] * y.powi(3)
        } else {
            inside(x, 0).iter().enumerate().map(|(j, wave)| wave * c[2 + j]).sum()
        }
    }
}

#[test]
fn a_linear_foundation_bends_the_needle_as_the_closed_form() {
    for (control, depth, mu) in [
        (20.0, 60.0, 12.72),
        (0.0, 40.0, 3.63),
        (40.0, 20.0, 500.0),
        (5.0, 100.0, 1e-6),
    ] {
        let needle = linear(control, depth, mu);
        for (displacement, slope) in [(15.0, -0.4), (2.0, 0.0), (0.0, 0.3), (-4.0, 0.1)] {
            let shape = solve(&needle, &base(displacement, slope));
            let exact = exact(&needle, mu, displacement, slope);
            // Hermite cubics are right at their nodes to (b h)^4/720 of the deflection: b h is 0.08 of the stiffest
            // here.
            let bound = 1e-6 * (displacement.abs() + slope.abs() * (control + depth));
            assert!(
                distance(&shape, &exact) < bound,
                "{control} {depth} {mu}: {}",
                distance(&shape, &exact)
            );
            assert!(shape.residual < 1e-10, "{}", shape.residual);
        }
    }
}

/// The order of Hermite cubics is four, at the nodes and between them.
#[test]
fn the_error_falls_with_the_fourth_power_of_the_length_of_elements() {
    // b h is 0.35 of the longest elements.
    let mu = 500.0;
    let mut needle = linear(0.0, 64.0, mu);
    let exact = exact(&needle, mu, 10.0, -0.2);
    let errors = [4.0, 2.0, 1.0, 0.5].map(|element_mm| {
        needle.element_mm = element_mm;
        let shape = solve(&needle, &base(10.0, -0.2));
        let between = (0..=640).map(|at| 0.1 * f64::from(at));
        let between = between.map(|x| (shape.at(x)[0] - exact(x)).abs()).fold(0.0, f64::max);
        [distance(&shape, &exact), between]
    });
    for (coarse, fine) in errors.iter().zip(&errors[1..]) {
        for kind in 0..2 {
            let order = (coarse[kind] / fine[kind]).log2();
            assert!((order - 4.0).abs() < 0.15, "{order}: {errors:?}");
        }
    }
}

/// Elements of a thousandth of the needle's length: rounding does not show, as it would with deflections as unknowns,
/// whose condition grows with the fourth power of the number of elements.
#[test]
fn short_elements_are_as_exact_as_long_ones() {
    let (mu, mut needle) = (3.63, linear(40.0, 60.0, 3.63));
    let exact = exact(&needle, mu, 15.0, -0.2);
    needle.element_mm = 0.1;
    let shape = solve(&needle, &base(15.0, -0.2));
    assert_eq!(shape.points.len(), 1001);
    // 1000 roundings of 15 mm, 1e-16 each, one upon the other.
    assert!(distance(&shape, &exact) < 1e-11, "{:e}", distance(&shape, &exact));
}

#[test]
fn without_foundation_the_needle_stays_straight() {
    let bare = linear(20.0, 60.0, 0.0);
    let mut out = linear(20.0, 60.0, 5.0);
    out.inserted_mm = 0.0;
    for needle in [bare, out] {
        let shape = solve(&needle, &base(15.0, -0.4));
        assert!(distance(&shape, |x| 15.0 - 0.4 * (x + 20.0)) < 1e-13);
        assert!(shape.points.iter().all(|point| point.reaction_n_per_mm == 0.0));
        assert_eq!((shape.residual, shape.base_force_n), (0.0, 0.0));
    }
}

/// The needle cannot tell left from right.
#[test]
fn a_mirrored_motion_gives_a_mirrored_needle() {
    let mut layers = vec![layer(PSM, 30.0), layer(super::case::PVC, 30.0)];
    layers[0].friction = 0.4;
    layers[1].initial_length_mm = 22.0;
    let needle = problem(20.0, layers);
    let [one, other] = [1.0, -1.0].map(|sign| solve(&needle, &base(sign * 15.0, sign * -0.2)));
    for (a, b) in one.points.iter().zip(&other.points) {
        assert_eq!(
            [a.u_mm, a.slope, a.reaction_n_per_mm],
            [-b.u_mm, -b.slope, -b.reaction_n_per_mm]
        );
    }
    assert_eq!((one.com_mm(), one.rcm_mm()), (other.com_mm(), other.rcm_mm()));
}
