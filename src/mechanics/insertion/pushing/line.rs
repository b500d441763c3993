//! Line through a body, the points of the body on it, and the layers along it.

use crate::insertion::{InvalidSetup, Peak};
use crate::tissue::nonlinear::{Contact, NonlinearBody};
use insonify_base::range::{OutOfRange, Ranges};

/// A layer of tissue along the line of the needle, behind a membrane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathLayer {
    /// Start of the layer from the entry, in the reference state, mm. The first begins at 0.
    pub from_mm: f64,
    /// Strength of its membrane, N (0 or more; 0: there is none).
    pub membrane_n: f64,
    /// Cutting force at the tip, N (0 or more).
    pub cutting_n: f64,
    /// Sliding friction per length of shaft, N/mm (0 or more).
    pub friction_n_per_mm: f64,
    /// Ratio of static to sliding friction (1 or more).
    pub static_ratio: f64,
    /// Force per length near the tip while it cuts, in place of the friction there.
    pub peak: Option<Peak>,
}

/// Checks layers, given in the order in which they are met.
pub(super) fn check(layers: &[PathLayer]) -> Result<(), InvalidSetup> {
    if layers.first().is_none_or(|layer| layer.from_mm != 0.0) {
        return Err(InvalidSetup::First {
            found: layers.first().map(|layer| layer.from_mm),
        });
    }
    for (index, layer) in layers.iter().enumerate() {
        let wrong = |key, found: f64, expected| {
            let cause = OutOfRange::new(key, found, expected);
            Err(InvalidSetup::Layer { layer: index, cause })
        };
        let above = index
            .checked_sub(1)
            .map_or(f64::NEG_INFINITY, |above| layers[above].from_mm);
        if !(layer.from_mm.is_finite() && layer.from_mm > above) {
            return wrong("from_mm", layer.from_mm, "more than that of the layer above");
        }
        let forces = [
            ("membrane_n", layer.membrane_n),
            ("cutting_n", layer.cutting_n),
            ("friction_n_per_mm", layer.friction_n_per_mm),
        ];
        for (key, found) in forces {
            if !(found.is_finite() && found >= 0.0) {
                return wrong(key, found, "a finite number, 0 or more");
            }
        }
        let ratio = layer.static_ratio;
        if !(ratio.is_finite() && ratio >= 1.0) {
            return wrong("static_ratio", ratio, "a finite number, 1 or more");
        }
        if let Some(Err(cause)) = layer.peak.map(|peak| peak.check_ranges()) {
            return Err(InvalidSetup::Layer { layer: index, cause });
        }
    }
    Ok(())
}

/// Distance of the points that represent the shaft, mm.
const PIECE_MM: f64 = 0.5;

/// Tolerance of the barycentric coordinates of points on the line: rounding, and lines along faces.
const OUTSIDE: f64 = 1e-9;

/// Tolerance of the barycentric coordinates of elements that the line may pass: larger than [`OUTSIDE`].
const BESIDE: f64 = 1e-6;

#[derive(Clone, Debug)]
pub(super) struct Line<const D: usize> {
    entry: [f64; D],
    direction: [f64; D],
    /// Elements on or along the line, ascending.
    elements: Vec<u32>,
    /// Midpoints of the pieces of the shaft.
    points: Vec<Contact>,
    length: f64,
}

/// Crossing of an element by a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Index of the element, from 0.
    pub element: u32,
    /// Start of the crossing, mm from the origin of the line.
    pub from_mm: f64,
    /// End of the crossing, mm from the origin of the line.
    pub to_mm: f64,
}

/// Returns the elements that a line passes through or along, ascending; `direction` is of unit length.
pub fn crossings<const D: usize, const N: usize>(
    body: &NonlinearBody<D, N>,
    origin: &[f64; D],
    direction: &[f64; D],
) -> Vec<Crossing> {
    let beyond: [f64; D] = std::array::from_fn(|axis| origin[axis] + direction[axis]);
    let crossing = |element: u32| {
        let (mut from_mm, mut to_mm) = (f64::NEG_INFINITY, f64::INFINITY);
        // Barycentric coordinates are linear along the line, and the line is inside where all are positive: each bounds
        // it on one side. `BESIDE` admits lines along a face.
        let [here, there] = [origin, &beyond].map(|point| body.barycentric(element as usize, point));
        for (here, there) in here.iter().zip(&there) {
            let (inside, slope) = (here + BESIDE, there - here);
            let crossing_mm = -inside / slope;
            if slope > 0.0 {
                from_mm = from_mm.max(crossing_mm);
            } else if slope < 0.0 {
                to_mm = to_mm.min(crossing_mm);
            } else if inside < 0.0 {
                return None;
            }
        }
        (from_mm <= to_mm).then_some(Crossing {
            element,
            from_mm,
            to_mm,
        })
    };
    (0..body.elements().len() as u32).filter_map(crossing).collect()
}

impl<const D: usize> Line<D> {
    /// Returns a line through nothing.
    pub(super) fn empty() -> Self {
        Line {
            entry: [0.0; D],
            direction: [0.0; D],
            elements: Vec::new(),
            points: Vec::new(),
            length: 0.0,
        }
    }

    pub(super) fn new<const N: usize>(
        body: &NonlinearBody<D, N>,
        entry: [f64; D],
        direction: [f64; D],
    ) -> Result<Self, InvalidSetup> {
        let norm = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > 0.0) {
            return Err(InvalidSetup::Direction {
                found: direction.to_vec(),
            });
        }
        let direction = direction.map(|x| x / norm);
        let crossed = crossings(body, &entry, &direction);
        let mut line = Line {
            entry,
            direction,
            elements: crossed.iter().map(|crossing| crossing.element).collect(),
            points: Vec::new(),
            length: 0.0,
        };
        // An entry from `crossings` already lies BESIDE outside, more or less by rounding.
        if line.least(body, 0.0) < -2.0 * BESIDE {
            return Err(InvalidSetup::Outside { entry: entry.to_vec() });
        }
        while line.least(body, line.length + PIECE_MM) >= -OUTSIDE {
            line.points.push(line.contact(body, line.length + 0.5 * PIECE_MM, 0.0));
            line.length += PIECE_MM;
        }
        Ok(line)
    }

    /// Returns the elements that the line passes through or along.
    pub(super) fn elements(&self) -> &[u32] {
        &self.elements
    }

    /// Returns the length of the line in the body, to a piece of the shaft, mm.
    pub(super) fn length(&self) -> f64 {
        self.length
    }

    /// Returns the point at a depth, constrained to a displacement along the line; without weights where there is no
    /// body.
    pub(super) fn contact<const N: usize>(&self, body: &NonlinearBody<D, N>, depth: f64, place_mm: f64) -> Contact {
        let mut entries = Vec::with_capacity(D * N);
        if let Some((element, _, weights)) = self.find(body, depth) {
            for (node, weight) in body.elements()[element].iter().zip(weights) {
                for (axis, component) in self
                    .direction
                    .iter()
                    .enumerate()
                    .filter(|(_, component)| **component != 0.0)
                {
                    entries.push((D as u32 * node + axis as u32, weight * component));
                }
            }
        }
        Contact {
            weights: entries,
            place_mm,
        }
    }

    /// Returns the points that represent the shaft down to a depth, with the start and end of their pieces.
    pub(super) fn pieces(&self, depth: f64) -> impl Iterator<Item = (&Contact, f64, f64)> {
        let pieces = self.points.iter().enumerate().map(move |(index, point)| {
            let from = index as f64 * PIECE_MM;
            (point, from, (from + PIECE_MM).min(depth))
        });
        pieces.take_while(|(_, from, to)| to > from)
    }

    /// Returns the least barycentric coordinate of the point at a depth: how far inside the body it is.
    fn least<const N: usize>(&self, body: &NonlinearBody<D, N>, depth: f64) -> f64 {
        self.find(body, depth).map_or(f64::NEG_INFINITY, |(_, least, _)| least)
    }

    /// Finds the element that contains the point, or is nearest to it: that with the largest least barycentric
    /// coordinate.
    fn find<const N: usize>(&self, body: &NonlinearBody<D, N>, depth: f64) -> Option<(usize, f64, [f64; N])> {
        let point: [f64; D] = std::array::from_fn(|axis| self.entry[axis] + depth * self.direction[axis]);
        let mut best: Option<(usize, f64, [f64; N])> = None;
        for &element in &self.elements {
            let weights = body.barycentric(element as usize, &point);
            let least = weights.iter().fold(f64::INFINITY, |a: f64, b| a.min(*b));
            if best.is_none_or(|(_, best_weight, _)| least > best_weight) {
                best = Some((element as usize, least, weights));
            }
        }
        best
    }
}
