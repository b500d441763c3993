//! Reciprocity, and work that becomes energy.

use insonify_mechanics::tissue::material::Materials;
use insonify_mechanics::tissue::problem::Load;

use super::case::{Case, material, noise, real, shaken, with_regions};
use super::reference;

/// Two materials on a fixed floor, with loads all over.
fn loaded(seed: u64) -> Case {
    let mesh = with_regions(&shaken([5, 5, 5], [10.0; 3], 0.15, 1), |_, middle| {
        i32::from(middle[0] > 5.0)
    });
    let mut case = Case::new(mesh, material(1.0, 0.3));
    case.materials = Materials::new(Some(material(4.0, 0.45)), &[(1, material(40.0, 0.3))]).unwrap();
    case.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
    load(&mut case, seed);
    case
}

fn load(case: &mut Case, seed: u64) {
    case.loads = (0..case.mesh.nodes().len() as u32)
        .map(|node| Load {
            node,
            force_n: [0, 1, 2].map(|axis| 1e-3 * noise(seed, 3 * node as usize + axis)),
        })
        .collect();
}

/// The work of loads along displacements, N mm.
fn work(loads: &[Load], displacement_mm: &[[f64; 3]]) -> f64 {
    let along = |load: &Load| {
        (0..3)
            .map(|axis| load.force_n[axis] * displacement_mm[load.node as usize][axis])
            .sum::<f64>()
    };
    loads.iter().map(along).sum()
}

/// The first load does along the displacement of the second what the second does along that of the first (E. Betti,
/// 1872).
#[test]
fn loads_are_reciprocal() {
    let (one, two) = (loaded(1), loaded(2));
    let [along_two, along_one] = [
        work(&one.loads, &two.solve().displacement_mm),
        work(&two.loads, &one.solve().displacement_mm),
    ];
    let scale = work(&one.loads, &one.solve().displacement_mm);
    assert!(
        (along_two - along_one).abs() < one.tolerance() * scale,
        "{along_two} {along_one}"
    );
}

/// Half the work of a load that grows from zero is what the elements store (B. P. E. Clapeyron).
#[test]
fn work_becomes_energy() {
    let case = loaded(3);
    let materials = case.materials.check(&case.mesh).unwrap();
    let displacements = case.solve().displacement_mm;
    let (stored, done) = (
        reference::energy(&case.mesh, &materials, &displacements),
        0.5 * work(&case.loads, &displacements),
    );
    assert!((stored / done - 1.0).abs() < case.tolerance(), "{stored} {done}");
}

#[test]
fn work_becomes_energy_in_real_organs() {
    let Some(mesh) = real("DERIVED_s0328_3organ_tet.vtu") else {
        return;
    };
    let mut case = Case::new(mesh, material(6.0, 0.45));
    case.materials = Materials::new(
        Some(material(6.0, 0.45)),
        &[(2, material(10.0, 0.49)), (4, material(1.0, 0.3))],
    )
    .unwrap();
    let [low, high] = case.mesh.bounds();
    // What lies low is held; each organ must be, so hold the whole surface's lower half.
    let middle = 0.5 * (low[2] + high[2]);
    case.fix(&[0, 1, 2], |p| p[2] < middle, |_| [0.0; 3]);
    load(&mut case, 4);
    let materials = case.materials.check(&case.mesh).unwrap();
    let displacements = case.solve().displacement_mm;
    let (stored, done) = (
        reference::energy(&case.mesh, &materials, &displacements),
        0.5 * work(&case.loads, &displacements),
    );
    assert!((stored / done - 1.0).abs() < case.tolerance(), "{stored} {done}");
}
