//! `rf` and `motion`: echoes of scenes, B-mode of echoes, motion against truth.

use crate::support::Bench;

/// A linear array on a block that is compressed along the beam by up to 1 %, on a mesh.
const COMPRESSED: &str = r#"
version = 2
seed = 4
[volume]
phantom = "two-layer"
resolution_mm = 1.0
[probe]
kind = "linear"
width_mm = 7.0
depth_mm = 30
frequency_mhz = 5
lines = 48
[effects]
only = []
slice.beyond = "void"
[deform]
nodes = 400
ramp_s = 1.0
field = { kind = "compression", fixed_mm = [0, 0, 45], direction = [0, 0, 1], strain = 0.01 }
[motion]
frames = 3
[[motion.keyframes]]
time_s = 0.0
position_mm = [0, 0, 45]
direction = [0, 0, -1]
lateral = [1, 0, 0]
[[motion.keyframes]]
time_s = 0.4
position_mm = [0, 0, 45]
direction = [0, 0, -1]
lateral = [1, 0, 0]
"#;

#[test]
fn motion_of_a_deforming_mesh_is_found_in_its_echoes() {
    let bench = Bench::new();
    bench.write("scene.toml", COMPRESSED);
    let summary = bench
        .run("rf scene.toml -o rf.igs.mha --truth truth.csv --node-truth nodes.csv --windows 40 --json")
        .json();
    assert_eq!(
        (
            summary["lines"].as_u64(),
            summary["samples"].as_u64(),
            summary["frames"].as_u64()
        ),
        (Some(48), Some(1558), Some(3))
    );
    let motion = bench
        .run(
            "motion rf.igs.mha -o u.csv --truth truth.csv --windows 40 --strain strain.png --displacement u.png --json",
        )
        .json();
    let errors = &motion["errors"];
    let number = |axis: &str, key: &str| errors[axis][key].as_f64().expect("a number");
    assert!(
        number("axial", "bias_um").abs() < 0.2 && number("axial", "sd_um") < 1.5,
        "{errors}"
    );
    assert!(
        number("lateral", "bias_um").abs() < 10.0 && number("lateral", "sd_um") < 60.0,
        "{errors}"
    );
    assert!(errors["windows"].as_u64() > Some(3500), "{errors}");
    // The last frame is compressed by 1 %: 10 um for each millimetre, towards the probe.
    let table = bench.text("truth.csv");
    let last: Vec<f64> = table
        .lines()
        .last()
        .expect("a row")
        .split(',')
        .map(|field| field.parse().expect("a number"))
        .collect();
    assert!((last[4] + 10.0 * last[3]).abs() < 0.6, "{last:?}");
    let table = bench.text("u.csv");
    assert_eq!(table.lines().count(), 1 + 2 * 48 * 40);
    assert!(table.starts_with("frame,line,window,depth_mm,axial_um,lateral_um,correlation,least_correlation\n"));
    assert!(bench.text("nodes.csv").lines().count() > 3 * 300);
    for name in ["strain.png", "u.png"] {
        let picture = image::open(bench.path(name)).expect("a picture").into_rgb8();
        let blue = picture
            .pixels()
            .filter(|pixel| pixel.0[2] > pixel.0[0].saturating_add(20))
            .count();
        assert!(
            blue * 3 > (picture.width() * picture.height()) as usize,
            "{name}: {blue} blue pixels"
        );
    }
    // The same against the truth, drawn.
    let study = bench
        .run("motion rf.igs.mha --truth truth.csv --windows 40 --validate -o study --quiet --json")
        .json();
    let row = &study["tables"]["errors"]["rows"][0];
    assert!(
        row["sd_um"].as_f64() < Some(1.5) && row["frames"].as_f64() == Some(2.0),
        "{row}"
    );
    let files = bench.files("study");
    for name in [
        "figure-6.svg",
        "figure-8-1.svg",
        "figure-9c.png",
        "places.csv",
        "index.html",
    ] {
        assert!(files.iter().any(|file| file == name), "{name} is not among {files:?}");
    }
    bench.run("rf rf.igs.mha --bmode -o frame.png --frame 2").text();
    let frame = image::open(bench.path("frame.png")).expect("a picture").into_luma8();
    let mean =
        frame.pixels().map(|pixel| f64::from(pixel.0[0])).sum::<f64>() / f64::from(frame.width() * frame.height());
    assert!((90.0..220.0).contains(&mean) && frame.height() == 640, "{mean}");
}

/// A curved array that is shifted along itself: its lines are further apart in the depth.
#[test]
fn lateral_motion_under_a_curved_array_is_that_of_the_tissue() {
    let bench = Bench::new();
    let (still, _) = COMPRESSED.split_once("[deform]").expect("a mesh");
    let still = still.replace(
        "kind = \"linear\"\nwidth_mm = 7.0",
        "kind = \"curvilinear\"\nradius_mm = 20\nangle_deg = 20",
    );
    let key = |time_s: f64, x: f64| {
        format!(
            "[[motion.keyframes]]\ntime_s = {time_s}\nposition_mm = [{x}, 0, 45]\ndirection = [0, 0, -1]\nlateral = [1, 0, 0]\n"
        )
    };
    let moves = format!("[motion]\nframes = 2\n{}{}", key(0.0, 0.0), key(0.2, 0.3));
    bench.write("scene.toml", &(still + &moves));
    bench
        .run("rf scene.toml -o rf.igs.mha --truth truth.csv --windows 40")
        .text();
    bench
        .run("motion rf.igs.mha -o u.csv --truth truth.csv --windows 40")
        .text();
    let column = |file: &str, frame: &str| -> Vec<f64> {
        let table = bench.text(file);
        let rows = table.lines().filter(|row| row.starts_with(frame));
        rows.map(|row| row.split(',').nth(5).expect("a column").parse().expect("a number"))
            .collect()
    };
    let (found, truth) = (column("u.csv", "1,"), column("truth.csv", "1,"));
    assert_eq!(found.len(), truth.len());
    for half in [0..20, 20..40] {
        let of_half = |index: &usize| half.contains(&(index % 40)) && (6 * 40..42 * 40).contains(index);
        let indices: Vec<usize> = (0..found.len()).filter(of_half).collect();
        let mean = |values: &[f64]| indices.iter().map(|index| values[*index]).sum::<f64>() / indices.len() as f64;
        let ratio = mean(&found) / mean(&truth);
        assert!((ratio - 1.0).abs() < 0.05, "windows {half:?}: {ratio} of the motion");
    }
}

/// Lines sampled at a rate are shorter where sound is slower, and so are pictures; gain brightens the depth.
#[test]
fn pictures_follow_the_speed_of_sound_and_the_gain_over_depth() {
    let bench = Bench::new();
    bench.write("scene.toml", COMPRESSED);
    bench.run("rf scene.toml -o rf.igs.mha --frames 2").text();
    let picture = |name: &str| image::open(bench.path(name)).expect("a picture").into_luma8();
    for (speed, depth_mm) in [(1540.0, 30.0), (1450.0, 30.0 * 1450.0 / 1540.0)] {
        bench
            .run(&format!(
                "motion rf.igs.mha -o u.csv --displacement u.png --speed-m-s {speed} --windows 30 --force"
            ))
            .text();
        let width = f64::from(picture("u.png").width());
        assert!(
            (width - 640.0 * 7.0 / depth_mm).abs() < 2.0,
            "{speed} m/s: {width} pixels"
        );
    }
    let brightness = |gain: &str| {
        bench
            .run(&format!("rf rf.igs.mha --bmode -o frame.png --force {gain}"))
            .text();
        let frame = picture("frame.png");
        let mean = |rows: std::ops::Range<u32>| {
            let values = rows.flat_map(|y| (0..frame.width()).map(move |x| (x, y)));
            let values: Vec<f64> = values.map(|(x, y)| f64::from(frame.get_pixel(x, y).0[0])).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        mean(560..620) - mean(20..80)
    };
    // 2.5 cm further down, 10 dB/cm are 25 of 60 dB: 106 of 255 levels.
    let gained = brightness("--tgc-db-cm 10") - brightness("");
    assert!((70.0..125.0).contains(&gained), "{gained} levels");
}

#[test]
fn the_same_scene_gives_the_same_echoes_and_another_seed_others() {
    let bench = Bench::new();
    let still = COMPRESSED
        .replace("frames = 3", "frames = 1")
        .replace("depth_mm = 30", "depth_mm = 10");
    bench.write("scene.toml", &still);
    bench.write("other.toml", &still.replace("seed = 4", "seed = 5"));
    for (scene, name) in [("scene", "a"), ("scene", "b"), ("other", "c")] {
        bench.run(&format!("rf {scene}.toml -o {name}.igs.nrrd")).text();
    }
    let bytes = |name: &str| std::fs::read(bench.path(name)).expect("a file");
    assert!(bytes("a.igs.nrrd") == bytes("b.igs.nrrd"));
    assert!(bytes("a.igs.nrrd") != bytes("c.igs.nrrd"));
}

#[test]
fn samples_of_32_bits_are_those_of_16_bits_without_rounding() {
    let bench = Bench::new();
    bench.write("scene.toml", &COMPRESSED.replace("depth_mm = 30", "depth_mm = 10"));
    let read = |options: &str| {
        bench
            .run(&format!("rf scene.toml -o rf.igs.mha --frames 1 --force {options}"))
            .text();
        let echoes = insonify_imaging::rf::file::Echoes::read(&bench.path("rf.igs.mha")).expect("echoes");
        echoes.frames[0].clone()
    };
    let whole = read("--backend cpu");
    let single = read("--backend cpu --float");
    let double = read("--backend cpu-f64 --float");
    assert!(
        whole
            .iter()
            .zip(&single)
            .all(|(whole, single)| (single - whole).abs() <= 0.5 + single.abs() * f32::EPSILON)
    );
    assert!(single != double && single.iter().any(|value| value.fract() != 0.0));
    let difference = single
        .iter()
        .zip(&double)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    // A count is a thousandth of the RMS of liver.
    assert!(difference < 0.1, "{difference} counts");
}

#[test]
fn bad_echoes_and_options_are_refused() {
    let bench = Bench::new();
    bench.write("scene.toml", COMPRESSED);
    bench.run("rf scene.toml -o one.igs.mha --frames 1").text();
    bench.write("short.csv", "frame,line,window,axial_um,lateral_um\n0,0,0,1,1\n");
    for (arguments, words) in [
        ("rf scene.toml -o rf.png", &["rf.png", ".mha, .nrrd or .npy"][..]),
        ("rf scene.toml -o rf.mha --sampling-mhz 9", &["`sampling_mhz`", "9"]),
        ("rf scene.toml -o rf.mha --bandwidth 3", &["`bandwidth`"]),
        (
            "rf scene.toml -o rf.mha --truth t.csv --window-mm 40",
            &["--window-mm 40", "15 mm"],
        ),
        ("rf scene.toml --bmode -o f.png", &["scene.toml"]),
        ("rf one.igs.mha --bmode -o f.png --frame 1", &["--frame 1 of 1 frames"]),
        ("rf one.igs.mha --bmode -o f.png --range-db 5", &["10 to 200 dB"]),
        ("rf one.igs.mha --bmode -o f.png --tgc-db-cm=-3", &["--tgc-db-cm"]),
        ("motion one.igs.mha -o u.csv", &["one frame", "two frames or more"]),
        ("motion nowhere.mha -o u.csv", &["nowhere.mha"]),
        ("motion -o u.csv", &["RF"]),
        (
            "rf scene.toml -o rf.mha --backend cpu --adapter none",
            &["--adapter none"],
        ),
        ("motion one.igs.mha -o u.txt", &[".csv"]),
    ] {
        bench.run(arguments).fails(2, words);
    }
    bench.run("rf scene.toml -o two.igs.mha --frames 2").text();
    bench
        .run("motion two.igs.mha -o u.csv --window-mm 0")
        .fails(2, &["--window-mm 0"]);
    bench
        .run("motion two.igs.mha -o u.csv --switch 1.1")
        .fails(2, &["--switch 1.1"]);
    bench
        .run("motion two.igs.mha --validate -o study")
        .fails(2, &["--truth"]);
    bench
        .run("motion two.igs.mha -o u.csv --truth short.csv")
        .fails(2, &["short.csv", "rows are missing"]);
    assert!(!bench.path("u.csv").exists() && !bench.path("rf.mha").exists());
}

/// The case that comes with the program names tables of a measurement that is made first.
#[test]
fn the_example_of_an_identification_asks_for_its_measurement() {
    let bench = Bench::new();
    let text = bench.run("identify --example").text().to_owned();
    assert_eq!(text, insonify_study::identification::EXAMPLE);
    bench.write("case.toml", &text);
    bench
        .run("identify case.toml -o out")
        .fails(2, &["steps.csv", "cannot be read"]);
}
