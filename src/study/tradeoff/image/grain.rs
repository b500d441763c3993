//! Grain of tissue: solid textures and speckle models.

use super::{
    Apart, Factor, ImageOptions, MEDIAN, MEMORY, P95, PICTURE, Subject, Table, coarsened, inside, picture, sampling,
    values, without_grain,
};
use nalgebra::Matrix4;

use crate::tradeoff::{Axis, GREY_LEVELS, Goal};
use insonify::Error;
use insonify_imaging::anatomies::{self, PLAIN};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::noise::Noise;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::synth::tables::Settings;
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_tracking::probe::{Linear, Probe, ProbeShape};

/// Standard deviation of fully developed speckle after log compression, dB: pi / sqrt(24) neper of amplitude.
const SPECKLE_DB: f64 = 5.57;
/// Pixel size of the uniform field, mm.
const PIXEL_MM: f64 = 0.1;
const SIDE: usize = 400;

/// Tolerance of the correlation lengths, mm, with its reason.
const HALF_A_CELL: (f64, &str) = (0.5, "half a cell of speckle");

pub(crate) fn grains(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    Ok(vec![textures(options)?, sampling::lookups(), models(options)?])
}

/// Compares frames with trilinear textures and without textures. Look-up methods in isolation are in [`sampling::lookups`].
fn textures(options: &ImageOptions) -> Result<Table, Error> {
    let subject = Subject::new(options.voxel_mm)?;
    let own = without_grain(subject.grid(coarsened(options, [256, 512])));
    let mut gold = subject.on(own.clone(), Backend::CpuF64)?;
    let standard = gold.render(&subject.state)?.pixels.clone();
    let inside = inside(&gold);
    let title = "Solid textures, without speckle, against trilinear look-ups in double precision";
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("solid textures");
    let mut table = Table::new("image_texture", title, &[Factor::new("texture", "texture")], &PICTURE)
        .against("trilinear look-ups in double precision")
        .seeking(goal.beside(&["p95_ms", "p99_grey", "memory_mb"]));
    for (name, textured) in [("trilinear", true), ("none: constant echo", false)] {
        let mut settings = own.clone();
        if !textured {
            settings.effects.texture = None;
        }
        let mut synth = subject.on(settings, Backend::Cpu)?;
        let found = picture(&mut synth, &subject.state, options.patience)?;
        let apart = Apart::of(&standard, &found.pixels, &inside);
        let flag = textured.then(|| super::labels::rounding(&apart)).flatten();
        table.push(vec![name.to_owned()], values(&found, Some(&apart)), flag);
    }
    Ok(table)
}

/// Returns settings for constant tissue under one of the speckle models.
fn uniform(effects: Effects) -> Settings {
    let side_mm = SIDE as f64 * PIXEL_MM;
    let probe = Probe {
        shape: ProbeShape::Linear(Linear { width_mm: side_mm }),
        depth_mm: side_mm,
        frequency_mhz: 7.0,
        lines: 256,
        samples: 512,
    };
    let effects = Effects {
        tone: Some(Tone::linear()),
        ..effects
    };
    Settings::new(probe, [SIDE; 2], effects)
}

/// Standard deviation of the grey levels, and full widths at half maximum of their axial and lateral correlation, mm.
struct Look {
    std_grey: f64,
    axial_mm: f64,
    lateral_mm: f64,
}

impl Look {
    fn of(pixels: &[u8]) -> Self {
        // The middle, away from the edges of the sector.
        let (low, high) = (SIDE / 8, SIDE - SIDE / 8);
        let at = |row: usize, column: usize| f64::from(pixels[row * SIDE + column]);
        let each = || (low..high).flat_map(|row| (low..high).map(move |column| [row, column]));
        let n = each().count() as f64;
        let mean = each().map(|[row, column]| at(row, column)).sum::<f64>() / n;
        let product = |[down, across]: [usize; 2]| {
            let pairs = each().filter(|[row, column]| row + down < high && column + across < high);
            let (sum, count) = pairs.fold((0.0, 0.0), |(sum, count), [row, column]| {
                let product = (at(row, column) - mean) * (at(row + down, column + across) - mean);
                (sum + product, count + 1.0)
            });
            sum / count
        };
        let variance = product([0, 0]);
        let width = |step: [usize; 2]| {
            let mut before = 1.0;
            for lag in 1..SIDE / 4 {
                let now = product(step.map(|part| part * lag)) / variance;
                if now < 0.5 {
                    return 2.0 * PIXEL_MM * (lag as f64 - (0.5 - now) / (before - now));
                }
                before = now;
            }
            f64::NAN
        };
        let grainy = variance > 1e-9;
        Self {
            std_grey: variance.max(0.0).sqrt(),
            axial_mm: if grainy { width([1, 0]) } else { 0.0 },
            lateral_mm: if grainy { width([0, 1]) } else { 0.0 },
        }
    }
}

fn models(options: &ImageOptions) -> Result<Table, Error> {
    let [axial_mm, lateral_mm] = [0.8, 1.5];
    let asked = Speckle {
        axial_mm: Some(axial_mm),
        lateral_mm: Some(lateral_mm),
        elevational_mm: Some(1.8),
        focal_zone_mm: Some(10_000.0),
        focus_mm: None,
    };
    let dynamic_range_db = Tone::default().dynamic_range_db;
    let expected = 255.0 * SPECKLE_DB / dynamic_range_db;
    let axes = [
        MEDIAN,
        P95,
        MEMORY,
        Axis::linear("std_grey", "std grey", "standard deviation, grey levels"),
        Axis::log(
            "std_error_grey",
            "std off",
            "error of the standard deviation, grey levels",
        ),
        Axis::linear("axial_mm", "axial mm", "correlation length along the beam, mm"),
        Axis::linear("lateral_mm", "lateral mm", "correlation length across the beam, mm"),
        Axis::log("length_error_mm", "mm off", "error of the correlation lengths, mm"),
    ];
    let title = format!(
        "Grain of constant tissue, against Rayleigh statistics ({expected:.1} grey levels) and lengths of {} by {} mm",
        axial_mm, lateral_mm
    );
    let goal = Goal::new("median_ms", "length_error_mm", HALF_A_CELL).choosing("grain");
    let mut table = Table::new("image_grain", title, &[Factor::new("model", "model")], &axes)
        .against("Rayleigh statistics, and the correlation lengths asked for")
        .seeking(goal.beside(&["p95_ms", "std_error_grey", "memory_mb"]));
    let ways = [
        ("none", Effects::default()),
        (
            "additive noise",
            Effects {
                noise: Some(Noise { std_grey: expected }),
                ..Effects::default()
            },
        ),
        (
            "fully developed speckle",
            Effects {
                speckle: Some(asked.clone()),
                ..Effects::default()
            },
        ),
    ];
    let state = FrameState::at(Matrix4::identity());
    for (name, effects) in ways {
        let developed = effects.speckle.is_some();
        let mut synth = Synthesizer::new(anatomies::uniform(PLAIN), uniform(effects), Backend::Cpu)?;
        let found = picture(&mut synth, &state, options.patience)?;
        let look = Look::of(&found.pixels);
        let off = (look.std_grey - expected).abs();
        let lengths = (look.axial_mm - axial_mm)
            .abs()
            .max((look.lateral_mm - lateral_mm).abs());
        // Some 900 speckle cells determine the standard deviation to 5 % or better; logarithms narrow the correlation by a tenth.
        let wrong = developed && (off > 0.15 * expected || lengths > 0.3 * lateral_mm);
        let flag = wrong.then(|| "not what fully developed speckle is".to_owned());
        let time = found.time;
        let all = vec![
            time.map(|time| time.median_ms),
            time.map(|time| time.p95_ms),
            Some(found.memory_mb),
            Some(look.std_grey),
            Some(off),
            Some(look.axial_mm),
            Some(look.lateral_mm),
            Some(lengths),
        ];
        table.push(vec![name.to_owned()], all, flag);
    }
    Ok(table)
}
