//! Case files for the identification of force parameters and Young's moduli from a measured insertion (Dehghan et al. 2008, section "Parameter
//! identification method").
//!
//! [`CaseFile`] is the file as written; [`CaseFile::resolve`] reads its scenario and checks it. Errors point at the line.

mod file;
mod resolve;

pub use file::{CaseFile, Cost};
pub use resolve::{Case, Crossed};

/// Example case file with every key.
pub const EXAMPLE: &str = include_str!("../../assets/identification.toml");
