//! Probe-mounted needle guide of three degrees of freedom, after Kobayashi et al. 2010 (section 2.3, figures 4 to 6).
//!
//! Three slides move it. Slide I carries the pivot of the needle along the lateral axis of the probe; slide II runs on
//! the same rail and turns the needle about the pivot through a slider-crank (a rod from the slide to a crank fixed to
//! the needle's holder); slide III moves the needle along itself. I and II together are horizontal positioning (A), II
//! alone is posture (B), III is insertion (C). The needle stays in the image plane, and its pose is one in the frame of
//! the probe: the guide goes where the probe goes.
//!
//! With the crank of length r at the angle t from the axial direction of its frame, the rail at the height h above the
//! pivot, a rod of length l, and the distance d of slide II from the pivot along the rail:
//!
//! ```text
//! (d - r sin t)^2 + (h - r cos t)^2 = l^2
//! d = r sin t + sqrt(l^2 - (h - r cos t)^2)
//! t = atan2(d, h) - acos((d^2 + h^2 + r^2 - l^2) / (2 r sqrt(d^2 + h^2)))
//! ```

pub mod drive;

use nalgebra::{Matrix4, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TrackingError;
use super::pose::Pose;
use insonify_base::range::parameters;

/// Range of horizontal positioning about its middle, mm: a travel of 40 mm (section 2.3).
pub const POSITION_MM: [f64; 2] = [-20.0, 20.0];
/// Range of posture about its middle, degrees (section 2.3).
pub const POSTURE_DEG: [f64; 2] = [-30.0, 30.0];
/// Range of insertion, mm (section 2.3).
pub const INSERTION_MM: [f64; 2] = [0.0, 60.0];
/// Least sine of the angle between crank and rod, and least cosine of that between rod and rail: nearer to a dead point
/// the slide no longer moves the needle surely, or the needle the slide.
pub const MIN: f64 = 0.1;
/// Distance of the needle from the image plane that counts as in it, mm, and slope against it.
const IN_PLANE: [f64; 2] = [0.05, 1e-3];
/// Excess over a range that counts as rounding.
const ROUNDING: f64 = 1e-9;

parameters! {
    /// Dimensions of the guide. Kobayashi et al. 2010 give none but the ranges and the outer size of 80 x 90 x 44 mm:
    /// the defaults are choices that fit into it.
    #[derive(Copy)]
    pub struct Guide {
        /// Lateral position of the pivot in the middle of its travel, in the frame of the probe, mm.
        side_mm: f64 = 40.0, in -200..=200;
        /// Distance of the pivot behind the centre of the array, mm.
        behind_mm: f64 = 13.0, in -100..=200;
        /// Angle of the needle in the middle of its range to the axial direction of the probe, positive towards the
        /// marked side, degrees.
        tilt_deg: f64 = -30.0, in -50..=50;
        /// Distance of the tip of the withdrawn needle from the pivot, mm. By default the tip is then level with the
        /// array.
        standoff_mm: f64 = 15.0, in 0..=200;
        /// Length of the crank, mm.
        crank_mm: f64 = 20.0, in 1..=100;
        /// Length of the rod, mm.
        rod_mm: f64 = 25.0, in 1..=200;
        /// Height of the rail of slide II above the pivot, mm.
        rail_mm: f64 = 20.0, in -100..=100;
    }
}

/// Position of the guide in its three degrees of freedom, each from the middle of its range (A, B) or from the
/// withdrawn needle (C).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Posture {
    /// Horizontal positioning (A), mm (-20 to 20).
    pub position_mm: f64,
    /// Posture (B), degrees (-30 to 30), positive towards the marked side.
    pub posture_deg: f64,
    /// Insertion (C), mm (0 to 60).
    pub insertion_mm: f64,
}

/// Straight needle in the image plane: its tip in the frame of the probe (lateral, axial), mm, and its angle to the
/// axial direction, positive towards the marked side, degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct InPlane {
    /// Tip, mm.
    pub tip_mm: [f64; 2],
    /// Angle, degrees.
    pub angle_deg: f64,
}

impl Guide {
    /// Checks every dimension, and that no dead point of the slider-crank lies within the range of posture.
    ///
    /// # Errors
    /// [`TrackingError`] with the key.
    pub fn check(&self) -> Result<(), TrackingError> {
        super::error::in_ranges("manipulator", self)?;
        let [low, high] = POSTURE_DEG;
        for step in 0..=60 {
            let degrees = low + (high - low) * f64::from(step) / 60.0;
            let [crank, rod] = self.transmission(degrees.to_radians()).unwrap_or([0.0; 2]);
            if !(crank >= MIN && rod >= MIN) {
                let text = format!(
                    "manipulator: with a crank of {} mm, a rod of {} mm and a rail at {} mm the slider-crank is at a dead point, or does not close, at \
                     {degrees} degrees of posture; expected lengths with which it moves from {low} to {high} degrees",
                    self.crank_mm, self.rod_mm, self.rail_mm
                );
                return Err(TrackingError::at("crank_mm", text));
            }
        }
        Ok(())
    }

    /// Distance of slide II from the pivot along the rail at an angle of the crank (rad), mm; `None` if the rod is too
    /// short.
    fn reach(&self, angle: f64) -> Option<f64> {
        let (sin, cos) = angle.sin_cos();
        let below = self.rail_mm - self.crank_mm * cos;
        let square = self.rod_mm * self.rod_mm - below * below;
        (square >= 0.0).then(|| self.crank_mm * sin + square.sqrt())
    }

    /// Sine of the angle between crank and rod, and cosine of that between rod and rail, at an angle of the crank
    /// (rad): 0 at a dead point for the slide, and for the crank.
    fn transmission(&self, angle: f64) -> Option<[f64; 2]> {
        let d = self.reach(angle)?;
        let (sin, cos) = angle.sin_cos();
        Some([
            (d * cos - self.rail_mm * sin) / self.rod_mm,
            (d - self.crank_mm * sin) / self.rod_mm,
        ])
    }

    /// Derivative of the angle of the crank with respect to the distance of slide II from slide I, rad/mm.
    pub fn turn_per_mm(&self, angle: f64) -> Option<f64> {
        let [crank, rod] = self.transmission(angle)?;
        Some(rod / (self.crank_mm * crank))
    }

    /// Places of the slides I, II and III, mm from the middle of the ranges and the withdrawn needle.
    ///
    /// # Errors
    /// [`TrackingError`] that names the degree of freedom out of its range.
    pub fn slides(&self, posture: &Posture) -> Result<[f64; 3], TrackingError> {
        posture.check()?;
        let reached = self.reach(posture.posture_deg.to_radians()).zip(self.reach(0.0));
        let (reach, reach_at_rest) = reached.ok_or_else(|| self.apart())?;
        let position = posture.position_mm;
        Ok([position, position + reach - reach_at_rest, posture.insertion_mm])
    }

    /// Posture for places of the slides, mm.
    ///
    /// # Errors
    /// [`TrackingError`] for slides between which the slider-crank does not close, and for a degree of freedom out of
    /// its range.
    pub fn posture(&self, slides: [f64; 3]) -> Result<Posture, TrackingError> {
        let posture = self.at(slides)?;
        posture.check()?;
        Ok(posture)
    }

    /// Posture for places of the slides, mm, whatever the ranges.
    fn at(&self, slides: [f64; 3]) -> Result<Posture, TrackingError> {
        let [first, second, third] = slides;
        let (r, h) = (self.crank_mm, self.rail_mm);
        let d = self.reach(0.0).ok_or_else(|| self.apart())? + second - first;
        let away = d.hypot(h);
        let cosine = (away * away + r * r - self.rod_mm * self.rod_mm) / (2.0 * r * away);
        if !(-1.0..=1.0).contains(&cosine) {
            let offset_mm = second - first;
            let text = format!(
                "slide II is {offset_mm} mm from its place beside slide I, where the slider-crank does not close; expected slides for a posture (B) of {} \
                 to {} degrees",
                POSTURE_DEG[0], POSTURE_DEG[1]
            );
            return Err(TrackingError::at("slide_2_mm", text));
        }
        Ok(Posture {
            position_mm: first,
            posture_deg: (d.atan2(h) - cosine.acos()).to_degrees(),
            insertion_mm: third,
        })
    }

    fn apart(&self) -> TrackingError {
        TrackingError::at(
            "rod_mm",
            format!("manipulator: a rod of {} mm does not reach the rail", self.rod_mm),
        )
    }

    /// Needle at a posture.
    pub fn needle(&self, posture: &Posture) -> InPlane {
        let angle_deg = self.tilt_deg + posture.posture_deg;
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let along = self.standoff_mm + posture.insertion_mm;
        let pivot = [self.side_mm + posture.position_mm, -self.behind_mm];
        InPlane {
            tip_mm: [pivot[0] + along * sin, pivot[1] + along * cos],
            angle_deg,
        }
    }

    /// Posture that places the needle.
    ///
    /// # Errors
    /// [`TrackingError`] that names the degree of freedom out of its range.
    pub fn reaching(&self, needle: &InPlane) -> Result<Posture, TrackingError> {
        let posture = self.placing(needle);
        posture.check()?;
        Ok(posture)
    }

    /// Posture that places the needle, whatever the ranges.
    pub fn placing(&self, needle: &InPlane) -> Posture {
        let [x, y] = needle.tip_mm;
        let below = y + self.behind_mm;
        let angle = needle.angle_deg.to_radians();
        Posture {
            position_mm: x - below * angle.tan() - self.side_mm,
            posture_deg: needle.angle_deg - self.tilt_deg,
            insertion_mm: below / angle.cos() - self.standoff_mm,
        }
    }

    /// Range of the angles (degrees, as in [`InPlane`]) at which the tip reaches a point of the image plane; `None` for
    /// a point out of reach.
    pub fn angles_deg(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let below = y + self.behind_mm;
        let [shortest, longest] = INSERTION_MM.map(|mm| self.standoff_mm + mm);
        if !(below > 0.0 && below <= longest + ROUNDING) {
            return None;
        }
        let by_position = POSITION_MM.map(|mm| ((x - self.side_mm + mm) / below).atan());
        let by_posture = POSTURE_DEG.map(|degrees| (self.tilt_deg + degrees).to_radians());
        let steepest = (below / longest).min(1.0).acos();
        let flattest = (below / shortest).min(1.0).acos();
        let meets = |by_depth: [f64; 2]| {
            let all = [by_position, by_posture, by_depth];
            let low = all.iter().map(|range| range[0]).fold(f64::NEG_INFINITY, f64::max);
            let high = all.iter().map(|range| range[1]).fold(f64::INFINITY, f64::min);
            (low <= high + ROUNDING).then(|| [low.to_degrees(), high.to_degrees()])
        };
        let parts = [meets([-steepest, -flattest]), meets([flattest, steepest])];
        let low = parts.iter().flatten().map(|part| part[0]).reduce(f64::min)?;
        let high = parts.iter().flatten().map(|part| part[1]).reduce(f64::max)?;
        Some([low, high])
    }
}

impl Posture {
    /// Checks that each degree of freedom is within its range.
    ///
    /// # Errors
    /// [`TrackingError`] that names it.
    pub fn check(&self) -> Result<(), TrackingError> {
        let axes = [
            (
                "position_mm",
                "horizontal positioning (A)",
                self.position_mm,
                POSITION_MM,
                "mm",
            ),
            ("posture_deg", "posture (B)", self.posture_deg, POSTURE_DEG, "degrees"),
            (
                "insertion_mm",
                "needle insertion (C)",
                self.insertion_mm,
                INSERTION_MM,
                "mm",
            ),
        ];
        for (key, name, setting, [low, high], unit) in axes {
            if !(low - ROUNDING..=high + ROUNDING).contains(&setting) {
                return Err(TrackingError::at(
                    key,
                    format!("{name} of {setting:.3} {unit}; expected {low} to {high}"),
                ));
            }
        }
        Ok(())
    }

    /// Posture on the straight line to another, at a share of it.
    pub fn lerp(&self, other: &Self, share: f64) -> Self {
        let between = |a: f64, b: f64| a + share * (b - a);
        Self {
            position_mm: between(self.position_mm, other.position_mm),
            posture_deg: between(self.posture_deg, other.posture_deg),
            insertion_mm: between(self.insertion_mm, other.insertion_mm),
        }
    }
}

impl InPlane {
    /// Needle of a pose of its tip in the frame of the probe, whose axial direction is that of the needle.
    ///
    /// # Errors
    /// [`TrackingError`] for a needle out of the image plane.
    pub fn of(pose: &Pose) -> Result<Self, TrackingError> {
        let (tip, along) = (pose.position_mm(), pose.axial());
        if tip.z.abs() > IN_PLANE[0] || along.z.abs() > IN_PLANE[1] {
            let text = format!(
                "a needle whose tip is {:.2} mm from the image plane, at {:.2} degrees to it; expected one in that plane, in which the guide holds it",
                tip.z.abs(),
                along.z.abs().asin().to_degrees()
            );
            return Err(TrackingError::new(text));
        }
        Ok(Self {
            tip_mm: [tip.x, tip.y],
            angle_deg: along.x.atan2(along.y).to_degrees(),
        })
    }

    /// Pose of the tip in the frame of the probe: its axial direction that of the needle, its lateral one in the image
    /// plane.
    ///
    /// # Errors
    /// [`TrackingError`] for numbers that are not finite.
    pub fn pose(&self) -> Result<Pose, TrackingError> {
        let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), -self.angle_deg.to_radians());
        let mut matrix: Matrix4<f64> = turn.to_homogeneous();
        (matrix[(0, 3)], matrix[(1, 3)]) = (self.tip_mm[0], self.tip_mm[1]);
        Pose::from_matrix(&matrix)
    }
}

#[cfg(test)]
mod tests;
