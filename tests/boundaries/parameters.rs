//! Parameter blocks: the same names at the same offsets in Rust and in WGSL.

use std::mem::offset_of;

use insonify::base::range::Ranges;
use insonify::imaging::effects::{
    Effects, blur, contact, geometry, interface, needle, noise, quantise, receiver, refraction, scan_conversion,
    shadow, slice, speckle, texture, thickness, tone, warp,
};
use insonify::imaging::quality::QualitySpec;
use insonify::input::scene::ImageSpec;
use insonify::mechanics::needle::BendingConstraint;
use insonify::tracking::TrackingError;
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
        block!("thickness", thickness::Params, weights, count, planes, stride),
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
/// range.
fn assert_true(table: &Value, accepts: impl Fn(&str, Value) -> Result<(), String>) -> usize {
    let mut ranges = 0;
    for (key, described) in table["properties"].as_object().expect("keys") {
        if let Some(default) = described.get("default").filter(|default| !default.is_null()) {
            assert_eq!(accepts(key, default.clone()), Ok(()), "{key}: default");
        }
        let is = |name: &str| described["type"] == name || described["type"][0] == name;
        if !is("number") && !is("integer") {
            continue;
        }
        let end = |name: &str| described[name].as_f64().unwrap_or_else(|| panic!("{key}: no {name}"));
        let (low, high) = (end("minimum"), end("maximum"));
        let value = |number: f64| match is("integer") {
            true => (number as i64).into(),
            false => number.into(),
        };
        let step = if is("integer") { 1.0 } else { 1e-9 * (high - low) };
        for good in [low, high] {
            assert_eq!(accepts(key, value(good)), Ok(()), "{key}: {good} of {low} to {high}");
        }
        for bad in [low - step, high + step] {
            let refused = accepts(key, value(bad)).expect_err(key);
            assert!(refused.contains(key) || is("integer"), "{key} = {bad}: {refused}");
        }
        ranges += 1;
    }
    ranges
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
    assert!(ranges >= 35, "{ranges}");
}

#[test]
fn schemas_say_what_other_tables_accept() {
    fn ranges<T: DeserializeOwned + JsonSchema + Ranges>() -> usize {
        assert_true(schema_for!(T).as_value(), |key, value| {
            let table: T = read(json!({ key: value }))?;
            table.check_ranges().map_err(|error| error.to_string())
        })
    }
    assert_eq!((ranges::<QualitySpec>(), ranges::<BendingConstraint>()), (2, 3));
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
#[should_panic(expected = "max_weight: 2 of 0 to 2")]
fn a_schema_that_says_otherwise_is_noticed() {
    let mut schema = schema_for!(BendingConstraint).to_value();
    schema["properties"]["max_weight"]["maximum"] = 2.into();
    assert_true(&schema, |key, value| {
        let table: BendingConstraint = read(json!({ key: value }))?;
        table.check_ranges().map_err(|error| error.to_string())
    });
}
