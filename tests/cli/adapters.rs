//! `render` on GPU adapters.

use crate::gpu::gpu_or_skip;
use crate::support::{Bench, SCENE, grey};

#[test]
fn a_gpu_is_named_and_shows_the_same_picture() {
    let bench = Bench::new();
    if gpu_or_skip("a_gpu_is_named_and_shows_the_same_picture").is_none() {
        return;
    }
    let report = bench.run("render scene.toml --backend gpu --json -o gpu.png").json();
    assert_eq!(report["backend"], "gpu");
    assert!(!report["adapter"].as_str().unwrap().is_empty());
    let auto = bench.run("render scene.toml --json -o auto.png").json();
    assert_eq!(
        (&auto["backend"], &auto["adapter"]),
        (&report["backend"], &report["adapter"])
    );
    bench.run("render scene.toml --backend cpu -o cpu.png").text();
    let [gpu, cpu] = ["gpu.png", "cpu.png"].map(|name| grey(&bench.path(name)).1);
    let furthest = gpu.iter().zip(&cpu).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(furthest <= Some(3), "{furthest:?}");
}

/// A volume of more than 128 MiB exceeds what wgpu's default limits let a pass bind, and all that software Vulkan has.
#[test]
fn a_scene_over_the_limits_names_the_limit() {
    let bench = Bench::new();
    let Some(gpu) = gpu_or_skip("a_scene_over_the_limits_names_the_limit") else {
        return;
    };
    let limit = gpu.report().limits.max_storage_buffer_binding_size;
    if limit >= 1 << 31 {
        println!("SKIPPED: no scene of a test exceeds the {limit} bytes of this adapter's bindings");
        return;
    }
    let lines = limit / (16_384 * 16) + 1;
    let large = SCENE
        .replace("samples = 64", "samples = 16384")
        .replace("lines = 32", &format!("lines = {lines}"));
    bench.write("large.toml", &format!("{large}[effects]\n"));
    bench
        .run("render large.toml --backend gpu")
        .fails(1, &["max_storage_buffer_binding_size", &limit.to_string()]);
    assert!(!bench.path("frame.png").exists());
    let auto = bench.run("render large.toml --json").json();
    assert_eq!(auto["backend"], "cpu");
    assert!(
        auto["warnings"][0]
            .as_str()
            .unwrap()
            .contains("max_storage_buffer_binding_size")
    );
}
