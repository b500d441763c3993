//! `insonify register`, `texture`, `score` and `exercise`: files, figures and bad input.

use std::fmt::Write;
use std::path::Path;

use image::GrayImage;

use crate::support::Bench;

/// A coarse liver biopsy with a target.
fn biopsy() -> String {
    let (_, text) = insonify::SCENARIOS
        .iter()
        .find(|(name, _)| *name == "liver-biopsy")
        .unwrap();
    let text = text
        .replace("nodes = 3300", "nodes = 400")
        .replace("dt_ms = 1.0", "dt_ms = 20.0");
    text + "\n[[plan.target]]\nname = \"lesion\"\nat_mm = [-14.5, 1.1, 17.6]\nradius_mm = 5.0\n"
}

#[test]
fn an_insertion_is_scored_and_groups_are_compared() {
    let bench = Bench::new();
    bench.write("biopsy.toml", &biopsy());
    bench.run("insert biopsy.toml -o run --images").text();
    let json = bench.run("score run -o score.html --json").json();
    for at in 1..=10 {
        assert!(
            json[format!("m{at}")].is_number() && json["at_rest"][format!("m{at}")].is_number(),
            "{json}"
        );
    }
    assert_eq!(
        (json["units"]["m8"].as_str(), json["withdrawn"].as_bool()),
        (Some("%"), Some(true))
    );
    assert!(json["at_rest"]["m10"].as_f64().unwrap() < 0.5, "{json}");
    let page = bench.text("score.html");
    assert!(page.contains("closest approach") && page.contains("Path in the x-z plane"));
    let summary: serde_json::Value = bench.read("run/summary.json");
    let nearest = summary["targets"][0]["nearest_tip_mm"].as_f64().unwrap();
    assert!(
        nearest > json["at_rest"]["m10"].as_f64().unwrap(),
        "the tissue yields: {nearest}"
    );
    let other = bench.run("insert biopsy.toml --hand wrong-angle --hand-seed 2 -o wrong");
    assert!(other.text().is_empty());
    let wrong = bench.run("score wrong --json").json();
    assert!(wrong["m1"].as_f64() > json["m1"].as_f64(), "{wrong}");

    let mut sessions = "group,person,session,m1,m2,m3,m4,m5,m6,m7,m8,m9,m10\n".to_owned();
    for (at, group) in ["a", "a", "a", "a", "b", "b", "b", "b"].iter().enumerate() {
        let shift = if *group == "a" { 0.0 } else { 10.0 };
        let values: Vec<String> = (0..10)
            .map(|metric| (shift + at as f64 + metric as f64).to_string())
            .collect();
        let _ = writeln!(sessions, "{group},{group}{},{at},{}", at / 2, values.join(","));
    }
    bench.write("sessions.csv", &sessions);
    let json = bench.run("score --groups sessions.csv -o groups.html --json").json();
    assert_eq!(
        (
            json["groups"][0]["people"].as_u64(),
            json["pairs"].as_array().map(Vec::len)
        ),
        (Some(2), Some(10))
    );
    let pair = &json["pairs"][0];
    // Every value of one group below every value of the other: 2 of 70 arrangements.
    assert!(
        (pair["mann_whitney_p"].as_f64().unwrap() - 2.0 / 70.0).abs() < 1e-12,
        "{pair}"
    );
    assert!(pair["welch_p"].is_number() && pair["holm_p"].is_number() && pair["metric"] == "m1");
    assert!(bench.text("groups.html").contains("Distributions"));
}

#[test]
fn runs_without_a_target_or_columns_are_told() {
    let bench = Bench::new();
    bench.write("biopsy.toml", biopsy().split("\n[[plan.target]]").next().unwrap());
    bench.run("insert biopsy.toml -o run").text();
    bench.run("score run").fails(2, &["run has no target"]);
    bench.run("score none").fails(2, &["none"]);
    bench.write("old.csv", "time_s,inserted_mm\n0,1\n");
    bench.run("score old.csv").fails(2, &["line 1", "without `tip_x_mm`"]);
    bench
        .run("score run run -o x.html")
        .fails(2, &["a page of several runs"]);
    bench.run("insert biopsy.toml --hand novice -o x").fails(2, &["novice"]);
    bench.run("insert biopsy.toml --hand-seed 1 -o x").fails(2, &["--hand"]);
}

#[test]
fn tasks_are_made_and_studied() {
    let bench = Bench::new();
    bench.write("biopsy.toml", &biopsy());
    // The tasks name the texture from their own folder.
    std::fs::create_dir(bench.path("deep")).expect("a folder");
    let head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw\n\n";
    bench.write("deep/mine.nrrd", &(head.to_owned() + &"x".repeat(64)));
    let textured = "\n[[scene.texture]]\nname = \"mine\"\nfile = \"mine.nrrd\"\n[[scene.tissue]]\nname = \"liver\"\ntexture = \"mine\"\n";
    bench.write("deep/biopsy.toml", &(biopsy() + textured));
    let tasks = bench
        .run("exercise make deep/biopsy.toml --organ liver --tasks 2 --seed 3 -o tasks --json")
        .json();
    assert_eq!(tasks.as_array().map(Vec::len), Some(2));
    assert_eq!(
        bench
            .files("tasks")
            .iter()
            .filter(|name| name.starts_with("task-"))
            .count(),
        2
    );
    let run = bench.run("exercise study tasks/task-1.toml --people 2 -o study");
    assert!(run.text().contains("consultant - student"), "{run:?}");
    assert_eq!(bench.text("study/sessions.csv").lines().count(), 7);
    assert!(bench.text("study/index.html").contains("Simulated hands, not people"));
    bench
        .run("exercise make biopsy.toml --organ brain -o x")
        .fails(2, &["named \"brain\"", "expected one of", "liver"]);
    bench
        .run("exercise make biopsy.toml --organ liver --depth-mm 90,40 -o x")
        .fails(2, &["`depth_mm`", "two rising depths"]);
    bench.write(
        "named.toml",
        &biopsy()
            .replace("[scene]\nseed = 11\n", "")
            .replace("[scene.", "[other."),
    );
    bench
        .run("exercise make named.toml --organ liver -o x")
        .fails(2, &["named.toml"]);
    assert!(!bench.path("x").exists());
}

/// Surface points of a body of 120 x 90 x 200 mm with a bump, turned by a quarter about z and shifted, and its labels
/// as a MetaImage.
fn body(bench: &Bench) {
    let size = [70, 60, 110];
    let inside = |at: [f64; 3]| {
        let [x, y, z] = [at[0] - 70.0, at[1] - 60.0, at[2] - 110.0];
        (x / 55.0).powi(2)
            + (y / 40.0).powi(2)
            + (z / 90.0).powi(2)
            + 0.3 * (x / 55.0) * (y / 40.0)
            + 0.2 * x * z / 5000.0
            + 0.15
                * ((x / 14.0).sin() * (y / 12.0).cos()
                    + (z / 16.0).sin() * (x / 13.0 + 1.0).cos()
                    + (y / 11.0).sin() * (z / 15.0).cos())
            - 1.0
    };
    let mut voxels = Vec::new();
    for k in 0..size[2] {
        for j in 0..size[1] {
            for i in 0..size[0] {
                voxels.push(u8::from(inside([i, j, k].map(|n| 2.0 * f64::from(n))) < 0.0));
            }
        }
    }
    let header = format!(
        "ObjectType = Image\nNDims = 3\nDimSize = {} {} {}\nElementSpacing = 2 2 2\nOffset = 0 0 0\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
        size[0], size[1], size[2]
    );
    std::fs::write(bench.path("body.mha"), [header.as_bytes(), &voxels].concat()).unwrap();
    let mut text = "x_mm,y_mm,z_mm\n".to_owned();
    for at in 0..400 {
        let (around, up) = (f64::from(at) * 2.4, (f64::from(at) + 0.5) / 200.0 - 1.0);
        let ray = [
            around.cos() * (1.0 - up * up).sqrt(),
            around.sin() * (1.0 - up * up).sqrt(),
            up,
        ];
        let point = |r: f64| [70.0 + r * ray[0], 60.0 + r * ray[1], 110.0 + r * ray[2]];
        let (mut low, mut high) = (0.0, 300.0);
        for _ in 0..40 {
            let middle = (low + high) / 2.0;
            if inside(point(middle)) < 0.0 {
                low = middle
            } else {
                high = middle
            }
        }
        let [x, y, z] = point(low);
        let _ = writeln!(text, "{},{},{}", -y + 300.0, x - 20.0, z + 5.0);
    }
    bench.write("touched.csv", &text);
}

#[test]
fn anatomy_is_registered_and_a_scene_takes_the_registration() {
    let bench = Bench::new();
    body(&bench);
    let marks = "name,volume_x_mm,volume_y_mm,volume_z_mm,surface_x_mm,surface_y_mm,surface_z_mm\n\
        a,70,60,110,240,50,115\nb,110,60,110,240,90,115\nc,70,80,150,220,50,155\n";
    bench.write("marks.csv", marks);
    let run = "register body.mha --no-complete --surface touched.csv --landmarks marks.csv";
    let fitted = bench.run(&format!("{run} --fit fit.toml --page fit.html -o fitted.nrrd --json"));
    let json = fitted.json();
    assert!(
        // A third of a voxel.
        json["rigid"]["rms_mm"].as_f64().unwrap() < 0.6 && json["quadratic"]["rms_mm"].as_f64().unwrap() < 0.6,
        "{json}"
    );
    assert!(
        (json["rigid"]["matrix"][0][1].as_f64().unwrap() - 1.0).abs() < 0.01,
        "{json}"
    );
    assert!(
        json["quadratic"]["jacobian_min"].as_f64().unwrap() > 0.8
            && json["quadratic"]["coefficients"][2].as_array().unwrap().len() == 10
    );
    assert!(
        json["landmarks_mm"]
            .as_array()
            .unwrap()
            .iter()
            .all(|it| it["quadratic_mm"].as_f64().unwrap() < 1.0),
        "{json}"
    );
    let targets = json["targets_mm"].as_array().expect("targets");
    let near = |target: &serde_json::Value| {
        target["expected_mm"]
            .as_f64()
            .is_some_and(|mm| (0.01..2.0).contains(&mm))
    };
    assert!(!targets.is_empty() && targets.iter().all(near), "{json}");
    assert!(bench.text("fit.html").contains("<circle"));
    // Its voxels were cubes before.
    assert!(!fitted.stderr.contains("cubes of"), "{fitted:?}");
    let info = bench.run("info fitted.nrrd --json").json();
    assert!(info.to_string().contains("\"value\":1"), "{info}");
    let scene = |more: &str| {
        format!(
            "version = 1\n[volume]\nfile = \"body.mha\"\nunlabelled = \"air\"\n{more}\n[image]\nwidth = 64\nheight = 64\n[[tissue]]\nname = \"mine\"\nlike = \"liver\"\nlabels = [1]\n"
        )
    };
    bench.write("scene.toml", &scene("registration = \"fit.toml\""));
    let rendered = bench.run_without_gpu("render scene.toml -o frame.png");
    rendered.text();
    assert!(bench.path("frame.png").exists(), "{rendered:?}");
    bench.write("scene.toml", &scene("registration = \"none.toml\""));
    bench
        .run_without_gpu("render scene.toml -o x.png")
        .fails(2, &["none.toml"]);
    bench
        .run("register body.mha --no-complete --surface body.txt")
        .fails(2, &["body.txt"]);
    let rough = bench.text("touched.csv");
    let rough = rough.lines().enumerate().map(|(row, line)| {
        let (rest, z) = line.rsplit_once(',').expect("columns");
        z.parse::<f64>()
            .map_or(line.to_owned(), |z| format!("{rest},{}", z + 40.0 * (row as f64).sin()))
    });
    bench.write("rough.csv", &rough.collect::<Vec<_>>().join("\n"));
    let run = "register body.mha --no-complete --surface rough.csv --fit rough.toml";
    bench
        .run(run)
        .fails(2, &["remains", "mm (RMS) from the skin", "--force"]);
    assert!(!bench.path("rough.toml").exists());
    let forced = bench.run(&format!("{run} --force"));
    assert!(forced.stderr.contains("warning: the surface remains"), "{forced:?}");
    assert!(bench.path("rough.toml").exists());
    bench.write("few.csv", "x_mm,y_mm,z_mm\n0,0,0\n");
    bench
        .run("register body.mha --no-complete --surface few.csv")
        .fails(2, &["1 surface points; expected at least 30"]);
    bench.write("metres.csv", "x_mm,y_mm,z_mm\n0,0,0\n0.33,0,0\n");
    bench
        .run("register body.mha --no-complete --surface metres.csv")
        .fails(2, &["in metres it is 330.0000 mm long: write it in mm"]);
    bench.write("solid.stl", "no triangles");
    bench
        .run("register body.mha --no-complete --surface solid.stl")
        .fails(2, &["solid.stl"]);
    bench.write(
        "solid.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float a\nend_header\n1\n",
    );
    bench
        .run("register body.mha --no-complete --surface solid.ply")
        .fails(2, &["x, y and z"]);
}

/// The points of the body as an OBJ file, turned half about its long axis, in some unit.
fn turned(bench: &Bench, file: &str, title: &str, unit: f64) {
    let touched = bench.text("touched.csv");
    let mut text = title.to_owned();
    for row in touched.lines().skip(1) {
        let [x, y, z]: [f64; 3] = row
            .split(',')
            .map(|x| x.parse().unwrap())
            .collect::<Vec<_>>()
            .try_into()
            .unwrap();
        let _ = writeln!(
            text,
            "v {} {} {}",
            unit * -(y + 20.0),
            unit * -(300.0 - x),
            unit * (z - 5.0)
        );
    }
    bench.write(file, &text);
}

#[test]
fn axes_and_units_of_surfaces_are_followed_or_questioned() {
    let bench = Bench::new();
    body(&bench);
    turned(&bench, "plain.obj", "# by hand\n", 1.0);
    turned(&bench, "ras.obj", "# 3D Slicer output. SPACE=RAS\n", 1.0);
    turned(&bench, "metres.obj", "# SPACE=RAS\n", 1e-3);
    let run = |rest: &str| bench.run(&format!("register body.mha --no-complete --surface {rest}"));
    let doubt = "turns the surface by 180 degrees about the body's long axis, taken as LPS: if its axes are RAS, give --world ras";
    let plain = run("plain.obj");
    assert!(plain.stderr.contains(doubt), "{plain:?}");
    let stated = run("plain.obj --world ras --json");
    let followed = run("ras.obj --json");
    assert_eq!(stated.json(), followed.json());
    assert!(
        followed.stderr.contains("ras.obj states its axes as RAS"),
        "{followed:?}"
    );
    for quiet in [&stated, &followed] {
        assert!(
            !quiet.stderr.contains("warning: the fit turns") && !quiet.stderr.contains("long axis"),
            "{quiet:?}"
        );
    }
    let contradicted = run("ras.obj --world lps");
    assert!(
        contradicted
            .stderr
            .contains("states its axes as RAS, and --world is LPS, which is taken"),
        "{contradicted:?}"
    );
    run("metres.obj").fails(2, &["metres.obj", "in metres it is", "`--unit m`"]);
    // In a wrong unit nothing else fits either: one cause, no advice on points.
    turned(&bench, "cm.obj", "# SPACE=RAS\n", 0.1);
    let cm = run("cm.obj");
    cm.fails(2, &["in centimetres it would be", "state its unit with --unit cm"]);
    assert!(!cm.stderr.contains("touch") && !cm.stderr.contains("warning"), "{cm:?}");
    run("cm.obj --unit cm").text();
    let metres = run("metres.obj --unit m --json").json();
    let (metres, millimetres) = (
        metres["quadratic"]["rms_mm"].as_f64(),
        followed.json()["quadratic"]["rms_mm"].as_f64(),
    );
    assert!(
        (metres.unwrap() - millimetres.unwrap()).abs() < 1e-3,
        "{metres:?} {millimetres:?}"
    );
    // Points of 3D Slicer say their axes.
    let mut points =
        "# Markups fiducial file version = 5.0\n# CoordinateSystem = RAS\n# columns = id,x,y,z\n".to_owned();
    for (number, row) in bench.text("ras.obj").lines().skip(1).enumerate() {
        let _ = writeln!(points, "{number},{}", row[2..].replace(' ', ","));
    }
    bench.write("points.fcsv", &points);
    run("points.fcsv --unit m").fails(2, &["--unit without a surface of triangles"]);
    assert_eq!(run("points.fcsv --json").json(), followed.json());
    run("few.txt").fails(2, &[".fcsv, .mrk.json or .stl"]);
}

#[test]
fn a_texture_is_made_from_a_picture_and_rendered() {
    let bench = Bench::new();
    let mut state = 1_u32;
    let picture = GrayImage::from_fn(160, 140, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        image::Luma([90 + (state >> 26) as u8])
    });
    picture.save(bench.path("liver.png")).unwrap();
    let run = "texture liver.png --region 8,8,140,120 --mm-per-pixel 0.3 --content keep --size 32 -o liver.nrrd";
    let json = bench.run(&format!("{run} --page liver.html --json")).json();
    assert_eq!(
        (json["size"].as_u64(), json["voxel_mm"].as_f64()),
        (Some(32), Some(0.3))
    );
    let bytes = std::fs::read(bench.path("liver.nrrd")).unwrap();
    assert!(bytes.len() > 4 * 32 * 32 * 32);
    bench.run(&format!("{run} --force")).text();
    assert_eq!(
        bytes,
        std::fs::read(bench.path("liver.nrrd")).unwrap(),
        "the same bytes again"
    );
    assert!(bench.text("liver.html").contains("Power spectra"));
    let scene = "version = 1\n[volume]\nphantom = \"two-layer\"\n[image]\nwidth = 64\nheight = 64\n[[texture]]\nname = \"mine\"\nfile = \"liver.nrrd\"\nseam = \"periodic\"\n";
    bench.write("scene.toml", scene);
    bench.run_without_gpu("render scene.toml -o frame.png").text();
    bench
        .run("texture liver.png --region 0,0,400,20 --mm-per-pixel 0.3 -o x.nrrd")
        .fails(2, &["within the image of 160 x 140"]);
    bench
        .run("texture liver.png --region 0,0,100,100 -o x.nrrd")
        .fails(2, &["--mm-per-pixel"]);
    bench
        .run(&format!("{} --force", run.replace("32", "33")))
        .fails(2, &["size 33"]);
    bench
        .run(&format!("{run} --range-db 1 --force"))
        .fails(2, &["10 to 200"]);
    assert!(!Path::new(&bench.path("x.nrrd")).exists());
}
