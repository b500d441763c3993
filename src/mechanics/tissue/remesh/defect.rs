//! Residual and backward error of displacements of the current mesh.

use super::adapted::AdaptedMesh;
use super::difference::Difference;

/// Returns f - K u for the current mesh, given its difference from the base.
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

/// Returns |f - K u| / (|K| |u| + |f|) in maximum norms, the normwise backward error (J. L. Rigal and J. Gaches, JACM
/// 14, 1967), with |K| bounded by the sum of the norms of the base and the difference.
pub(super) fn backward_error(mesh: &AdaptedMesh, difference: &Difference, u: &[f64], f: &[f64]) -> f64 {
    let residual = largest(&defect(mesh, difference, u, f));
    let norm = mesh.stiffness().norm_inf() + difference.norm_inf();
    if residual == 0.0 {
        0.0
    } else {
        residual / (norm * largest(u) + largest(f))
    }
}

/// Returns the largest magnitude; NaN if a value is NaN.
pub(super) fn largest(values: &[f64]) -> f64 {
    let magnitudes = values.iter().map(|value| value.abs());
    magnitudes.fold(0.0, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}

#[cfg(test)]
mod tests;
