//! Random meshes, materials, fixes and loads against a dense solution assembled another way.

use insonify_mechanics::tissue::material::Materials;
use insonify_mechanics::tissue::problem::{Fix, Load};
use nalgebra::{DMatrix, DVector};

use super::case::{Case, distance, material, noise, shaken, with_regions};
use super::reference;

/// A block of elements of four materials in no order, held at its bottom and at single axes elsewhere, and pulled
/// about.
fn random(seed: u64, poissons: [f64; 4], contrast: f64) -> Case {
    let mesh = shaken([3, 4, 3], [9.0, 10.0, 7.0], 0.15, seed);
    let mesh = with_regions(&mesh, |element, _| (2.0 + 2.0 * noise(seed, 1000 + element)) as i32);
    let young = [1.0, contrast.cbrt(), contrast.powf(2.0 / 3.0), contrast];
    let materials: Vec<_> = (0..4)
        .map(|region| (region as i32, material(young[region], poissons[region])))
        .collect();
    let mut case = Case::new(mesh, material(1.0, 0.3));
    case.materials = Materials::new(None, &materials).unwrap();
    let nodes = case.mesh.nodes().to_vec();
    let size = nodes.len();
    let bottom = |node: usize| nodes[node][2] == 0.0;
    for dof in (0..3 * size).filter(|&dof| bottom(dof / 3) || noise(seed, 3000 + dof) > 0.95) {
        case.fixes.push(Fix {
            node: (dof / 3) as u32,
            axis: (dof % 3) as u8,
            displacement_mm: 0.5 * noise(seed, 4000 + dof),
        });
    }
    case.loads = (0..size as u32)
        .map(|node| Load {
            node,
            force_n: [0, 1, 2].map(|axis| 1e-3 * noise(seed, 5000 + 3 * node as usize + axis)),
        })
        .collect();
    case
}

/// Displacements of all nodes by elimination on the dense matrix.
fn dense(case: &Case) -> Vec<[f64; 3]> {
    let materials = case.materials.check(&case.mesh).unwrap();
    let whole = reference::stiffness(&case.mesh, &materials);
    let size = whole.nrows();
    let mut displacement = DVector::zeros(size);
    let mut fixed = vec![false; size];
    for fix in &case.fixes {
        let dof = 3 * fix.node as usize + fix.axis as usize;
        (displacement[dof], fixed[dof]) = (fix.displacement_mm, true);
    }
    let mut force = -&whole * &displacement;
    for load in &case.loads {
        for axis in 0..3 {
            force[3 * load.node as usize + axis] += load.force_n[axis];
        }
    }
    let free: Vec<usize> = (0..size).filter(|dof| !fixed[*dof]).collect();
    let reduced = DMatrix::from_fn(free.len(), free.len(), |i, j| whole[(free[i], free[j])]);
    let rhs = DVector::from_fn(free.len(), |i, _| force[free[i]]);
    let solved = reduced.full_piv_lu().solve(&rhs).unwrap();
    for (value, dof) in solved.iter().zip(free) {
        displacement[dof] = *value;
    }
    displacement
        .as_slice()
        .chunks_exact(3)
        .map(|u| [u[0], u[1], u[2]])
        .collect()
}

fn agrees(case: &Case) {
    let (error, tolerance) = (distance(&case.solve().displacement_mm, &dense(case)), case.tolerance());
    assert!(
        error < tolerance && tolerance < 1e-3,
        "error {error:.2e}, tolerance {tolerance:.2e}"
    );
}

#[test]
fn a_dense_solution_agrees() {
    for seed in 1..=3 {
        agrees(&random(seed, [0.45, 0.3, 0.49, 0.2], 30.0));
    }
}

#[test]
fn a_dense_solution_agrees_at_the_ends_of_poissons_range() {
    agrees(&random(11, [0.499, 0.499, 0.499, 0.499], 1.0));
    agrees(&random(12, [0.499, 0.0, -0.3, -0.9], 10.0));
    agrees(&random(13, [0.0; 4], 10.0));
}

#[test]
fn a_dense_solution_agrees_at_a_contrast_of_a_million() {
    agrees(&random(21, [0.45, 0.3, 0.0, 0.4], 1e6));
}
