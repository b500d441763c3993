//! Simulated hands: motions of needle and probe with the errors of people of different skill, for training tasks
//! without trainees.
//!
//! The needle pivots about its entry: an error of the first aim that is corrected late or not at all, an entry beside
//! the planned one, a depth that is missed, and physiological tremor of 8 to 12 Hz (R. J. Elble and W. C. Koller,
//! "Tremor", 1990), which turns the needle about the entry. The image plane is off by a shift and a turn and drifts
//! slowly. The amounts of the groups are choices, made so that the groups differ; they are not measured.

use std::f64::consts::TAU;
use std::path::Path;

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use serde::Serialize;

use super::unscored;
use insonify::Error;
use insonify::input::scenario::Scenario;
use insonify_base::random::{hash3, seed_words, unit};
use insonify_mechanics::needle::across;
use insonify_tracking::TrackingError;
use insonify_tracking::needle::NeedlePath;
use insonify_tracking::pose::Pose;
use insonify_tracking::trajectory::{Interpolation, Key, Trajectory};

/// Interval of keyframes, s: ten within the shortest period of tremor.
const KEY_S: f64 = 0.01;
/// Frequencies of tremor, Hz.
const TREMOR_HZ: [f64; 4] = [8.1, 9.3, 10.6, 11.9];
/// Frequencies of the probe's drift, Hz.
const DRIFT_HZ: [f64; 3] = [0.07, 0.13, 0.29];
/// Least length of needle outside the body, about which tremor turns it, mm.
const MIN_LEVER_MM: f64 = 30.0;
/// Step of the search for the entry, mm.
const ENTRY_MM: f64 = 0.25;

/// Errors of a hand; standard deviations where drawn for each session.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hand {
    /// Error of the first aim in each direction, degrees.
    pub aim_deg: f64,
    /// Share of that error that remains.
    pub residual: f64,
    /// Time constant of the correction, s.
    pub correction_s: f64,
    /// Inserted length at which the correction begins, mm.
    pub notice_mm: f64,
    /// Error of the entry in each direction, mm.
    pub entry_mm: f64,
    /// Error of the depth, mm.
    pub depth_mm: f64,
    /// RMS of tremor at the hand in each direction, mm.
    pub tremor_mm: f64,
    /// Speed relative to the planned one.
    pub pace: f64,
    /// Shift of the image plane, mm.
    pub plane_mm: f64,
    /// Turn of the image plane about the beam's axis and about the array, degrees.
    pub plane_deg: f64,
    /// RMS of the drift of the image plane, mm and degrees.
    pub drift: f64,
}

/// A steady hand with full command of needle and probe.
const EXPERT: Hand = Hand {
    aim_deg: 0.7,
    residual: 0.1,
    correction_s: 0.8,
    notice_mm: 5.0,
    entry_mm: 1.0,
    depth_mm: 0.8,
    tremor_mm: 0.05,
    pace: 1.0,
    plane_mm: 0.5,
    plane_deg: 0.7,
    drift: 0.3,
};

/// Hands by name: single errors, and the groups of the study.
pub const HANDS: [(&str, Hand); 7] = [
    ("expert", EXPERT),
    (
        "tremor",
        Hand {
            tremor_mm: 1.5,
            ..EXPERT
        },
    ),
    (
        "wrong-angle",
        Hand {
            aim_deg: 6.0,
            residual: 1.0,
            ..EXPERT
        },
    ),
    (
        "late-correction",
        Hand {
            aim_deg: 6.0,
            residual: 0.1,
            notice_mm: 40.0,
            ..EXPERT
        },
    ),
    (
        "consultant",
        Hand {
            aim_deg: 1.2,
            residual: 0.2,
            entry_mm: 1.5,
            depth_mm: 1.2,
            tremor_mm: 0.08,
            plane_mm: 0.8,
            plane_deg: 1.0,
            drift: 0.4,
            ..EXPERT
        },
    ),
    (
        "registrar",
        Hand {
            aim_deg: 2.0,
            residual: 0.35,
            correction_s: 1.2,
            notice_mm: 12.0,
            entry_mm: 2.2,
            depth_mm: 2.0,
            tremor_mm: 0.12,
            pace: 0.85,
            plane_mm: 1.4,
            plane_deg: 1.6,
            drift: 0.6,
        },
    ),
    (
        "student",
        Hand {
            aim_deg: 4.5,
            residual: 0.6,
            correction_s: 2.5,
            notice_mm: 25.0,
            entry_mm: 4.0,
            depth_mm: 4.5,
            tremor_mm: 0.25,
            pace: 0.65,
            plane_mm: 3.0,
            plane_deg: 4.0,
            drift: 1.4,
        },
    ),
];

/// Hand of a name.
pub fn hand(name: &str) -> Option<Hand> {
    HANDS.iter().find(|(known, _)| *known == name).map(|(_, hand)| *hand)
}

/// Random numbers of one session.
pub(super) struct Draw {
    seed: [u32; 2],
    next: i32,
}

impl Draw {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            seed: seed_words(seed),
            next: 0,
        }
    }

    /// Uniform in [0, 1).
    pub(super) fn uniform(&mut self) -> f64 {
        self.next += 1;
        f64::from(unit(hash3([self.next, 0x5e55, 1], self.seed)[0]))
    }

    /// Normally distributed (G. E. P. Box and M. E. Muller, 1958).
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }

    /// Sum of sines of an RMS of 1.
    fn waves<const N: usize>(&mut self, hz: [f64; N]) -> impl Fn(f64) -> f64 + use<N> {
        let phases = hz.map(|_| TAU * self.uniform());
        let scale = (2.0 / N as f64).sqrt();
        move |time_s| {
            let waves = hz.iter().zip(&phases);
            scale * waves.map(|(hz, phase)| (TAU * hz * time_s + phase).sin()).sum::<f64>()
        }
    }
}

impl Hand {
    /// The hand with all its errors scaled, as those of another person.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            aim_deg: self.aim_deg * factor,
            entry_mm: self.entry_mm * factor,
            depth_mm: self.depth_mm * factor,
            tremor_mm: self.tremor_mm * factor,
            plane_mm: self.plane_mm * factor,
            plane_deg: self.plane_deg * factor,
            drift: self.drift * factor,
            ..*self
        }
    }

    /// The scenario as performed by this hand: a straight insertion to where the scenario's needle is deepest, a pause,
    /// and withdrawal.
    ///
    /// # Errors
    /// [`StudyError::Refused`](crate::StudyError::Refused) if the needle's path does not enter the body.
    pub fn perform(&self, scenario: &Scenario, seed: u64) -> Result<Scenario, Error> {
        let plan = InsertionPlan::of(scenario)?;
        let mut draw = Draw::new(seed);
        let [right, up] = across(&plan.along);
        let mut aside = |mm: f64| right * (mm * draw.normal()) + up * (mm * draw.normal());
        let entry = plan.entry + aside(self.entry_mm);
        let error = aside(self.aim_deg.to_radians());
        let depth = (plan.target - entry).norm() + self.depth_mm * draw.normal();
        let aim = (plan.target - entry).normalize();
        let tremor = [draw.waves(TREMOR_HZ), draw.waves(TREMOR_HZ)];
        let speed = plan.speed_mm_s * self.pace;
        let (inward_s, pause_s) = ((plan.before_mm + depth) / speed, plan.pause_s);
        let end_s = 2.0 * inward_s + pause_s;
        let notice_s = (plan.before_mm + self.notice_mm) / speed;
        let mut keys = Vec::new();
        let count = (end_s / KEY_S).ceil() as usize;
        for step in 0..=count {
            let time_s = (step as f64 * KEY_S).min(end_s);
            let inward = time_s.min(end_s - time_s).min(inward_s);
            let arc = inward * speed - plan.before_mm;
            // Corrections are kept on the way out.
            let since_s = (time_s - notice_s).max(0.0);
            let remaining = self.residual + (1.0 - self.residual) * (-since_s / self.correction_s).exp();
            // The needle pivots about its entry: the shorter the part outside, the farther a shift of the hand turns
            // it.
            let lever_mm = (plan.length_mm - arc).max(MIN_LEVER_MM);
            let shake = [0, 1].map(|axis| self.tremor_mm * tremor[axis](time_s) / lever_mm);
            let direction = (aim + error * remaining + right * shake[0] + up * shake[1]).normalize();
            keys.push((plan.start_s + time_s, entry + direction * arc, direction));
        }
        let tip = NeedlePath::tip_trajectory(&keys, Interpolation::Linear);
        let probe = match scenario.contact() {
            // A probe in contact moves as planned: its contact nodes were chosen along that motion.
            Some(_) => None,
            None => Some(self.probe(scenario, plan.start_s, end_s, &mut draw)?),
        };
        Ok(scenario.moved(tip?, probe))
    }

    fn probe(&self, scenario: &Scenario, start_s: f64, end_s: f64, draw: &mut Draw) -> Result<Trajectory, Error> {
        let planned = scenario.scene.probe_path();
        let offsets = [self.plane_mm, self.plane_deg, self.plane_deg].map(|spread| spread * draw.normal());
        let drift = [0; 3].map(|_| draw.waves(DRIFT_HZ));
        let count = (end_s / (10.0 * KEY_S)).ceil() as usize;
        let keys = (0..=count).map(|step| {
            let time_s = start_s + step as f64 * 10.0 * KEY_S;
            let pose = planned.at(time_s);
            let [out_mm, turn, tilt] = [0, 1, 2].map(|axis| offsets[axis] + self.drift * drift[axis](time_s));
            let about = |axis: Unit<Vector3<f64>>, deg: f64| UnitQuaternion::from_axis_angle(&axis, deg.to_radians());
            let rotation = about(pose.axial(), turn) * about(pose.lateral(), tilt) * pose.rotation();
            let position_mm = pose.position_mm() + pose.elevational().into_inner() * out_mm;
            Ok((time_s, Pose::from_rotation(position_mm, &rotation)?))
        });
        let keys: Result<Vec<_>, TrackingError> = keys.collect();
        let path = keys.and_then(|keys| Trajectory::from_keys(keys, Interpolation::Linear));
        Ok(path?)
    }
}

/// Straight insertion that a scenario plans.
pub(super) struct InsertionPlan {
    pub start_s: f64,
    pub speed_mm_s: f64,
    pub pause_s: f64,
    /// Distance of the tip's start from the entry, mm.
    pub before_mm: f64,
    pub length_mm: f64,
    pub entry: Point3<f64>,
    pub target: Point3<f64>,
    pub along: Vector3<f64>,
}

impl InsertionPlan {
    pub(super) fn of(scenario: &Scenario) -> Result<Self, Error> {
        let unscored = |reason| unscored(Path::new("the scenario"), reason);
        let keys = scenario.needle_tip().keys();
        let (Some(first_key), Some(last_key)) = (keys.first(), keys.last()) else {
            return Err(unscored("has a needle that does not move"));
        };
        let start = first_key.pose.position_mm();
        let distance = |point: &Point3<f64>| (point - start).norm();
        let deepest = keys
            .iter()
            .map(|key| distance(&key.pose.position_mm()))
            .fold(0.0, f64::max);
        let at_target = |key: &&Key| distance(&key.pose.position_mm()) > deepest - 1e-6;
        // First and last key at the greatest depth: between them the needle rests, which is the pause.
        let (Some(reached_key), Some(back)) = (keys.iter().find(at_target), keys.iter().rev().find(at_target)) else {
            return Err(unscored("has a needle that does not move"));
        };
        let target = reached_key.pose.position_mm();
        let Some(direction) = (target - start)
            .try_normalize(1e-6)
            .filter(|_| reached_key.time_s > first_key.time_s)
        else {
            return Err(unscored("has a needle that does not move"));
        };
        let body = scenario.scene.body();
        let inside = |mm: &f64| body.label_at(&(start + direction * *mm)).is_some();
        let steps = (deepest / ENTRY_MM) as usize;
        let mut search = (0..steps).map(|step| step as f64 * ENTRY_MM);
        let before_mm = search
            .find(inside)
            .ok_or_else(|| unscored("plans a needle that stays outside the body"))?;
        Ok(Self {
            start_s: first_key.time_s,
            speed_mm_s: deepest / (reached_key.time_s - first_key.time_s),
            pause_s: (back.time_s - reached_key.time_s).min(last_key.time_s),
            before_mm,
            length_mm: scenario.needle.length_mm,
            entry: start + direction * before_mm,
            target,
            along: direction,
        })
    }
}
