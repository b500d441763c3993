//! Straight cylinder in the thickened scan plane: filled fraction of the plane, and echo along a scanline.

use super::{BEVEL, BEVEL_MM, GRAIN_MM, NeedleParams, Segment};
use crate::effects::common::scatterers;
use insonify_base::real::Real;

/// A straight segment of the needle in the probe frame.
pub struct Shaft<T> {
    start: [T; 3],
    axis: [T; 3],
    length: T,
    radius: T,
    half_thickness: T,
    /// Distances of its ends from the tip, mm.
    from_tip: [T; 2],
    number: T,
    factor: T,
}

impl<T: Real> Shaft<T> {
    /// Creates the cylinder of a segment with the plane thickness for it.
    pub fn new([start, end, [first, last, number, factor]]: Segment<T>) -> Self {
        let along = [end[0] - start[0], end[1] - start[1], end[2] - start[2]];
        let length = (along[0] * along[0] + along[1] * along[1] + along[2] * along[2]).sqrt();
        let safe = length.max(T::of(1e-9));
        let half = T::of(0.5);
        Self {
            start: [start[0], start[1], start[2]],
            axis: along.map(|x| x / safe),
            length,
            radius: start[3],
            half_thickness: half * end[3],
            from_tip: [first, last],
            number,
            factor,
        }
    }

    /// Fraction of the plane's thickness inside the cylinder at a point of the plane.
    #[inline(always)]
    pub fn share(&self, x: T, y: T) -> T {
        let u = self.axis;
        let q = [x - self.start[0], y - self.start[1], -self.start[2]];
        let along = q[0] * u[0] + q[1] * u[1] + q[2] * u[2];
        // Distance from the axis at elevation z: |w + z v|, with w and v the parts of q and of z's axis across the
        // shaft.
        let w = [q[0] - along * u[0], q[1] - along * u[1], q[2] - along * u[2]];
        let a = T::one() - u[2] * u[2];
        let b = w[2];
        let c = w[0] * w[0] + w[1] * w[1] + w[2] * w[2] - self.radius * self.radius;
        let (mut low, mut high) = (-self.half_thickness, self.half_thickness);
        if a > T::of(PARALLEL) {
            let root = b * b - a * c;
            if root <= T::zero() {
                return T::zero();
            }
            let root = root.sqrt();
            low = low.max((-b - root) / a);
            high = high.min((-b + root) / a);
        } else if c > T::zero() {
            return T::zero();
        }
        if u[2].abs() > T::of(PARALLEL) {
            let (z0, z1) = (-along / u[2], (self.length - along) / u[2]);
            low = low.max(z0.min(z1));
            high = high.min(z0.max(z1));
        } else if along < T::zero() || along > self.length {
            return T::zero();
        }
        (high - low).max(T::zero()) / (self.half_thickness + self.half_thickness)
    }

    /// Complex multiplier of the echo at a point of the plane: grains along the shaft, and a needle's brighter bevel.
    #[inline(always)]
    pub(crate) fn grain(&self, x: T, y: T, numbers: &NeedleParams) -> [T; 2] {
        let along =
            (x - self.start[0]) * self.axis[0] + (y - self.start[1]) * self.axis[1] - self.start[2] * self.axis[2];
        let share = (along / self.length.max(T::of(1e-9))).max(T::zero()).min(T::one());
        let from_tip = self.from_tip[0] + share * (self.from_tip[1] - self.from_tip[0]);
        let lattice_point = [from_tip * T::of(1.0 / GRAIN_MM), self.number, T::zero()];
        let ([re], [im]) = scatterers(&lattice_point.map(|x| [x]), numbers.seed);
        let [steady, diffuse] = [numbers.steady, numbers.diffuse].map(|x| T::of(f64::from(x)));
        let is_bevel = self.number == T::zero() && from_tip < T::of(BEVEL_MM);
        let factor = if is_bevel {
            T::of(BEVEL) * self.factor
        } else {
            self.factor
        };
        [factor * (steady + diffuse * re), factor * diffuse * im]
    }

    /// Adds the echo and its repetitions to a scanline, and the filled and shaded fractions to the mask.
    pub(super) fn scanline(
        &self,
        ray: [T; 4],
        numbers: &NeedleParams,
        mask: &mut [[T; 2]],
        mut add: impl FnMut(usize, [T; 2]),
    ) {
        let step = T::of(f64::from(numbers.sample_mm));
        let half = T::of(0.5);
        let cosine = ray[2] * self.axis[0] + ray[3] * self.axis[1];
        let square = (T::one() - cosine * cosine)
            .max(T::zero())
            .sqrt()
            .powf(T::of(f64::from(numbers.directivity)));
        let mut echo = T::of(f64::from(numbers.echo)) * square;
        let Some((first, last)) = self.depths(ray) else { return };
        let thickness = self.half_thickness + self.half_thickness;
        let of_beam = (thickness * T::of(f64::from(numbers.beams_per_mm))).min(T::one());
        for repetition in 0..=numbers.reverberations {
            let shift = T::of(f64::from(repetition)) * T::of(f64::from(numbers.reverberation_mm));
            // A sample more at either end, so that rounding loses none: the share is 0 beside the shaft.
            let from = ((first + shift) / step - half)
                .floor()
                .max(T::zero())
                .to_usize()
                .unwrap_or(0);
            let to = ((last + shift) / step + half)
                .ceil()
                .max(T::zero())
                .to_usize()
                .unwrap_or(0)
                .min(mask.len());
            for i in from..to {
                let depth = (T::of(i as f64) + half) * step - shift;
                let (x, y) = (ray[0] + ray[2] * depth, ray[1] + ray[3] * depth);
                let share = self.share(x, y);
                // Repetitions are heard where there is no needle.
                if repetition == 0 {
                    let [filled, shaded] = mask[i];
                    let more = (filled + share).min(T::one());
                    mask[i] = [more, shaded + (more - filled) * of_beam];
                }
                if share > T::zero() {
                    add(i, self.grain(x, y, numbers).map(|part| echo * share * part));
                }
            }
            echo *= T::of(f64::from(numbers.reverberation));
        }
    }

    /// Depth interval in which a ray may meet the thickened shaft: where its distance from the axis is below the
    /// combined thickness of cylinder and plane.
    fn depths(&self, ray: [T; 4]) -> Option<(T, T)> {
        let u = self.axis;
        let q = [ray[0] - self.start[0], ray[1] - self.start[1], -self.start[2]];
        let d = [ray[2], ray[3], T::zero()];
        let dot = |p: [T; 3], q: [T; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        let across = |p: [T; 3]| {
            let along = dot(p, u);
            [p[0] - along * u[0], p[1] - along * u[1], p[2] - along * u[2]]
        };
        let (w, v) = (across(q), across(d));
        let reach = self.radius + self.half_thickness;
        let (a, b, c) = (dot(v, v), dot(w, v), dot(w, w) - reach * reach);
        if a <= T::of(PARALLEL) {
            let far = self.length + dot(q, u).abs() + reach;
            return (c <= T::zero()).then_some((T::zero(), far));
        }
        let root = b * b - a * c;
        (root >= T::zero()).then(|| ((-b - root.sqrt()) / a, (-b + root.sqrt()) / a))
    }
}

/// Squared sine, or cosine, below which a shaft counts as parallel, or perpendicular, to a direction: for a needle
/// of 200 mm the resulting error is below 0.1 mm.
const PARALLEL: f64 = 1e-7;

#[cfg(test)]
mod tests;
