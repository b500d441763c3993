//! Drive of a slide by a flexible rack, after Kobayashi et al. 2010 (section 2.2, figures 2 and 3): a motor with an
//! input pinion pushes and pulls a flexible rack in a guide tube; the rack turns an output pinion on a ball screw,
//! whose flange is the slide.
//!
//! The rack has a dead band (clearance of teeth and tube, buckling) and a stiffness. With the travel u of the input and
//! v of the output, the rack transmits `k (|u - v| - b/2)`, and the output moves while that exceeds what resists:
//! friction of the tube and the load through the screw. The lost motion u - v is therefore `b/2 + R/k` while pushing
//! and as much the other way while pulling. The screw is self-locking: an output at rest stays where it is whatever the
//! load. An encoder on the screw measures the output, and a PI controller at 1 kHz with the commanded speed fed forward
//! sets the speed of the motor, which follows without delay. Kobayashi et al. 2010 give none of the numbers: the
//! defaults are choices.

use std::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Guide, Posture};
use crate::TrackingError;
use insonify_base::range::parameters;

/// Period of the controller, s.
pub const PERIOD_S: f64 = 1e-3;

/// Control of the slides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Control {
    /// PI control on the encoder of the output.
    #[default]
    ClosedLoop,
    /// The motor makes the commanded motion, without regard to the output.
    OpenLoop,
    /// The slides are where they are commanded to be.
    Ideal,
}

parameters! {
    /// Flexible rack, ball screw, encoder and controller of a slide.
    #[derive(Copy)]
    pub struct Drive {
        /// Dead band of the rack, mm of its travel.
        dead_band_mm: f64 = 4.0, in 0..=50;
        /// Stiffness of the rack, N/mm.
        stiffness_n_per_mm: f64 = 2.0, in 0.01..=1e6;
        /// Friction of the rack in its guide tube, N.
        friction_n: f64 = 3.0, in 0..=1000;
        /// Pitch radius of the pinions, mm.
        pinion_mm: f64 = 4.0, in 0.5..=100;
        /// Lead of the ball screw, mm a turn.
        lead_mm: f64 = 2.0, in 0.1..=50;
        /// Efficiency of the screw: at most 0.5, so that it is self-locking.
        efficiency: f64 = 0.3, in 0.01..=0.5;
        /// Counts of the encoder a turn: 2000 is 1 um.
        counts_per_turn: f64 = 2000.0, in 1..=1e6;
        /// Proportional gain, 1/s.
        proportional_per_s: f64 = 100.0, in 0..=1000;
        /// Integral gain, 1/s^2.
        integral_per_s2: f64 = 500.0, in 0..=1e5;
        /// Highest speed of a slide, mm/s.
        speed_mm_s: f64 = 20.0, in 0.1..=1000;
        /// Force on the needle against its insertion, N: the lost motion of slide III depends on it.
        load_n: f64 = 0.0, in 0..=100;
    }
}

impl Drive {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`TrackingError`] with the key.
    pub fn check(&self) -> Result<(), TrackingError> {
        crate::error::in_ranges("manipulator.drive", self)
    }

    /// Travel of the slide for a travel of the rack of 1 mm, mm: `lead / (2 pi r)`.
    pub fn reduction(&self) -> f64 {
        self.lead_mm / (TAU * self.pinion_mm)
    }

    /// Lost motion while the rack pushes (0) or pulls (1) against a load, mm of the rack's travel.
    pub fn lost_mm(&self, load_n: f64) -> [f64; 2] {
        let through = load_n * self.reduction() / self.efficiency;
        [through, -through]
            .map(|by| 0.5 * self.dead_band_mm + (self.friction_n + by).max(0.0) / self.stiffness_n_per_mm)
    }
}

/// State of a slide and its drive.
#[derive(Clone, Copy, Debug, Default)]
struct Slide {
    /// Travel of the rack at the input, mm.
    input_mm: f64,
    /// Travel of the rack at the output, mm.
    output_mm: f64,
    /// Integral of the control error, mm s.
    integral: f64,
}

impl Slide {
    /// One period of the controller towards a command (mm of the slide, mm/s); returns the place of the slide.
    fn step(&mut self, drive: &Drive, open: bool, load_n: f64, command_mm: f64, rate_mm_s: f64) -> f64 {
        let ratio = drive.reduction();
        if open {
            self.input_mm = command_mm / ratio;
        } else {
            let count = drive.lead_mm / drive.counts_per_turn;
            let measured = (self.output_mm * ratio / count).round() * count;
            let error = command_mm - measured;
            let requested_mm_s = rate_mm_s + drive.proportional_per_s * error + drive.integral_per_s2 * self.integral;
            let speed_mm_s = requested_mm_s.clamp(-drive.speed_mm_s, drive.speed_mm_s);
            // Against wind-up, the integral waits while the motor runs at its highest speed_mm_s.
            if speed_mm_s == requested_mm_s {
                self.integral += error * PERIOD_S;
            }
            self.input_mm += speed_mm_s / ratio * PERIOD_S;
        }
        let [push, pull] = drive.lost_mm(load_n);
        self.output_mm = self.output_mm.clamp(self.input_mm - push, self.input_mm + pull);
        self.output_mm * ratio
    }
}

/// Command and outcome of a period of the controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Driven {
    /// Time, s.
    pub time_s: f64,
    /// Commanded posture.
    pub command: Posture,
    /// Posture of the guide.
    pub posture: Posture,
    /// Lost motion of each slide: travel of the rack at the input less that at the output, in mm of the slide.
    pub lost_mm: [f64; 3],
}

/// Follows commanded postures, one per [`PERIOD_S`] from `start_s` on; the guide is at the first of them at rest, in
/// the middle of the dead bands.
///
/// # Errors
/// [`TrackingError`] for a posture out of range.
pub fn follow(
    guide: &Guide,
    drive: &Drive,
    control: Control,
    start_s: f64,
    commands: &[Posture],
) -> Result<Vec<Driven>, TrackingError> {
    let Some(first) = commands.first() else {
        return Ok(Vec::new());
    };
    // Slides move from their own zero, the middle of the dead band at the first command.
    let (from, ratio) = (guide.slides(first)?, drive.reduction());
    let loads = [0.0, 0.0, drive.load_n];
    let mut slides = [Slide::default(); 3];
    let mut before = [0.0; 3];
    let mut all = Vec::with_capacity(commands.len());
    for (step, command) in commands.iter().enumerate() {
        let wanted = guide.slides(command)?;
        let mut places = wanted;
        if control != Control::Ideal {
            for (axis, slide) in slides.iter_mut().enumerate() {
                let to = wanted[axis] - from[axis];
                let rate = (to - before[axis]) / PERIOD_S;
                before[axis] = to;
                places[axis] = from[axis] + slide.step(drive, control == Control::OpenLoop, loads[axis], to, rate);
            }
        }
        all.push(Driven {
            time_s: start_s + step as f64 * PERIOD_S,
            command: *command,
            posture: guide.at(places)?,
            lost_mm: slides.map(|slide| (slide.input_mm - slide.output_mm) * ratio),
        });
    }
    Ok(all)
}
