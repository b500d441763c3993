//! Validation and defaults of the needle of a scenario.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion};

use super::file::ScenarioFile;
use super::instruments::{NeedleModel, NeedleTable};
use super::plan::{Deposit, Guide};
use super::resolve::Scenario;
use insonify_base::bending::BendingConstraint;
use insonify_base::document::InputError;
use insonify_base::range::OutOfRange;
use insonify_imaging::scene::{NeedleFrame, NeedleKeyframe, NeedleMotionSpec, NeedleTable as SceneNeedle};
use insonify_mechanics::needle::beam::bending_stiffness_nmm2;
use insonify_mechanics::needle::{self, Bevel, Constrained, Flexible, Needle, Rigid, Shaft, Stiffness};
use insonify_tracking::needle::{DEFAULT_DIAMETER_MM, DEFAULT_LENGTH_MM};
use insonify_tracking::pose::Pose;
use insonify_tracking::world::World;

/// Length and diameter of the needle of Goksel et al. 2011, mm.
const SPRINGS_MM: [f64; 2] = [200.0, 1.28];
/// Stiffness of its joints, N mm per degree, and the length of its links, mm.
const KAPPA_NMM_PER_DEG: f64 = 10.7;
const LINK_MM: f64 = 10.0;

/// Bending model of a needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bending {
    /// Rigid needle.
    None {
        /// Bevel, if any.
        bevel: Option<Bevel>,
    },
    /// Straight needle constrained to its entry direction.
    Constrained(BendingConstraint),
    /// Rigid links joined by angular springs.
    Springs {
        /// Bending stiffness EI, N mm^2.
        stiffness_nmm2: f64,
        /// Link length, mm.
        link_mm: f64,
        /// Bevel, if any.
        bevel: Option<Bevel>,
    },
    /// Elastic beam.
    Beam {
        /// Bending stiffness EI, N mm^2.
        stiffness_nmm2: f64,
        /// Element length, mm.
        element_mm: f64,
        /// Bevel, if any.
        bevel: Option<Bevel>,
    },
}

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
    /// Bending model.
    pub bending: Bending,
}

impl NeedleSettings {
    /// Whether the needle goes straight through tissue.
    pub fn is_straight(&self) -> bool {
        matches!(self.bending, Bending::None { bevel: None })
    }

    /// Its shaft.
    pub(crate) fn shaft(&self) -> Shaft {
        Shaft {
            length_mm: self.length_mm,
            radius_mm: self.diameter_mm / 2.0,
        }
    }

    fn model(&self) -> Result<Box<dyn Needle>, OutOfRange> {
        let shaft = self.shaft();
        Ok(match self.bending {
            Bending::None { bevel } => Box::new(Rigid::new(shaft, bevel)?),
            Bending::Constrained(constraint) => Box::new(Constrained::new(shaft, constraint)?),
            Bending::Springs {
                stiffness_nmm2,
                link_mm,
                bevel,
            } => {
                let stiffness = Stiffness::BendingNmm2(stiffness_nmm2);
                Box::new(Flexible::springs(shaft, stiffness, link_mm, bevel)?)
            }
            Bending::Beam {
                stiffness_nmm2,
                element_mm,
                bevel,
            } => {
                let stiffness = Stiffness::BendingNmm2(stiffness_nmm2);
                Box::new(Flexible::beam(shaft, stiffness, element_mm, bevel)?)
            }
        })
    }

    /// Transform from the base frame of the undeflected needle to world, for a pose of its tip whose axial direction is that of
    /// the needle.
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
        self.needle.model().map_err(|error| {
            let key = format!("needle.{}", error.key);
            self.file.fault(key, error)
        })
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
        self.in_ranges("needle", table)?;
        self.in_ranges("needle.bending", table.bending.as_ref())?;
        self.of_kind("needle", table, table.model)?;
        let usual = match table.model {
            NeedleModel::Springs | NeedleModel::Beam => SPRINGS_MM,
            _ => [DEFAULT_LENGTH_MM, DEFAULT_DIAMETER_MM],
        };
        let length_mm = table.length_mm.unwrap_or(usual[0]);
        Ok(NeedleSettings {
            length_mm,
            diameter_mm: table.diameter_mm.unwrap_or(usual[1]),
            bending: self.bending(table, length_mm)?,
        })
    }

    fn bending(&self, table: &NeedleTable, length_mm: f64) -> Result<Bending, InputError> {
        match table.model {
            NeedleModel::Rigid => Ok(Bending::None {
                bevel: self.bevel(table, length_mm)?,
            }),
            NeedleModel::Constrained => Ok(Bending::Constrained(table.bending.unwrap_or_default())),
            NeedleModel::Springs => self.springs(table, length_mm),
            NeedleModel::Beam => self.beam(table, length_mm),
        }
    }

    fn bevel(&self, table: &NeedleTable, length_mm: f64) -> Result<Option<Bevel>, InputError> {
        let shaft = Shaft {
            length_mm,
            ..Shaft::default()
        };
        let checked = table.bevel.map_or(Ok(()), |bevel| bevel.check(&shaft));
        checked.map_err(|error| self.wrong_keys(format!("needle.{}", error.key), error.found, error.expected))?;
        Ok(table.bevel)
    }

    /// Length of a link or an element, mm.
    fn part(&self, key: &str, found: f64, length_mm: f64) -> Result<f64, InputError> {
        let key = format!("needle.{key}");
        self.number(key, found, |x| x <= length_mm, "at most the needle's length, mm")
    }

    fn springs(&self, table: &NeedleTable, length_mm: f64) -> Result<Bending, InputError> {
        if table.kappa_nmm_per_deg.is_some() && table.bending_stiffness_nmm2.is_some() {
            let found = "both `kappa_nmm_per_deg` and `bending_stiffness_nmm2`";
            return Err(self.wrong_keys("needle.kappa_nmm_per_deg", found, "one of them"));
        }
        let kappa = table.kappa_nmm_per_deg.unwrap_or(KAPPA_NMM_PER_DEG);
        let of_kappa = kappa.to_degrees() * LINK_MM;
        Ok(Bending::Springs {
            stiffness_nmm2: table.bending_stiffness_nmm2.unwrap_or(of_kappa),
            link_mm: self.part("link_mm", table.link_mm.unwrap_or(LINK_MM), length_mm)?,
            bevel: self.bevel(table, length_mm)?,
        })
    }

    fn beam(&self, table: &NeedleTable, length_mm: f64) -> Result<Bending, InputError> {
        if table.young_gpa.is_some() && table.bending_stiffness_nmm2.is_some() {
            let found = "both `young_gpa` and `bending_stiffness_nmm2`";
            return Err(self.wrong_keys("needle.young_gpa", found, "one of them"));
        }
        let stiffness_nmm2 = match (table.bending_stiffness_nmm2, table.young_gpa) {
            (Some(stiffness), _) => stiffness,
            (None, Some(young)) => bending_stiffness_nmm2(young, table.diameter_mm.unwrap_or(SPRINGS_MM[1])),
            (None, None) => KAPPA_NMM_PER_DEG.to_degrees() * LINK_MM,
        };
        let element_mm = table.element_mm.unwrap_or(needle::ELEMENT_MM.min(length_mm));
        Ok(Bending::Beam {
            stiffness_nmm2,
            element_mm: self.part("element_mm", element_mm, length_mm)?,
            bevel: self.bevel(table, length_mm)?,
        })
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
        let given: Vec<&str> = movers.iter().filter(|(_, given)| *given).map(|(key, _)| *key).collect();
        let motion_key = match given[..] {
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

    /// Returns the needle of the scene, the seeds to deposit and the guiding holes; `aimed` is the motion of an aimed needle.
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
        for (at, time) in times.iter().enumerate() {
            let after = at.checked_sub(1).map_or(f64::NEG_INFINITY, |before| times[before]);
            let key = format!("needle.deposit_s[{at}]");
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
