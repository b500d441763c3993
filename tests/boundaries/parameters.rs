//! Parameter blocks: the same names at the same offsets in Rust and in WGSL.

use std::mem::offset_of;

use insonify::anatomy::acoustics::TissueOverride;
use insonify::base::range::Ranges;
use insonify::imaging::effects::{
    Effects, blur, contact, geometry, interface, needle, noise, quantise, receiver, refraction, scan_conversion,
    shadow, slice, speckle, texture, thickness, tone, truth, warp,
};
use insonify::imaging::quality::QualitySpec;
use insonify::input::material_case::CaseFile;
use insonify::input::scenario::instruments::{ContactProbeSpec, NeedleTable};
use insonify::input::scenario::manipulator::SensorSpec;
use insonify::input::scenario::planned::{PlanSpec, PlannedNeedle, TargetSpec, TemplateSpec};
use insonify::input::scenario::stiffened::{StepSolverSpec, TissueViscositySpec};
use insonify::input::scenario::{file::RunSpec, tissue::TissueSpec};
use insonify::input::scene::{ImageSpec, VolumeSpec, deform::DeformSpec, paths};
use insonify::input::statics::course::{SolverSpec, ViscositySpec};
use insonify::input::statics::{file::MaterialSpec, selection::CylinderChoice};
use insonify::input::{identification, scenario};
use insonify::mechanics::insertion::spring::Parameters;
use insonify::mechanics::insertion::{Bone, Peak};
use insonify::mechanics::needle::beam::spec;
use insonify::mechanics::needle::{BendingConstraint, Bevel};
use insonify::tracking::TrackingError;
use insonify::tracking::manipulator::{Guide, drive::Drive};
use insonify::tracking::probe::{BeamGrid, ImageGrid, Probe, ProbeShape, ProbeSpec};
use schemars::{JsonSchema, schema_for};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use super::shaders::{block_of, parse, passes};

struct Block {
    /// Start of the names of the passes that bind it.
    pass: &'static str,
    size: usize,
    members: Vec<(&'static str, usize)>,
}

macro_rules! block {
    ($pass:literal, $params:ty, $($member:ident),+) => {
        Block {
            pass: $pass,
            size: size_of::<$params>(),
            members: vec![$((stringify!($member), offset_of!($params, $member))),+],
        }
    };
}

fn blocks() -> Vec<Block> {
    vec![
        block!(
            "contact",
            contact::Params,
            probe_to_world,
            lines,
            samples,
            sample_mm,
            per_fade
        ),
        block!(
            "geometry",
            geometry::Params,
            probe_to_world,
            lines,
            samples,
            sample_mm,
            plane_mm
        ),
        block!(
            "warp",
            warp::Params,
            lines,
            samples,
            planes,
            deformed,
            reference,
            reference_at,
            frames_at,
            carries_at
        ),
        block!(
            "slice",
            slice::Params,
            world_to_index,
            size,
            boundary,
            lines,
            samples,
            mirrored
        ),
        block!("texture", texture::Params, lines, samples, strength),
        block!("thickness", thickness::Params, weights, count, planes, samples),
        block!(
            "speckle",
            speckle::Params,
            elevation,
            planes,
            seed,
            lines,
            samples,
            oversampling,
            plane_count,
            plane_mm,
            per_mm,
            axial_reach,
            lateral_reach,
            carries_at
        ),
        block!(
            "interface",
            interface::Params,
            world_to_index,
            size,
            mirrored,
            stride,
            samples,
            seed,
            mirror,
            directivity,
            steady,
            diffuse,
            per_mm
        ),
        block!(
            "needle",
            needle::Params,
            samples,
            sample_mm,
            segments,
            beams_per_mm,
            echo,
            directivity,
            reverberations,
            reverberation_mm,
            reverberation,
            steady,
            diffuse,
            after_surfaces,
            seed
        ),
        block!(
            "shadow",
            shadow::Params,
            lines,
            samples,
            reach,
            opaque_units,
            needle_units,
            exponent,
            opens,
            reverberation,
            spacing,
            spreading,
            mirror,
            unused
        ),
        block!(
            "refraction",
            refraction::Params,
            lines,
            samples,
            reach,
            unit,
            spacing,
            spreading,
            least,
            fading
        ),
        block!("blur", blur::Params, lines, samples, reach),
        block!("receiver", receiver::Params, seed, samples, frame, noise, unused),
        block!(
            "tone",
            tone::Params,
            samples,
            lines,
            compress,
            per_octave,
            middle,
            bend,
            gamma,
            scale,
            share,
            ceiling
        ),
        block!("scan_conversion", scan_conversion::Params, width, lines, samples, fill),
        block!("noise", noise::Params, seed, width, first_row, frame, scale),
        block!("quantise", quantise::Params, width, words_per_row),
        block!(
            "truth",
            truth::Params,
            probe_to_world,
            world_to_index,
            places,
            size,
            sample_mm,
            lines,
            samples
        ),
    ]
}

#[test]
fn blocks_have_the_layout_of_their_structs() {
    for pass in passes() {
        let block = blocks().into_iter().find(|block| pass.name.starts_with(block.pass));
        let block = block.unwrap_or_else(|| panic!("say what members the block of {} has", pass.name));
        let (module, _) = parse(pass);
        let (mut members, span) = block_of(&module);
        assert_eq!(span, block.size, "{}: size of the block", pass.name);
        for (name, offset) in block.members {
            assert_eq!(members.remove(name), Some(offset), "{}: offset of {name}", pass.name);
        }
        members.retain(|name, _| !name.starts_with("unused"));
        assert!(
            members.is_empty(),
            "{}: members of the shader that Rust does not fill: {members:?}",
            pass.name
        );
    }
}

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

/// Checks the keys of a table of a schema against what is accepted: the default, both ends of the range, nothing just outside. Returns how many have a
/// range; numbers without one, whose range depends on other keys, do not count.
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
        let value = |number: f64| match whole {
            true => Value::from(number as i64),
            false => Value::from(number),
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
    let found = assert_true(schema_for!(T).as_value(), |key, value| {
        let mut table = keys.clone();
        table[key] = value;
        read::<T>(table)?.check_ranges().map_err(|error| error.to_string())
    });
    assert_eq!(found, T::RANGES.len());
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
    assert_eq!(ranges, 38);
}

#[test]
fn schemas_say_what_other_tables_accept() {
    let text = |error: TrackingError| format!("{:?}: {error}", error.key());
    let probe = Probe::new(ProbeShape::Linear { width_mm: 40.0 }, 60.0).expect("a probe");
    let beam = BeamGrid::new(&probe).expect("a grid");
    let of_image = assert_true(schema_for!(ImageSpec).as_value(), |key, value| {
        let image: ImageSpec = read(json!({ key: value }))?;
        let fitted = ImageGrid::fit(&beam, image.width as usize, image.height as usize, image.margin);
        fitted.map(drop).map_err(text)
    });
    assert_eq!(of_image, 4);
    // Of probes the one with the widest range of a key.
    let of_probe = assert_true(schema_for!(ProbeSpec).as_value(), |key, value| {
        let mut table = match key {
            "radius_mm" => json!({ "kind": "curvilinear", "angle_deg": 60 }),
            "angle_deg" => json!({ "kind": "trus-transverse", "radius_mm": 10 }),
            "length_mm" => json!({ "kind": "trus-sagittal" }),
            _ => json!({ "kind": "linear", "width_mm": 40 }),
        };
        table["depth_mm"] = 60.into();
        table[key] = value;
        Probe::try_from(read::<ProbeSpec>(table)?).map(drop).map_err(text)
    });
    assert_eq!(of_probe, 8);
}

#[test]
fn schemas_of_tables_have_their_ranges() {
    agree::<QualitySpec>(json!({}));
    agree::<BendingConstraint>(json!({}));
    agree::<Guide>(json!({}));
    agree::<Drive>(json!({}));
    agree::<DeformSpec>(json!({}));
    agree::<paths::MotionSpec>(json!({}));
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
    agree::<Parameters>(json!({}));
    agree::<NeedleTable>(json!({}));
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
