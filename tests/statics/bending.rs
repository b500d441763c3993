//! Pure bending: a beam along z bent to the curvature k about y has the quadratic displacement
//! u = k/2 (z^2 + nu (x^2 - y^2)), v = k nu x y, w = -k x z, with the stress -E k x along z and none beside it
//! (S. P. Timoshenko and J. N. Goodier, "Theory of Elasticity", on bending by couples).

use insonify_mesh::TetMesh;

use super::case::{Case, lattice, material};
use super::reference;

const CURVATURE: f64 = 0.002;
const EXTENT: [f64; 3] = [8.0, 6.0, 24.0];

fn exact(poisson: f64) -> impl Fn(&[f64; 3]) -> [f64; 3] {
    move |p| {
        let [x, y, z] = [p[0] - EXTENT[0] / 2.0, p[1] - EXTENT[1] / 2.0, p[2]];
        [
            0.5 * CURVATURE * (z * z + poisson * (x * x - y * y)),
            CURVATURE * poisson * x * y,
            -CURVATURE * x * z,
        ]
    }
}

fn bent(mesh: TetMesh, poisson: f64) -> Case {
    let mut case = Case::new(mesh, material(12.0, poisson));
    case.fix_surface(exact(poisson));
    case
}

/// On a lattice the discrete equations of an inner node are a difference stencil, the same everywhere, which equals the
/// differential equations on quadratic displacements: the nodes lie right exactly.
#[test]
fn lattices_bend_exactly_at_their_nodes() {
    for poisson in [0.45, 0.0, -0.3, 0.499] {
        let case = bent(lattice([4, 4, 6], EXTENT), poisson);
        case.check(&case.solve().displacement_mm, exact(poisson));
    }
}

/// Between the nodes the strain is constant in each element: the energy exceeds the exact one, E I k^2 L / 2, by the
/// energy of what linear interpolation misses of a quadratic, which falls by four as a lattice is halved.
#[test]
fn energy_comes_from_above_with_the_second_order() {
    let poisson = 0.3;
    let [width, height, length] = EXTENT;
    let second_moment = height * width.powi(3) / 12.0;
    let exact_energy = 0.5 * 12.0e-3 * second_moment * CURVATURE.powi(2) * length;
    let excess = [1, 2, 4].map(|fine| {
        let case = bent(lattice([2 * fine, 2 * fine, 3 * fine], EXTENT), poisson);
        let displacements = case.solve().displacement_mm;
        let materials = case.materials.check(&case.mesh).unwrap();
        reference::energy(&case.mesh, &materials, &displacements) / exact_energy - 1.0
    });
    assert!(excess[2] > 0.0);
    for pair in excess.windows(2) {
        assert!((pair[0] / pair[1] - 4.0).abs() < 1e-8, "{excess:?}");
    }
}
