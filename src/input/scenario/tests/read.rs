//! Tests of scenario files: errors, built-in examples, and the schema.

use std::collections::BTreeSet;

use serde_json::Value;

use super::{BLOCK, resolved};
use crate::input::scenario::{EXAMPLES, REFERENCE, ScenarioFile, schema};
use insonify_base::blame::Blame;

#[test]
fn faults_point_at_their_line_and_say_what_is_expected() {
    let cases: &[(&str, &str, usize, &str)] = &[
        ("version = 1", "version = 3", 1, "found version 3"),
        ("dt_ms = 10", "dt_ms = 0", 3, "0.01 to 100 ms"),
        ("dt_ms = 10", "dt_s = 10", 3, "unknown key `dt_s`"),
        ("phantom = \"two-layer\"", "phantom = \"two\"", 5, "unknown value `two`"),
        ("resolution_mm = 5", "resolution_mm = 99", 6, "expected 0.01 to 5 mm"),
        ("nodes = 250", "nodes = 2", 11, "8 to 1000000"),
        ("nodes = 250", "nodes = 250\nlevel = \"V\"", 12, "unknown value `V`"),
        (
            "nodes = 250",
            "level = \"IV\"\ncolumns = \"on-demand\"",
            12,
            "keeps a dense inverse",
        ),
        (
            "nodes = 250",
            "model = \"mass-spring\"\nlevel = \"I\"",
            12,
            "mass-spring",
        ),
        (
            "nodes = 250",
            "model = \"mass-spring\"\ndevice = \"gpu\"",
            12,
            "`device` with `model = \"mass-spring\"`",
        ),
        ("nodes = 250", "device = \"gpu\"", 11, "the exact level on a GPU"),
        ("nodes = 250", "device = \"tpu\"", 11, "unknown value `tpu`"),
        (
            "nodes = 250",
            "device = \"gpu\"\nlevel = \"I\"\nprecision = \"f64\"",
            13,
            "keeps the inverse in f32",
        ),
        ("nodes = 250", "precision = \"f32\"", 11, "f32 at the exact level"),
        (
            "dt_ms = 10",
            "dt_ms = 10\n[[run.change]]\nat_s = 9\nlevel = \"I\"",
            5,
            "found 9; expected a time within the run",
        ),
        (
            "dt_ms = 10",
            "change = [\n{ at_s = 1, level = \"I\" },\n{ at_s = 0.5, level = \"II\" },\n]",
            5,
            "ascending times",
        ),
        ("dt_ms = 10", "change = [{ at_s = 1 }]", 3, "missing key `level`"),
        (
            "deposit_s = [1.0]",
            "deposit_s = [1.0]\n[needle.bevel]\nr_mm = 1\nlength_mm = \"long\"",
            22,
            "long",
        ),
        (
            "nodes = 250",
            "model = \"mass-spring\"\nalong_path = true",
            12,
            "mass-spring",
        ),
        ("nodes = 250", "mesh = \"a.vtu\"\nalong_path = true", 12, "with `mesh`"),
        ("40], [inf", "400], [inf", 13, "no node in this box"),
        (
            "\"phantom_inclusion\"",
            "\"phantom_inclusoin\"",
            15,
            "there is no region",
        ),
        (
            "friction_n_per_mm = 0.25",
            "friction_n_per_mm = -1",
            16,
            "0 N/mm or more",
        ),
        ("friction_n_per_mm = 0.25", "poisson = 0.5", 16, "below 0.5"),
        ("length_mm = 100", "length_mm = 0", 18, "0.1 to 1000"),
        ("length_mm = 100", "kappa_nmm_per_deg = 3", 18, "springs"),
        (
            "length_mm = 100",
            "model = \"springs\"\nlink_m = 3",
            19,
            "unknown key `link_m`",
        ),
        (
            "length_mm = 100",
            "link_mm = \"3\"\nmodel = \"springs\"",
            18,
            "found string \"3\"",
        ),
        (
            "length_mm = 100",
            "link_mm = 3\nmodel = \"beam\"",
            18,
            "found `link_mm` with `model = \"beam\"`; expected `model = \"springs\"`",
        ),
        (
            "length_mm = 100",
            "length_mm = 50\nmodel = \"springs\"\nlink_mm = 60",
            20,
            "at most the needle's length",
        ),
        (
            "length_mm = 100",
            "model = \"constrained\"\nbending = { max_weight = 2 }",
            19,
            "0 to 1",
        ),
        ("deposit_s = [1.0]", "deposit_s = [9.0]", 19, "within the run"),
        ("time_s = 2", "time_s = 0", 25, "more than 0"),
        (
            "direction = [0, 0, 1]\nroll",
            "direction = [0, 0, 0]\nroll",
            27,
            "not all zero",
        ),
        ("roll_deg = 90", "roll_deg = nan", 28, "finite number of degrees"),
    ];
    for (written, replacement, line, words) in cases {
        let text = BLOCK.replacen(written, replacement, 1);
        assert_ne!(text, BLOCK, "{written}");
        let error = resolved(&text).map(drop).expect_err(replacement);
        assert_eq!(error.location(), Some(("block.toml", *line)), "{replacement}: {error}");
        assert!(error.to_string().contains(words), "{replacement}: {error}");
        assert!(!error.is_machine(), "{replacement}");
    }
}

#[test]
fn a_region_that_is_not_there_lists_the_arrays_of_the_mesh() {
    let folder = tempfile::tempdir().expect("folder");
    let array = |name: &str| format!("SCALARS {name} int 1\nLOOKUP_TABLE default\n3\n");
    let mesh = "# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n\
                0 0 0 40 0 0 0 40 0 0 0 40\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nCELL_DATA 1\n";
    let mesh = format!("{mesh}{}{}", array("organ"), array("part"));
    std::fs::write(folder.path().join("a.vtk"), mesh).expect("file");
    let text = BLOCK.replace("nodes = 250", "mesh = \"a.vtk\"");
    let text = text.replace("\"phantom_inclusion\"", "77");
    let file = ScenarioFile::parse(&text, "block.toml").expect("a scenario");
    let error = file.resolve(folder.path(), |_| {}).map(drop).expect_err("no region 77");
    let help = error.help().unwrap_or_default();
    assert!(
        help.contains("cell arrays: `organ`, `part`; all regions are 0: choose with `region_array`"),
        "{error} {help}"
    );
}

#[test]
fn scenes_are_named_or_refused() {
    let needle = BLOCK.replace("[scene.image]", "[scene.needle]\ntip_mm = [0, 0, 0]\n[scene.image]");
    let error = resolved(&needle).map(drop).expect_err("a needle of its own");
    assert!(error.to_string().contains("the scenario moves the needle"), "{error}");
    let tissue_table = BLOCK.find("[tissue]").expect("a table");
    let named = |scene: &str| format!("version = 1\nscene = \"{scene}\"\n{}", &BLOCK[tissue_table..]);
    for (scene, words) in [
        ("liver-needle", "a scene with `needle` of its own"),
        ("prostate-truss", "unknown name"),
        ("nowhere.toml", "cannot be read"),
    ] {
        let error = resolved(&named(scene)).map(drop).expect_err(scene);
        assert!(error.to_string().contains(words), "{error}");
        assert_eq!(error.location(), Some(("block.toml", 2)), "{error}");
    }
}

#[test]
fn scenarios_that_come_with_the_crate_are_read() {
    for (name, text) in EXAMPLES {
        let file = ScenarioFile::parse(text, name).expect(name);
        assert!(file.needle.is_some(), "{name}");
    }
}

#[test]
fn every_key_is_explained_by_the_schema() {
    fn undocumented(schema: &serde_json::Value, path: &str, missing: &mut Vec<String>) {
        let properties = schema.get("properties").and_then(serde_json::Value::as_object);
        for (name, property) in properties.into_iter().flatten() {
            let path = format!("{path}.{name}");
            if property.get("description").is_none() {
                missing.push(path.clone());
            }
        }
    }
    let schema = schema();
    let mut missing = Vec::new();
    undocumented(&schema, "", &mut missing);
    let defined = schema.get("$defs").and_then(serde_json::Value::as_object);
    for (name, definition) in defined.into_iter().flatten() {
        undocumented(definition, name, &mut missing);
    }
    assert!(missing.is_empty(), "{missing:?}");
}

/// Paths of all keys in a schema, lists of tables as their tables; the keys of a scene are excluded.
fn known(schema: &Value, root: &Value, path: &str, paths: &mut BTreeSet<String>) {
    if let Some(reference) = schema["$ref"].as_str() {
        return known(
            &root[reference.rsplit_once("$defs/").map_or("", |(_, name)| name)],
            root,
            path,
            paths,
        );
    }
    for combinator in ["anyOf", "oneOf"] {
        for option in schema[combinator].as_array().into_iter().flatten() {
            known(option, root, path, paths);
        }
    }
    if schema["items"].is_object() {
        known(&schema["items"], root, path, paths);
    }
    for (key, property) in schema["properties"].as_object().into_iter().flatten() {
        let path = format!("{path}.{key}");
        if path != ".scene" {
            known(property, root, &path, paths);
        }
        paths.insert(path);
    }
}

/// Paths of all keys in a document.
fn written(value: &toml::Value, path: &str, paths: &mut BTreeSet<String>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                let path = format!("{path}.{key}");
                written(value, &path, paths);
                paths.insert(path);
            }
        }
        toml::Value::Array(list) => list.iter().for_each(|value| written(value, path, paths)),
        _ => {}
    }
}

#[test]
fn the_reference_has_every_key_of_the_schema_and_runs() {
    let reveal = |line: &str| match line.strip_prefix('#') {
        Some(rest) if rest.starts_with(|c: char| c.is_ascii_lowercase() || c == '[') => rest.to_owned(),
        _ => line.to_owned(),
    };
    let shown = REFERENCE.lines().map(reveal).collect::<Vec<_>>().join("\n");
    if let Err(error) = ScenarioFile::parse(&shown, "reference.toml") {
        panic!("{error}");
    }
    let (mut has, mut wanted) = (BTreeSet::new(), BTreeSet::new());
    written(&toml::Value::Table(shown.parse().expect("TOML")), "", &mut has);
    let schema = schema();
    known(&schema, &schema["$defs"], "", &mut wanted);
    let missing: Vec<_> = wanted.difference(&has).collect();
    let unknown: Vec<_> = has.difference(&wanted).collect();
    assert!(
        missing.is_empty() && unknown.is_empty(),
        "missing {missing:?}, unknown {unknown:?}"
    );
    assert!(wanted.len() > 90, "{}", wanted.len());

    let coarse = REFERENCE.replace("nodes = 3300 ", "nodes = 400 ");
    assert_ne!(coarse, REFERENCE);
    let scenario = resolved(&coarse).unwrap_or_else(|error| panic!("{error}"));
    assert!(scenario.timing.steps > 1000);
}

#[test]
fn only_finite_elements_change_their_level() {
    let text = BLOCK.replace("dt_ms = 10", "change = [{ at_s = 1, level = \"I\" }]");
    for model in ["mass-spring", "nonlinear"] {
        let text = text.replace("nodes = 250", &format!("model = \"{model}\""));
        let error = resolved(&text).map(drop).expect_err(model);
        assert_eq!(error.key(), Some("run.change"), "{error}");
    }
}
