//! Files that leave the program: PNG, image sequences with transforms, sidecars.

pub mod atomic;
pub mod overview;
pub mod png;
pub mod sequence;
pub mod sidecar;
