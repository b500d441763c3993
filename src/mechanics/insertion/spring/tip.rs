//! When the tip node counts as penetrated (Zhu et al. 2007, section 2.2).

use nalgebra::Vector3;

use super::geometry::{self, Simplex};

/// Rates of coordinates below this share of the largest are rounding: the needle runs along that face.
const PARALLEL: f64 = 1e-9;

/// The face through which the needle would leave an element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FarFace {
    /// The corner opposite.
    pub opposite: usize,
    /// P_inter: where the needle's direction meets it, mm.
    pub at: Vector3<f64>,
    /// From the tip to there, mm: negative where the tip is beyond it.
    pub distance: f64,
    /// mm.
    pub circumference: f64,
}

impl FarFace {
    /// The far face for a tip that goes along `direction` (of unit length). `tip_node` is the corner that is the last node of
    /// the shaft, if one is: its opposite is the far face. None for a flat element, or if the needle goes away from that face.
    pub fn of(
        corners: &[Vector3<f64>; 4],
        tip: &Vector3<f64>,
        direction: &Vector3<f64>,
        tip_node: Option<usize>,
    ) -> Option<FarFace> {
        let simplex = Simplex::new(corners)?;
        let (coordinates, rates) = (simplex.coordinates(tip), simplex.rates(direction));
        let steepest = rates.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        let distance = |place: usize| match rates[place] < -PARALLEL * steepest {
            true => coordinates[place] / -rates[place],
            false => f64::INFINITY,
        };
        let opposite = match tip_node {
            Some(place) => place,
            None => geometry::least(&std::array::from_fn(distance)).0,
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

    /// Whether the tip is as near to it as `lambda` circumferences.
    pub fn is_met(&self, lambda: f64) -> bool {
        self.distance <= lambda * self.circumference
    }

    /// Its corners, nearest to P_inter first; of equally near ones the first in the element.
    pub fn nearest_first(&self, corners: &[Vector3<f64>; 4]) -> [usize; 3] {
        let mut places = face(self.opposite);
        places.sort_by(|&a, &b| {
            let [a, b] = [a, b].map(|place| (corners[place] - self.at).norm_squared());
            a.total_cmp(&b)
        });
        places
    }
}

/// The corners of the face opposite a corner.
fn face(opposite: usize) -> [usize; 3] {
    [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]][opposite]
}
