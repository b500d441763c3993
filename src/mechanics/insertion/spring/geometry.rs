//! Barycentric coordinates in tetrahedra.

use nalgebra::Vector3;

/// A tetrahedron prepared for barycentric coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Simplex {
    origin: Vector3<f64>,
    /// Gradients of the coordinates of corners 1 to 3, 1/mm.
    gradients: [Vector3<f64>; 3],
}

/// Returns the signed volume, mm^3.
pub(super) fn volume(corners: &[Vector3<f64>; 4]) -> f64 {
    let [a, b, c] = [1, 2, 3].map(|corner| corners[corner] - corners[0]);
    a.dot(&b.cross(&c)) / 6.0
}

impl Simplex {
    /// Returns `None` if the corners are coplanar within rounding.
    pub fn new(corners: &[Vector3<f64>; 4]) -> Option<Simplex> {
        let [a, b, c] = [1, 2, 3].map(|corner| corners[corner] - corners[0]);
        let faces = [b.cross(&c), c.cross(&a), a.cross(&b)];
        let six_volumes = a.dot(&faces[0]);
        let gradients = faces.map(|face| face / six_volumes);
        let finite = gradients.iter().all(|gradient| gradient.iter().all(|x| x.is_finite()));
        finite.then_some(Simplex {
            origin: corners[0],
            gradients,
        })
    }

    /// Returns the barycentric coordinates of a point.
    pub fn coordinates(&self, point: &Vector3<f64>) -> [f64; 4] {
        let from = point - self.origin;
        let [b, c, d] = self.gradients.map(|gradient| gradient.dot(&from));
        [1.0 - (b + c + d), b, c, d]
    }

    /// Returns the derivatives of the coordinates along a direction, 1/mm.
    pub fn rates(&self, direction: &Vector3<f64>) -> [f64; 4] {
        let [b, c, d] = self.gradients.map(|gradient| gradient.dot(direction));
        [-(b + c + d), b, c, d]
    }
}

/// Returns the index of the least of four coordinates, and its value.
pub(super) fn least(coordinates: &[f64; 4]) -> (usize, f64) {
    let mut found = (0, coordinates[0]);
    for (place, coordinate) in coordinates.iter().enumerate().skip(1) {
        if *coordinate < found.1 {
            found = (place, *coordinate);
        }
    }
    found
}

/// Interpolates vectors at the corners by barycentric coordinates.
pub(super) fn mix(coordinates: &[f64; 4], corners: &[Vector3<f64>; 4]) -> Vector3<f64> {
    let mut sum = Vector3::zeros();
    for (coordinate, corner) in coordinates.iter().zip(corners) {
        sum += corner * *coordinate;
    }
    sum
}
