//! Output files: PNG, animated previews, image sequences with transforms, sidecars, and their destinations.

pub mod atomic;
mod error;
pub mod folder;
pub mod place;
pub mod png;
pub mod queue;
pub mod staged;

pub use error::OutputError;
pub use staged::abandon;

/// Formats a number below `total` for a file name: 4 digits, or as many as the largest needs, so that names sort.
pub fn numbered(number: usize, total: usize) -> String {
    let width = total.saturating_sub(1).to_string().len().max(4);
    format!("{number:0width$}")
}
