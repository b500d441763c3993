//! Points in elements of the deformed tissue.

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A point in an element, by barycentric coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Place {
    pub element: u32,
    pub bary: [f64; 4],
}

impl Place {
    /// Returns whether the point is in its element rather than extrapolated beside the mesh.
    pub fn is_inside(&self) -> bool {
        self.bary.iter().all(|share| *share >= -1e-9)
    }
}

/// An element with its current corners.
pub(super) struct Tetrahedron {
    origin: Point3<f64>,
    /// Gradients of the barycentric coordinates 1 to 3 as rows, 1/mm.
    gradients: Matrix3<f64>,
    pub volume: f64,
}

impl Tetrahedron {
    /// Returns `None` for an element without volume.
    pub fn new(corners: &[Point3<f64>; 4]) -> Option<Tetrahedron> {
        let edges = Matrix3::from_columns(&[1, 2, 3].map(|corner: usize| corners[corner] - corners[0]));
        let volume = edges.determinant() / 6.0;
        let gradients = edges.try_inverse()?;
        gradients.iter().all(|x| x.is_finite()).then_some(Tetrahedron {
            origin: corners[0],
            gradients,
            volume,
        })
    }

    pub fn bary(&self, p: &Point3<f64>) -> [f64; 4] {
        let [a, b, c] = (self.gradients * (p - self.origin)).into();
        [1.0 - (a + b + c), a, b, c]
    }

    /// Returns the derivatives of the barycentric coordinates along a direction, 1/mm.
    pub fn rates(&self, direction: &Vector3<f64>) -> [f64; 4] {
        let [a, b, c] = (self.gradients * direction).into();
        [-(a + b + c), a, b, c]
    }

    /// Returns the distance (mm) at which a ray from inside leaves, and the corner opposite the face that it leaves through.
    pub fn exit(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Option<(f64, usize)> {
        let (bary, rates) = (self.bary(from), self.rates(direction));
        let leaves = (0..4).filter(|corner| rates[*corner] < 0.0);
        let distances = leaves.map(|corner| ((bary[corner] / -rates[corner]).max(0.0), corner));
        distances.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_and_exits_of_a_corner_of_a_cube() {
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]].map(Point3::from);
        let tetrahedron = Tetrahedron::new(&corners).unwrap();
        assert!((tetrahedron.volume - 8.0 / 6.0).abs() < 1e-15);
        assert_eq!(tetrahedron.bary(&Point3::new(0.5, 0.5, 0.5)), [0.25; 4]);
        let (distance, face) = tetrahedron.exit(&Point3::new(0.5, 0.5, 0.5), &Vector3::x()).unwrap();
        assert_eq!((distance, face), (0.5, 0));
        let (distance, face) = tetrahedron.exit(&Point3::new(0.5, 0.5, 0.5), &-Vector3::y()).unwrap();
        assert_eq!((distance, face), (0.5, 2));
        let flat = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 0.0]].map(Point3::from);
        assert!(Tetrahedron::new(&flat).is_none());
    }
}
