//! Notes, doubts and progress: what is said beside results, and when a run ends because of it.

use crate::support::{Bench, SCENE};

#[test]
fn notes_are_a_line_each_with_details_on_request() {
    let Some(labels) = insonify_testing::shared("volumes/ts_example_seg.nii.gz") else {
        return;
    };
    let bench = Bench::new();
    let command = format!(
        "render --labels {} --target liver --size 32x24 --backend cpu -o a.png",
        labels.display()
    );
    let short = bench.run(&command);
    short.text();
    let notes: Vec<&str> = short.stderr.lines().filter(|line| line.starts_with("note: ")).collect();
    assert!(notes.iter().all(|note| note.len() < 150), "{notes:#?}");
    assert!(notes[0].starts_with("note: placed over liver: from the"), "{notes:#?}");
    assert!(!short.stderr.contains("voxels"), "{}", short.stderr);
    let long = bench.run(&format!("{command} --verbose"));
    assert!(
        long.stderr.contains("\n  probe on the skin at (") && long.stderr.contains(" voxels)"),
        "{}",
        long.stderr
    );
    let json = bench.run(&format!("{command} --json"));
    let report: serde_json::Value = serde_json::from_str(json.text()).expect("JSON");
    assert!(
        report["notes"][0]
            .as_str()
            .is_some_and(|note| note.contains("; probe on the skin at (")),
        "{report:#}"
    );
    let quiet = bench.run(&format!("{command} --quiet"));
    assert_eq!(quiet.stderr, "");
}

#[test]
fn films_have_the_size_of_the_frames() {
    let bench = Bench::new();
    bench.run("render scene.toml --frames 3 -o a.gif").text();
    let film = std::fs::read(bench.path("a.gif")).expect("a film");
    assert_eq!(&film[..10], b"GIF89a\x30\0\x28\0");
    let layers = bench.run("render scene.toml --frames 3 --layers sector -o b.gif");
    assert_eq!(layers.status, Some(2), "{layers:?}");
    assert!(
        layers.stderr.contains("--layers is not for animated pictures"),
        "{layers:?}"
    );
    assert_eq!(bench.files("."), ["a.gif", "scene.toml"]);
}

#[test]
fn one_picture_of_several_frames_is_refused_before_the_volume_is_read() {
    let bench = Bench::new();
    let text = "[volume]\nfile = \"missing.nii.gz\"\n[motion]\nframes = 2\n\
                [[motion.keyframes]]\ntime_s = 0\nposition_mm = [0, 0, 0]\ndirection = [0, 1, 0]\n\
                [[motion.keyframes]]\ntime_s = 1\nposition_mm = [9, 0, 0]\ndirection = [0, 1, 0]\n";
    bench.write("two.toml", text);
    for arguments in ["render two.toml -o x.png", "render scene.toml --frames 2 -o x.png"] {
        let run = bench.run(arguments);
        assert_eq!(run.status, Some(2), "{run:?}");
        assert!(run.stderr.contains("is one picture, and there are 2 frames"), "{run:?}");
    }
    let one = bench.run("render two.toml --frames 1 -o x.png");
    assert!(one.stderr.contains("missing.nii.gz"), "{one:?}");
}

#[test]
fn a_run_that_would_show_nothing_fails_with_the_reason() {
    let bench = Bench::new();
    let beside = |x: [f64; 2]| {
        let key = |time, x| {
            format!("[[motion.keyframes]]\ntime_s = {time}\nposition_mm = [{x}, 0, -40]\ndirection = [0, 0, 1]\n")
        };
        format!("{SCENE}[motion]\nframes = 4\n{}{}", key(0, x[0]), key(1, x[1]))
    };
    bench.write("blind.toml", &beside([3000.0, 4000.0]));
    let blind = bench.run("render blind.toml -q -o frames");
    assert_eq!(blind.status, Some(1), "{blind:?}");
    assert!(
        blind
            .stderr
            .contains("nothing is rendered: the probe sees nothing of the volume in 2 of 2 poses"),
        "{blind:?}"
    );
    assert!(blind.stderr.contains("mm apart"), "{blind:?}");
    assert_eq!(bench.files("."), ["blind.toml", "scene.toml"]);
    bench.write("seeing.toml", &beside([0.0, 4000.0]));
    let seeing = bench.run("render seeing.toml -o frames");
    assert_eq!(seeing.status, Some(0), "{seeing:?}");
    assert!(seeing.stderr.contains("1 of 2 poses"), "{seeing:?}");
}

#[test]
fn an_option_that_a_scenario_ignores_is_refused() {
    let run = Bench::new().run("rf two-layer-insertion --frames 4 -o rf.igs.mha");
    assert_eq!(run.status, Some(2), "{run:?}");
    assert!(
        run.stderr.contains("--frames 4 of a scenario") && run.stderr.contains("frame_rate_hz"),
        "{run:?}"
    );
}

#[test]
fn recordings_are_no_labels() {
    let bench = Bench::new();
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 2 2 1\nElementSpacing = 1 1 1\nElementType = MET_UCHAR\n";
    let image = |kind: &str| [head, kind, "ElementDataFile = LOCAL\n\u{1}\u{1}\u{1}\u{1}"].concat();
    bench.write("a.mha", &image("UltrasoundImageType = BRIGHTNESS\n"));
    let run = bench.run("render --labels a.mha -o a.png");
    assert_eq!(run.status, Some(2), "{run:?}");
    assert!(
        run.stderr
            .contains("an ultrasound image (UltrasoundImageType = BRIGHTNESS)"),
        "{run:?}"
    );
    bench.write("b.mha", &image("Comment = BRIGHTNESS\n"));
    assert!(
        !bench
            .run("render --labels b.mha -o b.png")
            .stderr
            .contains("ultrasound image")
    );
}
