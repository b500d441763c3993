//! Texture look-up: nearest voxel against trilinear interpolation.

use std::hint::black_box;
use std::time::Instant;

use super::{Table, factor};
use crate::anatomy::acoustics::bank;
use crate::anatomy::volume::texture::SolidTexture;
use crate::base::report::statistics::Spread;
use crate::imaging::effects::tone::Tone;
use crate::study::tradeoff::{Axis, GREY_LEVELS, Goal};

/// Textures of coarse and fine structure, with and without a preferred direction.
const TEXTURES: [&str; 3] = ["liver", "muscle", "fat"];
/// Scanlines and samples of the plane through each texture, and number of repetitions.
const PLANE: [usize; 2] = [64, 256];
const REPEATS: usize = 9;
/// Share of the mean echo below which echoes count as equally dark.
const DARKEST: f64 = 1e-2;

/// Look-up method.
struct Variant {
    name: &'static str,
    look: fn(&SolidTexture, [f32; 3]) -> f32,
}

const WAYS: [Variant; 2] = [
    Variant {
        name: "nearest voxel",
        look: nearest,
    },
    Variant {
        name: "trilinear",
        look: |texture, place| texture.sample(place),
    },
];

/// Returns the multiplier of the nearest voxel.
fn nearest(texture: &SolidTexture, place_mm: [f32; 3]) -> f32 {
    let (size, spacing) = (texture.size(), texture.spacing_mm());
    let index: [usize; 3] = std::array::from_fn(|axis| {
        let voxel = (place_mm[axis] / spacing[axis] as f32).round() as i64;
        voxel.rem_euclid(size[axis] as i64) as usize
    });
    texture.data()[index[0] + size[0] * (index[1] + size[1] * index[2])]
}

/// Returns the positions of a plane oblique to a texture's axes, scanline by scanline, mm.
fn places() -> Vec<[f64; 3]> {
    let [lines, samples] = PLANE;
    let place = |at: usize| {
        let [line, sample] = [at / samples, at % samples].map(|count| count as f64);
        [0.31 * line, 0.23 * sample, 0.11 * line - 0.07 * sample]
    };
    (0..lines * samples).map(place).collect()
}

fn decibels(amplitude: f64) -> f64 {
    20.0 * amplitude.max(DARKEST).log10()
}

pub fn lookups() -> Table {
    let axes = [
        Axis::log(
            "look_ns",
            "ns a look-up",
            "time of a look-up on one thread (median), ns",
        ),
        Axis::log("p95_ns", "p95 ns", "time of a look-up on one thread (95 of 100), ns"),
        Axis::log("rms_db", "RMS dB", "root mean square error of the echo, dB"),
        Axis::log(
            "rms_grey",
            "RMS grey",
            "the same after log compression, grey levels of 255",
        ),
    ];
    let factors = [factor("texture", "texture"), factor("look", "look-up")];
    let goal = Goal::new("look_ns", "rms_grey", GREY_LEVELS).choosing("look-up of solid textures");
    let mut table = Table::new(
        "image_lookup",
        "Look-ups of solid textures by themselves: the nearest voxel against trilinear",
        &factors,
        &axes,
    )
    .against("trilinear look-ups in double precision")
    .seeking(goal.over(&["texture"]).beside(&["p95_ns", "rms_db"]));
    let (places, range_db) = (places(), Tone::default().dynamic_range_db);
    let singles: Vec<[f32; 3]> = places.iter().map(|place| place.map(|it| it as f32)).collect();
    for name in TEXTURES {
        let Some(texture) = bank::make(name, 0) else { continue };
        for way in WAYS {
            let mut nanoseconds = Vec::with_capacity(REPEATS);
            for _ in 0..REPEATS {
                let start = Instant::now();
                let sum: f32 = singles.iter().map(|place| (way.look)(&texture, *place)).sum();
                black_box(sum);
                nanoseconds.push(start.elapsed().as_secs_f64() * 1e9 / singles.len() as f64);
            }
            let squares = places.iter().zip(&singles).map(|(place, single)| {
                let [gold, found] = [texture.sample(*place), f64::from((way.look)(&texture, *single))];
                (decibels(found) - decibels(gold)).powi(2)
            });
            let off_db = (squares.sum::<f64>() / places.len() as f64).sqrt();
            let time = Spread::of(nanoseconds);
            let values = vec![
                time.map(|time| time.median_ms),
                time.map(|time| time.p95_ms),
                Some(off_db),
                Some(255.0 * off_db / range_db),
            ];
            table.push(vec![name.to_owned(), way.name.to_owned()], values, None);
        }
    }
    table
}
