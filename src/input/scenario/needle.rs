//! Validation and defaults of the needle of a scenario.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion};

use super::file::ScenarioFile;
use super::instruments::NeedleTable;
use super::plan::{Deposit, Guide};
use super::resolve::Scenario;
use insonify_base::document::InputError;
use insonify_base::range::OutOfRange;
use insonify_imaging::scene::{NeedleFrame, NeedleKeyframe, NeedleMotionSpec, NeedleTable as SceneNeedle};
use insonify_mechanics::needle::{Needle, NeedleKeys, Shaft};
use insonify_tracking::needle::{DEFAULT_DIAMETER_MM, DEFAULT_LENGTH_MM};
use insonify_tracking::pose::Pose;
use insonify_tracking::world::World;

/// Motion of a needle, with its seeds and template guides.
pub(crate) struct Moving {
    pub needle: SceneNeedle,
    pub deposits: Vec<Deposit>,
    pub guides: Vec<Guide>,
}

/// Needle settings, every number within its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeedleSettings {
    /// Length from base to tip, mm.
    pub length_mm: f64,
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Keys of its bending model.
    pub keys: NeedleKeys,
}

impl NeedleSettings {
    /// Whether the needle goes straight through tissue.
    pub fn is_straight(&self) -> bool {
        self.keys.is_straight()
    }

    /// Its shaft.
    pub(crate) fn shaft(&self) -> Shaft {
        Shaft {
            length_mm: self.length_mm,
            radius_mm: self.diameter_mm / 2.0,
        }
    }

    /// Transform from the base frame of the undeflected needle to world, for a pose of its tip whose axial direction is
    /// that of the needle.
    pub fn base(&self, tip: &Pose) -> Isometry3<f64> {
        let (along, side) = (tip.axial().into_inner(), tip.lateral().into_inner());
        let axes = Matrix3::from_columns(&[side, along.cross(&side), along]);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let base = tip.position_mm() - along * self.length_mm;
        Isometry3::from_parts(base.coords.into(), turn)
    }
}

impl Scenario {
    /// Builds the model of the needle.
    pub(crate) fn needle_model(&self) -> Result<Box<dyn Needle>, InputError> {
        let needle = self.needle.keys.needle(self.needle.shaft());
        needle.map_err(|error| self.file.fault(format!("needle.{}", error.key), error))
    }
}

impl ScenarioFile {
    /// Returns the table `[needle]`, which must be present.
    pub(crate) fn needle_table(&self) -> Result<&NeedleTable, InputError> {
        self.needle
            .as_ref()
            .ok_or_else(|| self.wrong_keys("needle", "no `[needle]`", "the needle that goes in"))
    }

    /// Returns the needle settings, every number checked.
    pub(crate) fn needle_settings(&self) -> Result<NeedleSettings, InputError> {
        let table = self.needle_table()?;
        self.in_ranges("needle", &table.common)?;
        let fault = |error: OutOfRange| self.wrong_keys(format!("needle.{}", error.key), error.found, error.expected);
        let keys = table.keys().map_err(fault)?;
        let usual_mm = keys.usual_mm();
        let [length_mm, diameter_mm] = usual_mm.unwrap_or([DEFAULT_LENGTH_MM, DEFAULT_DIAMETER_MM]);
        let needle = NeedleSettings {
            length_mm: table.length_mm.unwrap_or(length_mm),
            diameter_mm: table.diameter_mm.unwrap_or(diameter_mm),
            keys,
        };
        keys.check(&needle.shaft()).map_err(fault)?;
        Ok(needle)
    }

    /// Returns the key that moves the needle, and checks that there is exactly one.
    pub(crate) fn motion_key(&self) -> Result<&'static str, InputError> {
        let table = self.needle_table()?;
        let planned = self.plan.as_ref().is_some_and(|plan| !plan.needle.is_empty());
        let movers = [
            ("plan.needle", planned),
            ("needle.motion", table.motion.is_some()),
            ("needle.target", table.target.is_some()),
            ("manipulator.keyframes", self.is_guided()),
        ];
        let given_keys: Vec<&str> = movers
            .iter()
            .filter(|(_, is_given)| *is_given)
            .map(|(key, _)| *key)
            .collect();
        let motion_key = match given_keys[..] {
            [] => {
                let expected = "`target`, `[[needle.motion.keyframes]]`, `needle.motion.csv`, `needle.motion.sequence` or \
                                `[[plan.needle]]`";
                return Err(self.wrong_keys("needle", "a needle that does not move", expected));
            }
            [motion_key] => motion_key,
            [first, second, ..] => {
                let found = format!("both `{first}` and `{second}`");
                return Err(self.wrong_keys(second, found, "one of them: each moves the needle"));
            }
        };
        if table.frame.is_some() && table.motion.is_none() {
            let found = "`frame` without `needle.motion`, whose frame it is";
            return Err(self.wrong_keys("needle.frame", found, "both, or neither"));
        }
        if table.entry.is_some() && table.target.is_none() {
            return Err(self.wrong_keys("needle.entry", "`entry` without `target`", "both, or neither"));
        }
        if planned && !table.deposit_s.is_empty() {
            let found = "both `plan.needle` and `needle.deposit_s`";
            return Err(self.wrong_keys("needle.deposit_s", found, "`seeds_mm` of the needles of the plan"));
        }
        Ok(motion_key)
    }

    /// Whether the keyframes of the manipulator move the needle.
    fn is_guided(&self) -> bool {
        self.manipulator.as_ref().is_some_and(|spec| !spec.keyframes.is_empty())
    }

    /// Returns the needle of the scene, the seeds to deposit and the guiding holes; `aimed` is the motion of an aimed
    /// needle.
    pub(crate) fn moving(
        &self,
        needle: &NeedleSettings,
        aimed: Option<Vec<NeedleKeyframe>>,
    ) -> Result<Moving, InputError> {
        let table = self.needle_table()?;
        let of_keyframes = |keyframes| NeedleMotionSpec {
            keyframes: Some(keyframes),
            ..NeedleMotionSpec::default()
        };
        let (motion, deposits, guides) = match (self.insertions(needle.length_mm)?, aimed) {
            (Some(plan), _) => (of_keyframes(plan.keyframes), plan.deposits, plan.guides),
            (None, aimed) => {
                let keyframes = aimed.map_or_else(|| self.guide_keyframes(), |aimed| Ok(Some(aimed)))?;
                let motion = keyframes.map(of_keyframes).or_else(|| table.motion.clone());
                (
                    motion.unwrap_or_default(),
                    self.commanded(&table.deposit_s)?,
                    Vec::new(),
                )
            }
        };
        let frame = if self.is_guided() {
            NeedleFrame::Probe
        } else {
            table.frame.unwrap_or_default()
        };
        let needle = SceneNeedle {
            // Axes of the world have no meaning in the frame of the probe.
            world: (frame == NeedleFrame::World).then_some(World::Lps),
            frame: Some(frame),
            length_mm: Some(needle.length_mm),
            diameter_mm: Some(needle.diameter_mm),
            motion: Some(motion),
            ..SceneNeedle::default()
        };
        Ok(Moving {
            needle,
            deposits,
            guides,
        })
    }

    fn commanded(&self, times: &[f64]) -> Result<Vec<Deposit>, InputError> {
        for (index, time) in times.iter().enumerate() {
            let after = index.checked_sub(1).map_or(f64::NEG_INFINITY, |before| times[before]);
            let key = format!("needle.deposit_s[{index}]");
            self.number(key, *time, |time| time > after, "a time in s after the one before")?;
        }
        Ok(times
            .iter()
            .map(|&time_s| Deposit {
                time_s,
                planned_mm: None,
            })
            .collect())
    }
}
