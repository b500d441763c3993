//! Error bounds of the needle pass: chords through a cylinder. A chord ends in a square root, so at the edge of the
//! shaft rounding errors enter by their root; in front of the tip and behind the hub the filled share may jump within
//! rounding of the end.

use crate::effects::needle::{BEVEL, BEVEL_MM, GRAIN_MM, NeedleParams, segments};
use nalgebra::{Point3, Vector3};

use crate::effects::speckle::bound::{INTERPOLATION, LOUDEST, SLOPE};
use crate::parity::rounding::{DIVIDE, ROOT, ULP, exp2, log2, root_off};
use crate::parity::{Slack, Step};

/// Needle segment in the probe frame, with the rounding errors of its ends.
struct Segment {
    start: Vector3<f64>,
    axis: Vector3<f64>,
    length: f64,
    /// Error bound of each component of the axis.
    axis_off: f64,
    size: f64,
}

/// Radius of the shaft and thickness of the scan plane, rounded once in both precisions.
struct Plane {
    radius: f64,
    thickness: f64,
}

impl Segment {
    fn new(start: Point3<f64>, end: Point3<f64>) -> Self {
        let span = end - start;
        let size = start.coords.amax().max(end.coords.amax());
        let length = span.norm();
        // Ends stored (1/2 each), difference (1), divided by the length; length from products, sums and a root;
        // division.
        let axis_off = 2.0 * ULP * size / length + (2.0 * ULP + ROOT + 2.0 * 2.0 * ULP * size / length + DIVIDE);
        Self {
            start: start.coords,
            axis: span / length,
            length,
            axis_off,
            size,
        }
    }

    /// Bounds the echo multiplier at a point of the plane known to `off` mm, and its error.
    fn grain(&self, point: [f64; 2], off: f64, [first, last]: [f64; 2], number: f64, factor: f64) -> (f64, f64) {
        let q = Vector3::new(point[0], point[1], 0.0) - self.start;
        let along = q.dot(&self.axis);
        let from_tip = first + (along / self.length).clamp(0.0, 1.0) * (last - first);
        let q_off = off + 0.5 * ULP * self.size + ULP * q.amax();
        let along_off = 3.0 * (q_off + q.amax() * self.axis_off + 4.0 * ULP * q.amax());
        let share_off = (along_off + ULP * self.size) / self.length + DIVIDE + 2.0 * ULP;
        let from_tip_off = share_off * (last - first).abs() + 4.0 * ULP * (first.abs() + last.abs());
        let jumps = number == 0.0 && (from_tip - BEVEL_MM).abs() <= from_tip_off;
        let size = BEVEL * factor * (1.0 + LOUDEST);
        let rough_off = SLOPE * (from_tip_off / GRAIN_MM + 2.0 * ULP * from_tip.abs()) + LOUDEST * INTERPOLATION;
        (
            size,
            BEVEL * factor * (rough_off + 8.0 * ULP * LOUDEST) + if jumps { size } else { 0.0 },
        )
    }

    /// Bounds the error of the filled share at a point of the plane known to `off` mm.
    fn share_off(&self, point: [f64; 2], off: f64, plane: &Plane) -> f64 {
        let u = self.axis;
        let q = Vector3::new(point[0], point[1], 0.0) - self.start;
        let along = q.dot(&u);
        let w = q - along * u;
        let q_off = off + 0.5 * ULP * self.size + ULP * q.amax();
        let along_off = 3.0 * (q_off + q.amax() * self.axis_off + 4.0 * ULP * q.amax());
        let w_off = q_off + along_off + along.abs() * self.axis_off + 2.0 * ULP * (q.amax() + along.abs());
        let half = plane.thickness / 2.0;
        // If the axis clears the slab by more than rounding, the share is zero on both sides.
        if w.norm() > plane.radius + half + 4.0 * w_off {
            return 0.0;
        }
        let a = 1.0 - u.z * u.z;
        let b = w.z;
        let c = w.norm_squared() - plane.radius * plane.radius;
        let a_off = 2.0 * u.z.abs() * self.axis_off + self.axis_off * self.axis_off + 2.0 * ULP;
        let c_off = 2.0 * 3f64.sqrt() * w.norm() * w_off
            + 3.0 * w_off * w_off
            + 4.0 * ULP * (w.norm_squared() + plane.radius.powi(2));
        let mut sides = 0.0;
        if a > 1e-3 {
            let square_off =
                2.0 * b.abs() * w_off + w_off * w_off + a * c_off + c.abs() * a_off + 3.0 * ULP * (b * b + a * c.abs());
            let square = b * b - a * c;
            if square < -square_off {
                return 0.0;
            }
            let root = square.max(0.0).sqrt();
            let root_off = root_off(square.max(0.0), square_off) + ROOT * root;
            let end = (b.abs() + root) / a;
            sides = 2.0 * ((w_off + root_off) / a + end * (a_off / a + DIVIDE + ULP));
        } else if c.abs() <= c_off + 2.0 * (b.abs() + w_off) * half + a * half * half {
            // Axis nearly normal to the plane, at the rim of the disc: the whole chord may appear or vanish.
            return 1.0;
        }
        let mut ends = 0.0;
        for cap in [along, along - self.length] {
            // The end of the shaft crosses the slab here, or may do so within rounding.
            if cap.abs() <= half * u.z.abs() + along_off + half * self.axis_off {
                ends += 2.0 * (along_off + half * self.axis_off + 3.0 * ULP * self.length) / u.z.abs().max(1e-30);
            }
        }
        ((sides + ends) / plane.thickness + (DIVIDE + 4.0 * ULP)).min(1.0)
    }
}

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let needle = step.tables.settings.effects.needle.clone().unwrap_or_default();
    slack.mask = vec![0.0; step.lines() * step.samples()];
    slack.shade = slack.mask.clone();
    // Stored once for all backends: the reference reads the same rounded numbers.
    let numbers = NeedleParams {
        echo: 10f64.powf(needle.echo_db / 20.0) as f32,
        reverberation: 10f64.powf(-needle.reverberation_db / 20.0) as f32,
        reverberation_mm: needle.reverberation_mm as f32,
        ..bytemuck::Zeroable::zeroed()
    };
    let beam_mm = step
        .tables
        .settings
        .effects
        .shadow
        .as_ref()
        .map(|shadow| shadow.needle_beam_mm());
    if slack.specular.is_empty() {
        slack.specular = vec![[0.0; 2]; step.lines() * step.samples()];
    }
    for [start, end, [first, last, number, factor]] in segments(step.tables, step.state) {
        let plane = Plane {
            radius: start[3],
            thickness: end[3],
        };
        let of_beam = beam_mm.map_or(0.0, |beam_mm| (plane.thickness / beam_mm).min(1.0));
        let point = |end: [f64; 4]| Point3::new(end[0], end[1], end[2]);
        let segment = Segment::new(point(start), point(end));
        for line in 0..step.lines() {
            let ray = step.tables.rays[line];
            let cosine = ray[2] * segment.axis.x + ray[3] * segment.axis.y;
            let (square, square_off) = squareness(cosine, 2.0 * (segment.axis_off + 2.0 * ULP), needle.directivity);
            for sample in 0..step.samples() {
                let index = line * step.samples() + sample;
                let mut echo = f64::from(numbers.echo);
                for repetition in 0..=needle.reverberations {
                    let shift = f64::from(repetition) * f64::from(numbers.reverberation_mm);
                    let depth = step.tables.grid.sample_depth_mm(sample) - shift;
                    let point = [ray[0] + ray[2] * depth, ray[1] + ray[3] * depth];
                    // Ray and depth as in the geometry pass, difference with the shift, and sum.
                    let size = ray[0].abs().max(ray[1].abs()) + depth.abs() + 2.0 * shift;
                    let off = 6.0 * ULP * size;
                    let share_off = segment.share_off(point, off, &plane);
                    let repeated = (f64::from(repetition) + 4.0) * ULP;
                    let (grain, grain_off) = segment.grain(point, off, [first, last], number, factor);
                    // The needle is absent if the share is zero on both sides.
                    let share = if share_off > 0.0 { 1.0 } else { 0.0 };
                    let loud = echo * share * square;
                    let departs = echo * (square * (share_off + repeated) + square_off) * (grain + grain_off) * share
                        + loud * (grain_off + 6.0 * ULP * grain);
                    if step.tables.effects.speckle.is_some() {
                        slack.specular[index][0] += departs + ULP * slack.specular[index][1];
                        slack.specular[index][1] += loud * grain;
                    } else {
                        slack.amplitude[index] += departs + ROOT * loud * grain;
                    }
                    if repetition == 0 {
                        let before = slack.mask[index];
                        slack.mask[index] = (before + share_off + ULP).min(1.0);
                        // No change if the share is zero on both sides. Otherwise the shaded share grows by as much as
                        // the filled one: a difference of two sums, times the share of the beam (stored and
                        // multiplied), added.
                        if share_off > 0.0 {
                            slack.shade[index] += of_beam * (before + slack.mask[index]) + 5.0 * ULP;
                        }
                    }
                    echo *= f64::from(numbers.reverberation);
                }
                slack.amplitude[index] += ULP * step.after.amplitude[index] * f64::from(needle.reverberations + 1);
            }
        }
    }
}

/// Returns the power of the sine between shaft and beam, and its error bound.
fn squareness(cosine: f64, cosine_off: f64, power: f64) -> (f64, f64) {
    let square = (1.0 - cosine * cosine).max(0.0);
    let off = 2.0 * cosine.abs() * cosine_off + cosine_off * cosine_off + 2.0 * ULP;
    let sine = square.sqrt();
    let sine_off = root_off(square, off) + ROOT * sine;
    let value = sine.powf(power);
    if power == 0.0 {
        return (1.0, 0.0);
    }
    let moved = (sine + sine_off).powf(power) - (sine - sine_off).max(0.0).powf(power);
    let top = (sine + sine_off).min(1.0);
    let exponent = power * top.log2();
    (
        value,
        moved + top.powf(power) * exp2(exponent, power * log2(top.log2()) + ULP * exponent.abs()),
    )
}
