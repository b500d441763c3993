//! `--set` and the options of single keys: each is the same key written in the file, and changes nothing else.

use insonify::SceneFile;
use insonify_base::document::to_toml;
use insonify_imaging::effects::{EffectName, LISTED};
use serde_json::Value;

use crate::insert::BLOCK;
use crate::support::{Bench, SCENE, grey};

/// Bytes of the frame of a scene, and the parameters in its sidecar.
fn frame(bench: &Bench, arguments: &str) -> (Vec<u8>, Value) {
    bench
        .run(&format!(
            "render {arguments} --backend cpu --sidecar --force -o out.png"
        ))
        .text();
    let bytes = std::fs::read(bench.path("out.png")).expect("a frame");
    (bytes, bench.read::<Value>("out.json")["parameters"].clone())
}

#[test]
fn a_frame_is_that_of_the_edited_file() {
    let bench = Bench::new();
    let tissue = "[[tissue]]\nname = \"phantom_top\"\nechogenicity_db = 3\n";
    let table = "[probe]\nkind = \"linear\"\nwidth_mm = 38\ndepth_mm = 60\nlines = 32\nsamples = 64";
    let inline = "seed = 3\nprobe = { kind = \"linear\", width_mm = 38, depth_mm = 60, lines = 32, samples = 64 }";
    for (base, set, edited) in [
        (SCENE.to_owned(), "--set seed=9", SCENE.replace("seed = 3", "seed = 9")),
        (
            SCENE.to_owned(),
            "--set probe.depth_mm=50",
            SCENE.replace("depth_mm = 60", "depth_mm = 50"),
        ),
        (
            SCENE.to_owned(),
            "--set effects.tone.gain_db=-6",
            format!("{SCENE}[effects]\ntone.gain_db = -6\n"),
        ),
        (
            SCENE.to_owned(),
            "--set effects.only=[\"tone\",\"speckle\"]",
            format!("{SCENE}[effects]\nonly = [\"tone\", \"speckle\"]\n"),
        ),
        (
            SCENE.replace(table, "").replace("seed = 3", inline),
            "--set probe.lines=48",
            SCENE.replace("lines = 32", "lines = 48"),
        ),
        (
            format!("{SCENE}{tissue}"),
            "--set tissue[0].echogenicity_db=-9",
            format!("{SCENE}{}", tissue.replace('3', "-9")),
        ),
        (
            SCENE.to_owned(),
            "--set tissue.0.name=phantom_top --set tissue.0.echogenicity_db=3",
            format!("{SCENE}{tissue}"),
        ),
        (
            SCENE.to_owned(),
            "--depth-mm 50 --gain-db -6 --frequency-mhz 4 --seed 9",
            SCENE
                .replace("depth_mm = 60", "depth_mm = 50\nfrequency_mhz = 4")
                .replace("seed = 3", "seed = 9")
                + "[effects]\ntone.gain_db = -6\n",
        ),
        (
            SCENE.to_owned(),
            "--set probe.depth_mm=9 --depth-mm 50",
            SCENE.replace("depth_mm = 60", "depth_mm = 50"),
        ),
        (
            SCENE.to_owned(),
            "--depth-mm 9 --set probe.depth_mm=50",
            SCENE.replace("depth_mm = 60", "depth_mm = 50"),
        ),
        // What is only set leaves out no other effect, in any version.
        (
            SCENE.replace("version = 2", "version = 1"),
            "--gain-db -6",
            format!("scanner = \"raw\"\n{SCENE}[effects]\ntone.gain_db = -6\n"),
        ),
    ] {
        bench.write("base.toml", &base);
        bench.write("edited.toml", &edited);
        let [plain, set, written] =
            ["base.toml", &format!("base.toml {set}"), "edited.toml"].map(|arguments| frame(&bench, arguments));
        assert!(set.0 == written.0 && set.0 != plain.0, "{set:?}");
        assert_eq!(set.1, written.1);
    }
}

#[test]
fn a_sidecar_repeats_what_was_set() {
    let bench = Bench::new();
    let set = "scene.toml --set effects.blur=false --set effects.tone.gamma=0.8 --depth-mm 45 --seed 9";
    let (set, parameters) = frame(&bench, set);
    let scene: SceneFile = serde_json::from_value(parameters["scene"].clone()).expect("a scene");
    bench.write("again.toml", &to_toml(&scene).expect("TOML"));
    assert!(frame(&bench, "again.toml").0 == set);
}

#[test]
fn an_effect_that_is_set_to_false_is_left_out_and_no_other() {
    let bench = Bench::new();
    // Labels are in every frame, as is what no key names.
    let has_key = |name: &&str| serde_json::from_value::<EffectName>((*name).into()).is_ok();
    let all = LISTED
        .iter()
        .map(|effect| effect.name)
        .filter(|name| *name != "slice" && has_key(name));
    for effect in all {
        bench.write("edited.toml", &format!("{SCENE}[effects]\n{effect} = false\n"));
        let [set, written] = [
            format!("scene.toml --set effects.{effect}=false"),
            "edited.toml".to_owned(),
        ]
        .map(|scene| bench.run(&format!("plan {scene} --json")).json());
        assert_eq!(set, written, "{effect}");
        let reason = format!("left out by `{effect} = false`");
        // The pass of `tone` makes grey levels even so.
        assert_eq!(
            set["without"].to_string().contains(&reason),
            effect != "tone",
            "{effect}"
        );
    }
}

#[test]
fn every_command_that_reads_a_scene_takes_settings() {
    let bench = Bench::new();
    let wide = "scene.toml --set image.width=96 --set probe.lines=40";
    let bytes = |plan: Value| plan["bytes"].as_u64().expect("bytes");
    let [set, plain] = [wide, "scene.toml"].map(|scene| bytes(bench.run(&format!("plan {scene} --json")).json()));
    assert!(set > plain);
    bench.run(&format!("inspect {wide} --at 90,20")).text();
    bench
        .run("inspect scene.toml --at 90,20")
        .fails(2, &["columns run from 0 to 47"]);
    let report = bench
        .run(&format!("bench {wide} --backend cpu --frames 2 --json"))
        .text()
        .to_owned();
    assert!(report.contains("96"), "{report}");
}

#[test]
fn settings_need_no_file() {
    let bench = Bench::new();
    bench.run("phantom two-layer --resolution-mm 4 -o labels.nii.gz").text();
    let labels = "--labels labels.nii.gz --target phantom_top --size 48x40";
    let set =
        "--set probe.kind=linear --set probe.lines=32 --set probe.samples=64 --depth-mm 50 --set pose.plane=sagittal";
    let scene = r#"version = 2
[volume]
file = "labels.nii.gz"
[pose]
target = "phantom_top"
plane = "sagittal"
[probe]
kind = "linear"
depth_mm = 50
lines = 32
samples = 64
[image]
width = 48
height = 40
"#;
    bench.write("edited.toml", scene);
    let [alone, written] =
        [format!("{labels} {set}"), "edited.toml".to_owned()].map(|arguments| frame(&bench, &arguments));
    assert!(alone.0 == written.0);
    assert_eq!(alone.1["scene"]["pose"], written.1["scene"]["pose"]);
    // The motion and the pose of a file make way, but for the plane and what is set.
    bench.write(
        "moving.toml",
        &format!(
            "{}[motion]\nframes = 3\n",
            scene.replace("target = \"phantom_top\"", "position_mm = [0, 0, 0]")
        ),
    );
    let run = bench.run("render moving.toml --target phantom_top --backend cpu -o moved.png");
    run.text();
    assert!(run.stderr.contains("the motion of the scene is left out"), "{run:?}");
    assert_eq!(grey(&bench.path("moved.png")), grey(&bench.path("out.png")));
    bench
        .run("render --labels labels.nii.gz --ct nowhere.nii.gz -o out.png --force")
        .fails(2, &["volume.ct", "nowhere.nii.gz"]);
}

#[test]
fn what_is_wrong_with_a_setting_names_it() {
    let bench = Bench::new();
    for (arguments, words) in [
        (
            "--set effects.tone.gian_db=6",
            &[
                "unknown key `gian_db` (--set effects.tone.gian_db=6)",
                "did you mean `gain_db`?",
            ][..],
        ),
        (
            "--set efects.tone.gain_db=6",
            &["unknown key `efects`", "did you mean `effects`?"],
        ),
        (
            "--set gain_db=6",
            &["unknown key `gain_db`", "`gain_db` belongs in [effects.tone]"],
        ),
        (
            "--set probe.dept_mm=6",
            &["unknown key `dept_mm`", "did you mean `depth_mm`?"],
        ),
        (
            "--set probe.depth_mm=deep",
            &["found string \"deep\", expected", "(--set probe.depth_mm=deep)"],
        ),
        (
            "--set probe.depth_mm=-5",
            &["probe.depth_mm", "-5", "(--set probe.depth_mm=-5)"],
        ),
        ("--depth-mm 5000", &["probe.depth_mm", "5000", "(--depth-mm 5000)"]),
        (
            "--gain-db loud",
            &["found string \"loud\", expected a number (--gain-db loud)"],
        ),
        ("--seed -1", &["found integer `-1`", "(--seed -1)"]),
        (
            "--set probe.kind=linaer",
            &[
                "unknown value `linaer`",
                "did you mean \"linear\"?",
                "(--set probe.kind=linaer)",
            ],
        ),
        (
            "--set probe.angle_deg=60",
            &[
                "`angle_deg` has no meaning for a linear probe",
                "(--set probe.angle_deg=60)",
            ],
        ),
        (
            "--set probe.kind=phased",
            &["`width_mm` has no meaning for a phased probe", "(scene.toml, line"],
        ),
        (
            "--set volume.fat_mm=5",
            &["`fat_mm` with a phantom", "(--set volume.fat_mm=5)"],
        ),
        (
            "--set probe=[40,60]",
            &["found a list, expected a table (--set probe=[40,60])"],
        ),
        ("--set effects=[\"tone\"]", &["found a list, expected a table"]),
        (
            "--set effects.tone=[6]",
            &["found a list, expected a table (--set effects.tone=[6])"],
        ),
        ("--set effects.only=[\"tonne\"]", &["tonne", "(--set effects.only"]),
        ("--set tissue.1.name=fat", &["found `1` in a list of 0"]),
        ("--set seed", &["KEY=VALUE"]),
        ("--set seed=", &["no value"]),
        ("--set probe={kind", &["not TOML"]),
    ] {
        bench.run(&format!("plan scene.toml {arguments}")).fails(2, words);
    }
    let recorded = format!("{SCENE}grid = \"recorded\"\n");
    bench.write("recorded.toml", &recorded);
    bench.run("plan recorded.toml --depth-mm 40").fails(
        2,
        &[
            "--depth-mm 40: with `grid = \"recorded\"` frames are as deep as the recorded images",
            "image.grid=fitted",
        ],
    );
    // A scene that names its effects is asked to list what is set, too.
    bench.write("only.toml", &format!("{SCENE}[effects]\nonly = [\"tone\"]\n"));
    bench
        .run("plan only.toml --set effects.blur.width_mm=1")
        .fails(2, &["`only` (line"]);
}

#[test]
fn a_scenario_is_set_with_its_scene() {
    let bench = Bench::new();
    bench.write("block.toml", BLOCK);
    let summary = |arguments: &str| {
        let summary = bench
            .run(&format!("insert {arguments} -o out --force -q --json"))
            .json();
        let forces: Vec<_> = ["steps", "max_base_force_n", "tip_deflection_mm"]
            .map(|key| summary[key].clone())
            .into();
        (forces, summary["set"].clone())
    };
    let edited = BLOCK
        .replace("dt_ms = 5", "dt_ms = 10")
        .replace("[needle]", "[needle]\nmodel = \"springs\"");
    bench.write("edited.toml", &edited.replace("depth_mm = 60", "depth_mm = 50"));
    let (set, recorded) = summary("block.toml --set run.dt_ms=10 --set needle.model=springs --depth-mm 50");
    let (written, nothing) = summary("edited.toml");
    assert_eq!((set, nothing), (written, Value::Null));
    assert_eq!(
        recorded,
        serde_json::json!([
            "run.dt_ms = 10",
            "needle.model = \"springs\"",
            "scene.probe.depth_mm = 50"
        ])
    );
    // A scene of a file of its own is set in that file.
    let inline = BLOCK.find("[scene.volume]").expect("a scene")..BLOCK.find("[tissue]").expect("tissue");
    let mut named = BLOCK.to_owned();
    let scene = named[inline.clone()].replace("[scene.", "[");
    named.replace_range(inline, "");
    bench.write("other.toml", &scene);
    bench.write(
        "named.toml",
        &named.replacen("version = 1", "version = 1\nscene = \"other.toml\"", 1),
    );
    bench
        .run("insert named.toml -o out --force --set scene.probe.depht_mm=9")
        .fails(
            2,
            &[
                "unknown key `depht_mm` (--set scene.probe.depht_mm=9)",
                "did you mean `depth_mm`?",
            ],
        );
    bench
        .run("insert named.toml -o out --force --depth-mm 5000")
        .fails(2, &["probe.depth_mm", "(--depth-mm 5000)"]);
    bench
        .run("insert block.toml -o out --force --set needle.lenght_mm=9")
        .fails(
            2,
            &[
                "unknown key `lenght_mm` (--set needle.lenght_mm=9)",
                "did you mean `length_mm`?",
            ],
        );
}
