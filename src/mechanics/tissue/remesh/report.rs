//! What a remesh did.

use super::Level;

/// Why a compliance was computed anew rather than updated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rebuilt {
    /// It always is.
    Always,
    /// A sample was off by more than tolerated; its residual.
    Residual(f64),
    /// The compliance at the contacts was no longer positive definite.
    Indefinite,
    /// The level before left entries as they were.
    Switched,
    /// It was asked for.
    Requested,
}

/// What a remesh did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemeshReport {
    /// At which level.
    pub level: Level,
    /// Rows of the change (s).
    pub rank: usize,
    /// Rows in which the stiffness differs from that of the base (|S|), where the level keeps account of them; else 0.
    pub held: usize,
    /// Reciprocal condition of I + dK G, estimated; 1 where nothing was solved.
    pub reciprocal_condition: f64,
    /// The sampled residual, where one was taken (see [`Remesher::residual`](super::Remesher::residual)): levels I to III for
    /// unit forces on single degrees of freedom, the exact level for forces of 1 or -1 N on all of S at once.
    pub residual: Option<f64>,
    /// Why the compliance was computed anew, if it was.
    pub rebuilt: Option<Rebuilt>,
    /// A rebuild was due and failed, and the updated compliance is kept; or it leaves a residual beyond the limit, as near
    /// incompressibility, where one update loses more digits than the limit allows. Prepare a new base.
    pub rebuild_failed: bool,
    /// Bytes of the large matrices read and written.
    pub bytes_moved: usize,
}
