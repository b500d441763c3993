//! Parameter blocks: the same names at the same offsets in Rust and in WGSL.

use std::mem::offset_of;

use insonify_imaging::effects::{
    blur, contact, geometry, interface, needle, noise, quantise, receiver, refraction, scan_conversion, shadow, slice,
    speckle, texture, thickness, tone, truth, warp,
};

use super::shaders::{parse, passes};
use insonify_testing::shader::block_of;

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
