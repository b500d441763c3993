//! How well displacements of the whole current mesh hold their forces.

use super::adapted::AdaptedMesh;
use super::difference::Difference;

/// f - K u for the current mesh, whose difference to the base is given.
pub(super) fn defect(mesh: &AdaptedMesh, difference: &Difference, u: &[f64], f: &[f64]) -> Vec<f64> {
    let mut defect = vec![0.0; f.len()];
    mesh.stiffness().multiply(u, &mut defect);
    difference.add_product(u, &mut defect);
    defect
        .iter_mut()
        .zip(f)
        .for_each(|(product, f)| *product = f - *product);
    defect
}

/// |f - K u| / (|K| |u| + |f|) in maximum norms, with |K| at most that of the base and that of the difference together: the
/// normwise backward error (J. L. Rigal and J. Gaches, JACM 14, 1967).
pub(super) fn backward_error(mesh: &AdaptedMesh, difference: &Difference, u: &[f64], f: &[f64]) -> f64 {
    let rest = largest(&defect(mesh, difference, u, f));
    let norm = mesh.stiffness().norm_inf() + difference.norm_inf();
    if rest == 0.0 {
        0.0
    } else {
        rest / (norm * largest(u) + largest(f))
    }
}

/// The largest magnitude; NaN where there is one.
pub(super) fn largest(values: &[f64]) -> f64 {
    let magnitudes = values.iter().map(|value| value.abs());
    magnitudes.fold(0.0, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}

#[cfg(test)]
mod tests;
