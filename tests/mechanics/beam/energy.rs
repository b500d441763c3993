//! What the hand does is what bends the needle and compresses the tissue.

use insonify_mechanics::needle::beam::material::Law;
use insonify_mechanics::needle::beam::{BeamLayer, FoundationBeam, Problem, Shape};

use super::case::{PSM, PVC, base, free, layer, problem, solve};

fn needle() -> Problem {
    let layers = [(PSM, 15.0), (PVC, 10.0), (PSM, 25.0)];
    let mut layers = layers.map(|(tissue, thickness)| layer(tissue, thickness));
    layers.iter_mut().for_each(|layer| layer.initial_length_mm = 25.0);
    problem(20.0, layers.to_vec())
}

/// Simpson's rule.
fn simpson(low: f64, high: f64, pieces: usize, of: impl Fn(f64) -> f64) -> f64 {
    let h = (high - low) / (2 * pieces) as f64;
    let weight = |at: usize| match at {
        _ if at == 0 || at == 2 * pieces => 1.0,
        _ if at % 2 == 1 => 4.0,
        _ => 2.0,
    };
    (0..=2 * pieces)
        .map(|at| weight(at) * of(low + at as f64 * h))
        .sum::<f64>()
        * h
        / 3.0
}

/// Energy per length (N) of tissue beside a deflection: the integral of k(u) u.
fn compressed(layer: &BeamLayer, u: f64) -> f64 {
    let law = Law::new(&layer.material, layer.compression);
    let force = |v: f64| 1e-3 * law.at(1.0 - v / layer.initial_length_mm).tangent_kpa * v;
    simpson(0.0, u.abs(), 40, force)
}

/// Energy of needle and tissue, N mm.
fn stored(problem: &Problem, shape: &Shape) -> f64 {
    let mut depth = 0.0;
    let layers = problem.layers.iter().map(|layer| {
        let from = depth;
        depth += layer.thickness_mm;
        simpson(from, depth, 4 * layer.thickness_mm as usize, |x| {
            compressed(layer, shape.at(x)[0])
        })
    });
    shape.bending_energy_nmm + layers.sum::<f64>()
}

#[test]
fn work_of_the_hand_is_stored() {
    let problem = needle();
    let mut beam = FoundationBeam::new(&problem).expect("a problem");
    let (displacement, slope) = (15.0, -0.25);
    let mut power = |share: f64| {
        let shape = beam.solve(&base(share * displacement, share * slope)).expect("a shape");
        shape.base_force_n * displacement + shape.base_moment_nmm * slope
    };
    let powers: Vec<f64> = (0..=80).map(|at| power(f64::from(at) / 80.0)).collect();
    let work = simpson(0.0, 80.0, 40, |at| powers[at as usize]) / 80.0;
    let stored = stored(&problem, &solve(&problem, &base(displacement, slope)));
    // The path is smooth but where points of the needle pass 0: Simpson's rule is then of third order, 1e-6.
    assert!((work - stored).abs() < 1e-6 * stored, "{work} {stored}");
}

/// Force and moment at the base balance the reaction of the tissue.
#[test]
fn the_base_holds_what_tissue_pushes() {
    let layers = vec![layer(PVC, 50.0)];
    let problem = problem(20.0, layers);
    let shape = solve(&problem, &base(8.0, -0.1));
    let law = Law::new(&PVC.0, PVC.1);
    let reaction = |x: f64| {
        let u = shape.at(x)[0];
        1e-3 * law.at(1.0 - u.abs() / 50.0).tangent_kpa * u
    };
    let force = simpson(0.0, 50.0, 500, reaction);
    let moment = simpson(0.0, 50.0, 500, |x| reaction(x) * (x + 20.0));
    // Simpson's rule over pieces of 0.1 mm, where the reaction bends at u = 0.
    assert!(
        (force - shape.base_force_n).abs() < 1e-6 * force.abs(),
        "{force} {}",
        shape.base_force_n
    );
    assert!(
        (moment - shape.base_moment_nmm).abs() < 1e-6 * moment.abs(),
        "{moment} {}",
        shape.base_moment_nmm
    );
    for point in shape.points.iter().filter(|point| point.x_mm >= 0.0) {
        let expected = reaction(point.x_mm);
        assert!((point.reaction_n_per_mm - expected).abs() < 1e-12, "{point:?}");
    }
}

/// A base that turns freely takes the slope of least energy, without moment.
#[test]
fn a_free_base_takes_the_slope_of_least_energy() {
    let problem = needle();
    let natural = solve(&problem, &free(12.0));
    let slope = natural.points[0].slope;
    let scale = natural.base_force_n.abs() * 20.0;
    assert!(
        natural.base_moment_nmm.abs() < 1e-9 * scale,
        "{}",
        natural.base_moment_nmm
    );
    let held = solve(&problem, &base(12.0, slope));
    assert!((held.tip_mm() - natural.tip_mm()).abs() < 1e-9);
    let least = stored(&problem, &natural);
    for by in [-1e-2, 1e-2] {
        let other = stored(&problem, &solve(&problem, &base(12.0, slope + by)));
        assert!(other > least * (1.0 + 1e-5), "{other} {least}");
    }
}
