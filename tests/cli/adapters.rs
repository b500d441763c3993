//! `render` on GPU adapters.

use crate::support::{Bench, Run, SCENE, grey};
use insonify_testing::gpu::gpu_or_skip;
use insonify_testing::skip;

#[test]
fn a_gpu_is_named_and_shows_the_same_picture() {
    let bench = Bench::new();
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let report = bench.run("render scene.toml --backend gpu --json -o gpu.png").json();
    assert_eq!(report["backend"], "gpu");
    assert!(!report["adapter"].as_str().unwrap().is_empty());
    let auto = bench.run("render scene.toml --json -o auto.png").json();
    assert_eq!(auto["backend"], if gpu.report().software { "cpu" } else { "gpu" });
    bench.run("render scene.toml --backend cpu -o cpu.png").text();
    let [gpu, cpu] = ["gpu.png", "cpu.png"].map(|name| grey(&bench.path(name)).1);
    let furthest = gpu.iter().zip(&cpu).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(furthest <= Some(3), "{furthest:?}");
}

/// A volume of more than 128 MiB exceeds what wgpu's default limits let a pass bind, and all that software Vulkan has.
#[test]
fn a_scene_over_the_limits_names_the_limit() {
    let bench = Bench::new();
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let limit = gpu.report().limits.max_storage_buffer_binding_size;
    if limit >= 1 << 31 {
        return skip(&format!(
            "no scene of a test exceeds the {limit} bytes of this adapter's bindings"
        ));
    }
    let lines = limit / (16_384 * 16) + 1;
    let large = SCENE
        .replace("samples = 64", "samples = 16384")
        .replace("lines = 32", &format!("lines = {lines}"));
    bench.write("large.toml", &format!("{large}[effects]\nonly = []\n"));
    bench.run("render large.toml --backend gpu").fails(
        1,
        &["max_storage_buffer_binding_size", &limit.to_string(), "--backend cpu"],
    );
    assert!(!bench.path("frame.png").exists());
    let auto = bench.run("render large.toml --json").json();
    assert_eq!(auto["backend"], "cpu");
    if gpu.report().software {
        return;
    }
    assert!(
        auto["warnings"][0]
            .as_str()
            .unwrap()
            .contains("max_storage_buffer_binding_size")
    );
}

#[test]
fn software_renders_only_where_it_is_named() {
    let bench = Bench::new();
    let Some(gpu) = gpu_or_skip() else { return };
    if !gpu.report().software {
        return skip("the adapter is hardware");
    }
    let name = &gpu.report().name;
    for command in ["render scene.toml", "doctor", "bench scene.toml --frames 1"] {
        let run = bench.run(command);
        let text = format!("{}{}", run.text(), run.stderr);
        assert!(text.contains("software adapter") && text.contains(name), "{run:?}");
    }
    let run = bench.run("render scene.toml --json -o auto.png");
    assert_eq!(run.json()["backend"], "cpu");
    let word = name.split_whitespace().next().expect("a word");
    let run = bench.run(&format!("render scene.toml --adapter {word} --json -o named.png"));
    assert_eq!(
        (&run.json()["backend"], &run.json()["adapter"]),
        (&"gpu".into(), &name.as_str().into())
    );
    let measured = bench
        .run(&format!("bench scene.toml --adapter {word} --frames 1 --json"))
        .json();
    assert_eq!(measured["backends"][1]["adapter"], name.as_str());
}

#[test]
fn a_wrong_name_in_the_environment_is_told_with_the_variable() {
    let bench = Bench::new();
    if gpu_or_skip().is_none() {
        return;
    }
    let run = |arguments: &str| {
        let mut command = bench.command(arguments);
        command.env("INSONIFY_ADAPTER", "bogus");
        Run::of(command, arguments)
    };
    run("render scene.toml").fails(2, &["'bogus' (from INSONIFY_ADAPTER)", "available: "]);
    let doctor = run("doctor --json").json();
    assert_eq!(doctor["backend"], "none");
    assert!(
        doctor["warnings"][0]
            .as_str()
            .expect("a warning")
            .contains("INSONIFY_ADAPTER")
    );
}
