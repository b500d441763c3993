//! Motion of probe and needle in a scene file.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use insonify_base::bending::BendingConstraint;
use insonify_base::matrix::Rows;
use insonify_base::range::parameters;
use insonify_tracking::needle::NeedleSpec;
use insonify_tracking::trajectory::{Interpolation, KeyframeSpec};
use insonify_tracking::world::World;

parameters! {
    /// Motion of the probe and of the patient: at most one of `keyframes`, `csv` and `sequence`.
    pub struct MotionSpec {
        /// Number of frames, spread evenly over the time of the motion. Default: one per valid pose of a tracked
        /// sequence or row of a CSV path; 25 per second of a path through keyframes or of a ramp, at most 1000; else 1.
        #[serde(skip_serializing_if = "Option::is_none")]
        frames: Option<u32>, in 1..=1000000 "frames";
        /// World axes of keyframes, CSV path or tracked sequence: `lps` (default), or `ras` as in 3D Slicer.
        #[serde(skip_serializing_if = "Option::is_none")]
        world: Option<World>;
        /// Interpolation of positions between poses. Default `linear`.
        #[serde(skip_serializing_if = "Option::is_none")]
        interpolation: Option<Interpolation>;
        /// Timed poses.
        #[serde(skip_serializing_if = "Option::is_none")]
        keyframes: Option<Vec<KeyframeSpec>>;
        /// CSV file with one timed pose per row: `time_s`, `x_mm`, `y_mm`, `z_mm` and `qw`, `qx`, `qy`, `qz` or `dx`,
        /// `dy`, `dz` (and `lx`, `ly`, `lz`), or `time_s` and `m00` to `m33`. Other columns state parameters of the
        /// frames by key: `gain_db`, `probe.depth_mm`, `liver.echogenicity_db`.
        #[serde(skip_serializing_if = "Option::is_none")]
        csv: Option<PathBuf>;
        /// A tracked sequence.
        #[serde(skip_serializing_if = "Option::is_none")]
        sequence: Option<SequenceSpec>;
        /// Respiration of the patient. Without it the body does not breathe.
        #[serde(skip_serializing_if = "Option::is_none")]
        breathing: Option<BreathingSpec>;
        /// Pulsation of arteries. Without it they are still.
        #[serde(skip_serializing_if = "Option::is_none")]
        pulse: Option<PulseSpec>;
        /// The probe pressed into the skin, from its pose on. Without it the probe only touches the body.
        #[serde(skip_serializing_if = "Option::is_none")]
        press: Option<PressSpec>;
    }
}

parameters! {
    /// Pressing of a probe at rest: its face dents the skin by linear elasticity. One of `indent_mm` and `force_n`.
    pub struct PressSpec {
        /// Way of the probe along its beam, from its pose on.
        #[serde(skip_serializing_if = "Option::is_none")]
        indent_mm: Option<f64>, in 0..=50 "mm";
        /// Force on the body, in place of a way.
        #[serde(skip_serializing_if = "Option::is_none")]
        force_n: Option<f64>, above 0..=200 "N";
        /// Width of the face across the image. Default 10.
        #[serde(skip_serializing_if = "Option::is_none")]
        face_mm: Option<f64>, in 1..=100 "mm";
    }
}

parameters! {
    /// Respiration: organs move towards the feet (-z of the world) and back; bone, skin and air rest. The volume shows
    /// the end of expiration.
    pub struct BreathingSpec {
        /// Breaths per minute.
        rate_per_min: f64 = 15.0, in 1..=60 "per minute";
        /// Travel of organs between the ends of expiration and inspiration, mm (0 to 100), by the name of a label, a
        /// tissue, or a part of one such as `kidney`. Default: liver and spleen 24.4, pancreas 23.7, kidneys 16.5.
        #[serde(skip_serializing_if = "Option::is_none")]
        travel_mm: Option<BTreeMap<String, f64>>;
        /// Times between which the breath is held, s.
        #[serde(skip_serializing_if = "Option::is_none")]
        hold_s: Option<[f64; 2]>;
    }
}

parameters! {
    /// Pulsation: arteries widen with every beat of the heart. The volume shows the end of diastole.
    pub struct PulseSpec {
        /// Beats per minute.
        rate_per_min: f64 = 70.0, in 20..=250 "per minute";
        /// Displacement of the walls of arteries outwards, mm (0 to 5), by the name of a label, a tissue, or a part of one
        /// such as `carotid`. Default: labels named aorta, artery or carotid by 9 % of their radius.
        #[serde(skip_serializing_if = "Option::is_none")]
        radial_mm: Option<BTreeMap<String, f64>>;
    }
}

impl MotionSpec {
    /// Returns whether the probe moves.
    pub fn moves_probe(&self) -> bool {
        self.keyframes.is_some() || self.csv.is_some() || self.sequence.is_some()
    }

    /// Returns whether the patient breathes or has a pulse.
    pub fn is_alive(&self) -> bool {
        self.breathing.is_some() || self.pulse.is_some()
    }
}

/// Probe path from a tracked sequence file of PLUS. Matrices act on column vectors, lengths in mm.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SequenceSpec {
    /// Sequence file: `.igs.mha`, `.igs.mhd`, `.igs.nrrd`.
    #[schemars(required)]
    pub file: Option<PathBuf>,
    /// Transform from the marker on the probe to the tracker: one in the file, or one composed of those in the file and
    /// those that `plus_config` defines. Default `ProbeToTracker`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transform: Option<String>,
    /// Rigid transform from the centre of the array (the probe frame of insonify) to the marker. Default: identity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transducer_to_probe: Option<Rows>,
    /// In place of `transducer_to_probe`: calibration from pixels (orientation MF) to the marker.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_to_probe: Option<Rows>,
    /// Pixel (column, row) of the centre of the array in the calibrated image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub array_centre_px: Option<[f64; 2]>,
    /// In place of these: PLUS configuration file with the calibration. Probe keys that the scene leaves open are also
    /// taken from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plus_config: Option<PathBuf>,
    /// Rigid transform from the tracker to the world, in the axes of `world` under `[motion]`. Default: identity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tracker_to_world: Option<Rows>,
}

impl SequenceSpec {
    /// Transform from the marker on the probe to the tracker.
    pub(crate) fn transform(&self) -> &str {
        self.transform.as_deref().unwrap_or("ProbeToTracker")
    }
}

/// Frame in which a needle is stated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NeedleFrame {
    /// World.
    #[default]
    World,
    /// Frame of the probe, with which the needle moves: x lateral, to the marked side, y axial, into the body, z = x
    /// cross y.
    Probe,
}

parameters! {
    /// A needle, at rest or moving.
    pub struct NeedleTable {
        /// World axes of the needle and its motion: `lps`, or `ras` as in 3D Slicer. Default: those of `[motion]`.
        #[serde(skip_serializing_if = "Option::is_none")]
        world: Option<World>;
        /// Frame of the needle and its motion: `world`, or `probe`, in which case it goes where the probe goes. Default
        /// `world`.
        #[serde(skip_serializing_if = "Option::is_none")]
        frame: Option<NeedleFrame>;
        /// Tip in the world, mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        tip_mm: Option<[f64; 3]>;
        /// Point that the shaft passes through on its way to the tip, mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        entry_mm: Option<[f64; 3]>;
        /// Direction of the needle; any length.
        #[serde(skip_serializing_if = "Option::is_none")]
        direction: Option<[f64; 3]>;
        /// A bent shaft: at least two points, hub first, tip last, mm.
        #[serde(skip_serializing_if = "Option::is_none")]
        nodes_mm: Option<Vec<[f64; 3]>>;
        /// Length of a straight shaft. Default 150.
        #[serde(skip_serializing_if = "Option::is_none")]
        length_mm: Option<f64>, in 0.1..=1000 "mm";
        /// Diameter. Default 1.27 (18 gauge).
        #[serde(skip_serializing_if = "Option::is_none")]
        diameter_mm: Option<f64>, in 0.05..=10 "mm (18 gauge: 1.27)";
        /// Motion, in place of a constant pose.
        #[serde(skip_serializing_if = "Option::is_none")]
        motion: Option<NeedleMotionSpec>;
        /// Bending limits of a moving needle in the body. Default: bends freely.
        #[serde(skip_serializing_if = "Option::is_none")]
        bending: Option<BendingSpec>;
    }
}

impl NeedleTable {
    /// Returns the pose keys of a needle at rest, in LPS.
    pub fn pose(&self) -> NeedleSpec {
        let world = self.world.unwrap_or_default();
        let vector = |stated: Option<[f64; 3]>| stated.map(|stated| world.vector(stated));
        let nodes = self.nodes_mm.as_ref();
        NeedleSpec {
            tip_mm: vector(self.tip_mm),
            entry_mm: vector(self.entry_mm),
            direction: vector(self.direction),
            nodes_mm: nodes.map(|nodes| nodes.iter().map(|&node| world.vector(node)).collect()),
            length_mm: self.length_mm,
            diameter_mm: self.diameter_mm,
        }
    }
}

/// Motion of the needle: exactly one of `keyframes`, `csv` and `sequence`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NeedleMotionSpec {
    /// Interpolation of positions between poses. Default `linear`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<Interpolation>,
    /// Timed tips and directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keyframes: Option<Vec<NeedleKeyframe>>,
    /// CSV file as for the probe, with the tip in place of the array and the needle's direction in place of the axial
    /// one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub csv: Option<PathBuf>,
    /// A tracked sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequence: Option<NeedleSequenceSpec>,
}

/// Timed tip and direction of a needle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NeedleKeyframe {
    /// Time, s; later than that of the previous keyframe.
    pub time_s: f64,
    /// Tip in the world, mm.
    pub tip_mm: [f64; 3],
    /// Direction of the needle; any length.
    pub direction: [f64; 3],
    /// Roll about the shaft, degrees: it turns a bevel. At most half a turn from keyframe to keyframe. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_deg: Option<f64>,
}

/// Needle path from a tracked sequence file of PLUS.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NeedleSequenceSpec {
    /// Sequence file: `.igs.mha`, `.igs.mhd`, `.igs.nrrd`.
    #[schemars(required)]
    pub file: Option<PathBuf>,
    /// Transform from the marker on the needle to the tracker, as for the probe. Default `NeedleToTracker`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transform: Option<String>,
    /// PLUS configuration file with more transforms. Default: that of the probe's sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plus_config: Option<PathBuf>,
    /// Rigid transform from the tip's frame to the marker. Default: identity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tip_to_marker: Option<Rows>,
    /// Direction from hub to tip in the tip's frame. Default `[0, 0, 1]`, as in PLUS's needle models.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shaft_axis: Option<[f64; 3]>,
    /// Rigid transform from the tracker to the world, in the axes of `world` under `[needle]`. Default: that of the
    /// probe's sequence where `transform` leads to the same frame, else identity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tracker_to_world: Option<Rows>,
}

parameters! {
    /// Bending constraint of a needle and its entry into the body.
    #[derive(Copy)]
    pub struct BendingSpec with required keys {
        /// Entry point of the needle into the body, mm.
        entry_mm: [f64; 3];
        /// Direction of the needle at entry; any length.
        entry_direction: [f64; 3];
        /// Largest weight of the entry direction. Default 0.9.
        #[serde(skip_serializing_if = "Option::is_none")]
        max_weight: Option<f64>, in 0..=1;
        /// Steepness of the transition to constrained bending, 1/mm. Default 0.06.
        #[serde(skip_serializing_if = "Option::is_none")]
        alpha_per_mm: Option<f64>, in 0..=10;
        /// Inserted length at which half the weight is reached. Default 120.
        #[serde(skip_serializing_if = "Option::is_none")]
        delta_mm: Option<f64>, in 0..=1000 "mm";
    }
}

impl BendingSpec {
    /// Returns the constraint with defaults filled in.
    pub fn constraint(&self) -> BendingConstraint {
        let usual = BendingConstraint::default();
        BendingConstraint {
            max_weight: self.max_weight.unwrap_or(usual.max_weight),
            alpha_per_mm: self.alpha_per_mm.unwrap_or(usual.alpha_per_mm),
            delta_mm: self.delta_mm.unwrap_or(usual.delta_mm),
        }
    }
}
