//! Line through a body, the points of the body on it, and the layers along it.

use std::f64::consts::PI;

use nalgebra::Vector3;

use crate::insertion::{InvalidSetup, Peak};
use crate::needle::across;
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

/// Rings of points that represent the patch of the tip in a solid, and points of each.
const RINGS: usize = 8;
const OF_RING: usize = 24;

/// Radius of the patch that gives way as far as linear elements under a force at a point do, over the edge of their
/// cells: fitted, so that an even block gives way alike in lattices of cells of 3 to 5 mm.
const OF_EDGE: f64 = 0.7;

#[derive(Clone, Debug)]
pub(super) struct Line<const D: usize> {
    entry: [f64; D],
    direction: [f64; D],
    /// Elements on or along the line, ascending.
    elements: Vec<u32>,
    /// Points of the surface that the patch of the tip enters by: lines through them beside this one meet the tissue that
    /// bears the force at the tip. None: it acts at a point.
    patch: Vec<[f64; D]>,
    /// Elements that the patch passes.
    beside: Vec<u32>,
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
            patch: Vec::new(),
            beside: Vec::new(),
            points: Vec::new(),
            length: 0.0,
        }
    }

    /// `patch_mm` is the radius of the patch of the tip, 0 for a point.
    pub(super) fn new<const N: usize>(
        body: &NonlinearBody<D, N>,
        entry: [f64; D],
        direction: [f64; D],
        patch_mm: f64,
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
            patch: Vec::new(),
            beside: Vec::new(),
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
        if patch_mm > 0.0 {
            line.spread(body, patch_mm);
        }
        Ok(line)
    }

    /// Spreads the tip over a patch, with the pressure of a flat rigid punch: the tissue under it gives way evenly. What
    /// elements spread already is taken off, as both add up by their squares.
    fn spread<const N: usize>(&mut self, body: &NonlinearBody<D, N>, patch_mm: f64) {
        let near = crossings(body, &self.entry, &self.direction)
            .into_iter()
            .filter(|crossing| crossing.from_mm < 2.0 * patch_mm);
        let sizes: Vec<f64> = near.map(|crossing| body.cell_mm(crossing.element as usize)).collect();
        let edge_mm = sizes.iter().sum::<f64>() / sizes.len().max(1) as f64;
        let patch_mm = (patch_mm.powi(2) - (OF_EDGE * edge_mm).powi(2)).max(0.0).sqrt();
        if patch_mm == 0.0 {
            return;
        }
        for offset in offsets(&self.direction)
            .into_iter()
            .map(|offset| offset.map(|x| x * patch_mm))
        {
            let origin: [f64; D] = std::array::from_fn(|axis| self.entry[axis] + offset[axis]);
            // The surface nearest to the plane through the entry.
            let crossed = crossings(body, &origin, &self.direction);
            let is_entry = |crossing: &&Crossing| {
                let meets =
                    |other: &Crossing| other.from_mm < crossing.from_mm && other.to_mm > crossing.from_mm - BESIDE;
                !crossed.iter().any(meets)
            };
            let entries = crossed.iter().filter(is_entry).map(|crossing| crossing.from_mm);
            if let Some(from_mm) = entries.min_by(|a, b| a.abs().total_cmp(&b.abs())) {
                self.patch.push(std::array::from_fn(|axis| {
                    origin[axis] + from_mm * self.direction[axis]
                }));
                self.beside.extend(crossed.iter().map(|crossing| crossing.element));
            }
        }
        self.beside.sort_unstable();
        self.beside.dedup();
    }

    /// Returns the tissue that bears the force at a tip at a depth, constrained to a displacement along the line: its
    /// patch lies as the surface does.
    pub(super) fn tip<const N: usize>(&self, body: &NonlinearBody<D, N>, depth: f64, place_mm: f64) -> Contact {
        let mut contact = Contact {
            weights: Vec::new(),
            place_mm,
        };
        let mut points = 0.0;
        for start in &self.patch {
            let point: [f64; D] = std::array::from_fn(|axis| start[axis] + depth * self.direction[axis]);
            if let Some((element, least, weights)) = nearest(body, &self.beside, &point)
                // Those of the surface already lie BESIDE outside, more or less by rounding.
                && least > -2.0 * BESIDE
            {
                self.weigh(body, element, &weights, &mut contact);
                points += 1.0;
            }
        }
        if points == 0.0 {
            return self.contact(body, depth, place_mm);
        }
        contact.weights.sort_by_key(|(dof, _)| *dof);
        contact.weights.dedup_by(|next, kept| {
            let is_same = next.0 == kept.0;
            if is_same {
                kept.1 += next.1;
            }
            is_same
        });
        contact.weights.iter_mut().for_each(|(_, weight)| *weight /= points);
        contact
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
        let mut contact = Contact {
            weights: Vec::with_capacity(D * N),
            place_mm,
        };
        if let Some((element, _, weights)) = self.find(body, depth) {
            self.weigh(body, element, &weights, &mut contact);
        }
        contact
    }

    /// Adds the displacement along the line of a point of an element to that of a contact.
    fn weigh<const N: usize>(
        &self,
        body: &NonlinearBody<D, N>,
        element: usize,
        weights: &[f64; N],
        contact: &mut Contact,
    ) {
        for (node, weight) in body.elements()[element].iter().zip(weights) {
            let components = self.direction.iter().enumerate();
            for (axis, component) in components.filter(|(_, component)| **component != 0.0) {
                contact
                    .weights
                    .push((D as u32 * node + axis as u32, weight * component));
            }
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

    /// Finds the element on the line that contains the point at a depth, or is nearest to it.
    fn find<const N: usize>(&self, body: &NonlinearBody<D, N>, depth: f64) -> Option<(usize, f64, [f64; N])> {
        let point: [f64; D] = std::array::from_fn(|axis| self.entry[axis] + depth * self.direction[axis]);
        nearest(body, &self.elements, &point)
    }
}

/// Returns the element among some that contains a point, or is nearest to it: that with the largest least barycentric
/// coordinate, which comes with it.
fn nearest<const D: usize, const N: usize>(
    body: &NonlinearBody<D, N>,
    elements: &[u32],
    point: &[f64; D],
) -> Option<(usize, f64, [f64; N])> {
    let mut best: Option<(usize, f64, [f64; N])> = None;
    for &element in elements {
        let weights = body.barycentric(element as usize, point);
        let least = weights.iter().fold(f64::INFINITY, |a: f64, b| a.min(*b));
        if best.is_none_or(|(_, best_weight, _)| least > best_weight) {
            best = Some((element as usize, least, weights));
        }
    }
    best
}

/// Returns points across a line, of equal force under a flat rigid punch of radius 1: its pressure grows towards its edge
/// as 1 / sqrt(1 - r^2), of a strip in a plane and of a disk (Johnson 1985, "Contact Mechanics", sections 2.8 and 3.4).
fn offsets<const D: usize>(direction: &[f64; D]) -> Vec<[f64; D]> {
    let along = Vector3::from_fn(|axis, _| direction.get(axis).copied().unwrap_or(0.0));
    let [first, second] = if D == 2 {
        [Vector3::new(-along.y, along.x, 0.0), Vector3::zeros()]
    } else {
        across(&along)
    };
    let mut points = Vec::new();
    if D == 2 {
        for index in 0..OF_RING {
            let quantile = (index as f64 + 0.5) / OF_RING as f64;
            points.push(first * (PI * (quantile - 0.5)).sin());
        }
    } else {
        for ring in 0..RINGS {
            let inside = (ring as f64 + 0.5) / RINGS as f64;
            let radius = (1.0 - (1.0 - inside).powi(2)).sqrt();
            for index in 0..OF_RING {
                // Rings are turned against each other.
                let (sin, cos) = (2.0 * PI * (index as f64 + 0.5 * (ring % 2) as f64) / OF_RING as f64).sin_cos();
                points.push((first * cos + second * sin) * radius);
            }
        }
    }
    points
        .iter()
        .map(|point| std::array::from_fn(|axis| point[axis]))
        .collect()
}
