//! Point spread and slice thickness beside a simulation of waves.

use super::{Factor, ImageOptions, MEDIAN, P95, Picture, Table, picture};
use nalgebra::Matrix4;

use crate::tradeoff::{Axis, Choice, Column, Goal};
use insonify::Error;
use insonify_base::statistics::{full_width, mean, std};
use insonify_imaging::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::thickness::Thickness;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::simulated::{self, AXIAL, CURVED_SPECKLE, SPHERES};
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::Settings;
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_tracking::probe::{Apodisation, BeamGrid, ProbeShape};

/// Seeds whose fields are averaged.
const SEEDS: u64 = 2;

/// Half of the depth over which lengths are taken, mm.
const HALF_MM: f64 = 7.5;

/// Mean over standard deviation of the amplitude of fully developed speckle.
const RAYLEIGH: f64 = 1.913;

/// Tolerance of lengths, with its reason.
const SIMULATION: (f64, &str) = (8.0, "the spread of one realisation of the simulation");

/// A variant, and how it changes the settings.
type Variant = (&'static str, fn(&mut Settings));

const VARIANTS: [Variant; 9] = [
    ("as usual", |_| {}),
    ("half the samples", |settings| settings.probe.samples /= 2),
    ("a quarter of the samples", |settings| settings.probe.samples /= 4),
    ("half the scanlines", |settings| settings.probe.lines /= 2),
    ("a Gaussian beam about the focus", |settings| {
        settings.effects.speckle = Some(Speckle {
            lateral_mm: Some(1.35),
            ..Speckle::default()
        });
    }),
    ("9 sub-planes", |settings| sub_planes(settings, 9)),
    ("5 sub-planes", |settings| sub_planes(settings, 5)),
    ("3 sub-planes", |settings| sub_planes(settings, 3)),
    ("one plane", |settings| settings.effects.thickness = None),
];

fn sub_planes(settings: &mut Settings, planes: u32) {
    settings.effects.thickness = Some(Thickness {
        planes,
        ..Thickness::default()
    });
}

/// Deviations of a variant from the simulation.
struct Row {
    variant: &'static str,
    picture: Picture,
    axial_percent: f64,
    lateral_percent: f64,
    evenness_percent: f64,
    sphere_db: f64,
}

const VARIANT: [Choice<Row>; 1] = [Factor::new("variant", "variant").of(|row| row.variant.to_owned())];

const COLUMNS: [Column<Row>; 7] = [
    MEDIAN.of(|row: &Row| Some(row.picture.time?.median_ms)),
    P95.of(|row: &Row| Some(row.picture.time?.p95_ms)),
    Axis::log(
        "length_percent",
        "lengths %",
        "largest error of the lengths of speckle, %",
    )
    .of(|row| Some(row.axial_percent.max(row.lateral_percent))),
    Axis::log(
        "lateral_percent",
        "lateral %",
        "largest error of the lateral length of speckle, %",
    )
    .of(|row| Some(row.lateral_percent)),
    Axis::log(
        "axial_percent",
        "axial %",
        "largest error of the axial length of speckle, %",
    )
    .of(|row| Some(row.axial_percent)),
    Axis::log(
        "evenness_percent",
        "SNR %",
        "error of mean over standard deviation of the amplitude, %",
    )
    .of(|row| Some(row.evenness_percent)),
    Axis::linear("sphere_db", "sphere dB", "largest error of echoes in a sphere, dB").of(|row| Some(row.sphere_db)),
];

pub(crate) fn waves(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let mut rows = Vec::new();
    for (variant, change) in VARIANTS {
        let effects = Effects {
            speckle: Some(Speckle::default()),
            thickness: Some(Thickness::default()),
            tone: Some(Tone::linear()),
            ..Effects::default()
        };
        // A quarter of the scanlines, with the aperture of all.
        let mut probe = simulated::probe(true, Apodisation::Hann);
        probe.aperture.aperture_mm = Some(probe.transducer().aperture_mm);
        probe.lines /= 4;
        if let ProbeShape::Curvilinear(array) = &mut probe.shape {
            array.angle_deg /= 4.0;
        }
        let mut settings = Settings::new(probe, [640, 480], effects);
        change(&mut settings);
        rows.push(row(variant, &settings, options)?);
    }
    let title = "Point spread and thickness under a curved array, against a simulation of waves (SIMUS)";
    let goal = Goal::new("median_ms", "length_percent", SIMULATION).choosing("the beam");
    Ok(vec![
        Table::of("image_waves", title, &VARIANT, &COLUMNS, &rows)
            .against("a simulation of waves, of which one realisation scatters by 5 to 8 % and by 3 dB")
            .seeking(goal.beside(&["lateral_percent", "axial_percent", "evenness_percent", "sphere_db"])),
    ])
}

fn row(variant: &'static str, settings: &Settings, options: &ImageOptions) -> Result<Row, Error> {
    let state = FrameState::at(Matrix4::identity());
    let grid = BeamGrid::new(&settings.probe)?;
    let mut synth = Synthesizer::new(anatomies::uniform(PLAIN), settings.clone(), Backend::Cpu)?;
    let mut fields = Vec::new();
    for seed in 0..SEEDS {
        synth.set(Settings {
            seed,
            ..settings.clone()
        })?;
        fields.push(synth.render_until("speckle_lateral", &state)?);
    }
    let [mut axial_percent, mut lateral_percent] = [0.0f64; 2];
    for [depth_mm, simulated_mm, _] in CURVED_SPECKLE {
        let lengths = lengths_mm(&fields, &grid, depth_mm);
        let off = |length_mm: f64, expected_mm: f64| 100.0 * (length_mm / expected_mm - 1.0).abs();
        axial_percent = axial_percent.max(off(lengths[0], AXIAL[1][1]));
        lateral_percent = lateral_percent.max(off(lengths[1], simulated_mm));
    }
    let amplitudes: Vec<f64> = fields
        .iter()
        .flat_map(|field| field.amplitude.iter().copied())
        .collect();
    let evenness = mean(&amplitudes) / std(&amplitudes);
    let mut sphere_db = 0.0f64;
    let mut shown = None;
    for [diameter_mm, depth_mm, simulated_db] in SPHERES {
        let frame = Frame::around([0.0, depth_mm, 0.0], [120; 3], 0.25);
        let void = Acoustics {
            echo_db: SILENT.echo_db,
            ..PLAIN
        };
        let anatomy = anatomies::ball(frame, [0.0, depth_mm, 0.0], 0.5 * diameter_mm, &[PLAIN, PLAIN, void]);
        let mut synth = Synthesizer::new(anatomy, settings.clone(), Backend::Cpu)?;
        let last_pass = if settings.effects.thickness.is_some() {
            "thickness"
        } else {
            "slice"
        };
        let beam = synth.render_until(last_pass, &state)?;
        let near = |index: &usize| {
            let [x, y] = grid.to_plane((index / grid.samples()) as f64, (index % grid.samples()) as f64);
            x.hypot(y - depth_mm) < 0.3 * diameter_mm
        };
        let powers: Vec<f64> = (0..beam.amplitude.len())
            .filter(near)
            .map(|index| beam.amplitude[index].powi(2))
            .collect();
        // What is below -60 dB is black.
        let db = 10.0 * mean(&powers).max(1e-6).log10();
        sphere_db = sphere_db.max((db - simulated_db).abs());
        shown = Some(picture(&mut synth, &state, options.patience)?);
    }
    Ok(Row {
        variant,
        picture: shown.expect("there are spheres"),
        axial_percent,
        lateral_percent,
        evenness_percent: 100.0 * (evenness / RAYLEIGH - 1.0).abs(),
        sphere_db,
    })
}

/// Full widths at half maximum of the autocovariance of intensity about a depth, along and across the beam, mm.
fn lengths_mm(fields: &[Beam], grid: &BeamGrid, depth_mm: f64) -> [f64; 2] {
    let (lines, samples) = (grid.lines(), grid.samples());
    let sample_mm = grid.sample_spacing_mm();
    let [first, last] = [-HALF_MM, HALF_MM].map(|aside| ((depth_mm + aside) / sample_mm) as usize);
    let intensity = |field: &Beam, line: usize, sample: usize| field.amplitude[line * samples + sample].powi(2);
    let all: Vec<f64> = fields
        .iter()
        .flat_map(|field| {
            (0..lines).flat_map(move |line| (first..last).map(move |sample| intensity(field, line, sample)))
        })
        .collect();
    let middle = mean(&all);
    let covariance = |[across, along]: [usize; 2]| {
        let (mut sum, mut count) = (0.0, 0.0);
        for field in fields {
            for line in 0..lines - across {
                for sample in first..last - along {
                    let other = intensity(field, line + across, sample + along) - middle;
                    sum += (intensity(field, line, sample) - middle) * other;
                    count += 1.0;
                }
            }
        }
        sum / count
    };
    let variance = covariance([0, 0]);
    let width = |step: [usize; 2], step_mm: f64| {
        let mut correlations = vec![1.0];
        while correlations.len() < 64 && correlations.iter().all(|correlation| *correlation >= 0.5) {
            let lag = correlations.len();
            correlations.push(covariance(step.map(|count| lag * count)) / variance);
        }
        full_width(&correlations, step_mm).unwrap_or(f64::NAN)
    };
    [
        width([0, 1], sample_mm),
        width([1, 0], grid.lateral_spacing_mm(depth_mm)),
    ]
}
