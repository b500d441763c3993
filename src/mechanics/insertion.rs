//! Needle insertion models: tissue deformation and forces from the poses of needle and probe.
//!
//! A [`Model`] takes the poses of needle and probe step by step and returns forces and the deformed tissue. It is a
//! finite element model, a mass-spring model, or a model of tissue that stiffens and creeps; all of them return the
//! same outcome and snapshots.

mod cost;
pub mod finite;
mod imager;
mod interaction;
mod living;
pub mod nonlinear;
mod outcome;
mod probe;
pub mod pushing;
mod recording;
pub mod spring;
mod validation;

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use super::needle::CentreLine;
use super::tissue::remesh::Level;
pub use cost::{StepCost, Work};
use insonify_base::blame::Blame;
pub use interaction::{Anatomy, Bone, Interaction, MeshRegions, Peak};
pub use living::TissueMotion;
pub use outcome::{Event, EventKind, Outcome, Wrench};
pub use probe::{ProbeContact, lever, pointed};
pub use recording::{RecordedInput, Recording, SimulatorState};
pub use validation::{InvalidSetup, check_pose};

/// Poses of the instruments at one step: rigid, checked as those of files are (rotations to within 5e-3 per entry).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instruments {
    /// Base frame of the needle to world (see [`needle`](super::needle)).
    pub base: Isometry3<f64>,
    /// Probe frame to world, if a probe presses.
    pub probe: Option<Isometry3<f64>>,
    /// A hole that guides the needle, as in a template: a point on its path, mm. It constrains a flexible needle across
    /// its shaft and lets it slide along it.
    pub guide: Option<Point3<f64>>,
    /// Whether a seed is left at the tip at the end of this step.
    pub deposit: bool,
}

/// Reason why a step failed. The model is left unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A pose or time that is not finite, or a time step that is not above 0.
    #[error("in a step, {what} is {found}; expected {expected}")]
    Input {
        /// Name of the value.
        what: &'static str,
        /// The rejected value.
        found: f64,
        /// Permitted values.
        expected: &'static str,
    },
    /// A pose that is not rigid, of a quaternion that is not of length 1, or too far away.
    #[error("in a step, {what}: {reason}")]
    Pose {
        /// Name of the pose.
        what: &'static str,
        /// Its fault.
        reason: String,
    },
    /// A force or position of the outcome that is not finite, as a user-defined model may return: it has made the step,
    /// but no force reaches the device.
    #[error("{what} is {found} after a step of the model; expected finite numbers")]
    Outcome {
        /// Name of the value.
        what: &'static str,
        /// The rejected value.
        found: f64,
    },
    /// A saved state of another model.
    #[error("the saved state is of another model: {0}")]
    Foreign(String),
    /// A change of the remeshing level in a model without remeshing.
    #[error("this model has no remeshing level: only linear finite elements are remeshed")]
    NoLevel,
    /// A remeshing level that cannot be used.
    #[error("the level of remeshing stays as it was: {0}")]
    Level(#[from] InvalidSetup),
}

impl Blame for StepError {
    fn is_machine(&self) -> bool {
        matches!(self, StepError::Level(error) if error.is_machine())
    }
}

/// Effect of a change of the remeshing level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelChange {
    /// Level before the change.
    pub from: Level,
    /// Level after the change.
    pub to: Level,
    /// Largest change of an entry of the compliance at the contacts, relative to its largest entry.
    pub compliance_change: f64,
    /// Change of the force on the hand at the same pose, N.
    pub force_jump_n: f64,
    /// Duration of the change, s.
    pub seconds: f64,
}

/// Deformed tissue, from which an image is made. Of the crate `insonify` it is `MovedTissue`; `Tissue` is
/// acoustic there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tissue {
    /// Node positions in the reference state, mm. Remeshing moves them.
    pub reference: Vec<[f64; 3]>,
    /// Current node positions, mm.
    pub current: Vec<[f64; 3]>,
    /// Number of inverted elements: tissue is crushed there.
    pub inverted: usize,
}

/// State from which the image thread computes [`Tissue`] by itself: small enough to be handed over at every step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Number of steps made.
    pub step: u64,
    /// Simulated time, s.
    pub time_s: f64,
    /// Centre line of the shaft, base first.
    pub line: CentreLine,
    /// Positions of the seeds left in the tissue, in the reference state, mm.
    pub seeds: Vec<Point3<f64>>,
    /// Nodes that remeshing has moved, with their positions in the reference state, mm.
    pub moved: Vec<(u32, [f64; 3])>,
    /// Displacement field of the nodes.
    pub field: Field,
    /// Tissue at the tip, whose dent the field has as far as the mesh can show it; `None` outside.
    pub at_tip: Option<TissueAtTip>,
}

/// Tissue at the tip of the needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TissueAtTip {
    /// Position of the tip, mm.
    pub tip_mm: Point3<f64>,
    /// Nodes of the element in which the tissue at the tip lies.
    pub corners: [u32; 4],
    /// Its barycentric coordinates there.
    pub shares: [f64; 4],
    /// Radius of the patch that the tip dents, mm.
    pub radius_mm: f64,
}

/// Displacements of the nodes, or the forces that determine them.
#[derive(Clone, Debug, PartialEq)]
pub enum Field {
    /// Forces (N) by degree of freedom on the base mesh: one solve with the factor of its stiffness gives the
    /// displacements.
    BaseForces(Vec<(u32, f64)>),
    /// Displacement of each node, mm.
    Displacement(Vec<[f64; 3]>),
}

impl Default for Field {
    fn default() -> Self {
        Field::BaseForces(Vec::new())
    }
}

/// Force of the tissue on a length of the needle's shaft, or at a point of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftLoad {
    /// Arc from the base to where the length begins, mm.
    pub from_mm: f64,
    /// Arc to where it ends, mm: not below `from_mm`, equal for a force at a point.
    pub to_mm: f64,
    /// Force on the needle, N, world axes.
    pub force_n: Vector3<f64>,
}

impl ShaftLoad {
    /// Length over which the force is spread, mm.
    pub fn length_mm(&self) -> f64 {
        self.to_mm - self.from_mm
    }
}

/// Computes node positions for the image from snapshots, on any thread.
pub trait NodeSolver: Send {
    /// Returns the elements of the mesh, four nodes each. They never change.
    fn elements(&self) -> &[[u32; 4]];

    /// Writes the node positions of a snapshot; `into` is `insonify::MovedTissue`.
    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue);
}

/// Everything that a step depends on except the instruments and the remeshing level: restored into a model at the same
/// level, the same steps give the same bits.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Saved(pub serde_json::Value);

/// Model of tissue with a needle in it and optionally a probe.
///
/// [`Finite`](finite::Finite) has an example of its use. A model of one's own, here of tissue beyond z = 0 that does
/// not move:
///
/// ```
/// use insonify_mechanics::insertion::{Instruments, Model, NodeSolver, Outcome, Saved, Snapshot, StepError, Tissue};
/// use nalgebra::{Isometry3, Point3, Vector3};
///
/// /// A needle of 100 mm, held by 0.02 N a millimetre.
/// #[derive(Default)]
/// struct Friction {
///     base: Isometry3<f64>,
///     outcome: Outcome,
/// }
///
/// impl Model for Friction {
///     fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
///         instruments.check(dt_s)?;
///         self.base = instruments.base;
///         self.outcome.tip_mm = self.base * Point3::new(0.0, 0.0, 100.0);
///         self.outcome.inserted_mm = self.outcome.tip_mm.z.max(0.0);
///         self.outcome.on_hand.force_n = self.base * Vector3::z() * (-0.02 * self.outcome.inserted_mm);
///         Ok(&self.outcome)
///     }
///     fn outcome(&self) -> &Outcome {
///         &self.outcome
///     }
///     fn snapshot(&mut self, into: &mut Snapshot) {
///         let shaft = [0.0, 100.0].map(|arc_mm| (arc_mm, self.base * Point3::new(0.0, 0.0, arc_mm)));
///         into.line.set(shaft);
///     }
///     fn imager(&self) -> Box<dyn NodeSolver> {
///         Box::new(Rest)
///     }
///     fn save(&mut self) -> Saved {
///         Saved(serde_json::json!([self.base, self.outcome]))
///     }
///     fn restore(&mut self, saved: &Saved) -> Result<(), StepError> {
///         let read = serde_json::from_value(saved.0.clone());
///         (self.base, self.outcome) = read.map_err(|error| StepError::Foreign(error.to_string()))?;
///         Ok(())
///     }
/// }
///
/// /// No mesh.
/// struct Rest;
///
/// impl NodeSolver for Rest {
///     fn elements(&self) -> &[[u32; 4]] {
///         &[]
///     }
///     fn tissue(&mut self, _: &Snapshot, _: &mut Tissue) {}
/// }
///
/// let mut model = Friction::default();
/// let base = Isometry3::translation(0.0, 0.0, -60.0);
/// let outcome = model.step(&Instruments::new(base), 1e-3)?;
/// assert_eq!((outcome.inserted_mm, outcome.on_hand.force_n.z), (40.0, -0.8));
/// # Ok::<(), StepError>(())
/// ```
pub trait Model: Send {
    /// Sets the poses of the instruments before the first step, which then starts from there and skips no element. A
    /// needle whose tip begins in the tissue is left to the first step, which treats it as pushed in before. Models
    /// without an implementation, or that have made steps, ignore the call.
    fn start(&mut self, _: &Instruments) {}

    /// Makes one step of `dt_s` seconds to the given poses. However large the motion, no element is skipped; what could
    /// not be resolved is reported in the outcome.
    ///
    /// # Errors
    /// [`StepError::Input`], [`StepError::Pose`].
    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError>;

    /// Returns the last outcome.
    fn outcome(&self) -> &Outcome;

    /// Returns what the last step spent its wall time on; `None` for a model that does not measure it.
    fn cost(&self) -> Option<&StepCost> {
        None
    }

    /// Returns the direction of the needle at its tip; `None` for a model without a needle of its own.
    fn tip_direction(&self) -> Option<Unit<Vector3<f64>>> {
        None
    }

    /// Writes the forces of the tissue on the needle after the last step, base first, the tip last: their sum is the
    /// force on the hand but for guides (and, of masses and springs, which give those of the last substep, for the mean
    /// over a step). A model without an implementation has none.
    fn shaft_loads(&self, into: &mut Vec<ShaftLoad>) {
        into.clear();
    }

    /// Returns the stress of each element, kPa, of a model whose stress does not follow from the displacements alone,
    /// if it is followed.
    fn stress_kpa(&self) -> Option<&[[[f64; 3]; 3]]> {
        None
    }

    /// Writes the state needed for an image, reusing the memory of `into`.
    fn snapshot(&mut self, into: &mut Snapshot);

    /// Returns a converter from snapshots to tissue, for another thread.
    fn imager(&self) -> Box<dyn NodeSolver>;

    /// Changes the remeshing level. The needle settles at the pose of the last step before and after, so that the force
    /// jump is due to the level alone. The first change to a level that needs a dense inverse takes seconds to minutes:
    /// not for a haptic loop. Saved states do not contain the level.
    ///
    /// # Errors
    /// [`StepError::NoLevel`], [`StepError::Level`]; the level is then unchanged.
    fn set_level(&mut self, _: Level) -> Result<LevelChange, StepError> {
        Err(StepError::NoLevel)
    }

    /// Returns the state. Saving may reset accumulated rounding: a model continues from a save exactly as one restored
    /// to it.
    fn save(&mut self) -> Saved;

    /// Restores a saved state.
    ///
    /// # Errors
    /// [`StepError::Foreign`]; the model is then unchanged.
    fn restore(&mut self, saved: &Saved) -> Result<(), StepError>;
}
