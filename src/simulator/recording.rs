//! States and inputs that are kept.

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use crate::mechanics::insertion::{Instruments, Saved};

/// How far from 1 the length of a quaternion in a file may be.
const UNIT_TOLERANCE: f64 = 1e-9;

/// Everything that later steps depend on but the instruments and the level of remeshing, which is the model's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Simulated time, s.
    pub time_s: f64,
    /// That of the model.
    pub model: Saved,
}

/// A state, and the inputs of the steps from there on: enough to make them again, bit for bit, also when written to a
/// file and read back (as JSON, which keeps every bit of a number).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// Before the first step.
    pub start: State,
    /// Those of each step.
    pub inputs: Vec<Input>,
}

/// The inputs of a step.
///
/// In a file it has `dt_s`, `base`, and where they are used `probe`, `guide_mm` and `deposit`; a pose has `position_mm`
/// and `quaternion_xyzw`, a unit quaternion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Input {
    /// Where needle and probe are.
    pub instruments: Instruments,
    /// Time of the step, s.
    pub dt_s: f64,
}

/// A pose in a file that is none.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("`quaternion_xyzw` of `{key}` is {found:?}; expected a quaternion of length 1")]
pub struct InvalidInput {
    /// Whose pose.
    pub key: &'static str,
    /// As given.
    pub found: [f64; 4],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    dt_s: f64,
    base: Pose,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    probe: Option<Pose>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    guide_mm: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    deposit: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pose {
    position_mm: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

impl Pose {
    fn of(pose: &Isometry3<f64>) -> Self {
        Self {
            position_mm: pose.translation.vector.into(),
            quaternion_xyzw: pose.rotation.coords.into(),
        }
    }

    fn read(&self, key: &'static str) -> Result<Isometry3<f64>, InvalidInput> {
        let found = self.quaternion_xyzw;
        let quaternion = Quaternion::from(found);
        if (quaternion.norm() - 1.0).abs() > UNIT_TOLERANCE || !quaternion.norm().is_finite() {
            return Err(InvalidInput { key, found });
        }
        let translation = Translation3::from(self.position_mm);
        // As it is: another normalisation would change its last bits.
        Ok(Isometry3::from_parts(
            translation,
            UnitQuaternion::new_unchecked(quaternion),
        ))
    }
}

impl From<Input> for Written {
    fn from(Input { instruments, dt_s }: Input) -> Self {
        let Instruments {
            base,
            probe,
            guide,
            deposit,
        } = instruments;
        Self {
            dt_s,
            base: Pose::of(&base),
            probe: probe.as_ref().map(Pose::of),
            guide_mm: guide.map(Into::into),
            deposit,
        }
    }
}

impl TryFrom<Written> for Input {
    type Error = InvalidInput;

    fn try_from(written: Written) -> Result<Self, InvalidInput> {
        Ok(Self {
            instruments: Instruments {
                base: written.base.read("base")?,
                probe: written.probe.map(|pose| pose.read("probe")).transpose()?,
                guide: written.guide_mm.map(Point3::from),
                deposit: written.deposit,
            },
            dt_s: written.dt_s,
        })
    }
}
