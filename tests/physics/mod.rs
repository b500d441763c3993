//! Each effect against what physics or arithmetic say of it, through the whole pipeline of the reference in both
//! precisions. The GPU follows by parity (`tests/parity`).

mod changes;
mod determinism;
mod empty;
mod large;
mod seeds;
mod speckle_motion;
mod tissue_motion;
