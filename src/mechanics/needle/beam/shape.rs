//! Solution of the beam problem: shape of the needle, and its centres of motion.

use nalgebra::{Vector2, Vector4};

use super::foundation::{self, cubics};
use super::problem::{Bed, Division};

/// Bisections that find a zero of a cubic to the last bit.
const HALVINGS: usize = 80;

/// Share of the largest deflection below which the deflection at the entry counts as 0: the needle pivots there.
const NOTHING: f64 = 1e-9;

/// A node of the needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position along the undeflected needle, mm from the entry.
    pub x_mm: f64,
    /// Deflection, mm.
    pub u_mm: f64,
    /// Slope du/dx.
    pub slope: f64,
    /// Reaction of the tissue per length of needle, F, N/mm: it has the sign of the deflection and pushes the needle
    /// back. At layer boundaries, that of the deeper layer; 0 outside the tissue.
    pub reaction_n_per_mm: f64,
    /// Compression ratio of the tissue (1: not compressed). At layer boundaries, that of the deeper layer; 1 outside
    /// the tissue.
    pub ratio: f64,
}

/// Load on the part of a layer along the needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerLoad {
    /// Index of the layer, from 0.
    pub layer: usize,
    /// Beginning of the layer, and end of it or of the needle, mm from the entry.
    pub depths_mm: [f64; 2],
    /// Least compression ratio of the tissue at the points.
    pub least_ratio: f64,
    /// Depth of that point, mm from the entry.
    pub least_at_mm: f64,
    /// Largest magnitude of the reaction per length at the points, N/mm.
    pub most_n_per_mm: f64,
    /// Force of the needle on the layer, N, along positive deflections.
    pub force_n: f64,
}

/// Shape of a needle whose base has been moved: a cubic between its points.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Points from base to tip.
    pub points: Vec<Point>,
    /// Force on the base, N, along the deflection.
    pub base_force_n: f64,
    /// Moment on the base, N mm, positive in the direction in which the slope rises.
    pub base_moment_nmm: f64,
    /// Bending energy, N mm.
    pub bending_energy_nmm: f64,
    /// Layers that the needle reaches, from the entry on.
    pub layers: Vec<LayerLoad>,
    /// Least compression ratio of the tissue at the points; 1 without tissue.
    pub least_ratio: f64,
    /// Largest residual moment over the largest moment.
    pub residual: f64,
    /// Number of Newton steps.
    pub iterations: usize,
    /// Index of the point at the entry.
    entry: usize,
}

impl Shape {
    /// Builds a shape; `forces` act on the tissue of each element, `sums` are force and moment at the base and the
    /// energy, `effort` residual and iterations.
    pub(super) fn new(
        division: &Division,
        beds: &[Bed],
        nodes: &[Vector2<f64>],
        forces: &[f64],
        sums: [f64; 3],
        effort: (f64, usize),
    ) -> Self {
        let points = nodes.iter().enumerate().map(|(index, node)| {
            let [before, after] = [index.checked_sub(1), Some(index)].map(|element| *division.layers.get(element?)?);
            let bed = after.or(before).map(|layer| &beds[layer]);
            let reaction = bed.and_then(|bed| foundation::reaction(bed, node.x, node.y));
            Point {
                x_mm: division.nodes[index],
                u_mm: node.x,
                slope: node.y,
                reaction_n_per_mm: reaction.map_or(0.0, |reaction| reaction.force),
                ratio: bed.map_or(1.0, |bed| foundation::ratio(bed, node.x)),
            }
        });
        let points = points.collect();
        let layers = layer_loads(division, beds, nodes, forces);
        let least_ratio = layers
            .iter()
            .fold(1.0, |least: f64, layer| least.min(layer.least_ratio));
        Shape {
            points,
            layers,
            base_force_n: sums[0],
            base_moment_nmm: sums[1],
            bending_energy_nmm: sums[2],
            least_ratio,
            residual: effort.0,
            iterations: effort.1,
            entry: division.entry,
        }
    }

    /// Returns the deflection of the tip, mm.
    pub fn tip_mm(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.u_mm)
    }

    /// Returns the remote centre of motion: the intersection of the tangent at the base with the undeflected needle, as
    /// a depth from the entry (mm, negative before it). `None` for a base that has not turned.
    pub fn rcm_mm(&self) -> Option<f64> {
        let base = self.points.first()?;
        let rcm = base.x_mm - base.u_mm / base.slope;
        (base.slope != 0.0).then_some(rcm)
    }

    /// Returns the centre of motion: the smallest depth from the entry (mm) at which the needle is not deflected.
    /// `None` if there is none, or if it is undeflected everywhere.
    pub fn com_mm(&self) -> Option<f64> {
        let inside = &self.points[self.entry..];
        if inside.iter().all(|point| point.u_mm == 0.0) {
            return None;
        }
        let largest = self
            .points
            .iter()
            .fold(0.0, |most: f64, point| most.max(point.u_mm.abs()));
        if inside[0].u_mm.abs() <= NOTHING * largest {
            return Some(0.0);
        }
        inside.windows(2).find_map(|pair| first_zero(&pair[0], &pair[1]))
    }

    /// Returns deflection (mm) and slope at a position (mm from the entry), between base and tip.
    pub fn at(&self, x_mm: f64) -> [f64; 2] {
        let last = self.points.len() - 1;
        let after = self
            .points
            .partition_point(|point| point.x_mm <= x_mm)
            .clamp(1.min(last), last);
        match after.checked_sub(1) {
            None => [self.points[0].u_mm, self.points[0].slope],
            Some(before) => between(&self.points[before], &self.points[after], x_mm),
        }
    }
}

fn layer_loads(division: &Division, beds: &[Bed], nodes: &[Vector2<f64>], forces: &[f64]) -> Vec<LayerLoad> {
    let mut loads: Vec<LayerLoad> = Vec::new();
    for (element, layer) in division.layers.iter().enumerate() {
        let Some(layer) = *layer else { continue };
        let from_mm = division.nodes[element];
        if loads.last().is_none_or(|last| last.layer != layer) {
            loads.push(LayerLoad {
                layer,
                depths_mm: [from_mm; 2],
                least_ratio: 1.0,
                least_at_mm: from_mm,
                most_n_per_mm: 0.0,
                force_n: 0.0,
            });
        }
        let Some(load) = loads.last_mut() else { continue };
        load.depths_mm[1] = division.nodes[element + 1];
        load.force_n += forces[element];
        // Both ends of each element: where layers meet, a node counts with the tissue of either.
        for node in [element, element + 1] {
            let (bed, q) = (&beds[layer], &nodes[node]);
            let ratio = foundation::ratio(bed, q.x);
            if ratio < load.least_ratio {
                (load.least_ratio, load.least_at_mm) = (ratio, division.nodes[node]);
            }
            let reaction = foundation::reaction(bed, q.x, q.y).map_or(0.0, |reaction| reaction.force.abs());
            load.most_n_per_mm = load.most_n_per_mm.max(reaction);
        }
    }
    loads
}

fn between(near: &Point, far: &Point, x_mm: f64) -> [f64; 2] {
    let length = far.x_mm - near.x_mm;
    let (values, slopes) = cubics(length, (x_mm - near.x_mm) / length);
    let ends = Vector4::new(near.u_mm, near.slope, far.u_mm, far.slope);
    [values.dot(&ends), slopes.dot(&ends)]
}

/// Returns the first zero in an element, excluding its near end.
fn first_zero(near: &Point, far: &Point) -> Option<f64> {
    let (from, length) = (near.x_mm, far.x_mm - near.x_mm);
    // Between its extrema the cubic is monotonic: u' = slope + 2 b s + 3 c s^2 of the share s.
    let chord = far.u_mm - near.u_mm;
    let (a, end) = (near.slope * length, far.slope * length);
    let (b, c) = (3.0 * chord - 2.0 * a - end, a + end - 2.0 * chord);
    let root = (b * b - 3.0 * a * c).max(0.0).sqrt();
    // Where it turns, by the roots of u', or of its linear part if c is 0; bisection between them cannot miss the first
    // zero.
    let mut shares = [
        0.0,
        (-b - root) / (3.0 * c),
        (-b + root) / (3.0 * c),
        -a / (2.0 * b),
        1.0,
    ]
    .map(|share| if (0.0..=1.0).contains(&share) { share } else { 1.0 });
    shares.sort_by(f64::total_cmp);
    let deflection = |share: f64| between(near, far, from + share * length)[0];
    let crossed = |pair: &&[f64]| {
        let [near, far] = [pair[0], pair[1]].map(deflection);
        pair[0] < pair[1] && (far == 0.0 || near * far < 0.0)
    };
    let pair = shares.windows(2).find(crossed)?;
    let (mut low, mut high) = (pair[0], pair[1]);
    let sign = deflection(low);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if deflection(middle) * sign > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(from + high * length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the first zero of one element of 2 mm from 3 mm on.
    fn zero(u: [f64; 2], slopes: [f64; 2]) -> Option<f64> {
        let point = |x_mm, u_mm, slope| Point {
            x_mm,
            u_mm,
            slope,
            reaction_n_per_mm: 0.0,
            ratio: 1.0,
        };
        first_zero(&point(3.0, u[0], slopes[0]), &point(5.0, u[1], slopes[1]))
    }

    #[test]
    fn zeros_are_found_within_elements() {
        let near = |zero: Option<f64>, expected: f64| {
            let zero = zero.expect("a zero");
            assert!((zero - expected).abs() < 1e-14 * 8.0, "{zero} {expected}");
        };
        // A line, and cubics (x - 3.5)(x - 4.5) and (x - 3.25)(x - 4)(x - 4.5), of whose zeros the first counts.
        near(zero([1.0, -3.0], [-2.0, -2.0]), 3.5);
        near(zero([0.75, 0.75], [-2.0, 2.0]), 3.5);
        let slope = |x: f64| (x - 4.0) * (x - 4.5) + (x - 3.25) * (x - 4.5) + (x - 3.25) * (x - 4.0);
        near(zero([-0.375, 0.875], [slope(3.0), slope(5.0)]), 3.25);
        // (x - 3.55)(x - 3.9)(x - 4): only its first extremum parts the zeros.
        let cubic = |x: f64| (x - 3.55) * (x - 3.9) * (x - 4.0);
        let slope = |x: f64| (x - 3.9) * (x - 4.0) + (x - 3.55) * (x - 4.0) + (x - 3.55) * (x - 3.9);
        near(zero([3.0, 5.0].map(cubic), [3.0, 5.0].map(slope)), 3.55);
        // At the far end, and without a zero.
        near(zero([1.0, 0.0], [-0.5, -0.5]), 5.0);
        assert_eq!(zero([1.0, 2.0], [0.5, 0.5]), None);
        assert_eq!(zero([1.0, 1.0], [-0.1, 0.1]), None);
    }
}
