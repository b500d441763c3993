//! Runs of many frames: parameters by frame, manifests, and runs that are cut off.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{Bench, SCENE};

/// Ranges of each kind, of probe, effects and tissues.
const RANGES: &str = r#"
[randomise]
seed = 7
gain_db = { uniform = [-6, 6] }
tone.dynamic_range_db = { integer = [45, 65] }
depth_mm = { integer = [40, 60] }
frequency_mhz = { choice = [4.0, 7.5] }
effects.speckle.axial_mm = { log_uniform = [0.3, 0.8] }
phantom_top.attenuation_db_cm_mhz = { uniform = [0.3, 1.5] }
tilt_deg = { uniform = [-10, 10] }
"#;

/// The scene with values of parameters written in.
fn stated(scene: &str, parameters: &BTreeMap<String, Value>) -> String {
    let mut table: toml::Table = scene.parse().expect("a scene");
    table.remove("randomise");
    for (path, value) in parameters {
        let value = toml::Value::try_from(value).expect("a value");
        let mut keys: Vec<&str> = path.split('.').collect();
        let last = keys.pop().expect("a key");
        let inner = if let ["tissue", name] = keys[..] {
            let list = table.entry("tissue").or_insert(toml::Value::Array(Vec::new()));
            let list = list.as_array_mut().expect("a list");
            let of_name = |tissue: &toml::Value| tissue["name"].as_str() == Some(name);
            let index = list.iter().position(of_name).unwrap_or_else(|| {
                list.push(toml::Table::from_iter([("name".to_owned(), name.into())]).into());
                list.len() - 1
            });
            list[index].as_table_mut()
        } else {
            fn deeper<'a>(table: &'a mut toml::Table, key: &&str) -> Option<&'a mut toml::Table> {
                table.entry(*key).or_insert(toml::Table::new().into()).as_table_mut()
            }
            keys.iter().try_fold(&mut table, deeper)
        };
        inner.expect("a table").insert(last.to_owned(), value);
    }
    table.to_string()
}

fn parameters_of(bench: &Bench, frame: &str) -> BTreeMap<String, Value> {
    let sidecar: Value = bench.read(&format!("{frame}.json"));
    let parameters = sidecar["frame_parameters"].as_object().expect("parameters");
    parameters.clone().into_iter().collect()
}

/// Checks that each frame of a folder is that of a scene with its values.
fn same_as_single_scenes(bench: &Bench, scene: &str, folder: &str, frames: usize) {
    for frame in 0..frames {
        let name = format!("{folder}/frame_{frame:04}");
        bench.write("single.toml", &stated(scene, &parameters_of(bench, &name)));
        bench
            .run("render single.toml --backend cpu --layers depth -o single/")
            .text();
        for suffix in ["", "_depth"] {
            let [one, many] = ["single/frame_0000".to_owned(), name.clone()]
                .map(|path| fs::read(bench.path(&format!("{path}{suffix}.png"))).expect("a picture"));
            assert!(one == many, "frame {frame}{suffix} of {folder}");
        }
    }
}

#[test]
fn frames_with_drawn_parameters_are_those_of_scenes_that_state_them() {
    let bench = Bench::new();
    let scene = SCENE.to_owned() + RANGES;
    bench.write("drawn.toml", &scene);
    let render = "render drawn.toml --backend cpu --layers depth --sidecar --frames";
    let run = bench.run(&format!("{render} 10 -o drawn"));
    assert!(
        run.text().is_empty() && !run.stderr.contains("nothing moves"),
        "{run:?}"
    );
    same_as_single_scenes(&bench, &scene, "drawn", 10);
    let drawn: Vec<_> = (0..10)
        .map(|frame| parameters_of(&bench, &format!("drawn/frame_{frame:04}")))
        .collect();
    assert_eq!(drawn[0].len(), 8, "{:?}", drawn[0]);
    for (number, parameters) in drawn.iter().enumerate() {
        let value = |path: &str| parameters[path].as_f64().expect(path);
        let within = |path: &str, low: f64, high: f64| assert!((low..=high).contains(&value(path)), "{path}");
        within("effects.tone.gain_db", -6.0, 6.0);
        within("effects.speckle.axial_mm", 0.3, 0.8);
        within("tissue.phantom_top.attenuation_db_cm_mhz", 0.3, 1.5);
        within("pose.tilt_deg", -10.0, 10.0);
        assert!(parameters["probe.depth_mm"].is_i64() && parameters["effects.tone.dynamic_range_db"].is_i64());
        assert!([4.0, 7.5].contains(&value("probe.frequency_mhz")));
        // Each has its own.
        assert!(drawn[..number].iter().all(|other| other["seed"] != parameters["seed"]));
    }
    // On a GPU, too.
    let gpu = "--backend gpu --sidecar";
    bench.run(&format!("render drawn.toml {gpu} --frames 2 -o gpu")).text();
    bench.write("single.toml", &stated(&scene, &parameters_of(&bench, "gpu/frame_0001")));
    bench.run(&format!("render single.toml {gpu} -o gpu_single/")).text();
    let [one, many] = ["gpu_single/frame_0000", "gpu/frame_0001"]
        .map(|path| fs::read(bench.path(&format!("{path}.png"))).expect("a picture"));
    assert!(one == many, "frame 1 on a GPU");
    // A frame depends on no other: not on their number, nor on the threads.
    let mut alone = bench.command(&format!("{render} 3 -o three"));
    assert!(
        alone
            .env("RAYON_NUM_THREADS", "1")
            .output()
            .expect("it runs")
            .status
            .success()
    );
    for frame in 0..3 {
        for ending in [".png", "_depth.png"] {
            let [ten, three] = ["drawn", "three"]
                .map(|folder| fs::read(bench.path(&format!("{folder}/frame_{frame:04}{ending}"))).expect("a picture"));
            assert!(ten == three, "frame {frame}{ending}");
        }
    }
}

#[test]
fn columns_beside_the_poses_are_parameters_of_their_frames() {
    let bench = Bench::new();
    let head = "time_s,x_mm,y_mm,z_mm,dx,dy,dz,gain_db,probe.depth_mm,curve,phantom_top.echogenicity_db,seed\n";
    let rows = [
        "0,0,0,-31,0,0,1,-3,40,linear,2.5,5",
        "1,2,0,-31,0,0,1,6.5,60,s,-4,6",
        "2,4,0,-31,0,0,1,0,50.5,linear,0,5",
    ];
    bench.write("poses.csv", &(head.to_owned() + &rows.join("\n")));
    let scene = SCENE.to_owned() + "[motion]\ncsv = \"poses.csv\"\n";
    // What the path is to show is told in the manifest, and has to be there.
    bench.write("rows.toml", &format!("{scene}[pose]\ntarget = \"phantom_top\"\n"));
    let run = bench.run("render rows.toml --backend cpu --layers depth --sidecar -o rows");
    run.text();
    assert!(run.stderr.contains("solid textures are made anew"), "{run:?}");
    assert!(bench.text("rows/manifest.csv").contains(",phantom_top,"));
    bench.write("other.toml", &format!("{scene}[pose]\ntarget = \"liver\"\n"));
    bench.run("render other.toml -o x").fails(2, &["pose.target", "liver"]);
    // One of these seeds in all rows makes them once.
    let seeds = rows.map(|row| row.rsplit_once(',').expect("a seed").0.to_owned() + ",4294967301");
    bench.write("poses.csv", &(head.to_owned() + &seeds.join("\n")));
    let run = bench.run("render rows.toml --backend cpu -o once/");
    assert!(run.status == Some(0) && !run.stderr.contains("made anew"), "{run:?}");
    bench.write("poses.csv", &(head.to_owned() + &rows.join("\n")));
    bench.run("render rows.toml --gain-db 30 -o x").fails(
        2,
        &[
            "`effects.tone.gain_db` differs from frame to frame",
            "expected one of the two",
        ],
    );
    let first = parameters_of(&bench, "rows/frame_0000");
    let expected = [
        ("effects.tone.curve", Value::from("linear")),
        ("effects.tone.gain_db", (-3).into()),
        ("probe.depth_mm", 40.into()),
        ("seed", 5.into()),
        ("tissue.phantom_top.echogenicity_db", 2.5.into()),
    ];
    assert_eq!(first, expected.map(|(path, value)| (path.to_owned(), value)).into());
    for (frame, row) in rows.iter().enumerate() {
        let pose: Vec<&str> = row.split(',').take(7).collect();
        bench.write(
            "pose.csv",
            &format!("time_s,x_mm,y_mm,z_mm,dx,dy,dz\n{}\n", pose.join(",")),
        );
        let name = format!("rows/frame_{frame:04}");
        let single = stated(&scene.replace("poses.csv", "pose.csv"), &parameters_of(&bench, &name));
        bench.write("single.toml", &single);
        bench.run("render single.toml --backend cpu -o single/").text();
        let [one, many] =
            ["single/frame_0000", &name].map(|path| fs::read(bench.path(&format!("{path}.png"))).expect("a picture"));
        assert!(one == many, "{row}");
    }
    bench
        .run("render rows.toml --frames 5 -o x")
        .fails(2, &["3 rows of parameters for 5 frames"]);
    for (column, cell, words) in [
        (
            "gian_db",
            "3",
            "line 1: column `gian_db` is unknown; did you mean `gain_db`?",
        ),
        ("gain_db", "loud", "line 3, column `gain_db`: "),
        ("gain_db", "", "line 3, column `gain_db`: found ``; expected a value"),
        ("probe.depth_mm", "-4", "line 3, column `probe.depth_mm`: "),
        ("mucsle.echogenicity_db", "1", "did you mean `muscle.echogenicity_db`?"),
        (
            "echogenicity_db",
            "1",
            "expected the tissue before it, as in `liver.echogenicity_db`",
        ),
        ("image.width", "64", "column `image.width` is unknown"),
        ("tilt_deg", "3", "`pose.tilt_deg` of a probe that moves"),
        ("depth_mm,probe.depth_mm", "50,50", "`probe.depth_mm` twice"),
    ] {
        let usual = if column == "gain_db" || column.contains("depth") {
            "50"
        } else {
            "1"
        };
        let usual = if column.contains(',') { "50,50" } else { usual };
        let table =
            format!("time_s,x_mm,y_mm,z_mm,dx,dy,dz,{column}\n0,0,0,-31,0,0,1,{usual}\n1,0,0,-31,0,0,1,{cell}\n");
        bench.write("poses.csv", &table);
        bench.run("render rows.toml -o x").fails(2, &["poses.csv", words]);
    }
    assert!(!bench.path("x").exists());
}

#[test]
fn wrong_ranges_are_refused_where_they_stand() {
    let bench = Bench::new();
    for (range, words) in [
        ("gain_db = [-6, 6]", "found a list, expected a table"),
        ("gain_db = 3", "randomise.gain_db"),
        ("gain_db = { unifrom = [0, 1] }", "did you mean `uniform`?"),
        ("gain_db = { uniform = [6, -6] }", "the lower first"),
        ("gain_db = { log_uniform = [0, 1] }", "above 0"),
        ("gain_db = { choice = [] }", "at least one"),
        ("gain_db = { uniform = [0, 1], choice = [3] }", "one of uniform"),
        ("gain_db = { uniform = [0, 1e9] }", "gain_db"),
        ("probe.depth_mm = { uniform = [-5, 60] }", "depth_mm"),
        (
            "lines = { uniform = [30, 40] }",
            "randomise.lines: found floating point `30.0`, expected a whole number",
        ),
        ("gian_db = { uniform = [0, 1] }", "did you mean `gain_db`?"),
        (
            "livre.echogenicity_db = { uniform = [0, 1] }",
            "did you mean `liver.echogenicity_db`?",
        ),
        ("volume.resolution_mm = { uniform = [2, 3] }", "no parameter of a frame"),
        ("seed = { integer = [0, 9] }", "the seed of the draws"),
        ("gain_db = { uniform = [0, 1] }\n[quality]\nframe_ms = 20", "[quality]"),
        (
            "tone.gain_db = { uniform = [0, 1] }\n[effects]\ntone = false",
            "leaves out",
        ),
    ] {
        bench.write("wrong.toml", &format!("{SCENE}[randomise]\n{range}\n"));
        bench
            .run("render wrong.toml --frames 3 -o x")
            .fails(2, &["wrong.toml", words]);
    }
    assert!(!bench.path("x").exists());
    bench.write(
        "drawn.toml",
        &format!("{SCENE}[randomise]\ngain_db = {{ uniform = [0, 1] }}\n"),
    );
    bench.run("rf drawn.toml -o x.mha").fails(2, &["parameters by frame"]);
}

/// All files below a folder, with their contents.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).expect("a folder").flatten();
    let file = |entry: fs::DirEntry| {
        let bytes = fs::read(entry.path()).expect("a file");
        (entry.file_name().to_string_lossy().into_owned(), bytes)
    };
    entries.map(file).collect()
}

/// Pictures in the hidden folder of a run; a folder that is renamed meanwhile may be listed twice.
#[cfg(unix)]
fn hidden_pictures(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let hidden = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(".insonify-"));
    let pictures = hidden.map(|entry| {
        let files = fs::read_dir(entry.path()).into_iter().flatten().flatten();
        files
            .filter(|file| file.file_name().to_string_lossy().ends_with(".png"))
            .count()
    });
    pictures.max().unwrap_or(0)
}

/// Starts a run and sends it a signal once it has made some pictures.
#[cfg(unix)]
fn cut_off(bench: &Bench, arguments: &str, folder: &str, signal: &str) {
    // Before it starts, as it renames the folder.
    let folder = bench.path(folder);
    let before = hidden_pictures(&folder);
    let mut child = bench.command(arguments).spawn().expect("it starts");
    while hidden_pictures(&folder) < before + 8 {
        assert!(
            child.try_wait().expect("a child").is_none(),
            "it ended before it was cut off"
        );
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let sent = std::process::Command::new("kill")
        .args(["-s", signal, &child.id().to_string()])
        .status();
    assert!(sent.expect("kill runs").success());
    child.wait().expect("it ends");
}

#[test]
#[cfg(unix)]
fn a_run_that_is_cut_off_is_resumed_to_the_same_bytes() {
    let bench = Bench::new();
    let scene = SCENE.replace("width = 48\nheight = 40", "width = 320\nheight = 240") + RANGES;
    bench.write("drawn.toml", &scene);
    let render = "render drawn.toml --backend cpu --layers depth --sidecar --frames 60";
    bench.run(&format!("{render} -o whole")).text();
    let whole = contents(&bench.path("whole"));
    assert_eq!(whole.len(), 60 * 3 + 4);
    cut_off(&bench, &format!("{render} -o cut --resume"), "cut", "KILL");
    assert_eq!(
        bench.files("cut").iter().filter(|name| !name.starts_with('.')).count(),
        0
    );
    // Asked to end, a run that can be resumed leaves what is whole, too.
    cut_off(&bench, &format!("{render} -o cut --resume"), "cut", "INT");
    let kept = hidden_pictures(&bench.path("cut"));
    assert!(kept >= 16, "{kept}");
    for (other, words) in [
        (
            format!("{render} --overview -o cut --resume"),
            "options.overview false, not true",
        ),
        (
            render.replace("--frames 60", "--frames 61") + " -o cut --resume",
            "options.frames 60, not 61",
        ),
    ] {
        bench.run(&other).fails(2, &["cut: --resume: the run there has", words]);
    }
    bench.write("drawn.toml", &scene.replace("seed = 7", "seed = 8"));
    bench.run(&format!("{render} -o cut --resume")).fails(
        2,
        &[
            "made_by.inputs[",
            "drawn.toml\"].blake3",
            "scene.randomise.seed 7, not 8",
        ],
    );
    bench.write("drawn.toml", &scene);
    assert_eq!(hidden_pictures(&bench.path("cut")), kept);
    let run = bench.run(&format!("{render} -o cut --resume --json"));
    let made = run.json()["frames"].as_array().expect("frames").len();
    assert!(
        made < 60 && run.stderr.contains("of 60 frames are whole and stay"),
        "{run:?}"
    );
    assert!(contents(&bench.path("cut")) == whole, "{:?}", bench.files("cut"));
    // A whole run is left as it is, and another one refused.
    let run = bench.run(&format!("{render} -o cut --resume"));
    assert!(
        run.text().is_empty() && run.stderr.contains("all 60 frames are in cut"),
        "{run:?}"
    );
    bench
        .run(
            &format!("{render} --seed-free -o cut --resume")
                .replace("--seed-free", "--overlay")
                .replace("--layers depth", ""),
        )
        .fails(2, &["the run there has"]);
    assert!(contents(&bench.path("cut")) == whole);
    bench
        .run(&format!("{render} -o one.mha --resume"))
        .fails(2, &["one.mha is one file"]);
}

#[test]
fn a_manifest_says_what_each_frame_shows() {
    let bench = Bench::new();
    bench.write("drawn.toml", &(SCENE.to_owned() + RANGES));
    let run = "render drawn.toml --backend cpu --layers depth,sector --sidecar --frames 3 -o drawn";
    bench.run(run).text();
    let text = bench.text("drawn/manifest.jsonl");
    let lines: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    let made_by = &lines[0]["made_by"];
    assert_eq!((lines.len(), &lines[0]["frames"]), (4, &3.into()));
    assert_eq!(
        (made_by["version"].as_str(), made_by["backend"].as_str()),
        (Some(env!("CARGO_PKG_VERSION")), Some("cpu"))
    );
    let input = &made_by["inputs"][0];
    let hash = blake3::hash(&fs::read(bench.path("drawn.toml")).expect("a scene")).to_hex();
    assert_eq!(
        (input["path"].as_str(), input["blake3"].as_str()),
        (Some("drawn.toml"), Some(hash.as_str()))
    );
    let mut table = csv::Reader::from_path(bench.path("drawn/manifest.csv")).expect("a table");
    let rows: Vec<BTreeMap<String, String>> = table.deserialize().map(|row| row.expect("a row")).collect();
    assert_eq!(rows.len(), 3);
    for (frame, (line, row)) in lines[1..].iter().zip(&rows).enumerate() {
        let name = format!("frame_{frame:04}");
        let sidecar: Value = bench.read(&format!("drawn/{name}.json"));
        assert_eq!(sidecar["made_by"], *made_by);
        for key in [
            "frame",
            "time_s",
            "seed",
            "probe_to_world",
            "frame_parameters",
            "warnings",
        ] {
            assert_eq!(line[key], sidecar[key], "{key}");
        }
        assert_eq!(
            (row["frame"].as_str(), row["image"].clone()),
            (frame.to_string().as_str(), name.clone() + ".png")
        );
        assert_eq!(
            (&row["depth"], &row["sidecar"]),
            (&(name.clone() + "_depth.png"), &(name + ".json"))
        );
        let gain = line["frame_parameters"]["effects.tone.gain_db"].to_string();
        assert_eq!(row["effects.tone.gain_db"], gain);
        assert_eq!(row["m03"].parse().ok(), line["probe_to_world"][0][3].as_f64());
    }
    // Label files and tables are inputs, too.
    bench.run("render --labels none.nrrd -o x").fails(2, &["none.nrrd"]);
}

/// Two kidneys of a segmentation that labels them in one piece.
fn kidneys(bench: &Bench) {
    let size = [90, 40, 50];
    let mut voxels = Vec::new();
    for k in 0..size[2] {
        for j in 0..size[1] {
            for i in 0..size[0] {
                let inside = |centre: f64| {
                    let [x, y, z] = [f64::from(i) - centre, f64::from(j) - 20.0, f64::from(k) - 25.0];
                    (x / 14.0).powi(2) + (y / 14.0).powi(2) + (z / 20.0).powi(2) < 1.0
                };
                voxels.push(if inside(22.0) { 2_u8 } else { 3 * u8::from(inside(66.0)) });
            }
        }
    }
    let head = format!(
        "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {} {} {}\n\
         space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (-90,-40,-50)\nencoding: raw\n\n",
        size[0], size[1], size[2]
    );
    fs::write(bench.path("kidneys.nrrd"), [head.as_bytes(), &voxels].concat()).expect("written");
    bench.write("kidneys.csv", "value,name\n2,kidney_right\n3,kidney_left\n");
}

#[test]
fn the_target_of_a_frame_is_the_one_drawn_for_it() {
    let bench = Bench::new();
    kidneys(&bench);
    bench.write(
        "drawn.toml",
        "[volume]\nfile = \"kidneys.nrrd\"\n[image]\nwidth = 40\nheight = 30\n\
         [probe]\nkind = \"linear\"\nlines = 16\nsamples = 32\n[pose]\ntarget = \"kidney_right\"\n\
         [randomise]\nseed = 7\npose.target = { choice = [\"kidney_left\", \"kidney_right\"] }\n",
    );
    bench.run("render drawn.toml --backend cpu --frames 6 -o drawn").text();
    let lines = bench.text("drawn/manifest.jsonl");
    let mut table = csv::Reader::from_path(bench.path("drawn/manifest.csv")).expect("a table");
    let rows = table.deserialize().map(|row| row.expect("a row"));
    let mut targets = BTreeSet::new();
    for (line, row) in lines.lines().skip(1).zip(rows) {
        let (line, row): (Value, BTreeMap<String, String>) = (serde_json::from_str(line).expect("JSON"), row);
        assert_eq!(line["target"], line["frame_parameters"]["pose.target"]);
        assert_eq!(line["target"], row["target"].as_str());
        let share = line["target_share"].as_f64().expect("a share");
        assert!(share > 0.02 && share < 0.9, "{line}");
        assert_eq!(row["target_share"], share.to_string());
        // The right kidney lies at x < 0 (LPS).
        let is_right = line["probe_to_world"][0][3].as_f64().expect("x") < 0.0;
        assert_eq!(is_right, line["target"] == "kidney_right", "{line}");
        targets.insert(row["target"].clone());
    }
    assert_eq!(targets.len(), 2, "{lines}");
}

#[test]
fn what_is_drawn_into_an_organ_is_part_of_it() {
    let bench = Bench::new();
    kidneys(&bench);
    let mut scene = "[volume]\nfile = \"kidneys.nrrd\"\n[image]\nwidth = 120\nheight = 90\n".to_owned();
    let _ = writeln!(
        scene,
        "[probe]\nkind = \"linear\"\nwidth_mm = 60\ndepth_mm = 120\nlines = 64\nsamples = 128"
    );
    for (organ, value, side) in [("kidney_right", 2, "right"), ("kidney_left", 3, "left")] {
        bench.write(
            "scene.toml",
            &(scene.clone() + &format!("[pose]\ntarget = \"{organ}\"\n")),
        );
        bench
            .run(
                "render scene.toml --backend cpu --layers label-value,label-index,organ --sidecar -o frame.png --force",
            )
            .text();
        let sidecar: Value = bench.read("frame.json");
        let labels = sidecar["parameters"]["labels"].as_array().expect("labels").clone();
        let layer = |name: &str| crate::support::grey16(&bench.path(&format!("frame_{name}.png"))).1;
        let [values, indices, organs] = ["label-value", "label-index", "organ"].map(layer);
        let mut drawn = 0;
        for ((shown, index), of_file) in values.iter().zip(&indices).zip(&organs) {
            let label = &labels[usize::from(*index)];
            assert_eq!(label["value"], *shown, "{label}");
            let part_of = label["part_of"].as_u64();
            assert_eq!(part_of.unwrap_or(u64::from(*shown)), u64::from(*of_file), "{label}");
            if label["name"] == "renal_sinus" {
                assert_eq!((part_of, label["side"].as_str()), (Some(value), Some(side)));
                drawn += 1;
            }
        }
        assert!(drawn > 50, "{drawn} pixels of a sinus");
        assert!(organs.contains(&0), "the completed body is unlabelled in the file");
        // The same but for pixels between voxels, whose labels vote.
        let undivided = scene.replace("[image]", "structures = false\n[image]");
        let pose = &sidecar["probe_to_world"];
        bench.write("scene.toml", &(undivided + &format!("[pose]\nmatrix = {pose}\n")));
        bench
            .run("render scene.toml --backend cpu --layers organ -o whole.png --force")
            .text();
        let whole = crate::support::grey16(&bench.path("whole_organ.png")).1;
        let differing = whole.iter().zip(&organs).filter(|(a, b)| a != b).count();
        assert!(
            differing * 500 < organs.len(),
            "{organ}: {differing} of {}",
            organs.len()
        );
    }
    // On both backends.
    bench
        .run("render scene.toml --backend gpu --layers organ -o gpu.png")
        .text();
    let [cpu, gpu] = ["whole_organ.png", "gpu_organ.png"].map(|name| crate::support::grey16(&bench.path(name)).1);
    let differing = cpu.iter().zip(&gpu).filter(|(cpu, gpu)| cpu != gpu).count();
    assert!(differing * 500 < cpu.len(), "{differing} of {}", cpu.len());
}
