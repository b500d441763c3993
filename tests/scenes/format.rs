//! The format explains itself: default scene, schema and code agree.

use std::collections::BTreeSet;
use std::path::Path;

use insonify_imaging::effects::parameters::Thickness;
use insonify_imaging::effects::table::Stated;
use insonify_imaging::effects::{Effects, EffectsTable};
use insonify_imaging::scene::{DEFAULT, SceneFile, schema};
use serde_json::Value;

use super::support::{parse, uncommented};

#[test]
fn the_default_scene_writes_the_defaults() {
    let file = parse(DEFAULT).expect("default");
    let mut effects = EffectsTable::from(&Effects::usual());
    effects.speckle = Some(Stated::With(Default::default()));
    // Those of the scanner, which the file leaves open.
    (effects.compound, effects.speckle_reduction) = (None, None);
    assert_eq!(file.effects, Some(effects));
    assert_eq!(file.image, Some(insonify_imaging::scene::ImageSpec::default()));
    let mut bare = parse("[volume]\nphantom = \"abdomen\"").expect("bare");
    let mut full = file;
    for file in [&mut bare, &mut full] {
        file.volume.as_mut().expect("volume").resolution_mm = Some(5.0);
    }
    let [bare, full] = [bare, full].map(|file| file.resolve(Path::new(".")).expect("scene"));
    assert_eq!(bare.settings, full.settings);
    assert_eq!(bare.probe_pose(0, 1), full.probe_pose(0, 1));
}

#[test]
fn comments_state_the_defaults_that_are_written() {
    let (_, from_image) = DEFAULT.split_once("[image]").expect("image");
    let mut compared = 0;
    for line in from_image.lines().filter(|line| !line.starts_with('#')) {
        let Some((code, comment)) = line.split_once('#') else {
            continue;
        };
        let (Some((_, written)), Some((_, stated))) = (code.split_once('='), comment.rsplit_once("default ")) else {
            continue;
        };
        let [written, stated] = [written, stated].map(|text| text.trim().parse::<toml::Value>().ok());
        let number = |value: &Option<toml::Value>| match value {
            Some(toml::Value::Integer(whole)) => Some(*whole as f64),
            Some(toml::Value::Float(number)) => Some(*number),
            _ => None,
        };
        assert!(
            number(&written).is_some() == number(&stated).is_some() && (number(&written) == number(&stated)),
            "{line}"
        );
        assert!(number(&written).is_some() || written == stated, "{line}");
        compared += 1;
    }
    assert!(compared > 20, "{compared}");
}

#[test]
fn every_key_shown_in_a_comment_is_one() {
    let text = uncommented();
    let file = parse(&text).unwrap_or_else(|error| panic!("{error}"));
    let effects = file.effects.clone().expect("effects");
    assert_eq!(
        (effects.thickness, effects.noise),
        (
            Some(Stated::With(Thickness {
                width_mm: Some(2.0),
                ..Thickness::default()
            })),
            Some(Stated::With(Default::default()))
        )
    );
    let full = serde_json::to_value(&file).expect("json");
    assert!(full["needle"]["bending"]["alpha_per_mm"].is_number());
    assert_eq!(full["deform"]["field"].as_array().map(Vec::len), Some(6));
}

/// Every key that the schema knows, whichever table it is in.
fn keys(schema: &Value, names: &mut BTreeSet<String>) {
    match schema {
        Value::Object(object) => {
            if let Some(Value::Object(properties)) = object.get("properties") {
                names.extend(properties.keys().cloned());
            }
            object.values().for_each(|value| keys(value, names));
        }
        Value::Array(list) => list.iter().for_each(|value| keys(value, names)),
        _ => {}
    }
}

#[test]
fn the_default_scene_explains_every_key_of_the_schema() {
    let text = uncommented();
    let shown = |key: &str| {
        let has = |line: &str| {
            let header = line.trim_start_matches('[').split([']', ' ']).next().unwrap_or("");
            line.starts_with('[') && header.split('.').any(|part| part == key)
                || line.split('#').next().is_some_and(|code| {
                    code.split(['{', ','])
                        .any(|part| part.split('=').next().is_some_and(|name| name.trim() == key))
                })
        };
        text.lines().any(has)
    };
    let mut known = BTreeSet::new();
    keys(&schema(), &mut known);
    assert!(known.len() > 100, "{}", known.len());
    let unexplained: Vec<_> = known.iter().filter(|key| !shown(key)).collect();
    assert!(unexplained.is_empty(), "{unexplained:?}");
}

/// Whether a value has only keys that a schema knows, and every key that it requires.
fn fits(value: &Value, schema: &Value, root: &Value) -> Result<(), String> {
    if let Some(reference) = schema.get("$ref").and_then(Value::as_str) {
        return fits(value, root.pointer(&reference[1..]).expect("reference"), root);
    }
    for many in ["anyOf", "oneOf"] {
        if let Some(options) = schema.get(many).and_then(Value::as_array) {
            let failures: Vec<String> = options
                .iter()
                .filter_map(|option| fits(value, option, root).err())
                .collect();
            if failures.len() == options.len() {
                return Err(failures.join(" / "));
            }
        }
    }
    if let Some(expected) = schema.get("const").filter(|expected| *expected != value) {
        return Err(format!("{value} is not {expected}"));
    }
    if let Some(choices) = schema.get("enum").and_then(Value::as_array)
        && !choices.contains(value)
    {
        return Err(format!("{value} is none of {choices:?}"));
    }
    let types: Vec<&str> = match schema.get("type") {
        Some(Value::String(kind)) => vec![kind],
        Some(Value::Array(kinds)) => kinds.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    };
    let is = |kind: &&str| match *kind {
        "null" => value.is_null(),
        "number" => value.is_number(),
        "integer" => value.is_i64() || value.is_u64(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "array" => value.is_array(),
        _ => value.is_object(),
    };
    if !types.is_empty() && !types.iter().any(is) {
        return Err(format!("{value} is none of {types:?}"));
    }
    match value {
        Value::Object(object) => {
            let properties = schema.get("properties").and_then(Value::as_object);
            for (key, value) in object {
                match properties.and_then(|properties| properties.get(key)) {
                    Some(inner) => fits(value, inner, root).map_err(|error| format!("{key}: {error}"))?,
                    None if schema.get("additionalProperties") == Some(&Value::Bool(false)) => {
                        return Err(format!("unknown key {key}"));
                    }
                    None => {}
                }
            }
            let required = schema.get("required").and_then(Value::as_array).into_iter().flatten();
            match required
                .filter_map(Value::as_str)
                .find(|key| !object.contains_key(*key))
            {
                Some(missing) => Err(format!("{missing} is missing")),
                None => Ok(()),
            }
        }
        Value::Array(list) => match schema.get("items") {
            Some(items) => list.iter().try_for_each(|value| fits(value, items, root)),
            None => Ok(()),
        },
        _ => Ok(()),
    }
}

#[test]
fn the_schema_accepts_what_the_parser_accepts() {
    let schema = schema();
    for text in [DEFAULT.to_owned(), uncommented()] {
        let value: Value = toml::from_str(&text).expect("toml");
        fits(&value, &schema, &schema).unwrap_or_else(|error| panic!("{error}"));
    }
    for wrong in [
        "volume = 1",
        "version = 1\nsed = 3\n[volume]",
        "version = 3\n[volume]\nphantom = \"abdomen\"",
        "version = 1\n[volume]\nphantom = 3",
    ] {
        let value: Value = toml::from_str(wrong).expect("toml");
        assert!(fits(&value, &schema, &schema).is_err(), "{wrong}");
    }
}

#[test]
fn a_resolved_scene_written_down_resolves_to_itself() {
    let text = super::support::small(
        "[pose]\ntarget = \"liver\"\nrock_deg = 3\n[effects]\nblur = false\nnoise = true\ntone.gain_db = 4\n",
    );
    let scene = super::support::resolve(&text).expect("scene");
    let written = toml::to_string(&scene.file).expect("toml");
    let again = super::support::resolve(&written).unwrap_or_else(|error| panic!("{error}\n{written}"));
    assert_eq!(scene.settings, again.settings);
    let moved = scene.probe_pose(0, 1).probe_to_world() - again.probe_pose(0, 1).probe_to_world();
    assert!(moved.amax() < 1e-9, "{moved}");
    let json = serde_json::to_value(&scene.file).expect("json");
    assert_eq!(json["effects"]["tone"]["gamma"], 1.0);
    let back: SceneFile = serde_json::from_value(json).expect("json");
    assert_eq!(back, scene.file);
}
