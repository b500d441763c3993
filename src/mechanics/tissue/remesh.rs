//! Remeshing at the needle's tip, at chosen levels of accuracy.
//!
//! The tip enters an element, one of its corners is moved there in the reference state, and the stiffness changes on the few
//! degrees of freedom around that node. What becomes of the compliance K^-1, and of its part at the contacts, is a choice:
//!
//! | level | what is brought up to date | how |
//! |---|---|---|
//! | [`Level::I`] | all of K^-1 | [`levels`] |
//! | [`Level::II`] | rows and columns of the node and its neighbours | [`levels`] |
//! | [`Level::III`] | rows and columns of the node | [`levels`] |
//! | [`Level::IV`] | nothing | [`levels`] |
//! | [`Level::Exact`] | only K^c at the contacts, exactly, from an untouched base inverse | [`exact`] |
//!
//! The levels I to IV are those of Goksel et al. 2011, section V-B. All of them, and others of their kind, answer to
//! [`Remesher`]; [`adaptation`] keeps one together with its mesh and changes it for another while running.
//!
//! | module | what it holds |
//! |---|---|
//! | [`adapted`] | the mesh whose nodes move, and what a move changes |
//! | [`difference`] | the stiffness now less that of the base |
//! | [`corner`] | which node is moved to the tip |
//! | [`exact`], [`levels`] | the levels |
//! | [`rebase`] | a new base, prepared in the background |
//! | [`adaptation`] | mesh and level together |

pub mod adaptation;
pub mod adapted;
pub mod corner;
mod defect;
pub mod difference;
mod error;
pub mod exact;
mod grown;
pub mod levels;
mod lu;
pub mod make;
mod options;
pub mod rebase;
mod report;
#[cfg(test)]
mod testing;
mod watch;

use faer::{Mat, MatMut, MatRef};

pub use adaptation::Adaptation;
pub use adapted::{AdaptedMesh, Change, RefusedMove};
pub use difference::Difference;
pub use error::RemeshError;
pub use make::{Maker, Source, make};
pub use options::Options;
pub use report::{Rebuilt, RemeshReport};

/// How much of the compliance a remesh brings up to date.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Level {
    /// Everything.
    I,
    /// Rows and columns of the moved node and its neighbours.
    II,
    /// Rows and columns of the moved node.
    III,
    /// Nothing: the constraints at the moved node act through the compliance of its place in the base.
    IV,
    /// Only what the contacts need, exactly.
    Exact,
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

/// Of the entries of the compliance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// `f32`.
    Single,
    /// `f64`.
    Double,
}

impl std::fmt::Display for Precision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Precision::Single => "f32",
            Precision::Double => "f64",
        })
    }
}

/// What the compliance at hand is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// That of the current mesh, up to rounding.
    Current,
    /// An approximation of it: entries have been left as they were. A level that promises more begins with a rebuild.
    Approximate {
        /// Changes since it was that of the mesh.
        changes: u64,
    },
}

/// Keeps a compliance, or what is needed of it, in step with an [`AdaptedMesh`].
///
/// Every change of the mesh is handed over once, in order, right after it is made. Contacts are degrees of freedom; forces are in
/// N, displacements in mm, compliances in mm/N.
pub trait Remesher: Send {
    /// The level it works at.
    fn level(&self) -> Level;

    /// Changes the level to another of the same kind: among I to IV. From II, III or IV to a lower numeral the compliance is
    /// rebuilt from the base first.
    ///
    /// # Errors
    /// [`RemeshError::Level`] where it is of another kind; or as [`refresh`](Self::refresh).
    fn set_level(&mut self, mesh: &AdaptedMesh, level: Level) -> Result<Option<RemeshReport>, RemeshError>;

    /// Of the compliance it starts from.
    fn precision(&self) -> Precision;

    /// Whether its compliance is that of the current mesh.
    fn state(&self) -> State;

    /// Takes in one change of the mesh.
    ///
    /// # Errors
    /// [`RemeshError`]; it is then as before, and the change must be taken back from the mesh, as [`Adaptation`] does.
    fn remesh(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<RemeshReport, RemeshError>;

    /// Is told around which degrees of freedom (ascending) the next change will probably be. A level that can do part of its work
    /// ahead does that in [`tend`](Self::tend); whether the change comes makes no difference but for rounding.
    fn expect(&mut self, _support: &[u32]) {}

    /// Does one thing that changes have left to do ([`Options::tended`]), if there is one. A report where that computed the compliance
    /// anew: it has changed then, by no more than its error was.
    fn tend(&mut self, _mesh: &AdaptedMesh) -> Option<RemeshReport> {
        None
    }

    /// Computes everything anew from the base and the current mesh, whatever changes were missed.
    ///
    /// # Errors
    /// [`RemeshError`]; it is then as before.
    fn refresh(&mut self, mesh: &AdaptedMesh) -> Result<RemeshReport, RemeshError>;

    /// Follows a new base of `mesh`, which is already that of the mesh, from its compliance. The contacts stay.
    ///
    /// # Errors
    /// [`RemeshError`]; it then follows the old base as before.
    fn rebase(&mut self, mesh: &AdaptedMesh, source: &Source) -> Result<RemeshReport, RemeshError>;

    /// The largest of |K X e - e| over the unit forces e on some degrees of freedom, in maximum norms, where K is the true
    /// stiffness of the current mesh and X the compliance at hand: how wrong, relative to the force, the forces are
    /// that hold the displacements.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn residual(&mut self, mesh: &AdaptedMesh, dofs: &[usize]) -> Result<f64, RemeshError>;

    /// Names the degrees of freedom of the contacts, in the order of [`condensed`](Self::condensed). What is known of those
    /// that stay is kept.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`] where one is out of range or named twice, or entries cannot be had.
    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), RemeshError>;

    /// The degrees of freedom of the contacts.
    fn contacts(&self) -> &[usize];

    /// K^c: displacements of the contacts under forces on them, symmetric bit for bit.
    fn condensed(&self) -> MatRef<'_, f64>;

    /// A block of the compliance at hand.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn compliance(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError>;

    /// Displacements of all free degrees of freedom under forces on the contacts.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`], also where a slice has the wrong length.
    fn displacement(&mut self, forces: &[f64], out: &mut [f64]) -> Result<(), RemeshError>;

    /// As [`displacement`](Self::displacement), with one step of iterative refinement against the true stiffness: what a
    /// compliance in single precision loses is won back. Returns the normwise backward error that is left.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn displacement_refined(&mut self, mesh: &AdaptedMesh, forces: &[f64], out: &mut [f64])
    -> Result<f64, RemeshError>;

    /// Forces (degree of freedom, N) that displace the whole mesh through the [carrier](Self::carrier_into) as `forces` on the
    /// contacts do: first those on the contacts in their order, then what makes up for moved nodes. One may be named twice; their
    /// forces then add up.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`] where there is not one force a contact.
    fn carried_forces(&mut self, forces: &[f64], out: &mut Vec<(usize, f64)>) -> Result<(), RemeshError>;

    /// Entries of the matrix that carried forces act through: the compliance of the base at the exact level, else the compliance
    /// at hand.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn carrier_into(&mut self, rows: &[usize], columns: &[usize], out: MatMut<'_, f64>) -> Result<(), RemeshError>;

    /// Whether the carrier is the compliance of the base: who has its factor can then compute displacements from the carried
    /// forces elsewhere.
    fn carries_on_base(&self) -> bool;

    /// Makes columns of the carrier ready ahead of their use.
    ///
    /// # Errors
    /// [`RemeshError::Compliance`].
    fn prefetch(&mut self, dofs: &[usize]) -> Result<(), RemeshError>;

    /// Bytes it holds, the base among them.
    fn memory(&self) -> usize;
}

/// Checks that a change comes right after those taken in, and the mesh has it and no more.
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
