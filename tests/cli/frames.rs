//! `render`: frames and what goes with them.

use insonify_imaging::sidecar::Sidecar;
use insonify_tracking::sequence::Sequence;
use serde_json::json;

use crate::support::{Bench, Run, SCENE, grey, grey16, names};

/// The scene with a probe that slides 10 mm in two seconds, and a needle.
fn moving() -> String {
    format!(
        "{SCENE}
[motion]
keyframes = [
  {{ time_s = 0, position_mm = [0, -40, 0], direction = [0, 1, 0], lateral = [1, 0, 0] }},
  {{ time_s = 2, position_mm = [10, -40, 0], direction = [0, 1, 0], lateral = [1, 0, 0] }},
]
[needle]
tip_mm = [5, -10, 0]
direction = [0, 1, 1]
[effects]
only = [\"needle\", \"shadow\", \"tone\"]
slice.beyond = \"void\"
"
    )
}

#[test]
fn one_frame_is_a_picture_and_one_object() {
    let bench = Bench::new();
    let report = bench.run("render scene.toml --backend cpu --json").json();
    assert_eq!((&report["backend"], &report["adapter"]), (&json!("cpu"), &json!(null)));
    assert_eq!((&report["width"], &report["height"]), (&json!(48), &json!(40)));
    assert_eq!(report["frames"].as_array().unwrap().len(), 1);
    assert_eq!(report["frames"][0]["path"], "frame.png");
    assert!(report["frames"][0]["ms"].as_f64().unwrap() > 0.0);
    assert!(names(&report["passes"]).contains(&"scan_conversion"));
    assert!(report["passes"][0]["ms"].is_number());
    assert_eq!(report["warnings"], json!([]));
    assert!(
        report["notes"].to_string().contains("the default pose of this phantom"),
        "{report}"
    );
    let (size, pixels) = grey(&bench.path("frame.png"));
    assert_eq!(size, (48, 40));
    assert!(pixels.iter().any(|&grey| grey > 60), "a picture, not a black square");
    assert_eq!(bench.files("."), ["frame.png", "scene.toml"]);
}

#[test]
fn a_name_without_a_file_is_a_built_in_scene() {
    let bench = Bench::new();
    bench.write("own.toml", bench.run("scene spine-linear").text());
    let plan = |scene: &str| bench.run(&format!("plan {scene} --json")).json();
    assert_eq!(plan("spine-linear"), plan("own.toml"));
    bench.write("spine-linear", SCENE);
    assert_eq!(plan("spine-linear"), plan("scene.toml"));
    bench.run("plan spine-liner").fails(2, &["spine-liner: cannot be read"]);
}

#[test]
fn the_cache_changes_no_picture_even_if_its_files_are_broken() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("cache")).expect("a folder");
    let frame = |name: &str| {
        bench.run(&format!("render scene.toml --backend cpu -o {name}")).text();
        std::fs::read(bench.path(name)).expect("a frame")
    };
    let first = frame("first.png");
    let folder = bench.path("cache/made");
    let files: Vec<_> = std::fs::read_dir(&folder).expect("a cache").collect();
    assert!(!files.is_empty());
    assert_eq!(frame("second.png"), first);
    for file in files {
        let path = file.expect("an entry").path();
        let mut bytes = std::fs::read(&path).expect("a file");
        bytes.iter_mut().skip(40).for_each(|byte| *byte = 0xff);
        std::fs::write(&path, bytes).expect("written");
    }
    assert_eq!(frame("third.png"), first);
    std::fs::remove_dir_all(&folder).expect("removed");
    std::fs::write(&folder, "in the way").expect("written");
    assert_eq!(frame("fourth.png"), first);
}

#[test]
fn the_backend_and_the_reason_go_to_standard_error() {
    let bench = Bench::new();
    let run = bench.run("render scene.toml");
    assert_eq!(run.text(), "");
    assert!(
        run.stderr.contains("backend: ") && run.stderr.contains("frame.png"),
        "{run:?}"
    );
    let run = bench.run_without_gpu("render scene.toml");
    assert_eq!(run.text(), "");
    assert!(
        run.stderr.contains("backend: cpu (no GPU adapter was found)"),
        "{run:?}"
    );
    let run = bench.run("render scene.toml --backend cpu --quiet");
    assert_eq!((run.text(), run.stderr.as_str()), ("", ""));
}

#[test]
fn the_same_scene_gives_the_same_bytes() {
    let bench = Bench::new();
    bench.run("render scene.toml --backend cpu -o a.png").text();
    let arguments = "render scene.toml --backend cpu -o b.png";
    let mut single = bench.command(arguments);
    single.env("RAYON_NUM_THREADS", "1");
    Run::of(single, arguments).text();
    let read = |name: &str| std::fs::read(bench.path(name)).unwrap();
    assert_eq!(read("a.png"), read("b.png"));
    bench.run("render scene.toml --backend cpu-f64 -o c.png").text();
    let (single, double) = (grey(&bench.path("a.png")).1, grey(&bench.path("c.png")).1);
    let furthest = single.iter().zip(&double).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(furthest <= Some(2), "{furthest:?}");
}

#[test]
fn many_frames_fill_a_folder_and_move() {
    let bench = Bench::new();
    bench.write("moving.toml", &moving());
    let report = bench
        .run("render moving.toml --backend cpu --frames 3 -o out/run --json")
        .json();
    let paths: Vec<&str> = report["frames"]
        .as_array()
        .unwrap()
        .iter()
        .map(|frame| frame["path"].as_str().unwrap())
        .collect();
    assert_eq!(
        paths,
        [
            "out/run/frame_0000.png",
            "out/run/frame_0001.png",
            "out/run/frame_0002.png"
        ]
    );
    assert_eq!(
        bench.files("out/run"),
        ["frame_0000.png", "frame_0001.png", "frame_0002.png"]
    );
    assert_ne!(grey(&bench.path(paths[0])), grey(&bench.path(paths[2])));
}

#[test]
fn a_sequence_reads_back_with_its_poses() {
    let bench = Bench::new();
    bench.write("moving.toml", &moving());
    bench
        .run("render moving.toml --backend cpu --frames 3 -o pictures")
        .text();
    for file in ["sweep.mha", "sweep.nrrd"] {
        let report = bench
            .run(&format!("render moving.toml --backend cpu --frames 3 -o {file} --json"))
            .json();
        assert_eq!(report["frames"][2]["path"], file);
        let sequence = Sequence::read(&bench.path(file)).unwrap();
        assert_eq!(sequence.frames.len(), 3);
        for (number, x) in [0.0, 5.0, 10.0].into_iter().enumerate() {
            let image = sequence.image(number).unwrap();
            let (size, pixels) = grey(&bench.path(&format!("pictures/frame_{number:04}.png")));
            assert_eq!((image.width, image.height), (size.0 as usize, size.1 as usize));
            assert_eq!(image.pixels, pixels, "{file} {number}");
            assert_eq!(sequence.frames[number].timestamp, Some(number as f64));
            let pose = sequence.transform(number, "Transducer", "World").unwrap();
            assert!(
                (pose[(0, 3)] - x).abs() < 1e-9 && (pose[(1, 3)] + 40.0).abs() < 1e-9,
                "{pose}"
            );
            let image_to_probe = sequence.transform(number, "Image", "Transducer").unwrap();
            assert!(
                image_to_probe[(0, 0)] > 0.0 && image_to_probe[(2, 3)].abs() < 1e-9,
                "{image_to_probe}"
            );
        }
    }
}

#[test]
fn a_sequence_of_ours_moves_a_probe_again() {
    let bench = Bench::new();
    bench.write("moving.toml", &moving());
    bench
        .run("render moving.toml --backend cpu --frames 3 -o sweep.mha")
        .text();
    let again = moving();
    let (before, rest) = again.split_once("[motion]").unwrap();
    let (_, after) = rest.split_once("[needle]").unwrap();
    let again =
        format!("{before}[motion.sequence]\nfile = \"sweep.mha\"\ntransform = \"TransducerToWorld\"\n[needle]{after}");
    bench.write("again.toml", &again);
    bench.run("render again.toml --backend cpu -o again.mha").text();
    let [first, second] = ["sweep.mha", "again.mha"].map(|name| Sequence::read(&bench.path(name)).unwrap());
    assert_eq!(second.frames.len(), 3);
    for frame in 0..3 {
        assert_eq!(first.image(frame), second.image(frame));
        assert_eq!(
            first.frames[frame].transforms.len(),
            second.frames[frame].transforms.len()
        );
    }
    // What a tracker records is kept, valid or not, and the world is that of the scene.
    let text = "Seq_Frame0000_A_1ToBTransform = 1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 1\nSeq_Frame0000_A_1ToBTransformStatus = INVALID\n";
    let mut bytes = std::fs::read(bench.path("sweep.mha")).unwrap();
    let at = bytes
        .windows(18)
        .position(|window| window == b"Seq_Frame0000_Imag")
        .unwrap();
    bytes.splice(at..at, text.bytes());
    std::fs::write(bench.path("sweep.mha"), bytes).unwrap();
    bench.write(
        "ras.toml",
        &again.replace("[motion.sequence]", "[motion]\nworld = \"ras\"\n[motion.sequence]"),
    );
    bench.run("render ras.toml --backend cpu -o ras.nrrd").text();
    let simulated = format!("Simulated = insonify {} seed 3\n", env!("CARGO_PKG_VERSION"));
    for (file, fields) in [
        ("sweep.mha", ["WorldAxes = LPS\n", &simulated]),
        ("ras.nrrd", ["WorldAxes:=RAS\n", &simulated.replace(" = ", ":=")]),
    ] {
        let bytes = std::fs::read(bench.path(file)).unwrap();
        for field in fields {
            let is_there = bytes.windows(field.len()).any(|window| window == field.as_bytes());
            assert!(is_there, "{file}: {field}");
        }
    }
    let kept = Sequence::read(&bench.path("ras.nrrd")).unwrap();
    let foreign = &kept.frames[0].transforms["A_1ToB"];
    assert_eq!((foreign.valid, foreign.matrix[(2, 3)]), (false, 7.0));
    for name in ["TransducerToWorld", "ImageToWorld"] {
        let [first, kept] = [&first, &kept].map(|sequence| sequence.frames[0].transforms[name].matrix);
        assert!((first - kept).amax() < 1e-9, "{name}: {first} {kept}");
    }
}

#[test]
fn ground_truth_goes_beside_the_frame() {
    let bench = Bench::new();
    bench.write("moving.toml", &moving());
    let layers = "label-value,label-index,sector,displacement,depth,needle,loss";
    bench
        .run(&format!(
            "render moving.toml --backend cpu --frames 1 -o a.png --layers {layers} --sidecar --overview"
        ))
        .text();
    let sidecar: Sidecar = bench.read("a.json");
    assert_eq!(sidecar.files.image.as_deref(), Some("a.png"));
    let listed: Vec<&str> = sidecar.files.layers.iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(listed.join(","), layers);
    assert_eq!((sidecar.seed, sidecar.frame), (3, 0));
    let layer = |name: &str| {
        let file = sidecar.files.layers.iter().find(|layer| layer.name == name).unwrap();
        let (size, values) = grey16(&bench.path(&file.path));
        assert_eq!(size, (sidecar.image.width as u32, sidecar.image.height as u32));
        values
    };

    let needle = sidecar.needle.as_ref().unwrap();
    assert!(
        needle.tip_in_picture && needle.tip_out_of_plane_mm.abs() < 1e-9,
        "{needle:?}"
    );
    let [column, row] = needle.tip_px.map(|at| at.round() as usize);
    let mask = layer("needle");
    let near = |at: usize| at.saturating_sub(2)..=at + 2;
    let around = near(row).flat_map(|row| near(column).map(move |column| row * 48 + column));
    assert!(
        around.into_iter().any(|at| mask[at] > 0),
        "the needle's tip is where the sidecar says"
    );

    let parameters = sidecar.parameters.as_ref().unwrap();
    let labels = parameters["labels"].as_array().unwrap();
    let (values, pixels, sector) = (layer("label-value"), layer("label-index"), layer("sector"));
    assert!(
        pixels
            .iter()
            .any(|&index| labels[usize::from(index)]["tissue"] == "phantom_inclusion")
    );
    for (value, index) in values.iter().zip(&pixels) {
        assert_eq!(labels[usize::from(*index)]["value"], *value);
    }
    assert!(sector.iter().all(|&inside| inside <= 1));
    assert!(
        sector.contains(&0)
            && sector
                .iter()
                .zip(&values)
                .all(|(&inside, &value)| inside == 1 || value == 0)
    );
    assert!(
        sector
            .iter()
            .zip(&values)
            .any(|(&inside, &value)| inside == 1 && value == 0)
    );
    assert!(layer("displacement").iter().all(|&moved| moved == 0));
    let (depth, loss) = (layer("depth"), layer("loss"));
    let column = |values: &[u16]| -> Vec<u16> { (4..36).map(|row| values[row * 48 + 24]).collect() };
    assert!(
        column(&depth).is_sorted() && column(&depth)[31] > 300,
        "tenths of a millimetre add up"
    );
    assert!(
        column(&loss).is_sorted() && column(&loss)[31] > 100,
        "hundredths of a decibel add up"
    );

    let overview = image::open(bench.path("a_overview.png")).unwrap().into_rgb8();
    assert!(
        overview.pixels().any(|pixel| pixel.0[0] != pixel.0[1]),
        "the overview has colours"
    );
}

#[test]
fn a_single_pixel_and_a_single_scanline_are_frames() {
    let bench = Bench::new();
    bench
        .run("render scene.toml --backend cpu --size 1x1 -o dot.png")
        .text();
    assert_eq!(grey(&bench.path("dot.png")).0, (1, 1));
    bench.write(
        "line.toml",
        &SCENE
            .replace("lines = 32", "lines = 1")
            .replace("samples = 64", "samples = 1"),
    );
    bench
        .run("render line.toml --backend cpu -o line.png --layers labels")
        .text();
    assert_eq!(grey(&bench.path("line.png")).0, (48, 40));
}

#[test]
fn a_probe_outside_the_volume_is_status_1_and_leaves_no_frame() {
    let bench = Bench::new();
    let away = "[pose]\nposition_mm = [0, 900, 0]\ndirection = [0, 1, 0]\n";
    bench.write("away.toml", &format!("{SCENE}{away}"));
    let run = bench.run("render away.toml --backend cpu --json --sidecar");
    assert_eq!(run.status, Some(1), "{run:?}");
    assert_eq!(run.stderr.matches("sees nothing of the volume").count(), 1, "{run:?}");
    assert!(!bench.path("frame.png").exists() && !bench.path("frame.json").exists());
}

#[test]
fn a_probe_that_leaves_the_volume_is_told_of_by_frame() {
    let bench = Bench::new();
    bench.write("leaving.toml", &moving().replace("[10, -40, 0]", "[400, -40, 0]"));
    let run = bench.run("render leaving.toml --backend cpu --frames 3 --json --sidecar -o out");
    let report = run.json();
    let warnings = report["warnings"].as_array().unwrap();
    let by_frame = |warning: &&serde_json::Value| warning.as_str().unwrap().contains("wholly outside the volume");
    let outside: Vec<_> = warnings.iter().filter(by_frame).collect();
    assert_eq!(outside.len(), 1, "{run:?}");
    assert!(
        outside[0]
            .as_str()
            .unwrap()
            .starts_with("2 of 3 frames, first frame 1: "),
        "{outside:?}"
    );
    assert!(bench.text("out/frame_0002.json").contains("wholly outside"));
    assert!(!bench.text("out/frame_0000.json").contains("field of view"));
}

#[test]
fn a_label_file_alone_is_enough() {
    let bench = Bench::new();
    bench.run("phantom abdomen -o body.nii.gz --resolution-mm 4").text();
    let run = bench.run("render --labels body.nii.gz --backend cpu --size 64x48 --target liver -o liver.png");
    assert_eq!(run.text(), "");
    assert!(run.stderr.contains("liver"), "{run:?}");
    assert!(grey(&bench.path("liver.png")).1.iter().any(|&grey| grey > 60));
    std::fs::create_dir(bench.path("scenes")).unwrap();
    bench.write("scenes/own.toml", &format!("{SCENE}[effects]\nonly = []\n"));
    bench
        .run("render scenes/own.toml --labels body.nii.gz --backend cpu -o replaced.png")
        .text();
}

#[test]
fn doubtful_poses_and_choices_are_questioned() {
    let bench = Bench::new();
    let with = |name: &str, more: &str| {
        bench.write(name, &format!("{SCENE}{more}"));
        bench.run(&format!("render {name} --backend cpu --json"))
    };
    let inside = with(
        "inside.toml",
        "[pose]\nposition_mm = [0, 0, 0]\ndirection = [0, 1, 0]\n",
    );
    let warnings = inside.json()["warnings"].to_string();
    assert!(
        warnings.contains("inside the body") && warnings.contains("outside the volume"),
        "{warnings}"
    );
    let partial = with("partial.toml", "[effects]\nonly = [\"speckle\"]\n");
    assert!(partial.text().contains("\"warnings\": []"), "{partial:?}");
    assert!(partial.stderr.contains("grey levels are linear"), "{partial:?}");
    bench.write("moving.toml", &moving());
    let still = bench.run("render moving.toml --backend cpu --target inclusion -o still.png");
    still.text();
    assert!(
        still.stderr.contains("the motion of the scene is left out"),
        "{still:?}"
    );
    let nowhere = bench.run("render scene.toml --backend cpu -o nowhere/frame.png");
    nowhere.fails(2, &["nowhere/frame.png: its folder does not exist"]);
    let film = bench.run("render moving.toml --backend cpu -o film.mp4 --frames 2");
    film.fails(2, &["film.mp4", ".mha"]);
}

/// Marks for people: over the picture alone, told in the sidecar, and not with ground truth nor in sequences.
#[test]
fn an_overlay_is_drawn_over_the_picture_and_told() {
    let bench = Bench::new();
    bench
        .run("render scene.toml --backend cpu -o plain.png --sidecar")
        .text();
    bench
        .run("render scene.toml --backend cpu -o marked.png --sidecar --overlay")
        .text();
    let [plain, marked] = ["plain.png", "marked.png"].map(|name| grey(&bench.path(name)));
    assert_eq!(plain.0, marked.0);
    let changed = plain.1.iter().zip(&marked.1).filter(|(a, b)| a != b).count();
    assert!((20..48 * 20).contains(&changed), "{changed} pixels are marked");
    let is_marked = |name: &str| bench.read::<Sidecar>(name).files.overlay;
    assert_eq!([is_marked("plain.json"), is_marked("marked.json")], [false, true]);
    for refused in ["-o a.png --overlay --layers depth", "-o a.mha --overlay"] {
        let run = bench.run(&format!("render scene.toml --backend cpu {refused}"));
        assert!(run.status == Some(2) && run.stderr.contains("--overlay"), "{run:?}");
        assert!(!bench.files(".").iter().any(|file| file.starts_with("a.")), "{refused}");
    }
}
