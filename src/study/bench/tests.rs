use super::*;
use insonify_imaging::anatomies::two_layers as scene;
use insonify_imaging::effects::Effect;
use insonify_imaging::plan::Plan;
use insonify_imaging::scene::SceneFile;
use insonify_imaging::synth::tables::Tables;

#[test]
fn percentiles_are_nearest_ranks() {
    assert_eq!(Spread::of(Vec::new()), None);
    let spread = Spread::of((1..=100).rev().map(f64::from).collect()).unwrap();
    assert_eq!((spread.median_ms, spread.p95_ms), (50.0, 95.0));
    assert_eq!((spread.fps, spread.frames), (20.0, 100));
    let one = Spread::of(vec![4.0]).unwrap();
    assert_eq!((one.median_ms, one.p95_ms, one.fps), (4.0, 4.0, 250.0));
}

/// Effects that a scene has and that can be removed, the last of the list first.
pub(super) fn removable(anatomy: &Anatomy, settings: &Settings) -> Vec<&'static str> {
    let plan = Plan::new(&Tables::new(anatomy.clone(), settings.clone()).unwrap());
    let present = |effect: &&&Effect| effect.remove.is_some() && plan.has(effect.name);
    let names: Vec<&str> = LISTED.iter().rev().filter(present).map(|effect| effect.name).collect();
    assert!(names.len() >= 10, "{names:?}");
    names
}

#[test]
fn the_ladder_ends_at_slicing_alone() {
    let (anatomy, settings, state) = scene();
    let options = BenchOptions {
        frames: 2,
        warm_up: 1,
        ..BenchOptions::default()
    };
    let report = bench(&anatomy, &settings, &[state], &Backend::Cpu, &options).unwrap();
    assert_eq!(
        (report.backend, &report.adapter, report.software),
        ("cpu", &None, false)
    );
    assert_eq!(report.frame.frames, 2);
    assert!(report.memory_bytes > 0);
    assert!(report.batch.fps > 0.0 && report.batch.png_fps.is_some_and(|fps| fps > 0.0));
    let removed: Vec<_> = report.ladder.iter().filter_map(|rung| rung.without).collect();
    assert_eq!(removed, removable(&anatomy, &settings));
    assert!(report.ladder.iter().all(|rung| rung.time.frames == 2));
    let passes: Vec<_> = report.ladder.iter().map(|rung| rung.passes).collect();
    // Without tone the pass remains, with a linear display; that of automatic gain is gone.
    assert!(passes.windows(2).all(|pair| pair[1] < pair[0]), "{passes:?}");
    let names: Vec<_> = report.passes.iter().map(|pass| pass.name).collect();
    assert_eq!(names.len(), passes[0]);
    assert_eq!(
        passes.last(),
        Some(&5),
        "geometry, slice, linear tone, scan conversion, quantise"
    );

    let mut bench = BenchReport::new(&anatomy, &settings);
    bench.backends.push(report);
    let table = bench.to_string();
    for word in [
        "64 scanlines",
        "32x24",
        "speckle_scatter",
        "- texture",
        "all effects",
        "written as PNG",
    ] {
        assert!(table.contains(word), "{word}: {table}");
    }
    let json = serde_json::to_value(&bench).unwrap();
    assert!(json["backends"][0]["ladder"][1]["median_ms"].is_number());
    assert_eq!(json["backends"][0]["ladder"][1]["without"], "noise");
}

#[test]
fn patience_ends_a_measurement_early_but_not_below_the_least() {
    let (_, _, state) = scene();
    let options = BenchOptions {
        frames: 1000,
        warm_up: 0,
        patience: Duration::ZERO,
    };
    let clock = Clock {
        states: &[state],
        options: &options,
    };
    let nap = |_: &FrameState| {
        std::thread::sleep(Duration::from_millis(1));
        Ok(())
    };
    let frames = clock.repeat(nap).unwrap();
    assert_eq!(frames.len(), MIN_FRAMES);
}

/// Where the mesh has been removed, states of its nodes are left out.
#[test]
fn a_scene_whose_mesh_moves_is_measured_to_the_end() {
    let text = "
volume = { phantom = \"two-layer\", resolution_mm = 4 }
probe = { lines = 16, samples = 32 }
[deform]
nodes = 300
field = { kind = \"indentation\", centre_mm = [0, 0, 0], direction = [0, 1, 0], depth_mm = 2, radius_mm = 15 }
";
    let scene = SceneFile::parse(text, "text").unwrap().resolve("".as_ref()).unwrap();
    let states: Vec<FrameState> = scene.states(2).collect::<Result<_, _>>().unwrap();
    assert!(states[0].nodes.is_some());
    let options = BenchOptions {
        frames: 2,
        warm_up: 1,
        ..BenchOptions::default()
    };
    let report = bench(&scene.anatomy, &scene.settings, &states, &Backend::Cpu, &options).unwrap();
    assert!(report.ladder.iter().any(|rung| rung.without == Some("warp")));
    assert!(report.ladder.iter().all(|rung| rung.time.frames == 2));
}
