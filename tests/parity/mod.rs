//! Parity of the backends, pass by pass.
//!
//! The reference in double precision is the truth of these tests; its single-precision twin and the GPU must follow it
//! to within rounding. How far rounding may carry them is not guessed: `insonify_imaging::parity` has a running error
//! analysis of each effect, which takes the bound before a pass to the bound after it. Here are the scenes that put
//! them to the test.

pub(crate) mod case;
pub(crate) mod scenes;

mod frame;
mod lossy;
mod warp_remeshed;
