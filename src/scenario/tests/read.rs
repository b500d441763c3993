//! Files as they are written: what is wrong in them, what comes with the crate, what their schema says.

use super::{BLOCK, resolved};
use crate::scenario::{EXAMPLES, ScenarioFile, schema};

#[test]
fn faults_point_at_their_line_and_say_what_is_expected() {
    let cases: &[(&str, &str, usize, &str)] = &[
        ("version = 1", "version = 2", 1, "expected `version = 1`"),
        ("dt_ms = 10", "dt_ms = 0", 3, "0.01 to 100 ms"),
        ("dt_ms = 10", "dt_s = 10", 3, "unknown key `dt_s`"),
        (
            "phantom = \"two-layer\"",
            "phantom = \"two\"",
            5,
            "unknown variant `two`",
        ),
        ("resolution_mm = 5", "resolution_mm = 99", 6, "expected 0.3 to 5 mm"),
        ("nodes = 250", "nodes = 2", 11, "8 to 1000000"),
        ("nodes = 250", "nodes = 250\nlevel = \"V\"", 12, "unknown variant `V`"),
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
        ("40], [inf", "400], [inf", 13, "no node in this box"),
        ("\"phantom_inclusion\"", "\"phantom_inclusio\"", 15, "no label here"),
        ("friction_n_per_mm = 0.25", "friction_n_per_mm = -1", 16, "0 or more"),
        ("friction_n_per_mm = 0.25", "poisson = 0.5", 16, "below 0.5"),
        ("length_mm = 100", "length_mm = 0", 18, "0.1 to 1000"),
        ("length_mm = 100", "kappa_nmm_per_deg = 3", 18, "springs"),
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
    for (from, to, line, words) in cases {
        let text = BLOCK.replacen(from, to, 1);
        assert_ne!(text, BLOCK, "{from}");
        let error = resolved(&text).map(drop).expect_err(to);
        assert_eq!(error.location(), Some(("block.toml", *line)), "{to}: {error}");
        assert!(error.to_string().contains(words), "{to}: {error}");
        assert!(!error.is_machine(), "{to}");
    }
}

#[test]
fn scenes_are_named_or_refused() {
    let needle = BLOCK.replace("[scene.image]", "[scene.needle]\ntip_mm = [0, 0, 0]\n[scene.image]");
    let error = resolved(&needle).map(drop).expect_err("a needle of its own");
    assert!(error.to_string().contains("the scenario moves the needle"), "{error}");
    let at = BLOCK.find("[tissue]").expect("a table");
    let named = |scene: &str| format!("version = 1\nscene = \"{scene}\"\n{}", &BLOCK[at..]);
    for (scene, words) in [
        ("liver-needle", "a scene with `needle` of its own"),
        ("prostate-truss", "nothing here is named"),
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
    fn undocumented(at: &serde_json::Value, path: &str, found: &mut Vec<String>) {
        let properties = at.get("properties").and_then(serde_json::Value::as_object);
        for (name, property) in properties.into_iter().flatten() {
            let path = format!("{path}.{name}");
            if property.get("description").is_none() {
                found.push(path.clone());
            }
        }
    }
    let schema = schema();
    let mut found = Vec::new();
    undocumented(&schema, "", &mut found);
    let defined = schema.get("$defs").and_then(serde_json::Value::as_object);
    for (name, of) in defined.into_iter().flatten() {
        undocumented(of, name, &mut found);
    }
    assert!(found.is_empty(), "{found:?}");
}
