//! Parity of the backends, pass by pass.
//!
//! The reference in double precision is the truth of these tests; its single-precision twin and the GPU must follow it to
//! within rounding. How far rounding may carry them is not guessed: `insonify_imaging::parity` has a running error analysis of
//! each effect, which takes the bound before a pass to the bound after it. Here are the scenes that put them to the test.

mod case;
mod scenes;

mod blur;
mod contact;
mod frame;
mod geometry;
mod interface;
mod lossy;
mod needle;
mod noise;
mod quantise;
mod receiver;
mod refraction;
mod scan_conversion;
mod shadow;
mod slice;
mod speckle;
mod texture;
mod thickness;
mod tone;
mod truth;
mod warp;
mod warp_remeshed;
