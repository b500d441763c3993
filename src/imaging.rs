//! Frames from anatomy and motion: effects, the plan of passes, both backends, and image sequences.

#[cfg(feature = "cli")]
pub mod canvas;
pub mod effects;
pub mod fusion;
#[cfg(feature = "cli")]
pub mod overlay;
#[cfg(feature = "cli")]
pub mod overview;
pub mod plan;
pub mod quality;
#[cfg(feature = "cli")]
pub mod rf;
pub mod sequence;
pub mod sidecar;
pub mod synth;
