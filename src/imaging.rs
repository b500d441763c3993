//! Frames from anatomy and motion: effects, the plan of passes, both backends, and image sequences.

pub mod canvas;
pub mod effects;
pub mod overlay;
pub mod overview;
pub mod plan;
pub mod quality;
pub mod rf;
pub mod sequence;
pub mod sidecar;
pub mod synth;
