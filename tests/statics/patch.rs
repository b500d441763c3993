//! The patch test: a linear displacement of the surface is carried through exactly (B. M. Irons, 1965).

use insonify_mechanics::tissue::material::Materials;
use insonify_mesh::TetMesh;

use super::case::{Case, material, noise, real, shaken, with_regions};

/// A displacement linear in the position: stretch, shear and rotation of some per cent.
fn linear(seed: u64) -> impl Fn(&[f64; 3]) -> [f64; 3] {
    move |p| {
        std::array::from_fn(|row| {
            let slope = |column: usize| 0.05 * noise(seed, 3 * row + column);
            noise(seed, 9 + row) + slope(0) * p[0] + slope(1) * p[1] + slope(2) * p[2]
        })
    }
}

fn passes(mesh: TetMesh, poisson: f64, seed: u64) {
    let mut case = Case::new(mesh, material(8.0, poisson));
    case.fix_surface(linear(seed));
    case.check(&case.solve().displacement_mm, linear(seed));
}

#[test]
fn shaken_lattices_carry_linear_fields() {
    for (seed, poisson) in [(1, 0.45), (2, 0.0), (3, -0.3), (4, 0.499)] {
        passes(shaken([5, 4, 6], [10.0, 9.0, 14.0], 0.15, seed), poisson, seed);
    }
}

#[test]
fn regions_of_equal_material_are_one() {
    let mesh = with_regions(&shaken([5, 5, 5], [10.0; 3], 0.15, 6), |element, _| element as i32 % 7);
    let mut case = Case::new(mesh, material(3.0, 0.4));
    let named: Vec<_> = (0..6).map(|region| (region, material(3.0, 0.4))).collect();
    case.materials = Materials::new(Some(material(3.0, 0.4)), &named).unwrap();
    case.fix_surface(linear(6));
    case.check(&case.solve().displacement_mm, linear(6));
}

#[test]
fn real_meshes_carry_linear_fields() {
    for name in ["DERIVED_s0328_3organ_tet.vtu", "fenris_sphere_tet4_593.msh"] {
        let Some(mesh) = real(name) else { return };
        for poisson in [0.45, 0.499] {
            passes(mesh.clone(), poisson, 8);
        }
    }
}
