//! Tables of files: the JSON schema accepts what the program accepts.

use std::collections::BTreeMap;

use insonify::input::scenario;
use insonify::input::scenario::ScenarioFile;
use insonify::input::scenario::instruments::{CommonNeedleKeys, ContactProbeSpec};
use insonify::input::scenario::manipulator::SensorSpec;
use insonify::input::scenario::nonlinear_tissue::{StepSolverSpec, TissueViscositySpec};
use insonify::input::scenario::plan::{PlanSpec, PlannedNeedle, TargetSpec, TemplateSpec};
use insonify::input::scenario::{file::RunSpec, tissue::TissueSpec};
use insonify::input::statics::course::{SolverSpec, ViscositySpec};
use insonify::input::{selection::CylinderChoice, statics::ProblemFile, statics::file::MaterialSpec};
use insonify_anatomy::acoustics::TissueOverride;
use insonify_base::bending::BendingConstraint;
use insonify_base::document::InputError;
use insonify_base::kinds::KeyedKind;
use insonify_base::range::Ranges;
use insonify_imaging::effects::Effects;
use insonify_imaging::quality::QualitySpec;
use insonify_imaging::scene::{ImageSpec, SceneFile, VolumeSpec, deform::DeformSpec, paths};
use insonify_mechanics::insertion::spring::MassSpringParameters;
use insonify_mechanics::insertion::{Bone, Peak};
use insonify_mechanics::needle::beam::material::{MooneyRivlin, NeoHookean, Ogden, Yeoh};
use insonify_mechanics::needle::beam::{ModelName, spec};
use insonify_mechanics::needle::{Bevel, NeedleModel, Shaft};
use insonify_study::identification;
use insonify_study::material_case::CaseFile;
use insonify_tracking::TrackingError;
use insonify_tracking::manipulator::{Guide, drive::Drive};
use insonify_tracking::probe::{
    Aperture, BeamGrid, ImageGrid, Linear, Probe, ProbeKind, ProbeShape, ProbeSpec, Sampling,
};
use schemars::{JsonSchema, SchemaGenerator, schema_for};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

fn read<T: DeserializeOwned>(table: Value) -> Result<T, String> {
    serde_json::from_value(table).map_err(|error| error.to_string())
}

/// Follows the references of a node of a schema.
fn resolved<'a>(schema: &'a Value, node: &'a Value) -> &'a Value {
    let node = node.get("anyOf").map_or(node, |either| &either[0]);
    match node["$ref"].as_str() {
        Some(at) => schema.pointer(at.trim_start_matches('#')).expect("a definition"),
        None => node,
    }
}

/// Checks the keys of a table of a schema against what is accepted: the default, both ends of the range, nothing just
/// outside. Returns how many have a range; numbers without one, whose range depends on other keys, do not count.
fn assert_true(table: &Value, accepts: impl Fn(&str, Value) -> Result<(), String>) -> usize {
    let mut ranges = 0;
    for (key, described) in table["properties"].as_object().expect("keys") {
        if let Some(default) = described.get("default").filter(|default| !default.is_null()) {
            assert_eq!(accepts(key, default.clone()), Ok(()), "{key}: default");
        }
        let is = |name: &str| described["type"] == name || described["type"][0] == name;
        let whole = is("integer");
        let of = |name: &str| described[name].as_f64();
        let (low, high) = (
            of("exclusiveMinimum").or(of("minimum")),
            of("exclusiveMaximum").or(of("maximum")),
        );
        if !(is("number") || whole) || low.is_none() || (whole && high.is_none()) {
            continue;
        }
        let value = |number: f64| {
            if whole {
                Value::from(number as i64)
            } else {
                Value::from(number)
            }
        };
        for (end, open, sign) in [(low, "exclusiveMinimum", -1.0), (high, "exclusiveMaximum", 1.0)] {
            let Some(end) = end else { continue };
            let step = sign * if whole { 1.0 } else { 1e-9 * end.abs().max(1e-9) };
            let (good, bad) = match of(open) {
                Some(_) => (value(end - step), value(end)),
                None => (value(end), value(end + step)),
            };
            assert_eq!(
                accepts(key, good.clone()),
                Ok(()),
                "{key}: {good} of {low:?} to {high:?}"
            );
            let refused = accepts(key, bad.clone()).expect_err(key);
            assert!(refused.contains(key) || whole, "{key} = {bad}: {refused}");
        }
        ranges += 1;
    }
    ranges
}

/// Checks that the schema of a table has all its ranges, and no others; `keys` are the required ones.
fn agree<T: DeserializeOwned + JsonSchema + Ranges>(keys: Value) {
    let ranges = assert_true(schema_for!(T).as_value(), |key, value| {
        let mut table = keys.clone();
        table[key] = value;
        read::<T>(table)?.check_ranges().map_err(|error| error.to_string())
    });
    assert_eq!(ranges, T::RANGES.len());
}

#[test]
fn schemas_say_what_effects_accept() {
    let schema = schema_for!(Effects).to_value();
    let mut ranges = 0;
    for (effect, table) in schema["properties"].as_object().expect("effects") {
        ranges += assert_true(resolved(&schema, table), |key, value| {
            let effects: Effects = read(json!({ effect: { key: value } }))?;
            effects.validate().map_err(|error| error.to_string())
        });
    }
    assert!(ranges > 30, "{ranges} ranges of effects were tried");
}

#[test]
fn schemas_say_what_other_tables_accept() {
    let text = |error: TrackingError| format!("{:?}: {error}", error.key());
    let probe = Probe::new(Linear { width_mm: 40.0 }, 60.0).expect("a probe");
    let beam = BeamGrid::new(&probe).expect("a grid");
    let of_image = assert_true(schema_for!(ImageSpec).as_value(), |key, value| {
        let image: ImageSpec = read(json!({ key: value }))?;
        let fitted = ImageGrid::fit(&beam, image.width as usize, image.height as usize, image.margin);
        fitted.map(drop).map_err(text)
    });
    assert_eq!(of_image, 4);
    let schema = schema_for!(ProbeSpec).to_value();
    let cases = schema["allOf"].as_array().expect("kinds");
    assert_eq!(cases.len(), ProbeKind::ALL.len());
    for (kind, case) in ProbeKind::ALL.iter().zip(cases) {
        assert_eq!(case["if"]["properties"]["kind"]["const"], kind.name());
        let (_, shape) = *ProbeShape::EXAMPLES
            .iter()
            .find(|(name, _)| *name == kind.name())
            .expect("an example");
        let example = serde_json::to_value(Probe::new(shape, 60.0).expect("a probe")).expect("JSON");
        let accepts = |key: &str, value| {
            let mut table = example.clone();
            table[key] = value;
            Probe::try_from(read::<ProbeSpec>(table)?).map(drop).map_err(text)
        };
        let properties = case["then"]["properties"].as_object().expect("keys");
        for (key, _) in properties.iter().filter(|(_, of)| **of == false) {
            let refused = accepts(key, 10.into()).expect_err(key);
            assert!(refused.contains("has no meaning"), "{refused}");
        }
        let ranges = properties.iter().filter(|(_, of)| of.is_object());
        let ranges: serde_json::Map<_, _> = ranges.map(|(key, of)| (key.clone(), of.clone())).collect();
        assert_eq!(
            assert_true(&json!({ "properties": ranges }), accepts),
            shape.numbers().len()
        );
    }
    for (of_all, numbers) in [(schema_for!(Sampling), 4), (schema_for!(Aperture), 7)] {
        let found = assert_true(of_all.as_value(), |key, value| {
            let mut table = json!({ "kind": "linear", "width_mm": 40, "depth_mm": 60 });
            table[key] = value;
            Probe::try_from(read::<ProbeSpec>(table)?).map(drop).map_err(text)
        });
        assert_eq!(found, numbers);
    }
}

#[test]
fn schemas_say_what_models_of_needles_accept() {
    let mut ranges = 0;
    for model in NeedleModel::ALL {
        let schema = model.schema(&mut SchemaGenerator::default()).to_value();
        ranges += assert_true(&schema, |key, value| {
            let keys = model.read(json!({ key: value })).map_err(|error| error.to_string())?;
            keys.check(&Shaft::default()).map_err(|error| error.to_string())
        });
    }
    assert!(ranges > 5, "{ranges}");
}

/// Checks that keys of one name in several kinds have one schema: a table describes each key once.
fn share_schemas<K: KeyedKind>() {
    let mut shared: BTreeMap<&str, Value> = BTreeMap::new();
    for kind in K::ALL {
        let schema = kind.schema(&mut SchemaGenerator::default()).to_value();
        for key in kind.keys() {
            let described = &schema["properties"][*key];
            let other = shared.entry(*key).or_insert_with(|| described.clone());
            assert_eq!(other, described, "{key} of {}", json!(kind));
        }
    }
}

#[test]
fn keys_of_several_kinds_have_one_schema() {
    share_schemas::<ModelName>();
    share_schemas::<NeedleModel>();
}

#[test]
fn schemas_of_tables_have_their_ranges() {
    agree::<QualitySpec>(json!({}));
    agree::<BendingConstraint>(json!({}));
    agree::<Guide>(json!({}));
    agree::<Drive>(json!({}));
    agree::<DeformSpec>(json!({}));
    agree::<paths::MotionSpec>(json!({}));
    agree::<paths::BreathingSpec>(json!({}));
    agree::<paths::PulseSpec>(json!({}));
    agree::<paths::PressSpec>(json!({}));
    agree::<paths::NeedleTable>(json!({}));
    agree::<paths::BendingSpec>(json!({ "entry_mm": [0, 0, 0], "entry_direction": [0, 1, 0] }));
    agree::<VolumeSpec>(json!({}));
    agree::<scenario::tissue::MaterialSpec>(json!({}));
    agree::<identification::LayerSpec>(json!({ "region": "liver" }));
    let history = json!({ "control": "stress", "time_s": [0, 1], "value": [1, 1] });
    agree::<CaseFile>(json!({ "law": "zener", "order": 0.1, "modulus_kpa": 1, "history": history }));
    agree::<RunSpec>(json!({}));
    agree::<TissueSpec>(json!({}));
    agree::<SensorSpec>(json!({}));
    agree::<MassSpringParameters>(json!({}));
    agree::<CommonNeedleKeys>(json!({}));
    agree::<StepSolverSpec>(json!({}));
    agree::<TissueViscositySpec>(json!({}));
    agree::<PlanSpec>(json!({}));
    agree::<SolverSpec>(json!({}));
    agree::<ViscositySpec>(json!({}));
    agree::<spec::NeedleSpec>(json!({}));
    agree::<spec::MeshSpec>(json!({}));
    agree::<TissueOverride>(json!({ "name": "liver" }));
    agree::<Bevel>(json!({ "r_mm": 0.6 }));
    agree::<ContactProbeSpec>(json!({ "radius_mm": 10, "length_mm": 60 }));
    agree::<Peak>(json!({ "density_n_per_mm": 0.1, "width_mm": 6 }));
    agree::<Bone>(json!({ "stiffness_n_per_mm": 40, "penetration_mm": 0.5 }));
    let names = json!({ "columns": ["A"], "rows": ["1"] });
    agree::<TemplateSpec>(json!({ "origin_mm": [0, 0, 0], "x_axis": [1, 0, 0], "y_axis": [0, 1, 0], "names": names }));
    agree::<PlannedNeedle>(json!({ "hole": "A1", "depth_mm": 60 }));
    agree::<TargetSpec>(json!({ "name": "a", "at_mm": [0, 0, 0] }));
    agree::<MaterialSpec>(json!({ "poisson": 0.4 }));
    agree::<CylinderChoice>(json!({ "at_mm": [0, 0, 0], "axis": [0, 0, 1], "radius_mm": 9 }));
    agree::<spec::BaseSpec>(json!({ "control_distance_mm": 20, "displacement_mm": 3 }));
    let layer = json!({ "thickness_mm": 9, "model": "yeoh", "compression": "UTru", "initial_length_mm": 50 });
    agree::<spec::LayerSpec>(layer);
    agree::<NeoHookean>(json!({ "mu_kpa": 5 }));
    agree::<Ogden>(json!({ "mu_kpa": 5, "alpha": 2 }));
    agree::<Yeoh>(json!({ "c10_kpa": 5, "c20_kpa": 2 }));
    agree::<MooneyRivlin>(json!({ "c10_kpa": 5, "c01_kpa": 2 }));
}

/// Checks of every key of a file that is a table, or a list of tables, that a list in place of a table is refused.
fn refuses_lists<T: JsonSchema>(parse: impl Fn(&str) -> Result<(), InputError>) {
    let schema = schema_for!(T).to_value();
    let mut tried = 0;
    for (key, node) in schema["properties"].as_object().expect("keys") {
        let node = resolved(&schema, node);
        let text = if node["properties"].is_object() {
            format!("{key} = [1]")
        } else if resolved(&schema, &node["items"])["properties"].is_object() {
            format!("{key} = [[1]]")
        } else {
            continue;
        };
        let error = parse(&text).expect_err(&text);
        assert!(
            error.to_string().contains("found a list, expected a table"),
            "{text}: {error}"
        );
        tried += 1;
    }
    assert!(tried > 2, "{tried}");
}

#[test]
fn lists_in_place_of_tables_are_refused() {
    refuses_lists::<SceneFile>(|text| SceneFile::parse(text, "a").map(drop));
    refuses_lists::<ScenarioFile>(|text| ScenarioFile::parse(text, "a").map(drop));
    refuses_lists::<ProblemFile>(|text| ProblemFile::parse(text, "a").map(drop));
    refuses_lists::<identification::CaseFile>(|text| identification::CaseFile::parse(text, "a").map(drop));
    for text in [
        "effects.speckle = [0.8, 1.5]",
        "probe = [\"linear\", 40, 60]",
        "deform.field = [[\"rotation\", [0, 0, 0], [0, 0, 1], 3.0]]",
        "needle.motion.keyframes = [[0.0, [0, 0, 0]]]",
    ] {
        let error = SceneFile::parse(text, "a").expect_err(text);
        let key = text.split(" = ").next().unwrap_or_default();
        let named = format!("`{key}`: found a list, expected a table");
        assert!(error.to_string().contains(&named), "{text}: {error}");
    }
    for text in [
        "scene.volume = [\"abdomen\"]",
        "tissue.material = [{ region = \"liver\", law = [\"neo-hookean\"] }]",
    ] {
        let error = ScenarioFile::parse(text, "a").expect_err(text);
        assert!(error.to_string().contains("found a list"), "{text}: {error}");
    }
    // Under old names, too.
    for key in ["nonlinear", "viscoelastic"] {
        let error = ProblemFile::parse(&format!("{key} = [1]"), "a").expect_err(key);
        let named = format!("`{key}`: found a list, expected a table");
        assert!(error.to_string().contains(&named), "{error}");
    }
}

#[test]
#[should_panic(expected = "max_weight: 2.0 of Some(0.0) to Some(2.0)")]
fn a_schema_that_says_otherwise_is_noticed() {
    let mut schema = schema_for!(BendingConstraint).to_value();
    schema["properties"]["max_weight"]["maximum"] = 2.into();
    assert_true(&schema, |key, value| {
        let table: BendingConstraint = read(json!({ key: value }))?;
        table.check_ranges().map_err(|error| error.to_string())
    });
}
