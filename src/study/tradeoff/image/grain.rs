//! Grain of tissue: solid textures and speckle models.

use super::{
    Compared, Difference, Factor, ImageOptions, MEDIAN, MEMORY, P95, Picture, Subject, Table, coarsened, compared,
    inside, picture, sampling, without_grain,
};
use nalgebra::Matrix4;

use crate::tradeoff::{Axis, Choice, Column, GREY_LEVELS, Goal};
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

/// Compares frames with trilinear textures and without textures. Look-up methods in isolation are in
/// [`sampling::lookups`].
fn textures(options: &ImageOptions) -> Result<Table, Error> {
    let subject = Subject::new(options.voxel_mm)?;
    let structure = without_grain(subject.grid(coarsened(options, [256, 512])));
    let mut gold = subject.on(structure.clone(), Backend::CpuF64)?;
    let standard = gold.render(&subject.state)?.pixels.clone();
    let inside = inside(&gold);
    let mut rows = Vec::new();
    for (name, textured) in [("trilinear", true), ("none: constant echo", false)] {
        let mut settings = structure.clone();
        if !textured {
            settings.effects.texture = None;
        }
        let mut synth = subject.on(settings, Backend::Cpu)?;
        let picture = picture(&mut synth, &subject.state, options.patience)?;
        let difference = Difference::of(&standard, &picture.pixels, &inside);
        rows.push(Compared {
            variant: name,
            picture,
            difference,
            flag: textured.then(|| super::labels::rounding(&difference)).flatten(),
        });
    }
    let title = "Solid textures, without speckle, against trilinear look-ups in double precision";
    let goal = Goal::new("median_ms", "rms_grey", GREY_LEVELS).choosing("solid textures");
    let texture = Factor::new("texture", "texture").of(|row: &Compared<&str>| row.variant.to_owned());
    Ok(Table::of("image_texture", title, &[texture], &compared(), &rows)
        .flagged(&rows, |row| row.flag.clone())
        .against("trilinear look-ups in double precision")
        .seeking(goal.beside(&["p95_ms", "p99_grey", "memory_mb"])))
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
        aperture: Default::default(),
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
        let grey = |row: usize, column: usize| f64::from(pixels[row * SIDE + column]);
        let pixels_inside = || (low..high).flat_map(|row| (low..high).map(move |column| [row, column]));
        let n = pixels_inside().count() as f64;
        let mean = pixels_inside().map(|[row, column]| grey(row, column)).sum::<f64>() / n;
        let product = |[rows, columns]: [usize; 2]| {
            let pairs = pixels_inside().filter(|[row, column]| row + rows < high && column + columns < high);
            let (sum, count) = pairs.fold((0.0, 0.0), |(sum, count), [row, column]| {
                let product = (grey(row, column) - mean) * (grey(row + rows, column + columns) - mean);
                (sum + product, count + 1.0)
            });
            sum / count
        };
        let variance = product([0, 0]);
        let width = |step: [usize; 2]| {
            let mut before = 1.0;
            for lag in 1..SIDE / 4 {
                let correlation = product(step.map(|component| component * lag)) / variance;
                if correlation < 0.5 {
                    return 2.0 * PIXEL_MM * (lag as f64 - (0.5 - correlation) / (before - correlation));
                }
                before = correlation;
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

/// Correlation lengths that are asked for, along and across the beam, mm.
const LENGTHS_MM: [f64; 2] = [0.8, 1.5];

/// Constant tissue under a model of its grain.
struct GrainRow {
    model: &'static str,
    picture: Picture,
    look: Look,
    std_error_grey: f64,
    length_error_mm: f64,
    flag: Option<String>,
}

const MODEL: [Choice<GrainRow>; 1] = [Factor::new("model", "model").of(|row| row.model.to_owned())];

const GRAIN: [Column<GrainRow>; 8] = [
    MEDIAN.of(|row| Some(row.picture.time?.median_ms)),
    P95.of(|row| Some(row.picture.time?.p95_ms)),
    MEMORY.of(|row| Some(row.picture.memory_mb)),
    Axis::linear("std_grey", "std grey", "standard deviation, grey levels").of(|row| Some(row.look.std_grey)),
    Axis::log(
        "std_error_grey",
        "std off",
        "error of the standard deviation, grey levels",
    )
    .of(|row| Some(row.std_error_grey)),
    Axis::linear("axial_mm", "axial mm", "correlation length along the beam, mm").of(|row| Some(row.look.axial_mm)),
    Axis::linear("lateral_mm", "lateral mm", "correlation length across the beam, mm")
        .of(|row| Some(row.look.lateral_mm)),
    Axis::log("length_error_mm", "mm off", "error of the correlation lengths, mm").of(|row| Some(row.length_error_mm)),
];

fn models(options: &ImageOptions) -> Result<Table, Error> {
    let [axial_mm, lateral_mm] = LENGTHS_MM;
    let speckle = Speckle {
        receive_bandwidth: None,
        axial_mm: Some(axial_mm),
        lateral_mm: Some(lateral_mm),
        elevational_mm: Some(1.8),
        focal_zone_mm: Some(10_000.0),
        focus_mm: None,
    };
    let expected = 255.0 * SPECKLE_DB / Tone::default().dynamic_range_db;
    let models = [
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
                speckle: Some(speckle),
                ..Effects::default()
            },
        ),
    ];
    let state = FrameState::at(Matrix4::identity());
    let mut rows = Vec::new();
    for (model, effects) in models {
        let developed = effects.speckle.is_some();
        let mut synth = Synthesizer::new(anatomies::uniform(PLAIN), uniform(effects), Backend::Cpu)?;
        let picture = picture(&mut synth, &state, options.patience)?;
        let look = Look::of(&picture.pixels);
        let std_error_grey = (look.std_grey - expected).abs();
        let length_error_mm = (look.axial_mm - axial_mm)
            .abs()
            .max((look.lateral_mm - lateral_mm).abs());
        // Some 900 speckle cells determine the standard deviation to 5 % or better; logarithms narrow the correlation
        // by a tenth.
        let deviates = developed && (std_error_grey > 0.15 * expected || length_error_mm > 0.3 * lateral_mm);
        rows.push(GrainRow {
            model,
            picture,
            look,
            std_error_grey,
            length_error_mm,
            flag: deviates.then(|| "not what fully developed speckle is".to_owned()),
        });
    }
    let title = format!(
        "Grain of constant tissue, against Rayleigh statistics ({expected:.1} grey levels) and lengths of {axial_mm} by {lateral_mm} mm"
    );
    let goal = Goal::new("median_ms", "length_error_mm", HALF_A_CELL).choosing("grain");
    Ok(Table::of("image_grain", title, &MODEL, &GRAIN, &rows)
        .flagged(&rows, |row| row.flag.clone())
        .against("Rayleigh statistics, and the correlation lengths asked for")
        .seeking(goal.beside(&["p95_ms", "std_error_grey", "memory_mb"])))
}
