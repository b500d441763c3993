//! What is picked where a scene says how long a frame or a step may take.

use insonify_base::machine::Machine;
use insonify_imaging::quality::cache::Cache;
use insonify_imaging::quality::{SettingOption, VariedSetting};
use insonify_study::step_costs::{LEVEL, StepCosts};

use crate::insert::BLOCK;
use crate::support::{Bench, Run, SCENE};

/// The scene with a time for frames, its grid left open.
fn open(frame_ms: f64) -> String {
    let quality = format!("seed = 3\nquality = {{ frame_ms = {frame_ms} }}\n");
    let text = SCENE.replace("lines = 32\nsamples = 64\n", "");
    text.replace("seed = 3\n", &quality)
}

fn plan(bench: &Bench, more: &str) -> Run {
    bench.run(&format!("plan open.toml --backend cpu --json{more}"))
}

#[test]
fn the_grid_is_picked_told_and_part_of_the_plan() {
    let bench = Bench::new();
    // Any machine does it in ten seconds: the finest that 48 pixels across show.
    bench.write("open.toml", &open(10_000.0));
    let first = plan(&bench, "");
    let quality = first.json()["quality"].clone();
    assert_eq!(
        (&quality["asked"], &quality["met"]),
        (&"frame_ms".into(), &true.into()),
        "{quality}"
    );
    let values: Vec<&str> = quality["settings"]
        .as_array()
        .expect("settings")
        .iter()
        .filter_map(|it| it["value"].as_str())
        .collect();
    assert_eq!(values, ["64", "128"]);
    assert!(first.json()["bytes"] != bench.run("plan scene.toml --json").json()["bytes"]);
    // The second time nothing is measured, so the figure is the same to the bit; asked for, it is measured again.
    assert_eq!(plan(&bench, "").json()["quality"], quality);
    assert_eq!(bench.files("cache").len(), 1);
    let quality = plan(&bench, " --recalibrate").json()["quality"].clone();
    assert_eq!(bench.files("cache").len(), 1);
    let text = bench.run("plan open.toml --backend cpu");
    assert!(
        text.text().contains("Picked for frame_ms = 10000") && text.text().contains("probe.lines"),
        "{text:?}"
    );
    let render = bench.run("render open.toml --backend cpu -o frame.png --json");
    assert_eq!(render.json()["quality"], quality);
    assert!(
        render.stderr.contains("quality: probe.lines = 64, probe.samples = 128"),
        "{render:?}"
    );
}

#[test]
fn what_cannot_be_met_is_a_warning_with_its_figure_and_quiet_silences_it() {
    let bench = Bench::new();
    // No frame takes as little as that, however small.
    bench.write("open.toml", &open(0.01));
    let run = bench.run("render open.toml --backend cpu -o frame.png --json");
    assert_eq!(run.json()["quality"]["met"], false);
    assert!(
        run.stderr
            .contains("nothing stays within 0.01 ms: this is the cheapest"),
        "{run:?}"
    );
    let run = bench.run("render open.toml --backend cpu -o frame.png --json --quiet");
    assert_eq!(
        (run.json()["quality"]["met"].as_bool(), run.stderr.as_str()),
        (Some(false), "")
    );
}

#[test]
fn what_is_stated_stays_and_wrong_times_are_errors_at_their_line() {
    let bench = Bench::new();
    bench.write(
        "open.toml",
        &SCENE.replace("seed = 3\n", "seed = 3\nquality = { frame_ms = 5 }\n"),
    );
    let run = plan(&bench, "");
    assert!(
        run.json()["quality"].is_null() && run.stderr.contains("nothing to pick"),
        "{run:?}"
    );
    for (wrong, words) in [
        ("{ frame_ms = 0 }", ["line 4", "0.01 to 10000 ms"]),
        ("{ step_ms = nan }", ["line 4", "NaN"]),
        ("{ frames_ms = 3 }", ["line 4", "frame_ms"]),
        ("\"fast\"", ["line 4", "expected"]),
    ] {
        bench.write(
            "open.toml",
            &SCENE.replace("seed = 3\n", &format!("seed = 3\nquality = {wrong}\n")),
        );
        bench.run("plan open.toml").fails(2, &words);
    }
    bench.write(
        "case.toml",
        "version = 1\nscene = \"spine-linear\"\nquality = { step_ms = 1e9 }\n[needle]\n",
    );
    bench
        .run("insert case.toml -o out")
        .fails(2, &["case.toml", "line 3", "0.01 to 10000 ms"]);
}

#[test]
fn a_kept_file_that_no_measurement_gives_is_named_and_measured_anew() {
    let bench = Bench::new();
    bench.write("open.toml", &open(10_000.0));
    let good = plan(&bench, "").json()["quality"]["settings"].clone();
    let name = format!("cache/{}", bench.files("cache")[0]);
    let kept = bench.text(&name);
    for bad in [
        kept.replace("\"64\"", "\"0\""),
        kept.replace("\"64\"", "\"x\""),
        kept.replacen('{', "[", 1),
    ] {
        assert_ne!(bad, kept);
        bench.write(&name, &bad);
        let run = plan(&bench, "");
        assert!(
            run.stderr.contains("warning: the cached costs are ignored") && run.stderr.contains(&name),
            "{run:?}"
        );
        assert_eq!(run.json()["quality"]["settings"], good);
    }
}

/// Costs that were kept say that nothing takes any time: what an insertion itself takes is what counts.
#[test]
fn steps_are_tried_on_the_insertion_itself() {
    let option = |name: &str, error| SettingOption {
        values: vec![format!("\"{name}\"")],
        extra_ms: 0.0,
        error,
    };
    let setting = |options| VariedSetting {
        keys: vec![LEVEL.to_owned()],
        options,
    };
    let levels = || setting(vec![option("exact", 0.0), option("IV", 0.1)]);
    let free = StepCosts {
        few: 300,
        base_ms: [1e-9; 2],
        levels: [levels(), levels()],
        nodes: setting(Vec::new()),
        links: setting(Vec::new()),
        elements: setting(Vec::new()),
        thinning: setting(Vec::new()),
    };
    let bench = Bench::new();
    let cache = Cache::at(&bench.path("cache"), &Machine::here().to_string());
    cache.put(&["steps"], &free).expect("kept");
    let quality = |step_ms: f64| {
        let head = format!("version = 1\nquality = {{ step_ms = {step_ms} }}\n");
        bench.write("open.toml", &BLOCK.replace("version = 1\n", &head));
        let run = bench.run("insert open.toml -o out --json");
        (run.json()["quality"][0].clone(), run.stderr)
    };
    let (met, stderr) = quality(10_000.0);
    assert!(stderr.contains("quality: trying it on this insertion"), "{stderr}");
    assert_eq!(
        (&met["met"], &met["settings"][0]["value"]),
        (&true.into(), &"\"exact\"".into())
    );
    assert!(met["expected_ms"].as_f64().expect("ms") > 1e-4, "{met}");
    let why = met["why"].as_str().expect("words");
    assert!(
        why.contains("of this insertion") && why.contains("; 0 of 100 steps take longer than 10000 ms"),
        "{why}"
    );
    // It is kept, so the figure stays the same to the bit.
    assert_eq!(quality(10_000.0).0, met);
    let files = bench.files("cache").len();
    // No step that remeshes takes as little as that.
    let (missed, stderr) = quality(0.01);
    assert_eq!(missed["met"], false);
    assert!(
        stderr.contains("warning: quality.step_ms") && stderr.contains("nothing stays within 0.01 ms"),
        "{stderr}"
    );
    assert_eq!(bench.files("cache").len(), files + 1);
}
