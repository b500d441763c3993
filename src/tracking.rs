//! Where the probe and the needle are: geometry, poses, trajectories, tracked sequences.

pub mod probe;
pub mod sequence;
