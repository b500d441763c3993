//! The slab of a frame in the frame of the probe: which elements cross it, and the scanlines that can meet them.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Matrix4;

use super::LANES;
use crate::synth::tables::Tables;
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, Pack, array, map};
use insonify_mesh::element::MAX_REACH;
use insonify_tracking::probe::BeamGrid;

/// Bound on the rounding error of the position of a sample, in epsilons of the largest coordinate.
const POINT_EPSILONS: f64 = 16.0;

/// The slab in the frame of the probe, mm.
pub(crate) struct SlabView<'a> {
    grid: &'a BeamGrid,
    to_probe: [[f64; 4]; 3],
    /// Largest factor by which lengths grow in the probe frame.
    scale: f64,
    /// Box around all samples.
    bounds: [[f64; 3]; 2],
    /// Rounding of a position.
    margin: f64,
}

impl<'a> SlabView<'a> {
    /// The slab of a frame whose positions are computed in `T`.
    pub(super) fn new<T: Real>(tables: &'a Tables, probe_to_world: &Matrix4<f64>) -> Self {
        // Frames are refused whose pose has no inverse.
        let inverse = probe_to_world.try_inverse().unwrap_or(Matrix4::repeat(f64::NAN));
        let scale = inverse.fixed_view::<3, 3>(0, 0).norm();
        let sector = tables.grid.bounds_mm();
        let bounds = [[sector.min[0], sector.min[1], 0.0], [sector.max[0], sector.max[1], 0.0]];
        let farthest = bounds.iter().flatten().fold(0.0f64, |far, x| far.max(x.abs()));
        let rows = probe_to_world.fixed_view::<3, 4>(0, 0);
        let largest = rows.iter().fold(0.0f64, |sum, x| sum.max(x.abs())) * (1.0 + 3.0 * farthest);
        Self {
            grid: &tables.grid,
            to_probe: std::array::from_fn(|row| std::array::from_fn(|column| inverse[(row, column)])),
            scale,
            bounds,
            margin: scale * POINT_EPSILONS * T::epsilon().wide() * largest,
        }
    }

    /// Whether the box of the nodes of an element, grown by what may test as inside, meets that of the samples. If the
    /// box of several elements does not, none of theirs does. Nodes that are NaN do not count.
    #[inline(always)]
    pub(super) fn meets(&self, in_probe: &[Vec<f64>; 3], nodes: &[u32]) -> bool {
        // Most elements lie beside the plane.
        [2, 0, 1].into_iter().all(|axis| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for &node in nodes {
                let coordinate = in_probe[axis][node as usize];
                low = if coordinate < low { coordinate } else { low };
                high = if coordinate > high { coordinate } else { high };
            }
            let reach = MAX_REACH * (high - low) + self.margin;
            low - reach <= self.bounds[1][axis] && high + reach >= self.bounds[0][axis]
        })
    }

    /// First scanline that can meet each of several elements with these corners, grown by `reach` (mm in the world),
    /// and the one past the last.
    #[inline(always)]
    pub(super) fn lines(&self, corners: &[[Pack<LANES>; 3]; 4], reach: Pack<LANES>) -> [[u32; 2]; LANES] {
        let line_count = self.grid.lines() as u32;
        if line_count == 1 {
            return [[0, 1]; LANES];
        }
        let margin = reach * self.scale + self.margin;
        let planes = [margin * -1.0 + self.bounds[0][2], margin + self.bounds[1][2]];
        let mut directions = Directions::new(self.grid.virtual_apex_mm(), margin);
        for (index, a) in corners.iter().enumerate() {
            directions.take((planes[0] - a[2]).max(a[2] - planes[1]), a[0], a[1]);
            for b in &corners[index + 1..] {
                let per_mm = Pack::splat(1.0) / (a[2] - b[2]);
                for z in planes {
                    let (from, to) = (a[2] - z, b[2] - z);
                    let share = (from * per_mm).max(Pack::splat(0.0)).min(Pack::splat(1.0));
                    // Edges with both ends on one side of the plane are left out.
                    directions.take(from * to, a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]));
                }
            }
        }
        let Directions {
            behind,
            low,
            high,
            clear,
            ..
        } = directions;
        let middle = f64::from(line_count - 1) / 2.0;
        let (low, high, per, near) = match behind {
            None => (low, high, self.grid.to_line_and_depth(1.0, 0.0).0 - middle, NEAR),
            Some(_) => {
                let per = 1.0 / self.grid.angular_spacing();
                (arctangent(low), arctangent(high), per, NEAR + ARCTANGENT_ERROR * per)
            }
        };
        let first = (low * per + (middle - near)).map(f64::ceil);
        let end = (high * per + (middle + near + 1.0)).map(f64::floor);
        array(|lane| {
            if behind.is_some() && clear.0[lane] <= 0.0 {
                return [0, line_count];
            }
            let first = first.0[lane].clamp(0.0, f64::from(line_count)) as u32;
            [first, end.0[lane].clamp(f64::from(first), f64::from(line_count)) as u32]
        })
    }
}

/// Interval of the directions of points, each widened by a margin.
struct Directions {
    /// Distance of the apex in which scanlines meet, at (0, -behind), if they are not parallel.
    behind: Option<f64>,
    margin: Pack<LANES>,
    low: Pack<LANES>,
    high: Pack<LANES>,
    /// Least distance of the points in front of the apex less ten margins, mm: not above 0, directions are undefined.
    clear: Pack<LANES>,
}

impl Directions {
    #[inline(always)]
    fn new(behind: Option<f64>, margin: Pack<LANES>) -> Self {
        let none = Pack::splat(f64::INFINITY);
        Self {
            behind,
            margin,
            low: none,
            high: none * -1.0,
            clear: none,
        }
    }

    /// Takes points at x and y, in the direction x / (y + behind), except where `left_out` is above 0.
    #[inline(always)]
    fn take(&mut self, left_out: Pack<LANES>, x: Pack<LANES>, y: Pack<LANES>) {
        let (zero, none) = (Pack::splat(0.0), Pack::splat(f64::INFINITY));
        let (toward, margin) = match self.behind {
            None => (x, self.margin),
            Some(behind) => {
                let ahead = y + behind;
                let clear = ahead - self.margin * 10.0;
                self.clear = self.clear.min(zero.if_below(left_out, none, clear));
                let per_mm = Pack::splat(1.0) / ahead;
                let toward = x * per_mm;
                // Over `ahead - margin`, which is at least 0.9 of `ahead`.
                (toward, self.margin * (toward.abs() + 1.0) * per_mm * (1.0 / 0.9))
            }
        };
        self.low = self.low.min(zero.if_below(left_out, none, toward - margin));
        self.high = self.high.max(zero.if_below(left_out, none * -1.0, toward + margin));
    }
}

/// Rounding of a scanline, in scanlines.
const NEAR: f64 = 1e-6;

/// Error of [`arctangent`], radians.
const ARCTANGENT_ERROR: f64 = 1.2e-5;

/// Arctangents within [`ARCTANGENT_ERROR`] (Abramowitz and Stegun 1964, 4.4.49).
#[inline(always)]
fn arctangent(tangent: Pack<LANES>) -> Pack<LANES> {
    let one = Pack::splat(1.0);
    let size = tangent.abs();
    let x = size.min(one) / size.max(one);
    let square = x * x;
    let polynomial =
        (((square * 0.020_835_1 - 0.085_133) * square + 0.180_141) * square - 0.330_299_5) * square + 0.999_866;
    let angle = polynomial * x;
    let angle = one.if_below(size, Pack::splat(FRAC_PI_2) - angle, angle);
    Pack(array(|lane| angle.0[lane].copysign(tangent.0[lane])))
}

/// Positions of nodes in the frame of the probe.
pub(crate) struct Projection<'a, T>(pub &'a SlabView<'a>, pub &'a [[T; 3]], pub &'a mut [Vec<f64>; 3]);

impl<T: Real> Kernel for Projection<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self(view, nodes, in_probe) = self;
        for (row, along) in view.to_probe.iter().zip(in_probe) {
            for (along, &node) in along.iter_mut().zip(nodes) {
                let [x, y, z] = map(node, T::wide);
                *along = row[0] * x + row[1] * y + row[2] * z + row[3];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arctangents_are_within_their_error() {
        let numbers = (-400..=400i32).map(|k| f64::from(k).powi(3) * 1e-5);
        for number in numbers.chain([f64::INFINITY, f64::NEG_INFINITY]) {
            let approximated = arctangent(Pack::splat(number)).0;
            let error = (approximated[LANES - 1] - number.atan()).abs();
            assert!(error < ARCTANGENT_ERROR, "{number}: {error}");
        }
    }
}
