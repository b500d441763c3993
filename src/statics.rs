//! Static problems as a user writes them: a mesh, materials, what is fixed and what is loaded, in one TOML file.
//!
//! [`ProblemFile`] is the file as written; [`ProblemFile::resolve`] reads its mesh and picks the nodes it means;
//! [`Problem::solve`] solves it (see [`mechanics::tissue`](crate::mechanics::tissue)). Errors point at the line.
//!
//! ```
//! use insonify::statics::ProblemFile;
//!
//! let text = r#"
//! mesh = "block.vtu"
//! report_nodes = [7]
//! [[material]]
//! young_kpa = 5.0
//! poisson = 0.45
//! [[fix]]
//! box_mm = [[-inf, -inf, -inf], [inf, inf, 0.0]]
//! [[load]]
//! nodes = [7]
//! node_force_n = [0.0, 0.0, 0.001]
//! "#;
//! let file = ProblemFile::parse(text, "pull.toml")?;
//! assert_eq!(file.load[0].node_force_n, Some([0.0, 0.0, 0.001]));
//!
//! let error = ProblemFile::parse(&text.replace("poisson", "poison"), "pull.toml").unwrap_err();
//! assert_eq!(error.location(), Some(("pull.toml", 6)));
//! # Ok::<(), insonify::statics::StaticsError>(())
//! ```

mod course;
mod error;
mod fields;
mod file;
mod loads;
mod materials;
mod report;
mod resolve;
mod run;
pub(crate) mod selection;

pub use course::{HistorySpec, MOST_STEPS, MemoryName, Model, RuleName, SchemeName, SolverSpec, ViscositySpec};
pub use error::{StaticsError, Wrong};
pub use fields::Fields;
pub use file::{FixSpec, LoadSpec, MaterialSpec, ProblemFile};
pub use report::Report;
pub use resolve::{Problem, Solved};
pub use run::History;

/// A problem file to start from, with every key of linear tissue.
pub const EXAMPLE: &str = include_str!("../assets/press.toml");

/// Another, of viscoelastic tissue with a history.
pub const CREEP: &str = include_str!("../assets/liver-plate.toml");

#[cfg(test)]
mod tests;
