//! Periodic cells: the Voronoi regions of one jittered point in each box of a lattice (S. Worley, SIGGRAPH 1996).

use super::field::{Grid, Seed};
use crate::random::unit;

/// A lattice of boxes over one period, with a point in each.
pub(super) struct Cells {
    counts: [i32; 3],
    box_mm: [f32; 3],
    /// Position of each point within its box, in boxes, and a random number in [0, 1) per cell.
    points: Vec<([f32; 3], f32)>,
}

/// Location of a position within its cell.
pub(super) struct Place {
    /// Distance to the nearest wall, mm.
    pub wall_mm: f32,
    /// Absolute cosine of the angle between the wall's normal and each axis: 1 along it, 0 across it.
    pub facing: [f32; 3],
    /// Random number of the cell in [0, 1).
    pub id: f32,
}

/// Fraction of a box over which its point is jittered; the rest avoids sliver cells.
const JITTER: f32 = 0.85;

impl Cells {
    /// Creates cells of about `box_mm`, adjusted so that a whole number fits the period of `grid`.
    pub fn new(grid: &Grid, seed: Seed, stream: u32, box_mm: [f32; 3]) -> Self {
        let period = grid.period_mm();
        let counts = [0, 1, 2].map(|axis| (period[axis] / box_mm[axis]).round().max(1.0) as i32);
        let (place, identity) = (seed.words(stream), seed.words(stream + 1));
        let mut points = Vec::new();
        for k in 0..counts[2] {
            for j in 0..counts[1] {
                for i in 0..counts[0] {
                    let offset = place([i, j, k]).map(|word| 0.5 + JITTER * (unit(word) - 0.5));
                    points.push((offset, unit(identity([i, j, k])[0])));
                }
            }
        }
        Self {
            counts,
            box_mm: [0, 1, 2].map(|axis| period[axis] / counts[axis] as f32),
            points,
        }
    }

    /// Locates `position` (mm). Distances are measured in boxes, so that cells are as flat as their boxes.
    pub fn place(&self, position: [f32; 3]) -> Place {
        let scaled = [0, 1, 2].map(|axis| position[axis] / self.box_mm[axis]);
        let home = scaled.map(|x| x.floor() as i32);
        let mut nearest = [(f32::INFINITY, [0.0f32; 3], 0.0f32); 2];
        for dk in -1..=1 {
            for dj in -1..=1 {
                for di in -1..=1 {
                    let cell = [home[0] + di, home[1] + dj, home[2] + dk];
                    let [i, j, k] = [0, 1, 2].map(|axis| cell[axis].rem_euclid(self.counts[axis]));
                    let (offset, id) = self.points[(i + self.counts[0] * (j + self.counts[1] * k)) as usize];
                    let to = [0, 1, 2].map(|axis| cell[axis] as f32 + offset[axis] - scaled[axis]);
                    let square = to.iter().map(|x| x * x).sum();
                    if square < nearest[0].0 {
                        nearest = [(square, to, id), nearest[0]];
                    } else if square < nearest[1].0 {
                        nearest[1] = (square, to, id);
                    }
                }
            }
        }
        let [(first, a, id), (second, b, _)] = nearest;
        // The wall is the plane second - first = 0; its distance is that difference over its gradient, in mm.
        let gradient = [0, 1, 2].map(|axis| 2.0 * (b[axis] - a[axis]) / self.box_mm[axis]);
        let steepness = gradient.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-6);
        Place {
            wall_mm: (second - first) / steepness,
            facing: gradient.map(|x| x.abs() / steepness),
            id,
        }
    }
}
