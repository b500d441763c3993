//! Stiffness of the linear tetrahedron (constant strain).
//!
//! With the gradients g_a of the four barycentric coordinates, the volume V and the Lame parameters lambda and mu, the
//! force on corner a per displacement of corner b is the 3 x 3 block
//! `V (lambda g_a g_b^T + mu g_b g_a^T + mu (g_a . g_b) I)` (O. C. Zienkiewicz and R. L. Taylor, "The Finite Element
//! Method", vol. 1, chapter on three-dimensional stress analysis, written in Lame parameters).

use super::material::Material;
use insonify_mesh::vector::{cross, dot, minus};

/// Force on one node per displacement of another, N/mm; rows are force axes, columns displacement axes.
pub(crate) type NodeBlock = [[f64; 3]; 3];

/// Newtons per square millimetre in one kilopascal.
const NEWTON_PER_MM2: f64 = 1e-3;

/// Least ratio of height to longest edge of a tetrahedron. Below it, rounding of everyday coordinates (1e-14 of them)
/// leaves the height too few digits, and the element is refused as flat.
pub const FLATTEST: f64 = 1e-9;

/// Stiffness of one tetrahedron: block `[a][b]` is the force on corner a per displacement of corner b, N/mm. Symmetric:
/// block `[b][a]` is the transpose of block `[a][b]`, bit for bit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg(test)]
pub(crate) struct ElementStiffness(pub [[NodeBlock; 4]; 4]);

/// Why a tetrahedron has no usable volume.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DegenerateElement {
    /// The corners have the opposite orientation.
    #[error("it is inverted: its volume is {volume_mm3:.3e} mm^3; expected a positive one")]
    Inverted {
        /// Signed volume, mm^3.
        volume_mm3: f64,
    },
    /// The four corners are coplanar to working precision.
    #[error("it is flat: its least height is {height:.1e} of its longest edge; expected at least {FLATTEST:.0e}")]
    Flat {
        /// Ratio of least height to longest edge.
        height: f64,
    },
    /// A corner is NaN or infinite, or so far away that volumes overflow.
    #[error("its volume is no finite number; a corner is at {corner:?}")]
    NotFinite {
        /// Corner farthest from the origin, mm.
        corner: [f64; 3],
    },
}

/// Gradients and volume of one tetrahedron.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Gradient of each corner's barycentric coordinate, 1/mm.
    gradients: [[f64; 3]; 4],
    /// Volume, mm^3.
    volume: f64,
}

impl Shape {
    /// Computes the shape of a tetrahedron from its corners, mm.
    pub(super) fn of(corners: &[[f64; 3]; 4]) -> Result<Shape, DegenerateElement> {
        let [e1, e2, e3] = [1, 2, 3].map(|corner| minus(corners[corner], corners[0]));
        let faces = [cross(e2, e3), cross(e3, e1), cross(e1, e2)];
        let determinant = dot(e1, faces[0]);
        let opposite: [f64; 3] = std::array::from_fn(|axis| -(faces[0][axis] + faces[1][axis] + faces[2][axis]));
        let faces = [opposite, faces[0], faces[1], faces[2]];
        let square = |edge: [f64; 3]| dot(edge, edge);
        let edges = [e1, e2, e3, minus(e2, e1), minus(e3, e1), minus(e3, e2)];
        let longest = edges.map(square).into_iter().fold(0.0, f64::max).sqrt();
        let widest = faces.map(square).into_iter().fold(0.0, f64::max).sqrt();
        if !(determinant.is_finite() && widest.is_finite() && longest.is_finite()) {
            let reach = |corner: &[f64; 3]| {
                corner
                    .iter()
                    .fold(0.0, |a: f64, x| if x.is_nan() { f64::INFINITY } else { a.max(x.abs()) })
            };
            let farthest = (1..4).fold(0, |best, next| {
                if reach(&corners[next]) > reach(&corners[best]) {
                    next
                } else {
                    best
                }
            });
            return Err(DegenerateElement::NotFinite {
                corner: corners[farthest],
            });
        }
        // Six volumes divided by twice the area of the widest face give the least height.
        let height = if widest > 0.0 {
            determinant.abs() / widest / longest
        } else {
            0.0
        };
        if height < FLATTEST {
            return Err(DegenerateElement::Flat { height });
        }
        if determinant < 0.0 {
            return Err(DegenerateElement::Inverted {
                volume_mm3: determinant / 6.0,
            });
        }
        Ok(Shape {
            gradients: faces.map(|face| face.map(|x| x / determinant)),
            volume: determinant / 6.0,
        })
    }

    /// Returns V lambda and V mu, N mm.
    #[inline]
    pub(super) fn weights(&self, material: &Material) -> [f64; 2] {
        material.lame_kpa().map(|kpa| kpa * NEWTON_PER_MM2 * self.volume)
    }

    /// Returns the block of corners `a` and `b`, N/mm.
    #[inline]
    pub(super) fn block(&self, [lambda, mu]: [f64; 2], a: usize, b: usize) -> NodeBlock {
        let (ga, gb) = (self.gradients[a], self.gradients[b]);
        let shear = mu * dot(ga, gb);
        // Products are ordered so that swapping a with b and row with column changes no rounding.
        std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let entry = lambda * (ga[row] * gb[column]) + mu * (gb[row] * ga[column]);
                if row == column { entry + shear } else { entry }
            })
        })
    }

    /// Returns the forces (N) that balance the displacements (mm) of the corners. A translation gives exactly zero; the
    /// forces sum to zero up to the rounding of the last sum.
    #[inline]
    pub(super) fn forces(&self, [lambda, mu]: [f64; 2], displacements: &[[f64; 3]; 4]) -> [[f64; 3]; 4] {
        let mut slope = [[0.0; 3]; 3];
        for corner in 1..4 {
            let difference = minus(displacements[corner], displacements[0]);
            for (row, difference) in slope.iter_mut().zip(difference) {
                for (entry, gradient) in row.iter_mut().zip(self.gradients[corner]) {
                    *entry += difference * gradient;
                }
            }
        }
        let pressure = lambda * (slope[0][0] + slope[1][1] + slope[2][2]);
        let stress: [[f64; 3]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let shear = mu * (slope[i][j] + slope[j][i]);
                if i == j { shear + pressure } else { shear }
            })
        });
        let [a, b, c] = [1, 2, 3].map(|corner| stress.map(|row| dot(row, self.gradients[corner])));
        [std::array::from_fn(|axis| -(a[axis] + b[axis] + c[axis])), a, b, c]
    }
}

/// Computes the stiffness of a tetrahedron from its corners (mm; positive volume in the order of [`TetMesh`]).
///
/// # Errors
/// [`DegenerateElement`] where the element is flat or inverted, or a corner is not finite.
///
/// [`TetMesh`]: insonify_mesh::TetMesh
#[cfg(test)]
pub(crate) fn element_stiffness(
    corners: &[[f64; 3]; 4],
    material: &Material,
) -> Result<ElementStiffness, DegenerateElement> {
    let shape = Shape::of(corners)?;
    let weights = shape.weights(material);
    Ok(ElementStiffness(std::array::from_fn(|a| {
        std::array::from_fn(|b| shape.block(weights, a, b))
    })))
}

#[cfg(test)]
mod tests;
