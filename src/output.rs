//! Files that leave the program: PNG, animated previews, image sequences with transforms, sidecars; and the places that they go to.

pub mod atomic;
mod canvas;
pub mod folder;
pub mod gif;
pub mod overlay;
pub mod overview;
pub mod place;
pub mod png;
pub mod sequence;
pub mod sidecar;
mod staged;

pub use staged::abandon;

/// A number below `of` for the name of a file: 4 digits, and more if the largest has more, so that names sort.
pub fn numbered(number: usize, of: usize) -> String {
    let width = of.saturating_sub(1).to_string().len().max(4);
    format!("{number:0width$}")
}
