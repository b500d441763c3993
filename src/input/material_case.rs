//! Case files for material tests: one point of tissue in shear, under a history of stress or strain.
//!
//! [`CaseFile`] is the file as written; [`CaseFile::resolve`] checks it; [`Case::run`] follows the history (see
//! [`mechanics::tissue::viscoelastic::point`](crate::mechanics::tissue::viscoelastic::point)). [`rheometer`] puts the material
//! through the measurements of Kobayashi et al. 2010. Errors point at the line.
//!
//! ```
//! use insonify::input::material_case::CaseFile;
//!
//! let text = r#"
//! law = "spring-pot"
//! order = 0.1
//! modulus_kpa = 0.4
//! [history]
//! control = "stress"
//! time_s = [0.0, 1.0, 10.0]
//! value = [0.05, 0.05, 0.05]
//! "#;
//! let report = CaseFile::parse(text, "creep.toml")?.resolve()?.run()?;
//! // 0.05 t^k / (0.4 Gamma(1.1)) at 10 s.
//! assert!((report.strain[2] - 0.125 * 10f64.powf(0.1) / 0.951350769866873).abs() < 1e-12);
//!
//! let error = CaseFile::parse(&text.replace("0.1\n", "1.1\n"), "creep.toml")?.resolve().unwrap_err();
//! assert_eq!(error.location(), Some(("creep.toml", 3)));
//! # Ok::<(), insonify::input::InputError>(())
//! ```

mod file;
pub mod fit;
mod report;
mod resolve;
pub mod rheometer;

pub use file::CaseFile;

/// Example case file with every key.
pub const EXAMPLE: &str = include_str!("../../assets/liver-creep.toml");

#[cfg(test)]
mod tests;
