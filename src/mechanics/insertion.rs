//! Needle insertion: instruments move, tissue yields, forces come back.
//!
//! A [`Model`] takes the poses of needle and probe step by step and answers with forces, and with the tissue as it is now. Behind
//! it is a finite element model, a mass-spring model, or one of tissue that stiffens and creeps; all hand the same things to image and
//! hand.

mod anatomy;
pub mod finite;
mod interaction;
pub mod nonlinear;
mod outcome;
mod parts;
mod probe;
pub mod pushing;
pub mod spring;

use nalgebra::{Isometry3, Point3};

use super::needle::CentreLine;
use super::tissue::remesh::Level;
pub use anatomy::{Anatomy, MeshRegions};
pub use interaction::{Bone, Interaction, InvalidInteraction, Peak};
pub use outcome::{Event, EventKind, Outcome, Wrench};
pub use parts::InvalidPart;
pub use probe::ProbeContact;
pub(crate) use probe::{lever, pointed};

/// Where the instruments are: what a step reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instruments {
    /// Base frame of the needle to world (see [`needle`](super::needle)).
    pub base: Isometry3<f64>,
    /// Probe frame to world, if a probe presses.
    pub probe: Option<Isometry3<f64>>,
    /// A hole that the needle runs through, as that of a template: a point in its way, mm. It holds a needle that bends across its
    /// shaft and lets it slide.
    pub guide: Option<Point3<f64>>,
    /// Leaves a seed at the tip at the end of this step.
    pub deposit: bool,
}

/// Why a step cannot be made. The model is then as before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepError {
    /// A pose or time that is not finite, or a time that is not above 0.
    #[error("in a step, {what} is {found}; expected {expected}")]
    Input {
        /// Which value.
        what: &'static str,
        /// As given.
        found: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// A saved state of another model.
    #[error("the saved state is of another model: {0}")]
    Foreign(String),
    /// The level of remeshing of a model that has none.
    #[error("this model has no level of remeshing: the mesh of linear finite elements alone follows the needle")]
    NoLevel,
    /// A level of remeshing that cannot be changed to.
    #[error("the level of remeshing stays as it was: {0}")]
    Level(#[from] finite::InvalidSetup),
}

impl StepError {
    /// Whether the machine failed rather than the input: too little memory, or a device.
    pub fn is_machine(&self) -> bool {
        matches!(self, StepError::Level(error) if error.is_machine())
    }
}

/// What a change of the level of remeshing came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelChange {
    /// The level before.
    pub from: Level,
    /// The level since.
    pub to: Level,
    /// Largest change of an entry of the compliance at the contacts, over its largest entry.
    pub compliance_change: f64,
    /// Change of the force on the hand at the same pose, N.
    pub force_jump_n: f64,
    /// What it took, s.
    pub seconds: f64,
}

/// The tissue as it is now: what an image is made from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tissue {
    /// Nodes in the reference state, mm. Remeshing moves them.
    pub reference: Vec<[f64; 3]>,
    /// Nodes now, mm.
    pub current: Vec<[f64; 3]>,
    /// Elements that are inverted now: tissue is crushed there.
    pub inverted: usize,
}

/// What the image thread needs to compute [`Tissue`] by itself: small, so that it can be handed over at every step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Steps made.
    pub step: u64,
    /// Simulated time, s.
    pub time_s: f64,
    /// The shaft, base first.
    pub line: CentreLine,
    /// Seeds left in the tissue: their places in the reference state, mm.
    pub seeds: Vec<Point3<f64>>,
    /// Nodes that remeshing has moved, and where in the reference state they are now (mm).
    pub moved: Vec<(u32, [f64; 3])>,
    /// How the nodes are displaced.
    pub field: Field,
}

/// Displacements of the nodes, or what they follow from.
#[derive(Clone, Debug, PartialEq)]
pub enum Field {
    /// Forces (N) by degree of freedom on the base mesh: one solve with the factor of its stiffness gives the displacements.
    BaseForces(Vec<(u32, f64)>),
    /// Displacement of each node, mm.
    Displacement(Vec<[f64; 3]>),
}

impl Default for Field {
    fn default() -> Self {
        Field::BaseForces(Vec::new())
    }
}

/// Turns snapshots into tissue, on any thread.
pub trait Imager: Send {
    /// Elements of the mesh, four nodes each. They never change.
    fn elements(&self) -> &[[u32; 4]];

    /// Writes where the nodes are.
    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue);
}

/// Everything that a step depends on but the instruments and the level of remeshing: put back into a model at the same level, the same
/// steps give the same bits.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Saved(pub serde_json::Value);

/// A model of tissue with a needle in it, and perhaps a probe beside it.
pub trait Model: Send {
    /// Puts the instruments where they are before the first step, which then goes all the way from there, past no element unseen. A
    /// needle whose tip begins in the tissue is left to the first step: it has been pushed in before. So is everything in a model that
    /// does nothing here, or has made steps.
    fn start(&mut self, _: &Instruments) {}

    /// Makes one step of `dt_s` seconds to where the instruments are now. However far they have come, no element is passed
    /// unseen; what could not be resolved is told in the outcome.
    ///
    /// # Errors
    /// [`StepError::Input`].
    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError>;

    /// The last outcome.
    fn outcome(&self) -> &Outcome;

    /// Writes what the image needs, reusing the memory of `into`.
    fn snapshot(&mut self, into: &mut Snapshot);

    /// What turns snapshots into tissue, for another thread.
    fn imager(&self) -> Box<dyn Imager>;

    /// Changes the level of remeshing. The needle comes to rest at the pose of the last step before and after, so that the jump of the
    /// force is of the level alone. To a level that needs a dense inverse, where
    /// none was made before, that takes seconds to minutes: not for a haptic loop. States do not hold the level.
    ///
    /// # Errors
    /// [`StepError::NoLevel`], [`StepError::Level`]; the level is then as before.
    fn set_level(&mut self, _: Level) -> Result<LevelChange, StepError> {
        Err(StepError::NoLevel)
    }

    /// The state. Saving may settle rounding: a model goes on from a saved state as one does that it is restored to.
    fn save(&mut self) -> Saved;

    /// Goes back to a saved state.
    ///
    /// # Errors
    /// [`StepError::Foreign`]; the model is then as before.
    fn restore(&mut self, saved: &Saved) -> Result<(), StepError>;
}
