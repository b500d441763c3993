//! Bright flattened strands in a periodic grid, nearly parallel to its first axis.

use super::field::{Grid, Seed};
use crate::random::unit;

/// Geometry and brightness of strands. Each is a ribbon with a soft edge that tapers towards its ends.
pub(super) struct Strands {
    /// Number of strands per 1000 cubic millimetres.
    pub density: f32,
    /// Minimum and maximum length, mm.
    pub length_mm: [f32; 2],
    /// Minimum and maximum thickness across the ribbon (full width at 1/e), mm.
    pub thickness_mm: [f32; 2],
    /// Minimum and maximum width along the ribbon, mm.
    pub width_mm: [f32; 2],
    /// Minimum and maximum peak, dB above the surroundings.
    pub peak_db: [f32; 2],
    /// Largest slope relative to the first axis (tangent).
    pub slope: f32,
    /// Largest angle between a ribbon's normal and the second axis, radians.
    pub roll: f32,
}

/// Height of a strand below which it is ignored, dB.
const FAINT_DB: f32 = 0.3;

impl Strands {
    /// Decibels above 0 in each voxel: those of the brightest strand through it.
    pub fn lay(&self, grid: &Grid, seed: Seed, stream: u32) -> Vec<f32> {
        let period = grid.period_mm();
        let count = (self.density * period.iter().product::<f32>() / 1000.0).round() as i32;
        let streams = [0, 1, 2].map(|n| seed.words(stream + n));
        let mut data = vec![0.0; grid.size.iter().product()];
        for number in 0..count {
            let [a, b, c] = [0, 1, 2].map(|n| streams[n]([number, 0, 0]).map(unit));
            self.lay_one(grid, &mut data, [a, b, c]);
        }
        data
    }

    fn lay_one(&self, grid: &Grid, data: &mut [f32], [at, shape, lie]: [[f32; 3]; 3]) {
        let pick = |[low, high]: [f32; 2], share: f32| low + share * (high - low);
        let period = grid.period_mm();
        let centre = [0, 1, 2].map(|axis| at[axis] * period[axis]);
        let half_length = 0.5 * pick(self.length_mm, shape[0] * shape[0]);
        let half_thickness = 0.5 * pick(self.thickness_mm, shape[1]);
        let half_width = 0.5 * pick(self.width_mm, lie[1]);
        let peak = pick(self.peak_db, shape[2]);
        let (sin, cos) = (self.roll * (2.0 * lie[0] - 1.0)).sin_cos();
        let slope = [lie[2], (lie[2] * 7.31).fract()].map(|share| self.slope * (2.0 * share - 1.0));
        // A slight bow, so that no strand is exactly straight.
        let bow = 0.35 * (2.0 * (lie[1] * 5.17).fract() - 1.0);

        let reach = half_thickness.max(half_width) * (peak / FAINT_DB).ln().max(0.0).sqrt();
        let span = |axis: usize, middle: f32, reach: f32| {
            let spacing = grid.spacing_mm[axis];
            (((middle - reach) / spacing).ceil() as i64)..=(((middle + reach) / spacing).floor() as i64)
        };
        let wrap = |index: i64, axis: usize| index.rem_euclid(grid.size[axis] as i64) as usize;
        for i in span(0, centre[0], half_length) {
            let along = i as f32 * grid.spacing_mm[0] - centre[0];
            let share = along / half_length;
            let taper = (1.0 - share * share).max(0.0);
            let middle = [centre[1] + slope[0] * along + bow * taper, centre[2] + slope[1] * along];
            for k in span(2, middle[1], reach) {
                let z = k as f32 * grid.spacing_mm[2] - middle[1];
                for j in span(1, middle[0], reach) {
                    let y = j as f32 * grid.spacing_mm[1] - middle[0];
                    let (across, beside) = (cos * y + sin * z, cos * z - sin * y);
                    let height = peak
                        * taper.sqrt()
                        * (-(across / half_thickness).powi(2) - (beside / half_width).powi(2)).exp();
                    let voxel = wrap(i, 0) + grid.size[0] * (wrap(j, 1) + grid.size[1] * wrap(k, 2));
                    data[voxel] = data[voxel].max(height);
                }
            }
        }
    }
}
