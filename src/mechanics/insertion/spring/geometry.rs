//! Barycentric coordinates in tetrahedra, and the penetration rule for the tip node (Zhu et al. 2007, section 2.2).

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
    pub(super) fn new(corners: &[Vector3<f64>; 4]) -> Option<Simplex> {
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
    pub(super) fn coordinates(&self, point: &Vector3<f64>) -> [f64; 4] {
        let offset = point - self.origin;
        let [b, c, d] = self.gradients.map(|gradient| gradient.dot(&offset));
        [1.0 - (b + c + d), b, c, d]
    }

    /// Returns the derivatives of the coordinates along a direction, 1/mm.
    pub(super) fn rates(&self, direction: &Vector3<f64>) -> [f64; 4] {
        let [b, c, d] = self.gradients.map(|gradient| gradient.dot(direction));
        [-(b + c + d), b, c, d]
    }
}

/// Returns the index of the least of four coordinates, and its value.
pub(super) fn least(coordinates: &[f64; 4]) -> (usize, f64) {
    let mut lowest = (0, coordinates[0]);
    for (corner, coordinate) in coordinates.iter().enumerate().skip(1) {
        if *coordinate < lowest.1 {
            lowest = (corner, *coordinate);
        }
    }
    lowest
}

/// Interpolates vectors at the corners by barycentric coordinates.
pub(super) fn mix(coordinates: &[f64; 4], corners: &[Vector3<f64>; 4]) -> Vector3<f64> {
    let mut sum = Vector3::zeros();
    for (coordinate, corner) in coordinates.iter().zip(corners) {
        sum += corner * *coordinate;
    }
    sum
}

/// Share of the largest coordinate rate below which a rate is rounding: the needle runs along that face.
const PARALLEL: f64 = 1e-9;

/// Face through which the needle would leave an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FarFace {
    /// Corner opposite the face.
    pub opposite: usize,
    /// P_inter: intersection of the needle's direction with the face, mm.
    pub at: Vector3<f64>,
    /// Distance from the tip to P_inter, mm: negative where the tip is beyond it.
    pub distance: f64,
    /// Circumference of the face, mm.
    pub circumference: f64,
}

impl FarFace {
    /// Finds the far face for a tip that moves along `direction` (of unit length). `tip_node` is the corner that is the
    /// last node of the shaft, if one is: its opposite is the far face. Returns `None` for a flat element, or if the
    /// needle moves away from that face.
    pub(super) fn of(
        corners: &[Vector3<f64>; 4],
        tip: &Vector3<f64>,
        direction: &Vector3<f64>,
        tip_node: Option<usize>,
    ) -> Option<FarFace> {
        let simplex = Simplex::new(corners)?;
        let (coordinates, rates) = (simplex.coordinates(tip), simplex.rates(direction));
        let steepest = rates.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        let distance = |corner: usize| {
            if rates[corner] < -PARALLEL * steepest {
                coordinates[corner] / -rates[corner]
            } else {
                f64::INFINITY
            }
        };
        // At a corner the tip lies on three faces, and rounding would choose one of them.
        let opposite = match tip_node {
            Some(corner) => corner,
            None => least(&std::array::from_fn(distance)).0,
        };
        let distance = distance(opposite);
        let [a, b, c] = face(opposite).map(|corner| corners[corner]);
        distance.is_finite().then(|| FarFace {
            opposite,
            at: tip + direction * distance,
            distance,
            circumference: (a - b).norm() + (b - c).norm() + (c - a).norm(),
        })
    }

    /// Returns whether the tip is within `lambda` circumferences of the face.
    pub(crate) fn is_met(&self, lambda: f64) -> bool {
        self.distance <= lambda * self.circumference
    }

    /// Returns the corners of the face, nearest to P_inter first; ties in element order.
    pub(crate) fn nearest_first(&self, corners: &[Vector3<f64>; 4]) -> [usize; 3] {
        let mut places = face(self.opposite);
        places.sort_by(|&a, &b| {
            let [a, b] = [a, b].map(|corner| (corners[corner] - self.at).norm_squared());
            a.total_cmp(&b)
        });
        places
    }
}

/// Returns the corners of the face opposite a corner.
fn face(opposite: usize) -> [usize; 3] {
    [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]][opposite]
}
