//! Report of a remesh.

use super::Level;

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
    pub held: usize,
    /// Estimated reciprocal condition of I + dK G; 1 where nothing was solved.
    pub reciprocal_condition: f64,
    /// Sampled residual, where taken (see [`Remesher::residual`](super::Remesher::residual)): at levels I to III for
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
