//! Patch tests above the knee: where the boundary is strained uniformly, so is all of an irregular mesh, with the
//! stress of the law. In floating point to the tolerance of the balance times the condition of the tangent.

use insonify_mechanics::tissue::nonlinear::{NonlinearBody, Scheme, relative_strain};
use std::sync::Arc;

use super::case::{Held, block, difference, held, largest, law, options, sheet, target};

/// Condition of these small meshes: under 1e4 at Poisson's ratios up to 0.45, and growing as 1 / (1 - 2 nu).
const CONDITION: f64 = 1e4;

/// Strains the boundary of the box `extent` by `slope` in steps and checks all nodes and the stress.
fn check<const D: usize, const N: usize>(
    body: &Arc<NonlinearBody<D, N>>,
    extent: [f64; D],
    slope: [[f64; D]; D],
    poisson: f64,
    scheme: Scheme,
) {
    let displaced = |p: &[f64; D]| -> [f64; D] { std::array::from_fn(|i| (0..D).map(|j| slope[i][j] * p[j]).sum()) };
    let outside = |p: &[f64; D]| (0..D).any(|axis| p[axis] < 1e-9 || p[axis] > extent[axis] - 1e-9);
    let mut driven = Held::new();
    for (node, p) in (0..).zip(body.nodes()).filter(|(_, p)| outside(p)) {
        driven.extend((0..D as u8).map(|axis| (node, axis, displaced(p)[axis as usize])));
    }
    let inner = D * body.nodes().len() - driven.len();
    assert!(inner >= 8, "{inner} free displacements");
    let (mut solver, prescribed) = held(body, &driven, options(scheme));
    let loads = vec![0.0; solver.supports().all()];
    solver.step(&target(&loads, &prescribed)).unwrap();
    let expected: Vec<f64> = body.nodes().iter().flat_map(displaced).collect();
    let allowed = 1e-12 * CONDITION / (1.0 - 2.0 * poisson);
    let off = difference(solver.displacement(), &expected) / largest(&expected);
    assert!(off < allowed, "{off:e} in {D} dimensions");
    let strain: [[f64; D]; D] = std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (slope[i][j] + slope[j][i])));
    let relative = relative_strain(&strain).0;
    assert!(
        relative > 0.12,
        "a relative strain of {relative} is hardly above the knee"
    );
    let spread = body
        .relative_strains(solver.displacement())
        .iter()
        .fold(0.0, |a: f64, e| a.max((e - relative).abs()));
    assert!(spread < 10.0 * allowed, "{spread:e}");
    // The work of the boundary, sum of forces times displacements, is stress times strain times volume.
    let law = law(poisson);
    let [lambda, mu] = law.material().lame_kpa().map(|kpa| 1e-3 * kpa * law.secant(relative));
    let trace: f64 = (0..D).map(|i| strain[i][i]).sum();
    let product: f64 = strain.iter().flatten().map(|x| x * x).sum();
    let volume = extent.iter().product::<f64>() * if D == 2 { 2.0 } else { 1.0 };
    let work: f64 = solver.forces().iter().zip(&expected).map(|(f, u)| f * u).sum();
    let expected = volume * (lambda * trace * trace + 2.0 * mu * product);
    assert!(
        (work / expected - 1.0).abs() < 10.0 * allowed,
        "{work} instead of {expected}"
    );
}

#[test]
fn triangles_pass() {
    for poisson in [0.0, 0.45, 0.499] {
        let body = sheet([5, 4], 2.0, 0.25, 2.0, law(poisson));
        for scheme in [Scheme::Newton, Scheme::MODIFIED] {
            check(&body, [10.0, 8.0], [[0.15, 0.12], [-0.03, -0.14]], poisson, scheme);
        }
    }
}

#[test]
fn tetrahedra_pass() {
    for poisson in [0.0, 0.45, 0.499] {
        let body = block([4, 3, 3], 2.0, 0.2, law(poisson));
        let slope = [[0.12, 0.1, -0.05], [0.02, -0.1, 0.04], [0.03, 0.06, -0.021]];
        for scheme in [Scheme::Newton, Scheme::MODIFIED] {
            check(&body, [8.0, 6.0, 6.0], slope, poisson, scheme);
        }
    }
}
