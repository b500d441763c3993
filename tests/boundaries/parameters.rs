//! Parameter blocks: the same names at the same offsets in Rust and in WGSL.

use std::mem::offset_of;

use insonify::imaging::effects::{
    Effects, blur, contact, geometry, interface, needle, noise, quantise, receiver, refraction, scan_conversion,
    shadow, slice, speckle, texture, thickness, tone,
};
use insonify::mechanics::mesh::pack::{GridParams, WarpParams};
use serde_json::Value;

use super::shaders::{block_of, layout, parse, passes};

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
            "warp", WarpParams, lines, samples, planes, elements, carries_at, tangled, deformed, reference
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

#[test]
fn the_search_grids_in_the_block_of_the_warp_have_the_layout_of_their_struct() {
    let pass = passes().into_iter().find(|pass| pass.name == "warp").expect("the warp");
    let (module, _) = parse(pass);
    let (members, span) = layout(&module, "Grid").expect("the grid");
    assert_eq!(span, size_of::<GridParams>());
    let grid = block!(
        "warp", GridParams, origin, per_mm, low, starts_at, high, lists_at, cells, frames_at
    );
    assert_eq!(members.len(), grid.members.len());
    for (name, offset) in grid.members {
        assert_eq!(members.get(name), Some(&offset), "{name}");
    }
}

/// Ranges stand in the description of a key and in its check: they are the same.
#[test]
fn ranges_are_those_described() {
    let all = Effects {
        thickness: Some(Default::default()),
        noise: Some(Default::default()),
        ..Effects::usual()
    };
    let all = serde_json::to_value(all).expect("effects");
    let schema = serde_json::to_value(schemars::schema_for!(Effects)).expect("a schema");
    let definitions = schema["$defs"].as_object().expect("definitions");
    let mut checked = 0;
    for (effect, values) in all.as_object().expect("effects") {
        let keys = values.as_object().expect("keys");
        let same = |definition: &&Value| {
            let properties = definition["properties"].as_object();
            properties.is_some_and(|properties| properties.keys().eq(keys.keys()))
        };
        let described = definitions
            .values()
            .find(same)
            .unwrap_or_else(|| panic!("no schema of {effect}"));
        for key in keys.keys() {
            let description = described["properties"][key]["description"].as_str().unwrap_or_default();
            let description = description.replace('\n', " ");
            let Some((low, high)) = range(&description) else {
                continue;
            };
            let above = high.parse::<f64>().expect("a number") + 2.0;
            let mut changed = all.clone();
            changed[effect][key] = match &keys[key] {
                Value::Number(number) if number.is_u64() => (above as u64).into(),
                _ => above.into(),
            };
            let changed: Effects =
                serde_json::from_value(changed).unwrap_or_else(|error| panic!("{effect}.{key}: {error}"));
            let refused = changed.validate().expect_err(key);
            assert_eq!(refused.key, format!("{effect}.{key}"));
            assert!(
                refused.expected.ends_with(&format!("number from {low} to {high}")),
                "{effect}.{key}: {refused}, described as {low} to {high}"
            );
            checked += 1;
        }
    }
    assert!(checked >= 35, "{checked}");
}

/// The range in a description: `(-40 to 80)`.
fn range(description: &str) -> Option<(&str, &str)> {
    description.split('(').skip(1).find_map(|part| {
        let (low, rest) = part.split_once(" to ")?;
        let end = rest.find([')', ';', ',', ':'])?;
        let is_number = |text: &str| text.parse::<f64>().is_ok();
        (is_number(low) && is_number(&rest[..end])).then(|| (low, &rest[..end]))
    })
}
