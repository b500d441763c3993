//! Probe and needle tracking: geometry, poses, trajectories, tracked sequences, calibration.

pub mod calibrate;
pub mod calibration;
mod error;
pub mod manipulator;
pub mod needle;
pub mod placement;
pub mod plus;
pub mod pose;
pub mod probe;
pub mod sequence;
pub mod template;
pub mod trajectory;
pub mod world;

pub use error::TrackingError;
