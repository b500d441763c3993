//! Saved states and recorded inputs.

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};
use serde::{Deserialize, Deserializer, Serialize};

use super::{Instruments, Saved};
use insonify_base::document::Table;

/// Tolerance on the length of a unit quaternion in a file.
const UNIT_TOLERANCE: f64 = 1e-9;

/// Everything that later steps depend on except the instruments and the remeshing level, which belongs to the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorState {
    /// Simulated time, s.
    pub time_s: f64,
    /// State of the model.
    pub model: Saved,
}

/// A state, and the inputs of the steps from there on: enough to repeat them, bit for bit, also when written to a file
/// and read back (as JSON, which preserves every bit of a number).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recording {
    /// State before the first step.
    #[serde(deserialize_with = "keyed")]
    pub start: SimulatorState,
    /// Inputs of each step.
    pub inputs: Vec<RecordedInput>,
}

fn keyed<'de, D: Deserializer<'de>>(table: D) -> Result<SimulatorState, D::Error> {
    Table::deserialize(table).map(|Table(state)| state)
}

/// Inputs of a step.
///
/// In a file it has `dt_s`, `base`, and where they are used `probe`, `guide_mm`, `deposit` and `view`; a pose has
/// `position_mm` and `quaternion_xyzw`, a unit quaternion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Table<Written>", into = "Written")]
pub struct RecordedInput {
    /// Poses of needle and probe.
    pub instruments: Instruments,
    /// Time step, s.
    pub dt_s: f64,
    /// Pose of the imaging probe, if it was recorded.
    pub view: Option<Isometry3<f64>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    dt_s: f64,
    base: Table<Pose>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    probe: Option<Table<Pose>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    guide_mm: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    deposit: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    view: Option<Table<Pose>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pose {
    position_mm: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

impl Pose {
    fn of(pose: &Isometry3<f64>) -> Table<Self> {
        Table(Self {
            position_mm: pose.translation.vector.into(),
            quaternion_xyzw: pose.rotation.coords.into(),
        })
    }

    fn read(&self, key: &'static str) -> Result<Isometry3<f64>, String> {
        let found = self.quaternion_xyzw;
        let quaternion = Quaternion::from(found);
        if (quaternion.norm() - 1.0).abs() > UNIT_TOLERANCE || !quaternion.norm().is_finite() {
            return Err(format!(
                "`quaternion_xyzw` of `{key}` is {found:?}; expected a quaternion of length 1"
            ));
        }
        let translation = Translation3::from(self.position_mm);
        // Unchanged: another normalisation would alter its last bits.
        Ok(Isometry3::from_parts(
            translation,
            UnitQuaternion::new_unchecked(quaternion),
        ))
    }
}

impl From<RecordedInput> for Written {
    fn from(
        RecordedInput {
            instruments,
            dt_s,
            view,
        }: RecordedInput,
    ) -> Self {
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
            view: view.as_ref().map(Pose::of),
        }
    }
}

impl TryFrom<Table<Written>> for RecordedInput {
    type Error = String;

    fn try_from(Table(written): Table<Written>) -> Result<Self, String> {
        Ok(Self {
            instruments: Instruments {
                base: written.base.0.read("base")?,
                probe: written.probe.map(|pose| pose.0.read("probe")).transpose()?,
                guide: written.guide_mm.map(Point3::from),
                deposit: written.deposit,
            },
            dt_s: written.dt_s,
            view: written.view.map(|pose| pose.0.read("view")).transpose()?,
        })
    }
}
