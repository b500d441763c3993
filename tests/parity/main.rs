//! Parity of the backends, pass by pass.
//!
//! The reference in double precision is the truth of these tests; its single-precision twin and the GPU must follow it to
//! within rounding. How far rounding may carry them is not guessed: `insonify::study::parity` has a running error analysis of
//! each effect, which takes the bound before a pass to the bound after it. Here are the scenes that put them to the test.

#[path = "../mechanics/remesh/support.rs"]
mod remesh_support;
#[path = "../support/mod.rs"]
mod support;

mod case;
mod scenes;

mod blur;
mod contact;
mod frame;
mod geometry;
mod insertion;
mod interface;
mod needle;
mod noise;
mod quantise;
mod receiver;
mod refraction;
mod remesh;
mod scan_conversion;
mod shadow;
mod slice;
mod speckle;
mod texture;
mod thickness;
mod tone;
mod warp;
mod warp_remeshed;
mod warp_shader;

use support::gpu::gpu_or_skip;

/// How many tests of this binary need a GPU.
#[test]
fn gpu_tests_run_or_are_counted_as_skipped() {
    let sources = [
        include_str!("blur.rs"),
        include_str!("contact.rs"),
        include_str!("frame.rs"),
        include_str!("geometry.rs"),
        include_str!("insertion.rs"),
        include_str!("interface.rs"),
        include_str!("needle.rs"),
        include_str!("noise.rs"),
        include_str!("quantise.rs"),
        include_str!("receiver.rs"),
        include_str!("remesh.rs"),
        include_str!("scan_conversion.rs"),
        include_str!("shadow.rs"),
        include_str!("slice.rs"),
        include_str!("speckle.rs"),
        include_str!("texture.rs"),
        include_str!("thickness.rs"),
        include_str!("tone.rs"),
        include_str!("warp.rs"),
        include_str!("warp_remeshed.rs"),
        include_str!("warp_shader.rs"),
    ];
    let tests: usize = sources.iter().map(|source| source.matches("#[test]").count()).sum();
    match gpu_or_skip("the parity tests") {
        Some(gpu) => println!(
            "{tests} parity tests compare both CPU precisions and {}",
            gpu.report().name
        ),
        None => println!("SKIPPED: the GPU half of {tests} parity tests; the CPU half ran"),
    }
}
