//! Where the probe and the needle are: geometry, poses, trajectories, tracked sequences.

pub mod placement;
pub mod probe;
