//! Remeshing at the needle tip, at selectable levels of accuracy.
//!
//! The tip enters an element, one of its corners is moved there in the reference state, and the stiffness changes on
//! the few degrees of freedom around that node. The level determines how the compliance K^-1, and its part at the
//! contacts, are updated:
//!
//! | level | updated part | module |
//! |---|---|---|
//! | [`Level::I`] | all of K^-1 | [`levels`] |
//! | [`Level::II`] | rows and columns of the node and its neighbours | [`levels`] |
//! | [`Level::III`] | rows and columns of the node | [`levels`] |
//! | [`Level::IV`] | nothing | [`levels`] |
//! | [`Level::Exact`] | only K^c at the contacts, exactly, from an unmodified base inverse | [`exact`] |
//!
//! The levels I to IV are those of Goksel et al. 2011, section V-B. All levels implement [`Remesher`]; [`adaptation`]
//! combines a remesher with its mesh and can replace it at run time.
//!
//! | module | contents |
//! |---|---|
//! | [`adapted`] | mesh with movable nodes, and the effects of a move |
//! | [`difference`] | current stiffness minus that of the base |
//! | [`corner`] | choice of the node to move to the tip |
//! | [`exact`], [`levels`] | remeshers of the levels |
//! | [`adaptation`] | mesh and remesher combined |

pub mod adaptation;
pub mod adapted;
pub mod corner;
mod defect;
pub mod difference;
mod error;
pub mod exact;
mod growable;
pub mod levels;
mod lu;
pub mod make;

pub use adaptation::Adaptation;
pub use adapted::{AdaptedMesh, Change};
pub use error::RemeshError;
pub use make::{Maker, Source, make};

use faer::{Mat, MatMut, MatRef};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Part of the compliance that a remesh updates: see `docs/remeshing.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
pub enum Level {
    /// Only the compliance at the contacts is computed, exactly.
    #[default]
    #[serde(rename = "exact")]
    Exact,
    /// All entries are updated.
    I,
    /// The rows and columns of the moved node and its neighbours are updated.
    II,
    /// The rows and columns of the moved node are updated.
    III,
    /// No entry is updated: constraints at the moved node act through the compliance of its place in the base.
    IV,
}

impl std::fmt::Display for Level {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Level::I => "I",
            Level::II => "II",
            Level::III => "III",
            Level::IV => "IV",
            Level::Exact => "exact",
        })
    }
}

/// Floating-point precision of a compliance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
pub enum Precision {
    /// Double precision, `f64`.
    #[serde(rename = "f64")]
    Double,
    /// Single precision, `f32`.
    #[serde(rename = "f32")]
    Single,
}

impl std::fmt::Display for Precision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Precision::Single => "f32",
            Precision::Double => "f64",
        })
    }
}

/// Keeps a compliance, or the part of it that is needed, consistent with an [`AdaptedMesh`].
///
/// Every change of the mesh must be passed once, in order, right after it is made. Contacts are degrees of freedom;
/// forces are in N, displacements in mm, compliances in mm/N.
pub trait Remesher: Send {
    /// Level in use.
    fn level(&self) -> Level;

    /// Changes the level to another of the same kind, that is among I to IV. A switch from II, III or IV to a lower
    /// numeral first rebuilds the compliance from the base.
    ///
    /// # Errors
    /// [`RemeshError::Level`] where the level is of another kind; otherwise those of [`refresh`](Self::refresh).
    fn set_level(&mut self, mesh: &AdaptedMesh, level: Level) -> Result<Option<RemeshReport>, RemeshError>;

    /// Precision of the base compliance.
    fn precision(&self) -> Precision;

    /// Processes one change of the mesh.
    ///
    /// # Errors
    /// [`RemeshError`]; the remesher is then unchanged, and the change must be reverted in the mesh, as [`Adaptation`]
    /// does.
    fn remesh(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<RemeshReport, RemeshError>;

    /// Announces the degrees of freedom (ascending) around which the next change is likely. A level may do part of its
    /// work early, in [`run_deferred`](Self::run_deferred); whether the change occurs affects the results only by
    /// rounding.
    fn expect(&mut self, _support: &[u32]) {}

    /// Performs one deferred task of earlier changes ([`RemesherOptions::deferred`]), if any. Returns a report where
    /// that recomputed the compliance, which then has changed by no more than its error was.
    fn run_deferred(&mut self, _mesh: &AdaptedMesh) -> Option<RemeshReport> {
        None
    }

    /// Recomputes everything from the base and the current mesh, even after missed changes.
    ///
    /// # Errors
    /// [`RemeshError`]; the remesher is then unchanged.
    fn refresh(&mut self, mesh: &AdaptedMesh) -> Result<RemeshReport, RemeshError>;

    /// Returns the largest |K X e - e| over the unit forces e on some degrees of freedom, in maximum norms, where K is
    /// the true stiffness of the current mesh and X the current compliance: the error, relative to the force, of the
    /// forces that balance the displacements.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn residual(&mut self, mesh: &AdaptedMesh, dofs: &[usize]) -> Result<f64, RemeshError>;

    /// Sets the degrees of freedom of the contacts, in the order of [`condensed`](Self::condensed). Data of those
    /// already set are kept.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`] where one is out of range or repeated, or entries cannot be read.
    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), RemeshError>;

    /// Degrees of freedom of the contacts.
    fn contacts(&self) -> &[usize];

    /// K^c: displacements of the contacts under forces on them, exactly symmetric.
    fn condensed(&self) -> MatRef<'_, f64>;

    /// Returns a block of the current compliance.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn compliance(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError>;

    /// Computes the displacements of all free degrees of freedom under forces on the contacts.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`], also where a slice has the wrong length.
    fn displacement(&mut self, forces: &[f64], out: &mut [f64]) -> Result<(), RemeshError>;

    /// Computes displacements as [`displacement`](Self::displacement) does, with one step of iterative refinement
    /// against the true stiffness, which recovers the accuracy lost in single precision. Returns the remaining normwise
    /// backward error.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn displacement_refined(&mut self, mesh: &AdaptedMesh, forces: &[f64], out: &mut [f64])
    -> Result<f64, RemeshError>;

    /// Computes the forces (degree of freedom, N) that displace the entire mesh through the
    /// [carrier](Self::force_compliance_into) as `forces` on the contacts do: first those on the contacts in their
    /// order, then corrections for moved nodes. A degree of freedom may occur twice; its forces then add up.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`] where there is not one force per contact.
    fn equivalent_forces(&mut self, forces: &[f64], out: &mut Vec<(usize, f64)>) -> Result<(), RemeshError>;

    /// Writes entries of the carrier, the matrix that carried forces act through: the compliance of the base at the
    /// exact level, else the current compliance.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn force_compliance_into(
        &mut self,
        rows: &[usize],
        columns: &[usize],
        out: MatMut<'_, f64>,
    ) -> Result<(), RemeshError>;

    /// Whether the carrier is the compliance of the base, so that displacements can be computed elsewhere from the
    /// carried forces and the factor of the base.
    fn uses_base_compliance(&self) -> bool;

    /// Computes columns of the carrier before their use.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn prefetch(&mut self, dofs: &[usize]) -> Result<(), RemeshError>;

    /// Memory in use, including the base, bytes.
    fn memory(&self) -> usize;
}

/// Checks that a change directly follows those processed, and is the last one of the mesh.
fn check_step(step: u64, mesh: &AdaptedMesh, change: &Change) -> Result<(), RemeshError> {
    let expected = step + 1;
    if change.step == expected && mesh.step() == expected {
        return Ok(());
    }
    Err(RemeshError::OutOfStep {
        expected,
        found: change.step,
        mesh: mesh.step(),
    })
}

/// Tolerances and policies of a [`Remesher`]. The defaults suit tissue meshes of some thousand nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemesherOptions {
    /// Smallest reciprocal condition of the capacitance matrix I + dK G; changes below it are refused. There an update
    /// loses more than ten of sixteen digits; moves within the mesh's own limit stay far above.
    pub reciprocal_limit: f64,
    /// Largest number of changes between samples of the errors (0: no samples). Every change is sampled at first and
    /// after a bad sample, then ever fewer.
    pub check_every: u64,
    /// Exact level: sampled backward error of C, or relative error of K^c against C, above which both are recomputed.
    pub exact_tolerance: f64,
    /// Level I in f64: largest residual. The inverse is rebuilt where a sample exceeds a tenth of it. See
    /// [`Remesher::residual`].
    pub residual_double: f64,
    /// Level I in f32: largest residual. The inverse is rebuilt where a sample exceeds a tenth of it.
    pub residual_single: f64,
    /// Exact level: whether to defer work not needed at once, the last product that completes C and due samples of
    /// errors, to [`Remesher::run_deferred`], so that no step has to do it all. Work still pending at
    /// the next change is done then.
    pub deferred: bool,
    /// Largest Poisson's ratio at which levels I to III may use f32.
    pub single_poisson_limit: f64,
}

impl Default for RemesherOptions {
    fn default() -> Self {
        RemesherOptions {
            reciprocal_limit: 1e-10,
            check_every: 16,
            exact_tolerance: 1e-12,
            residual_double: 1e-9,
            residual_single: 1e-2,
            deferred: false,
            single_poisson_limit: 0.49,
        }
    }
}

/// Why a compliance was recomputed instead of updated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rebuilt {
    /// The residual of a sample, given here, exceeded the tolerance.
    Residual(f64),
    /// The compliance at the contacts was no longer positive definite.
    Indefinite,
    /// The previous level had not updated all entries.
    Switched,
    /// The caller requested it.
    Requested,
}

/// Outcome of a remesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemeshReport {
    /// Level of the remesh.
    pub level: Level,
    /// Number of rows of the change (s).
    pub rank: usize,
    /// Number of rows in which the stiffness differs from that of the base (|S|), where the level tracks them; else 0.
    pub support_size: usize,
    /// Estimated reciprocal condition of I + dK G; 1 where nothing was solved.
    pub reciprocal_condition: f64,
    /// Sampled residual, where taken (see [`Remesher::residual`]): at levels I to III for
    /// unit forces on single degrees of freedom, at the exact level for forces of 1 or -1 N on all of S at once.
    pub residual: Option<f64>,
    /// Why the compliance was recomputed, if it was.
    pub rebuilt: Option<Rebuilt>,
    /// Whether a due rebuild failed, so that the updated compliance was kept, or left a residual beyond the limit, as
    /// near incompressibility, where one update loses more digits than the limit allows.
    pub rebuild_failed: bool,
    /// Bytes of the large matrices read and written.
    pub bytes_moved: usize,
}

/// Counter of updates between samples: one after a start or a bad sample, twice as many after each good one.
#[derive(Clone, Copy, Debug)]
struct SampleSchedule {
    /// Updates since the last sample.
    updates: u64,
    interval: u64,
}

impl SampleSchedule {
    /// Creates a schedule that samples the next update.
    pub(crate) fn new() -> SampleSchedule {
        SampleSchedule {
            updates: 0,
            interval: 1,
        }
    }

    /// Counts an update; returns whether to sample it. With `every` 0 none is sampled.
    pub(crate) fn is_due(&mut self, every: u64) -> bool {
        self.updates += 1;
        every > 0 && self.updates >= self.interval
    }

    /// Records a good sample: the next may wait twice as long, but at most `every` updates.
    pub(crate) fn relax(&mut self, every: u64) {
        *self = SampleSchedule {
            updates: 0,
            interval: (2 * self.interval).min(every),
        };
    }
}

#[cfg(test)]
mod testing;
