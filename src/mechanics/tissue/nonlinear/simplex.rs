//! Constant-strain simplices: the triangle in plane strain and the tetrahedron.

use crate::tissue::element::{DegenerateElement, FLATTEST};
use insonify_mesh::vector::{dot, minus, norm};

/// Gradients and measure of a simplex with `N` = `D` + 1 corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Simplex<const D: usize, const N: usize> {
    /// Gradient of each corner's barycentric coordinate, 1/mm.
    pub gradients: [[f64; D]; N],
    /// Area (mm^2) or volume (mm^3).
    pub measure: f64,
}

impl<const D: usize, const N: usize> Simplex<D, N> {
    /// Creates the simplex of these corners (mm), whose measure must be positive in their order.
    ///
    /// # Errors
    /// [`DegenerateElement`] where the simplex is flat or inverted, or a corner is not finite.
    pub(super) fn of(corners: &[[f64; D]; N]) -> Result<Self, DegenerateElement> {
        const { assert!(N == D + 1 && D >= 2 && D <= 3, "triangles and tetrahedra") }
        let edges: [[f64; D]; D] = std::array::from_fn(|i| minus(corners[i + 1], corners[0]));
        let (columns, determinant) = inverse(edges);
        let factorial = if D == 2 { 2.0 } else { 6.0 };
        let measure = determinant / factorial;
        // Columns of the inverse are the gradients of corners 1 to D; all gradients sum to zero.
        let gradients: [[f64; D]; N] = std::array::from_fn(|corner| {
            std::array::from_fn(|axis| match corner {
                0 => -columns[axis].iter().sum::<f64>(),
                _ => columns[axis][corner - 1],
            })
        });
        let longest = (0..N).flat_map(|a| (0..a).map(move |b| (a, b)));
        let longest = longest.map(|(a, b)| norm(minus(corners[a], corners[b])));
        let longest = longest.fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) });
        if !(longest.is_finite() && measure.is_finite()) {
            let reach = |corner: &[f64; D]| {
                corner.iter().fold(
                    0.0,
                    |a: f64, x| if x.is_finite() { a.max(x.abs()) } else { f64::INFINITY },
                )
            };
            let farthest = corners.iter().max_by(|a, b| reach(a).total_cmp(&reach(b)));
            let mut corner = [0.0; 3];
            corner[..D].copy_from_slice(farthest.unwrap_or(&corners[0]));
            return Err(DegenerateElement::NotFinite { corner });
        }
        // A corner's height is the reciprocal length of its gradient.
        let steepest = gradients.iter().map(|gradient| norm(*gradient)).fold(0.0, f64::max);
        let height = if determinant == 0.0 {
            0.0
        } else {
            1.0 / (steepest * longest)
        };
        if height.is_nan() || height < FLATTEST {
            return Err(DegenerateElement::Flat {
                height: if height.is_nan() { 0.0 } else { height },
            });
        }
        if measure < 0.0 {
            return Err(DegenerateElement::Inverted { volume_mm3: measure });
        }
        Ok(Simplex { gradients, measure })
    }

    /// Returns the displacement gradient for displacements of the corners (mm); exactly zero for a translation.
    #[inline]
    pub(super) fn gradient(&self, displacements: &[[f64; D]; N]) -> [[f64; D]; D] {
        let mut slope = [[0.0; D]; D];
        for corner in 1..N {
            let difference = minus(displacements[corner], displacements[0]);
            for (row, difference) in slope.iter_mut().zip(difference) {
                for (entry, gradient) in row.iter_mut().zip(self.gradients[corner]) {
                    *entry += difference * gradient;
                }
            }
        }
        slope
    }

    /// Returns the strain for displacements of the corners (mm); exactly zero for a translation.
    #[inline]
    pub(super) fn strain(&self, displacements: &[[f64; D]; N]) -> [[f64; D]; D] {
        let slope = self.gradient(displacements);
        std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (slope[i][j] + slope[j][i])))
    }

    /// Returns the product of a stress with each corner's gradient. These sum to zero.
    #[inline]
    pub(super) fn divergence(&self, stress: &[[f64; D]; D]) -> [[f64; D]; N] {
        let mut forces = [[0.0; D]; N];
        for corner in 1..N {
            forces[corner] = std::array::from_fn(|axis| dot(stress[axis], self.gradients[corner]));
            forces[0] = minus(forces[0], forces[corner]);
        }
        forces
    }
}

/// Returns the determinant of the edges from the first corner: positive where the corners keep their order.
pub(super) fn orientation<const D: usize, const N: usize>(corners: &[[f64; D]; N]) -> f64 {
    inverse(std::array::from_fn(|i| minus(corners[i + 1], corners[0]))).1
}

/// Returns inverse and determinant by Gauss-Jordan elimination with row pivoting; the determinant of a singular matrix
/// is 0.
fn inverse<const D: usize>(mut a: [[f64; D]; D]) -> ([[f64; D]; D], f64) {
    let mut b: [[f64; D]; D] = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    let mut determinant = 1.0;
    for k in 0..D {
        // Edges may lie along an axis, with zeros on the diagonal.
        let pivot = (k..D).fold(
            k,
            |best, row| if a[row][k].abs() > a[best][k].abs() { row } else { best },
        );
        if pivot != k {
            a.swap(pivot, k);
            b.swap(pivot, k);
            determinant = -determinant;
        }
        determinant *= a[k][k];
        if a[k][k] == 0.0 {
            return (b, 0.0);
        }
        let scale = 1.0 / a[k][k];
        a[k] = a[k].map(|x| x * scale);
        b[k] = b[k].map(|x| x * scale);
        let (row_a, row_b) = (a[k], b[k]);
        for row in (0..D).filter(|row| *row != k) {
            let factor = a[row][k];
            for column in 0..D {
                a[row][column] -= factor * row_a[column];
                b[row][column] -= factor * row_b[column];
            }
        }
    }
    (b, determinant)
}
