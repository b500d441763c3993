//! `insonify insert`: what it prints and writes, and that whatever is wrong with a scenario ends with status 2, the
//! line, and nothing written.

use std::fs;

use insonify_mesh::file::{ReadOptions, read_mesh};
use serde_json::Value;

use crate::support::{Bench, grey};
use insonify_testing::gpu::gpu_or_skip;

/// A coarse block, held at its far side, with a needle that goes in 25 mm along z in 0.5 s.
pub(crate) const BLOCK: &str = r#"version = 1
[run]
dt_ms = 5
frame_rate_hz = 20
[scene.volume]
phantom = "two-layer"
resolution_mm = 5
[scene.probe]
kind = "linear"
width_mm = 38
depth_mm = 60
lines = 24
samples = 48
[scene.image]
width = 24
height = 16
[tissue]
nodes = 300
[[tissue.fix]]
box_mm = [[-inf, -inf, 40], [inf, inf, inf]]
[needle]
length_mm = 100
[[needle.motion.keyframes]]
time_s = 0
tip_mm = [3, 2, -47]
direction = [0, 0, 1]
[[needle.motion.keyframes]]
time_s = 0.5
tip_mm = [3, 2, -20]
direction = [0, 0, 1]
"#;

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("block.toml", BLOCK);
    bench
}

/// The table without the last column, which holds milliseconds.
fn table(bench: &Bench, folder: &str) -> Vec<String> {
    let text = bench.text(&format!("{folder}/steps.csv"));
    let cut = |line: &str| line.rsplit_once(',').expect("columns").0.to_owned();
    text.lines().map(cut).collect()
}

#[test]
fn a_run_leaves_steps_plots_page_and_summary() {
    let bench = bench();
    let summary = bench.run("insert block.toml -o out --json --quiet").json();
    assert_eq!(bench.files("out"), ["index.html", "plots", "steps.csv", "summary.json"]);
    assert_eq!(summary["steps"], 100);
    assert!(summary["max_base_force_n"].as_f64().expect("a force") > 0.0);
    assert!(summary["remeshes"].as_u64().expect("a count") > 0);
    for key in ["median", "p95", "p99", "p999", "max", "remesh_median", "remesh_max"] {
        assert!(summary["step_ms"][key].as_f64().expect(key) > 0.0, "{key}");
    }
    let longest = summary["step_ms"]["longest"].as_array().expect("a list");
    assert_eq!(longest.len(), 10);
    let shares = longest.iter().map(|step| {
        let spent = step["spent_ms"].as_object().expect("work").values();
        let spent_ms: f64 = spent.map(|ms| ms.as_f64().expect("a time")).sum();
        spent_ms / step["ms"].as_f64().expect("a time")
    });
    let shares: Vec<f64> = shares.collect();
    // A busy machine interrupts single steps.
    let told = shares.iter().filter(|share| **share > 0.9).count();
    assert!(
        told >= 5 && shares.iter().all(|share| *share < 1.0 + 1e-9),
        "{shares:?}"
    );
    let events = summary["events"].as_array().expect("a list");
    let kinds: Vec<_> = events
        .iter()
        .map(|event| event["kind"].as_str().expect("a word"))
        .collect();
    assert_eq!(kinds[0], "surface", "{kinds:?}");
    assert_eq!(bench.read::<Value>("out/summary.json"), summary);

    let table = table(&bench, "out");
    assert_eq!(table.len(), 101);
    let columns = table[0].split(',').count();
    assert!(
        table.iter().all(|line| line.split(',').count() == columns),
        "{}",
        table[0]
    );
    let of = |name: &str| table[0].split(',').position(|column| column == name).expect(name);
    let last: Vec<f64> = table[100]
        .split(',')
        .map(|cell| {
            if cell.is_empty() {
                f64::NAN
            } else {
                cell.parse().expect("a number")
            }
        })
        .collect();
    assert!((last[of("time_s")] - 0.5).abs() < 1e-12);
    assert!((last[of("base_z_mm")] + 120.0).abs() < 1e-9 && last[of("base_dz")] == 1.0);
    // The base frame looks along z as the world does here, so that the axial force is the same in both.
    assert!((last[of("base_force_z_n")] - last[of("world_force_z_n")]).abs() < 1e-12);
    assert!(last[of("base_force_z_n")] < 0.0, "tissue pushes the hand back");

    let page = bench.text("out/index.html");
    assert_eq!(page.matches("<svg").count(), 5);
    assert_eq!(page.matches("<script").count(), 0, "without images there is no slider");
    for outside in ["src=", "href=\"http", "@import", "url("] {
        assert!(!page.contains(outside), "{outside}: the page asks for nothing else");
    }
    assert!(
        events[0]["text"]
            .as_str()
            .expect("words")
            .ends_with("phantom_top touched"),
        "{summary}"
    );
    assert_eq!(bench.files("out/plots").len(), 10);
}

#[test]
fn the_same_scenario_makes_the_same_steps() {
    let bench = bench();
    bench.run("insert block.toml -o a -q").text();
    bench.run("insert block.toml -o b -q").text();
    assert_eq!(table(&bench, "a"), table(&bench, "b"));
}

#[test]
fn frames_and_meshes_follow_on_request() {
    let bench = bench();
    bench
        .run("insert block.toml -o out --frames --vtu 100 --backend cpu -q")
        .text();
    assert_eq!(bench.files("out/frames").len(), 11);
    let page = bench.text("out/index.html");
    // First and deepest, without a script; the others behind the slider.
    assert_eq!(page.matches("<img src=\"data:image/png").count(), 2);
    assert_eq!(page.matches("data:image/png").count(), 2 + 11);
    assert!(!page.contains("src=\"http") && page.contains("type=\"range\""));
    let (size, pixels) = grey(&bench.path("out/frames/frame_0010.png"));
    assert_eq!(size, (24, 16));
    assert!(pixels.iter().any(|grey| *grey > 0));
    let meshes = bench.files("out/mesh");
    let of = |series: &str| meshes.iter().filter(|name| name.starts_with(series)).count();
    // Six of each, and the list of them; nothing of seeds.
    assert_eq!(
        ["mesh", "needle_", "probe", "seeds"].map(of),
        [7, 6, 7, 0],
        "{meshes:?}"
    );
    let forces = bench.text("out/mesh/needle.csv");
    assert!(forces.starts_with("time_s,from_mm,to_mm,along_n,"), "{forces}");
    let stress = bench.text("out/mesh/mesh_0005.vtu");
    assert!(stress.contains("Name=\"von_mises_kpa\""));
    let last = read_mesh(&bench.path("out/mesh/mesh_0005.vtu"), &ReadOptions::default()).expect("a mesh");
    let moved = last.displacements.expect("displacements");
    assert!(
        moved.iter().flatten().any(|x| x.abs() > 0.01),
        "the needle drags tissue along"
    );

    // A later run takes the place of an earlier one, and leaves what is of others' making.
    bench.write("out/mine.txt", "mine");
    bench.write("out/frames/mine.png", "mine");
    bench
        .run("insert block.toml -o out --frames=mha --preview --backend cpu -q")
        .text();
    assert!(
        fs::read(bench.path("out/preview.gif"))
            .expect("a preview")
            .starts_with(b"GIF89a")
    );
    let left = [
        "frames",
        "frames.mha",
        "index.html",
        "mine.txt",
        "plots",
        "preview.gif",
        "steps.csv",
        "summary.json",
    ];
    assert_eq!(bench.files("out"), left);
    assert_eq!(bench.files("out/frames"), ["mine.png"]);
}

/// Ground truth has the needle as the model bends it and the tissue as it yields.
#[test]
fn ground_truth_follows_needle_and_tissue() {
    let bench = bench();
    let scan = "[scene.pose]\nposition_mm = [3, 2, -45]\ndirection = [0, 0, 1]\nlateral = [1, 0, 0]\n[scene.probe]";
    // As fine as a needle of 1.27 mm wants it.
    let fine = BLOCK
        .replace("lines = 24", "lines = 100")
        .replace("samples = 48", "samples = 200");
    let fine = fine
        .replace("width = 24", "width = 120")
        .replace("height = 16", "height = 160");
    bench.write("block.toml", &fine.replace("[scene.probe]", scan));
    let arguments = "--layers label-value,displacement,needle --sidecar --overview --backend cpu -q";
    bench.run(&format!("insert block.toml -o out {arguments}")).text();
    let names = bench.files("out/frames");
    assert_eq!(names.len(), 11 * 6 + 1, "{names:?}");
    let layer = |frame: &str, layer: &str| {
        let path = bench.path(&format!("out/frames/frame_{frame}_{layer}.png"));
        image::open(path).expect("a layer").into_luma16().into_raw()
    };
    let greatest = |values: Vec<u16>| values.into_iter().max();
    assert_eq!(
        greatest(layer("0000", "needle")),
        Some(0),
        "the needle is outside at first"
    );
    assert!(greatest(layer("0010", "needle")) > Some(100));
    assert!(greatest(layer("0010", "displacement")) > greatest(layer("0000", "displacement")));
    assert!(layer("0010", "label-value").contains(&1));
    let sidecar: Value = bench.read("out/frames/frame_0010.json");
    let tip = sidecar["needle"]["tip_mm"][2].as_f64().expect("a tip");
    assert!((tip + 20.0).abs() < 0.5, "{tip}");
    assert!((sidecar["time_s"].as_f64().expect("a time") - 0.5).abs() < 0.01);

    bench
        .run(&format!("insert block.toml -o out --images=mha {arguments}"))
        .text();
    assert!(
        bench.files("out").contains(&"frames_needle.mha".to_owned()),
        "{:?}",
        bench.files("out")
    );
}

#[test]
fn bad_scenarios_end_with_their_line_and_leave_nothing() {
    let bench = bench();
    for (from, to, words) in [
        ("dt_ms = 5", "dt_ms = 500", &["block.toml:3", "0.01 to 100 ms"][..]),
        ("nodes = 300", "nods = 300", &["block.toml:18", "did you mean `nodes`?"]),
        (
            "tip_mm = [3, 2, -20]",
            "tip = 3",
            &["block.toml:29", "unknown key `tip`"],
        ),
        (
            "depth_mm = 60",
            "depth_mm = -60",
            &["block.toml:11", "probe key `depth_mm`"],
        ),
        (
            "[[tissue.fix]]\nbox_mm = [[-inf, -inf, 40], [inf, inf, inf]]",
            "",
            &["rigid motion free", "[[tissue.fix]]"],
        ),
    ] {
        let text = BLOCK.replacen(from, to, 1);
        assert_ne!(text, BLOCK, "{from}");
        bench.write("block.toml", &text);
        bench.run("insert block.toml -o out --backend cpu").fails(2, words);
        assert!(!bench.path("out").exists(), "{to}");
    }
    bench
        .run("insert nowhere -o out")
        .fails(2, &["neither a file nor a scenario"]);
    bench.run("insert nowhere.toml -o out").fails(2, &["nowhere.toml"]);
    bench.run("insert scene.toml").fails(2, &["--output"]);
    bench
        .run("insert --labels nowhere.nii.gz -o out")
        .fails(2, &["--target"]);
    bench
        .run("insert --labels nowhere.nii.gz --target liver -o out")
        .fails(2, &["nowhere.nii.gz", "cannot be read"]);
    bench
        .run("insert block.toml -o scene.toml")
        .fails(2, &["must be a folder"]);
    bench
        .run("insert block.toml -o out --vtu 0")
        .fails(2, &["milliseconds"]);
}

#[test]
fn scenarios_that_come_with_the_program_are_printed_and_described() {
    let bench = Bench::new();
    for (name, text) in insonify::input::scenario::EXAMPLES {
        assert_eq!(bench.run(&format!("insert --example {name}")).text(), *text);
    }
    assert_eq!(
        bench.run("insert --reference").text(),
        insonify::input::scenario::REFERENCE
    );
    let example = bench.run("insert segmentation-biopsy -o out");
    example.fails(2, &["your-labels.nii.gz", "[scene.volume]", "put the path of your own"]);
    let schema = bench.run("schema insert").json();
    for key in ["version", "scene", "run", "tissue", "needle", "contact_probe", "plan"] {
        assert!(schema["properties"][key]["description"].is_string(), "{key}");
    }
}

/// Bone whose nodes are all held stops a needle that meets it first, with the force that is stated.
#[test]
fn bone_at_the_surface_stops_a_needle() {
    let bench = bench();
    let bone = "[[tissue.material]]\nregion = \"phantom_top\"\nrigid = true\n\
                bone = { stiffness_n_per_mm = 40, penetration_mm = 0.5 }\n";
    bench.write("bone.toml", &format!("{BLOCK}{bone}"));
    let summary = bench.run("insert bone.toml -o out --json -q").json();
    let events = summary["events"].as_array().expect("a list");
    let kinds: Vec<_> = events.iter().map(|event| &event["kind"]).collect();
    assert_eq!(kinds, ["surface", "bone"], "{summary}");
    // However far the hand goes on, the force of the depth that bone lets the tip come to.
    let force = summary["max_base_force_n"].as_f64().expect("a force");
    assert!((force - 20.0).abs() < 1e-6, "{force}");
    let depth = summary["max_inserted_mm"].as_f64().expect("a depth");
    assert!((depth - 0.5).abs() < 1e-6, "{depth}");
    let warnings = summary["warnings"].as_array().expect("a list");
    assert!(
        warnings.len() == 1
            && warnings[0]
                .as_str()
                .is_some_and(|it| it.contains("the needle hit bone: phantom_top")),
        "{summary}"
    );
}

/// A needle that is through the whole block after its first step has gone through it, as one that is after its second.
#[test]
fn the_first_step_is_travelled() {
    let bench = bench();
    let still = "[[needle.motion.keyframes]]\ntime_s = 0.005\ntip_mm = [3, 2, -47]\ndirection = [0, 0, 1]\n";
    let short = BLOCK.replacen("dt_ms = 5", "dt_ms = 5\nduration_s = 0.1", 1);
    let far = |time: &str| {
        let from = "time_s = 0.5\ntip_mm = [3, 2, -20]";
        short.replacen(from, &format!("time_s = {time}\ntip_mm = [3, 2, 60]"), 1)
    };
    bench.write("first.toml", &far("0.005"));
    let second = far("0.01");
    let at = second.rfind("[[needle.motion.keyframes]]").expect("a keyframe");
    bench.write("second.toml", &format!("{}{still}{}", &second[..at], &second[at..]));
    let [first, second] =
        ["first", "second"].map(|name| bench.run(&format!("insert {name}.toml -o {name} --json -q")).json());
    for key in ["remeshes", "max_inserted_mm"] {
        assert_eq!(first[key], second[key], "{first} {second}");
    }
    assert!(first["remeshes"].as_u64().expect("a count") > 3, "{first}");
    let kind = |summary: &Value| summary["events"][0]["kind"].clone();
    assert_eq!([kind(&first), kind(&second)], ["surface", "surface"]);
}

#[test]
fn remeshing_works_on_a_gpu_and_changes_its_level_on_the_way() {
    let bench = bench();
    let on_gpu = BLOCK
        .replace(
            "nodes = 300",
            "nodes = 300\ndevice = \"gpu\"\nlevel = \"I\"\n[[tissue.material]]\npoisson = 0.45",
        )
        .replace(
            "[scene.volume]",
            "[[run.change]]\nat_s = 0.25\nlevel = \"III\"\n[scene.volume]",
        );
    bench.write("gpu.toml", &on_gpu);
    bench
        .run_without_gpu("insert gpu.toml -o out -q")
        .fails(1, &["gpu.toml", "line 22", "no GPU adapter"]);
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    bench
        .run("insert gpu.toml -o out -q --adapter nonsense")
        .fails(2, &["nonsense", "line 22"]);
    let run = bench.run("insert gpu.toml -o out --json");
    let name = format!("remeshing works on '{}'", gpu.report().name);
    assert!(run.stderr.contains(&name), "{}", run.stderr);
    let summary = run.json();
    let change = &summary["level_changes"][0];
    assert_eq!(
        (&change["from"], &change["to"]),
        (&Value::from("I"), &Value::from("III"))
    );
    let page = bench.text("out/index.html");
    assert!(page.contains("Changes of level") && page.contains("I to III"));

    // In f32 as on the CPU, up to rounding.
    bench.write("cpu.toml", &on_gpu.replace("device = \"gpu\"", "precision = \"f32\""));
    let cpu = bench.run("insert cpu.toml -o cpu --json").json();
    let [gpu_force, cpu_force] = [&summary, &cpu].map(|summary| summary["max_base_force_n"].as_f64().expect("a force"));
    assert!(
        (gpu_force - cpu_force).abs() < 1e-2 * cpu_force,
        "{gpu_force} N, on the CPU {cpu_force} N"
    );
    assert_eq!(summary["remeshes"], cpu["remeshes"]);
}
