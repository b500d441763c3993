//! Case files for a needle whose base is moved: needle, base, elements and tissue layers in one TOML file.
//!
//! [`CaseFile`] is the file as written; [`CaseFile::resolve`] checks it; [`Case::solve`] bends the needle (see
//! [`mechanics::needle::beam`](crate::mechanics::needle::beam)) and [`Case::find`] finds the base motion for what is wanted.
//! Errors point at the line. [`points`] reads measured stretch and stress.
//!
//! ```
//! use insonify::input::beam_case::{self, CaseFile};
//!
//! let case = CaseFile::parse(beam_case::EXAMPLE, "beam.toml")?.resolve()?;
//! assert_eq!(case.solve()?.rcm_mm(), Some(17.5));
//!
//! let error = CaseFile::parse(&beam_case::EXAMPLE.replace("slope", "slop"), "beam.toml").unwrap_err();
//! assert_eq!(error.location(), Some(("beam.toml", 15)));
//! # Ok::<(), insonify::input::InputError>(())
//! ```

mod file;
pub mod points;
mod report;
mod resolve;

pub use file::CaseFile;
pub use report::{Report, plot};
pub use resolve::Case;

/// Example case file with every key.
pub const EXAMPLE: &str = include_str!("../../assets/beam.toml");

#[cfg(test)]
mod tests;
