//! Files that leave the program: PNG, animated previews, image sequences with transforms, sidecars.

pub mod atomic;
pub mod gif;
pub mod overview;
pub mod png;
pub mod sequence;
pub mod sidecar;
