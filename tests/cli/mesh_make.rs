//! `insonify mesh make`.

use insonify_mesh::file::{ReadOptions, read_mesh};
use insonify_mesh::quality::Quality;
use serde_json::{Value, json};

use crate::support::Bench;

/// A block of 40 x 30 x 20 mm: label 4 in its middle, label 7 around it, as NRRD text.
fn block(bench: &Bench) {
    let mut text =
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 20 15 10\nencoding: text\nspace: left-posterior-superior\n\
        space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (1,1,1)\n\n"
            .to_owned();
    for k in 0..10 {
        for j in 0..15 {
            for i in 0..20 {
                let inside = (6..14).contains(&i) && (4..11).contains(&j) && (3..7).contains(&k);
                text += if inside { "4 " } else { "7 " };
            }
            text += "\n";
        }
    }
    bench.write("block.nrrd", &text);
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

#[test]
fn a_volume_becomes_a_mesh_that_info_and_the_library_accept() {
    let bench = Bench::new();
    block(&bench);
    let report = bench
        .run("mesh make block.nrrd --nodes 600 --no-complete -o block.vtu --json")
        .json();
    let nodes = report["nodes"].as_u64().expect("nodes");
    assert!((540..=600).contains(&nodes), "{nodes} nodes");
    assert_eq!(report["parts"], json!(1));
    assert!(number(&report["min_dihedral_deg"]) >= 12.0 - 1e-6, "{report}");
    let info = bench.run("mesh info block.vtu --json").json();
    assert_eq!(
        (&info["nodes"], &info["elements"]),
        (&report["nodes"], &report["elements"])
    );
    assert_eq!((&info["parts"], &info["quality"]["usable"]), (&json!(1), &json!(true)));
    let least = [&info["quality"], &report].map(|from| number(&from["min_dihedral_deg"]));
    assert!((least[0] - least[1]).abs() < 1e-9, "{least:?}");
    // 8 x 7 x 4 voxels of 8 mm3, of 20 x 15 x 10.
    for (place, (value, ml)) in [(4, 8.0 * 224.0e-3), (7, 8.0 * 2776.0e-3)].into_iter().enumerate() {
        let (region, report) = (&info["regions"][place], &report["regions"][place]);
        assert_eq!((&region["value"], &report["value"]), (&json!(value), &json!(value)));
        assert!((number(&report["voxels_ml"]) - ml).abs() < 1e-9, "{report}");
        assert!(
            (number(&region["volume_ml"]) - number(&report["mesh_ml"])).abs() < 1e-9,
            "{region}, {report}"
        );
        assert!(number(&report["error_percent"]).abs() <= 1.0, "{report}");
    }
    let file = read_mesh(&bench.path("block.vtu"), &ReadOptions::default()).expect("a mesh");
    let quality = Quality::measure(&file.mesh, file.mesh.nodes());
    assert_eq!((quality.usable(), quality.face_parts), (Ok(()), 1));
    // The same bytes once more, with words in place of JSON.
    let table = bench.run("mesh make block.nrrd --nodes 600 --no-complete -o again.vtu");
    for words in ["wrote again.vtu", "least dihedral angle", "voxels ml", "error %"] {
        assert!(table.text().contains(words), "{words} in {table:?}");
    }
    let bytes = |name: &str| std::fs::read(bench.path(name)).expect("a file");
    assert_eq!(bytes("block.vtu"), bytes("again.vtu"));
}

#[test]
fn labels_are_chosen_and_phantoms_named() {
    let bench = Bench::new();
    block(&bench);
    let inner = bench
        .run("mesh make block.nrrd --nodes 200 --labels 4 -o inner.vtu --json")
        .json();
    assert_eq!(inner["regions"].as_array().map(Vec::len), Some(1));
    // The block of 16 x 14 x 8 mm is filled to its faces.
    let info = bench.run("mesh info inner.vtu --json").json();
    assert!((number(&info["volume_ml"]) - 1.792).abs() < 1e-9, "{info}");
    bench
        .run("mesh make --phantom two-layer --nodes 400 -o phantom.vtu -q")
        .text();
    let info = bench.run("mesh info phantom.vtu --json").json();
    assert_eq!((&info["parts"], &info["quality"]["usable"]), (&json!(1), &json!(true)));
}

#[test]
fn a_scene_deforms_by_a_generated_mesh() {
    let bench = Bench::new();
    bench
        .run("mesh make --phantom two-layer --nodes 400 -o phantom.vtu")
        .text();
    let scene = bench.text("scene.toml");
    bench.write(
        "bent.toml",
        &format!(
            "{scene}\n[deform]\nmesh = \"phantom.vtu\"\n\
        field = {{ kind = \"compression\", fixed_mm = [0, 60, 0], direction = [0, 1, 0], strain = 0.1 }}\n"
        ),
    );
    bench.run("render bent.toml --backend cpu -o bent.png").text();
}

#[test]
fn what_cannot_be_meshed_is_status_2_and_leaves_no_file() {
    let bench = Bench::new();
    block(&bench);
    bench.write("text.nrrd", "no volume");
    for (arguments, words) in [
        ("none.nrrd --nodes 100 -o a.vtu", vec!["none.nrrd"]),
        ("text.nrrd --nodes 100 -o a.vtu", vec!["text.nrrd"]),
        ("block.nrrd --nodes 100 -o a.stl", vec!["a.stl", ".vtu"]),
        (
            "block.nrrd --nodes 0 --no-complete -o a.vtu",
            vec!["0 nodes are too few", "at least about"],
        ),
        ("block.nrrd -o a.vtu", vec!["--nodes"]),
        ("block.nrrd --nodes 100", vec!["--output"]),
        ("--nodes 100 -o a.vtu", vec!["VOLUME"]),
        ("block.nrrd --phantom spine --nodes 100 -o a.vtu", vec!["--phantom"]),
        ("--phantom heart --nodes 100 -o a.vtu", vec!["heart", "abdomen"]),
        (
            "block.nrrd --nodes 100 --labels 5 -o a.vtu",
            vec!["label 5", "the labels 4, 7"],
        ),
    ] {
        bench.run(&format!("mesh make {arguments}")).fails(2, &words);
        assert_eq!(
            bench.files("."),
            ["block.nrrd", "scene.toml", "text.nrrd"],
            "{arguments}"
        );
    }
}

#[test]
fn an_output_that_cannot_be_written_is_status_1_and_told_first() {
    let bench = Bench::new();
    block(&bench);
    let run = bench.run("mesh make block.nrrd --nodes 100 --no-complete -o nowhere/a.vtu");
    run.fails(2, &["nowhere"]);
    std::fs::create_dir(bench.path("folder.vtu")).expect("a folder");
    let run = bench.run("mesh make block.nrrd --nodes 100 --no-complete -o folder.vtu");
    run.fails(2, &["folder.vtu", "regular file"]);
    assert_eq!(bench.files("."), ["block.nrrd", "folder.vtu", "scene.toml"]);
}
