//! A line through a body, and the points of the body on it.

use super::InvalidWay;
use crate::mechanics::tissue::nonlinear::{Body, Contact};

/// Distance of the points that stand for the shaft, mm.
const PIECE_MM: f64 = 0.5;

/// How far outside an element a point may seem to lie, in barycentric coordinates: rounding, and lines along faces.
const OUTSIDE: f64 = 1e-9;

#[derive(Clone, Debug)]
pub struct Line<const D: usize> {
    entry: [f64; D],
    direction: [f64; D],
    /// Points in the middle of each piece.
    points: Vec<Contact>,
    length: f64,
}

impl<const D: usize> Line<D> {
    pub fn new<const N: usize>(body: &Body<D, N>, entry: [f64; D], direction: [f64; D]) -> Result<Self, InvalidWay> {
        let norm = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > 0.0) {
            return Err(InvalidWay::Direction {
                found: direction.to_vec(),
            });
        }
        let mut line = Line {
            entry,
            direction: direction.map(|x| x / norm),
            points: Vec::new(),
            length: 0.0,
        };
        if line.find(body, 0.0).1 < -1e-6 {
            return Err(InvalidWay::Outside { entry: entry.to_vec() });
        }
        while line.find(body, line.length + PIECE_MM).1 >= -OUTSIDE {
            line.points.push(line.contact(body, line.length + 0.5 * PIECE_MM, 0.0));
            line.length += PIECE_MM;
        }
        Ok(line)
    }

    /// How long it is within the body, to a piece of the shaft, mm.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// The point at a depth, held at a displacement along the line.
    pub fn contact<const N: usize>(&self, body: &Body<D, N>, depth: f64, place_mm: f64) -> Contact {
        let (element, _, weights) = self.find_all(body, depth);
        let mut all = Vec::with_capacity(D * N);
        for (node, weight) in body.elements()[element].iter().zip(weights) {
            for (axis, along) in self.direction.iter().enumerate().filter(|(_, along)| **along != 0.0) {
                all.push((D as u32 * node + axis as u32, weight * along));
            }
        }
        Contact { weights: all, place_mm }
    }

    /// Points that stand for the shaft down to a depth, and the piece of it each stands for.
    pub fn pieces(&self, depth: f64) -> impl Iterator<Item = (&Contact, f64, f64)> {
        let pieces = self.points.iter().enumerate().map(move |(at, point)| {
            let from = at as f64 * PIECE_MM;
            (point, from, (from + PIECE_MM).min(depth))
        });
        pieces.take_while(|(_, from, to)| to > from)
    }

    fn find<const N: usize>(&self, body: &Body<D, N>, depth: f64) -> (usize, f64) {
        let (element, least, _) = self.find_all(body, depth);
        (element, least)
    }

    /// The element that holds the point, or is nearest to it: its least barycentric coordinate is the largest.
    fn find_all<const N: usize>(&self, body: &Body<D, N>, depth: f64) -> (usize, f64, [f64; N]) {
        let point: [f64; D] = std::array::from_fn(|axis| self.entry[axis] + depth * self.direction[axis]);
        let mut best = (0, f64::NEG_INFINITY, [0.0; N]);
        for element in 0..body.elements().len() {
            let weights = body.barycentric(element, &point);
            let least = weights.iter().fold(f64::INFINITY, |a: f64, b| a.min(*b));
            if least > best.1 {
                best = (element, least, weights);
            }
        }
        best
    }
}
