//! Problem files for static problems: mesh, materials, constraints and loads in one TOML file.
//!
//! [`ProblemFile`] is the file as written; [`ProblemFile::resolve`] reads its mesh and selects nodes;
//! [`Problem::solve`] solves it (see [`mechanics::tissue`](crate::mechanics::tissue)). Errors point at the line.
//!
//! ```
//! use insonify::input::statics::ProblemFile;
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
//! # Ok::<(), insonify::input::InputError>(())
//! ```

pub mod course;
mod error;
mod fields;
pub mod file;
mod loads;
mod materials;
mod report;
mod resolve;
mod run;
pub mod selection;

pub use course::{Model, SchemeName};
pub use file::ProblemFile;
pub use report::Report;

/// Example problem file with every key of linear tissue.
pub const EXAMPLE: &str = include_str!("../../assets/press.toml");

/// Example problem file of viscoelastic tissue with a load history.
pub const CREEP: &str = include_str!("../../assets/liver-plate.toml");

#[cfg(test)]
mod tests;
