//! What is in the way of an output, what a later run replaces, and what an interrupt leaves.

use std::fs;

use insonify_tracking::sequence::Sequence;
use serde_json::Value;

use crate::insert::BLOCK;
use crate::support::{Bench, Run, SCENE, grey, grey16};

const SWEEP: &str = "[motion]
keyframes = [
  { time_s = 0, position_mm = [0, -40, 0], direction = [0, 1, 0] },
  { time_s = 1, position_mm = [10, -40, 0], direction = [0, 1, 0] },
]
";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("sweep.toml", &format!("{SCENE}{SWEEP}"));
    bench.write("block.toml", BLOCK);
    bench
}

#[test]
fn a_folder_has_the_frames_of_one_run() {
    let bench = bench();
    let render = |arguments: &str| bench.run(&format!("render sweep.toml --backend cpu -o out {arguments}"));
    render("--frames 10 --layers depth").text();
    assert_eq!(bench.files("out").len(), 20);
    bench.write("out/mine.txt", "mine");
    bench.write("out/frame_0001_notes.txt", "mine");
    render("--frames 5").text();
    let five: Vec<String> = (0..5).map(|frame| format!("frame_{frame:04}.png")).collect();
    let mine = ["frame_0001_notes.txt", "mine.txt"].map(str::to_owned);
    assert_eq!(bench.files("out").len(), 7);
    assert!(mine.iter().chain(&five).all(|file| bench.files("out").contains(file)));
    let list = bench.read::<Value>("out/insonify.json");
    let manifest = ["manifest.csv", "manifest.jsonl"].map(str::to_owned);
    assert_eq!(
        (&list["command"], &list["files"]),
        (&"render".into(), &[&five[..], &manifest].concat().into())
    );

    // A frame that no list names is somebody's.
    bench.write("out/frame_0007.png", "mine");
    render("--frames 5").fails(2, &["out/frame_0007.png", "--force"]);
    render("--frames 8 --force").text();
    assert_eq!(bench.files("out").len(), 10);
    render("--frames 5").text();
    assert_eq!(bench.files("out").len(), 7);
}

/// Folders called as those of a run, with files that it never wrote.
#[test]
fn an_insertion_replaces_only_files_of_its_own() {
    let bench = bench();
    for (folder, file) in [
        ("plots/thesis", "plots/thesis/fig1.svg"),
        ("frames", "frames/recorded_0001.png"),
        ("mesh", "mesh/body.vtu"),
    ] {
        fs::create_dir_all(bench.path(folder)).unwrap();
        bench.write(file, "precious");
    }
    let insert = "insert block.toml -o . --backend cpu -q --frames --vtu 100";
    bench.run(insert).text();
    bench.run(insert).text();
    for file in ["plots/thesis/fig1.svg", "frames/recorded_0001.png", "mesh/body.vtu"] {
        assert_eq!(fs::read(bench.path(file)).expect(file), b"precious");
    }
    assert_eq!(bench.files("frames").len(), 12);
    bench.write("frames/frame_0099.png", "mine");
    bench.run(insert).fails(2, &["frame_0099.png", "--force"]);
    // A mesh of the run before cannot be what this one starts from.
    fs::remove_file(bench.path("frames/frame_0099.png")).unwrap();
    let with_mesh = BLOCK.replacen("nodes = 300", "mesh = \"mesh/mesh_0000.vtu\"", 1);
    bench.write("block.toml", &with_mesh);
    bench.run(insert).fails(2, &["mesh_0000.vtu", "this run reads"]);
}

#[test]
fn files_of_another_kind_and_inputs_are_not_overwritten() {
    let bench = bench();
    bench.write("notes.png", "my notes");
    bench.write("a.json", "{ \"mine\": 1 }");
    let render = "render sweep.toml --backend cpu --frames 1";
    bench
        .run(&format!("{render} -o notes.png"))
        .fails(2, &["notes.png", "--force"]);
    bench.run(&format!("{render} -o a.png --sidecar")).fails(2, &["a.json"]);
    assert!(!bench.path("a.png").exists());
    bench.run(&format!("{render} -o notes.png --force")).text();
    bench.run(&format!("{render} -o notes.png")).text();
    // The recording that moves the probe.
    bench
        .run("render sweep.toml --backend cpu --frames 2 -o sweep.mha")
        .text();
    let again = "[motion.sequence]\nfile = \"sweep.mha\"\ntransform = \"TransducerToWorld\"\n";
    bench.write("again.toml", &format!("{SCENE}{again}"));
    bench
        .run("render again.toml --backend cpu -o ./sweep.mha")
        .fails(2, &["sweep.mha", "this run reads"]);

    bench.run("phantom two-layer --resolution-mm 5 -o block.nrrd").text();
    bench
        .run("mesh make block.nrrd --nodes 100 --no-complete -q -o block.vtu")
        .text();
    let problem = "mesh = \"block.vtu\"\n[[material]]\nyoung_kpa = 5\npoisson = 0.4\n[[fix]]\nbox_mm = [[-inf, -inf, -inf], [inf, 0, inf]]\n[[load]]\nbox_mm = [[-inf, 20, -inf], [inf, inf, inf]]\nforce_n = [0, 0, 0.01]\n";
    bench.write("problem.toml", problem);
    bench
        .run("solve problem.toml -o block.vtu")
        .fails(2, &["block.vtu", "this run reads"]);
    bench
        .run("solve problem.toml -o out.vtu --history ./out.vtu")
        .fails(2, &["two outputs"]);
    bench.run("solve problem.toml -o moved.vtu").text();
    bench.run("solve problem.toml -o moved.vtu").text();
}

/// Nothing is computed for an output that cannot be written: these would take minutes.
#[test]
fn what_is_in_the_way_is_found_before_the_computation() {
    let bench = bench();
    bench.write("file", "mine");
    fs::create_dir(bench.path("folder.vtu")).unwrap();
    for arguments in [
        "puncture --step-mm 0.001 -o file",
        "tradeoff -o file",
        "tradeoff tissue --whole -o file",
        "stability -o file",
        "bench --compare -o file",
        "insert block.toml -o file",
        "render sweep.toml --frames 2 -o file",
        "mesh make --phantom abdomen --nodes 30000 -o folder.vtu",
        "phantom abdomen --resolution-mm 0.5 -o folder.vtu",
    ] {
        bench.run(arguments).fails(2, &["must be"]);
    }
    assert_eq!(
        bench.files("."),
        ["block.toml", "file", "folder.vtu", "scene.toml", "sweep.toml"]
    );
}

#[test]
fn layers_of_a_sequence_are_sequences_with_its_poses() {
    let bench = bench();
    let layers = "--layers label-value,sector --sidecar";
    bench
        .run(&format!(
            "render sweep.toml --backend cpu --frames 3 -o pictures {layers}"
        ))
        .text();
    for ending in ["mha", "nrrd"] {
        bench
            .run(&format!(
                "render sweep.toml --backend cpu --frames 3 -o x.{ending} {layers}"
            ))
            .text();
        let files = [format!("x_label-value.{ending}"), format!("x_sector.{ending}")];
        assert!(
            files.iter().all(|file| bench.files(".").contains(file)),
            "{:?}",
            bench.files(".")
        );
        let [images, masks] = [format!("x.{ending}"), files[0].clone()].map(|file| {
            let read = Sequence::read_poses(&bench.path(&file)).expect("a sequence");
            let frames = read.frames.iter();
            frames
                .map(|frame| (frame.timestamp, frame.transforms["ImageToWorld"].matrix))
                .collect::<Vec<_>>()
        });
        assert_eq!(images, masks);
        let text = fs::read(bench.path(&files[0])).expect("a file");
        let kind: &[u8] = if ending == "mha" {
            b"ElementType = MET_USHORT"
        } else {
            b"type: uint16"
        };
        assert!(text.windows(kind.len()).any(|part| part == kind));
        let sidecar = bench.read::<Value>("x/frame_0002.json");
        assert_eq!(
            sidecar["files"]["layers"][0]["path"],
            format!("../x_label-value.{ending}")
        );
    }
    // Arrays have the pixels of the pictures, one after another; nothing is compressed on request.
    for plain in ["x.npy", "plain.mha --uncompressed"] {
        let run = format!("render sweep.toml --backend cpu --frames 3 {layers} -o {plain}");
        let report = bench.run(&format!("{run} --json")).json();
        assert!(report["frames_per_second"].as_f64().is_some_and(|rate| rate > 0.0));
        let file = plain.split(' ').next().expect("a file");
        let bytes = |file: &str| fs::read(bench.path(file)).expect("a file");
        let picture = |name: &str| bench.path(&format!("pictures/frame_{name}.png"));
        let pixels: Vec<u8> = (0..3).flat_map(|at| grey(&picture(&format!("{at:04}"))).1).collect();
        assert!(bytes(file).ends_with(&pixels), "{file}");
        let layer = (0..3).flat_map(|at| grey16(&picture(&format!("{at:04}_label-value"))).1);
        let layer: Vec<u8> = layer.flat_map(u16::to_le_bytes).collect();
        let (stem, ending) = file.split_once('.').expect("an ending");
        assert!(
            bytes(&format!("{stem}_label-value.{ending}")).ends_with(&layer),
            "{file}"
        );
    }
    bench
        .run("render sweep.toml --backend cpu --frames 2 -o pictures --uncompressed")
        .fails(2, &["--uncompressed", ".mha"]);
    // What frames share is written once.
    let shared = bench.read::<Value>("pictures/parameters.json");
    assert!(shared["labels"].as_array().is_some_and(|labels| !labels.is_empty()));
    let sidecar = bench.text("pictures/frame_0001.json");
    assert!(
        sidecar.len() < 2500 && sidecar.contains("\"parameters_file\": \"parameters.json\""),
        "{sidecar}"
    );
    assert!(
        grey16(&bench.path("pictures/frame_0001_label-value.png"))
            .1
            .iter()
            .any(|&value| value > 0)
    );
}

#[test]
fn earlier_names_of_layers_are_taken_and_told() {
    let bench = bench();
    let run = bench.run("render sweep.toml --backend cpu --frames 1 -o a.png --layers labels,shadowed,loss");
    run.text();
    assert!(
        run.stderr.contains("note: the layer `labels` is now `label-value`"),
        "{run:?}"
    );
    for name in ["a_label-value.png", "a_loss.png"] {
        assert!(bench.path(name).exists(), "{name}");
    }
    let help = bench.run("render --help");
    assert!(help.text().contains("label-value") && !help.text().contains("shadowed"));
}

#[test]
fn frames_of_a_scene_where_nothing_moves_are_told_of_once() {
    let bench = bench();
    let run = bench.run("render scene.toml --backend cpu --frames 3 -o still --json");
    let warning = "all 3 frames show the same pose";
    assert_eq!(run.stderr.matches(warning).count(), 1, "{run:?}");
    assert!(run.text().contains(warning));
    let run = bench.run("render sweep.toml --backend cpu --frames 3 -o moving");
    assert!(!run.stderr.contains("the same pose"), "{run:?}");
}

#[cfg(unix)]
mod unix {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;

    use std::process::{Command, Stdio};
    use std::thread::sleep;
    use std::time::{Duration, Instant};

    use super::*;

    /// Everything in a folder and below whose name shows that it was in the making.
    fn leftovers(bench: &Bench) -> Vec<String> {
        let mut files = Vec::new();
        let mut folders = vec![String::from(".")];
        while let Some(folder) = folders.pop() {
            for name in bench.files(&folder) {
                let path = format!("{folder}/{name}");
                if name.starts_with(".insonify-") {
                    files.push(path.clone());
                }
                if bench.path(&path).is_dir() {
                    folders.push(path);
                }
            }
        }
        files
    }

    /// Starts a long run and sends it a signal as soon as something is in the making; returns its status.
    fn interrupted(bench: &Bench, arguments: &str, signal: &str) -> Option<i32> {
        let mut command = bench.command(arguments);
        let mut child = command
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("it runs");
        let start = Instant::now();
        while leftovers(bench).is_empty() && start.elapsed() < Duration::from_secs(60) {
            sleep(Duration::from_millis(20));
        }
        sleep(Duration::from_millis(200));
        let sent = Command::new("kill")
            .args(["-s", signal, &child.id().to_string()])
            .status();
        assert!(sent.expect("kill runs").success(), "{arguments}");
        child.wait().expect("it ends").code()
    }

    #[test]
    fn signals_leave_nothing() {
        let bench = bench();
        let long = BLOCK.replacen("dt_ms = 5", "dt_ms = 0.05", 1);
        bench.write("long.toml", &long);
        let before = bench.files(".");
        for (arguments, signal, status) in [
            (
                "render sweep.toml --backend cpu --size 900x900 --frames 2000 -o new/frames",
                "INT",
                130,
            ),
            (
                "render sweep.toml --backend cpu --size 900x900 --frames 2000 -o frames",
                "TERM",
                143,
            ),
            ("insert long.toml --backend cpu --frames -q -o out", "HUP", 129),
        ] {
            assert_eq!(interrupted(&bench, arguments, signal), Some(status), "{arguments}");
            assert_eq!(leftovers(&bench), [""; 0], "{arguments}");
        }
        fs::remove_dir(bench.path("new")).expect("an empty folder");
        assert_eq!(bench.files("."), before);
    }

    #[test]
    fn what_a_killed_run_leaves_is_cleared_by_the_next() {
        let bench = bench();
        let long = "render sweep.toml --backend cpu --size 900x900 --frames 2000 -o frames";
        assert_eq!(interrupted(&bench, long, "KILL"), None);
        assert!(!leftovers(&bench).is_empty());
        bench.run("render sweep.toml --backend cpu --frames 2 -o frames").text();
        assert_eq!(bench.files("frames"), ["frame_0000.png", "frame_0001.png"]);
    }

    #[test]
    fn names_that_are_not_utf_8_are_kept() {
        let bench = bench();
        let name = |end: &[u8]| bench.path("").join(OsStr::from_bytes(&[b"n\xff", end].concat()));
        let mut render =
            bench.command("render sweep.toml --backend cpu -q --frames 1 --layers depth --overview --sidecar --json");
        render.arg("-o").arg(name(b".png"));
        let report = Run::of(render, "render -o n\\xff.png").json();
        assert!(
            report["frames"][0]["path"]
                .as_str()
                .is_some_and(|path| path.ends_with("n\u{fffd}.png"))
        );
        for end in [&b".png"[..], b"_depth.png", b"_overview.png", b".json"] {
            assert!(name(end).is_file(), "{}", end.escape_ascii());
        }
        let mut render = bench.command("render sweep.toml --backend cpu -q --frames 2 --layers depth --sidecar");
        render.arg("-o").arg(name(b".mha"));
        Run::of(render, "render -o n\\xff.mha").text();
        assert!(name(b"_depth.mha").is_file() && name(b"/frame_0001.json").is_file());
    }

    #[test]
    fn a_header_that_is_not_utf_8_finds_its_image() {
        let bench = bench();
        let Some(formats) = insonify_testing::shared("formats") else {
            return;
        };
        for ending in ["hdr", "img"] {
            let to = bench
                .path("")
                .join(OsStr::from_bytes(&[b"n\xff.", ending.as_bytes()].concat()));
            fs::copy(formats.join(format!("niivue_ras.{ending}")), to).expect("copied");
        }
        let mut info = bench.command("info");
        info.arg(bench.path("").join(OsStr::from_bytes(b"n\xff.hdr")));
        Run::of(info, "info n\\xff.hdr").text();
    }
}
