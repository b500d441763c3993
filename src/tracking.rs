//! Where the probe and the needle are: geometry, poses, trajectories, tracked sequences.

<<<<<<< HEAD
pub mod calibration;
pub mod matrix;
pub mod needle;
pub mod pose;
=======
pub mod placement;
>>>>>>> 727b95ac4db851c61337198dc24dd6b785fd6ef5
pub mod probe;
pub mod trajectory;
