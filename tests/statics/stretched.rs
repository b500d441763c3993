//! Stretched blocks against closed forms.

use insonify_mechanics::tissue::material::Materials;

use super::case::{Case, material, reaction, shaken, with_regions};

const EXTENT: [f64; 3] = [8.0, 6.0, 12.0];
const PULL_MM: f64 = 0.6;

/// A block that slides on the planes x = 0, y = 0 and z = 0, its top pulled up: the stress is E e along z everywhere,
/// and the sides draw in by nu e.
#[test]
fn a_stretched_block_draws_in() {
    for poisson in [0.45, 0.0, -0.3, 0.499] {
        let mut case = Case::new(shaken([4, 3, 5], EXTENT, 0.15, 1), material(7.0, poisson));
        for axis in 0..3u8 {
            case.fix(&[axis], |p| p[axis as usize] == 0.0, |_| [0.0; 3]);
        }
        case.fix(&[2], |p| p[2] == EXTENT[2], |_| [0.0, 0.0, PULL_MM]);
        let solution = case.solve();
        let strain = PULL_MM / EXTENT[2];
        case.check(&solution.displacement_mm, |p| {
            [-poisson * strain * p[0], -poisson * strain * p[1], strain * p[2]]
        });
        let force = reaction(&case, &solution, 2, |p| p[2] == EXTENT[2]);
        let expected = 7.0e-3 * strain * EXTENT[0] * EXTENT[1];
        assert!((force / expected - 1.0).abs() < case.tolerance(), "{force} {expected}");
    }
}

/// The same by a force in place of a displacement: a uniform traction gives each node of the top a third of it over the
/// surface triangles around.
#[test]
fn a_pulled_block_lengthens() {
    let traction = 2.0e-4;
    let (young_kpa, poisson) = (7.0, 0.45);
    let mut case = Case::new(shaken([4, 3, 5], EXTENT, 0.15, 2), material(young_kpa, poisson));
    for axis in 0..3u8 {
        case.fix(&[axis], |p| p[axis as usize] == 0.0, |_| [0.0; 3]);
    }
    let mesh = case.mesh.clone();
    let nodes = mesh.nodes();
    for corners in mesh.elements() {
        let top: Vec<u32> = corners
            .iter()
            .copied()
            .filter(|node| nodes[*node as usize][2] == EXTENT[2])
            .collect();
        let [a, b, c] = top[..] else { continue };
        let [a, b, c] = [a, b, c].map(|node| nodes[node as usize]);
        let area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        case.loads
            .extend(top.iter().map(|&node| insonify_mechanics::tissue::problem::Load {
                node,
                force_n: [0.0, 0.0, traction * area / 3.0],
            }));
    }
    let strain = traction / (young_kpa * 1e-3);
    case.check(&case.solve().displacement_mm, |p| {
        [-poisson * strain * p[0], -poisson * strain * p[1], strain * p[2]]
    });
}

/// Layers across the pull, each `moduli` the stiffness that counts: displacements add up as of springs in series.
fn layered(young_kpa: [f64; 3], poisson: f64, walls: bool) {
    // The faces of the layers lie on planes of nodes that no shaking moves.
    let heights = [4.0, 8.0, 12.0];
    let regular = super::case::lattice([3, 3, 6], EXTENT);
    let mesh = with_regions(&regular, |_, middle| {
        heights.iter().position(|top| middle[2] < *top).unwrap() as i32
    });
    let mut case = Case::new(mesh, material(1.0, poisson));
    let by_region: Vec<_> = (0..3)
        .map(|region| (region as i32, material(young_kpa[region], poisson)))
        .collect();
    case.materials = Materials::new(None, &by_region).unwrap();
    for axis in 0..3u8 {
        let far = EXTENT[axis as usize];
        let walled = walls && axis < 2;
        case.fix(
            &[axis],
            |p| p[axis as usize] == 0.0 || walled && p[axis as usize] == far,
            |_| [0.0; 3],
        );
    }
    case.fix(&[2], |p| p[2] == EXTENT[2], |_| [0.0, 0.0, PULL_MM]);
    let solution = case.solve();
    // Between walls nothing draws in, and the modulus that counts is that of confined compression.
    let confined = if walls {
        (1.0 - poisson) / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    } else {
        1.0
    };
    let compliance: f64 = young_kpa.iter().map(|young| 4.0 / (young * 1e-3 * confined)).sum();
    let stress = PULL_MM / compliance;
    case.check(&solution.displacement_mm, |p| {
        let share = |layer: usize| (p[2] - 4.0 * layer as f64).clamp(0.0, 4.0) / (young_kpa[layer] * 1e-3 * confined);
        [0.0, 0.0, stress * (share(0) + share(1) + share(2))]
    });
    let force = reaction(&case, &solution, 2, |p| p[2] == EXTENT[2]);
    let expected = stress * EXTENT[0] * EXTENT[1];
    assert!((force / expected - 1.0).abs() < case.tolerance(), "{force} {expected}");
}

#[test]
fn layers_stretch_in_series() {
    layered([2.0, 20.0, 5.0], 0.0, false);
    layered([1.0, 1e6, 30.0], 0.0, false);
}

#[test]
fn confined_layers_stretch_in_series() {
    for poisson in [0.45, -0.3, 0.499] {
        layered([2.0, 20.0, 5.0], poisson, true);
        layered([1e6, 1.0, 1e3], poisson, true);
    }
}
