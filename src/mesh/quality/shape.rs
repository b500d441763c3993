//! Shape measures of a tetrahedron.

use nalgebra::Vector3;

use crate::element::edges;

/// Measures of one element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Signed volume, mm^3. Negative: inverted. NaN where a corner is not finite.
    pub volume_mm3: f64,
    /// Least angle between two faces, degrees. NaN where a corner is not finite.
    pub min_dihedral_deg: f64,
    /// Greatest angle between two faces, degrees. NaN where a corner is not finite.
    pub max_dihedral_deg: f64,
    /// [`jacobian_condition`] of the element.
    pub condition: f64,
}

impl Shape {
    /// Measures the element with these corners, mm.
    pub fn of(corners: &[[f64; 3]; 4]) -> Shape {
        let Some(scaled) = Scaled::of(corners) else {
            let finite = corners.iter().flatten().all(|x| x.is_finite());
            let none = if finite { 0.0 } else { f64::NAN };
            return Shape {
                volume_mm3: none,
                min_dihedral_deg: none,
                max_dihedral_deg: none,
                condition: f64::INFINITY,
            };
        };
        let [min_dihedral_deg, max_dihedral_deg] = scaled.dihedral_deg();
        Shape {
            volume_mm3: scaled.determinant * scaled.unit.powi(3) / 6.0,
            min_dihedral_deg,
            max_dihedral_deg,
            condition: scaled.condition(),
        }
    }
}

/// Returns the condition number of an element: `|J|_F |J^-1|_F / 3`, where J maps the regular tetrahedron onto the one
/// with these corners (Freitag and Knupp, "Tetrahedral mesh improvement via optimization of the element condition
/// number", Int. J. Numer. Meth. Engng 53, 2002). 1 for a regular tetrahedron, larger for worse ones, and infinite for
/// an inverted or flat one or one with a corner that is not finite. It does not depend on size, position, orientation
/// or the order of corners.
///
/// Explicitly, `|J|_F^2` is half the sum of the squared edges, and `|J^-1|_F^2` half the sum of the squared inverse
/// heights.
pub fn jacobian_condition(corners: &[[f64; 3]; 4]) -> f64 {
    Scaled::of(corners).map_or(f64::INFINITY, |scaled| scaled.condition())
}

/// An element in units of its greatest edge component, so that no product of coordinates leaves the range of `f64`.
struct Scaled {
    unit: f64,
    determinant: f64,
    /// Sum of the squares of the six edges.
    squared_edges: f64,
    /// Normal of the face opposite each corner, with twice its area as length.
    normals: [Vector3<f64>; 4],
}

impl Scaled {
    /// Returns `None` where all corners are one point, or not all are finite.
    fn of(corners: &[[f64; 3]; 4]) -> Option<Scaled> {
        let edges = edges(corners);
        let unit = edges.amax();
        // `amax` ignores NaN.
        if !(unit > 0.0 && edges.iter().all(|x| x.is_finite())) {
            return None;
        }
        let edges = edges / unit;
        let [a, b, c] = [0, 1, 2].map(|column| Vector3::from(edges.column(column)));
        let squared_edges = [a, b, c, b - a, c - b, a - c];
        Some(Scaled {
            unit,
            determinant: edges.determinant(),
            squared_edges: squared_edges.iter().map(Vector3::norm_squared).sum(),
            normals: [(c - a).cross(&(b - a)), b.cross(&c), c.cross(&a), a.cross(&b)],
        })
    }

    fn condition(&self) -> f64 {
        let squared_normals: f64 = self.normals.iter().map(Vector3::norm_squared).sum();
        // A height is the determinant over the length of the normal.
        let condition = (self.squared_edges * squared_normals).sqrt() / (6.0 * self.determinant);
        if self.determinant > 0.0 {
            condition
        } else {
            f64::INFINITY
        }
    }

    /// Returns the least and the greatest angle between two faces, degrees.
    fn dihedral_deg(&self) -> [f64; 2] {
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for (corner, normal) in self.normals.iter().enumerate() {
            for other in &self.normals[..corner] {
                // The angle between normals that both point outwards (or both inwards) is the supplement of the angle
                // between the faces.
                let angle = f64::atan2(normal.cross(other).norm(), 0.0 - normal.dot(other)).to_degrees();
                range = [range[0].min(angle), range[1].max(angle)];
            }
        }
        range
    }
}
