//! Frames from anatomy and motion: scene files, effects, the plan of passes, both backends, and image sequences.
//!
//! Features: `gpu`, on by default, has wgpu and `rf`, radio-frequency echoes; `analysis` has bounds on rounding errors
//! and volumes with closed forms.

#[cfg(any(test, feature = "analysis"))]
pub mod anatomies;
pub mod canvas;
pub mod effects;
pub mod fusion;
pub mod overlay;
pub mod overview;
#[cfg(any(test, feature = "analysis"))]
pub mod parity;
pub mod plan;
pub mod quality;
#[cfg(feature = "gpu")]
pub mod rf;
pub mod scene;
pub mod sequence;
pub mod sidecar;
#[cfg(any(test, feature = "analysis"))]
pub mod simulated;
pub mod synth;

#[cfg(test)]
extern crate self as insonify_imaging;
#[cfg(test)]
#[path = "../../tests/parity/mod.rs"]
mod parity_tests;
#[cfg(test)]
#[path = "../../tests/support/mod.rs"]
mod support;
