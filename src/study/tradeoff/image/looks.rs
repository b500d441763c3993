//! Looks of spatial compounding beside looks that are rendered whole, and what looks and smoothing do to speckle.

use super::{Factor, ImageOptions, MEDIAN, P95, Picture, Table, coarsened, picture};
use crate::tradeoff::{Axis, Choice, Column, Goal};
use insonify::Error;
use insonify_base::statistics::{mean, std};
use insonify_imaging::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::compound::Compound;
use insonify_imaging::effects::interface::Interface;
use insonify_imaging::effects::shadow::Shadow;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::speckle_reduction::SpeckleReduction;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::simulated;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_tracking::probe::{Apodisation, BeamGrid, Linear, ProbeShape};
use nalgebra::Matrix4;

/// Numbers of looks; 1 is a frame without compounding.
const LOOKS: [u32; 4] = [1, 3, 5, 9];

/// Looks of the standard.
const WHOLE: u32 = 9;

/// Seeds over which amplitudes are averaged, so that structure remains.
const SEEDS: u64 = 6;

const WIDTH_MM: f64 = 40.0;
const DEPTH_MM: f64 = 40.0;

/// Scanlines and samples of a cell over which amplitudes are averaged.
const CELL: [usize; 2] = [4, 12];

/// Least mean amplitude that is compared, of that of the tissue.
const LEAST: f64 = 0.01;

/// Tolerance, with its reason.
const SPECKLE: (f64, &str) = (1.0, "what speckle leaves of the means of cells");

struct Row {
    looks: String,
    smoothing: &'static str,
    picture: Picture,
    error_db: f64,
    evenness: f64,
}

const CHOICES: [Choice<Row>; 2] = [
    Factor::new("looks", "looks").of(|row| row.looks.clone()),
    Factor::new("smoothing", "smoothing").of(|row| row.smoothing.to_owned()),
];

const COLUMNS: [Column<Row>; 4] = [
    MEDIAN.of(|row: &Row| Some(row.picture.time?.median_ms)),
    P95.of(|row: &Row| Some(row.picture.time?.p95_ms)),
    Axis::log("error_db", "RMS dB", "root mean square error of mean amplitudes, dB").of(|row| Some(row.error_db)),
    Axis::linear(
        "evenness",
        "SNR",
        "mean over standard deviation of the amplitude of speckle",
    )
    .of(|row| Some(row.evenness)),
];

/// Tissue with a brighter one below a tilted surface, and an absorber above.
fn body() -> Anatomy {
    let tissue = Acoustics {
        attenuation_db_cm_mhz: 0.3,
        impedance_mrayl: 1.6,
        ..PLAIN
    };
    let brighter = Acoustics {
        echo_db: 4.0,
        impedance_mrayl: 1.7,
        ..tissue
    };
    let opaque = Acoustics {
        occlusion_per_mm: 0.9999,
        ..tissue
    };
    let frame = Frame::around([0.0, 25.0, 0.0], [260, 240, 3], 0.25);
    anatomies::anatomy_from(frame, &[SILENT, tissue, opaque, brighter], |[x, y, _]| {
        let is_absorber = x.abs() < 2.5 && (10.0..12.0).contains(&y);
        match y {
            ..0.0 => 0,
            _ if is_absorber => 2,
            _ => 1 + 2 * u8::from(y > 26.0 + 0.14 * x),
        }
    })
}

fn settings(options: &ImageOptions, looks: u32, smooths: bool) -> Settings {
    let effects = Effects {
        speckle: Some(Speckle::default()),
        interface: Some(Interface::default()),
        shadow: Some(Shadow {
            mirror: 0.0,
            reverberation: 0.0,
            ..Shadow::default()
        }),
        compound: (looks > 1).then(|| Compound {
            looks,
            ..Compound::default()
        }),
        speckle_reduction: smooths.then(SpeckleReduction::default),
        tone: Some(Tone::linear()),
        ..Effects::default()
    };
    let mut probe = simulated::probe(false, Apodisation::Hann);
    probe.shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
    probe.depth_mm = DEPTH_MM;
    [probe.lines, probe.samples] = coarsened(options, [256, 512]);
    Settings::new(probe, [640, 480], effects)
}

/// The last pass of a beam.
fn last_pass(settings: &Settings) -> &'static str {
    if settings.effects.speckle_reduction.is_some() {
        "speckle_reduction"
    } else if settings.effects.compound.is_some() {
        "compound"
    } else if settings.effects.shadow.is_some() {
        "shadow"
    } else {
        "speckle_lateral"
    }
}

/// Amplitudes of a frame in the beam frame, summed over seeds from `first_seed` on.
fn sums(anatomy: Anatomy, settings: &Settings, state: &FrameState, first_seed: u64) -> Result<Vec<f64>, Error> {
    let mut synth = Synthesizer::new(anatomy, settings.clone(), Backend::Cpu)?;
    let mut sums = vec![0.0; (settings.probe.lines * settings.probe.samples) as usize];
    for seed in first_seed..first_seed + SEEDS {
        synth.set(Settings {
            seed,
            ..settings.clone()
        })?;
        let beam = synth.render_until(last_pass(settings), state)?;
        sums.iter_mut()
            .zip(&beam.amplitude)
            .for_each(|(sum, amplitude)| *sum += amplitude);
    }
    Ok(sums)
}

/// Amplitudes of looks that are each rendered by a probe turned along them, averaged where their elements are on the
/// array.
fn whole_looks(options: &ImageOptions) -> Result<Vec<f64>, Error> {
    let settings = settings(options, 1, false);
    let grid = BeamGrid::new(&settings.probe)?;
    let angle = Compound::default().angle_deg.to_radians();
    let sample_mm = grid.sample_spacing_mm();
    // All of the turned probe lies above the skin, where there is nothing.
    let above = (0.5 * WIDTH_MM * angle.sin() / sample_mm).ceil() + 1.0;
    let mut turned = settings.clone();
    turned.probe.samples += 2 * above as u32;
    turned.probe.depth_mm = f64::from(turned.probe.samples) * sample_mm;
    let turned_grid = BeamGrid::new(&turned.probe)?;
    let (mut sums_of_looks, mut counts) = (
        vec![0.0; grid.lines() * grid.samples()],
        vec![0.0; grid.lines() * grid.samples()],
    );
    for look in 0..WHOLE {
        // Waves that leave the array at evenly spaced tangents.
        let tangent = angle.tan() * (2.0 * f64::from(look) / f64::from(WHOLE - 1) - 1.0);
        let (sin, cos) = tangent.atan().sin_cos();
        let away = -above * sample_mm;
        let pose = Matrix4::new(
            cos,
            sin,
            0.0,
            away * sin, //
            -sin,
            cos,
            0.0,
            away * cos, //
            0.0,
            0.0,
            1.0,
            0.0, //
            0.0,
            0.0,
            0.0,
            1.0,
        );
        let amplitudes = sums(body(), &turned, &FrameState::at(pose), u64::from(look) * SEEDS)?;
        for index in 0..sums_of_looks.len() {
            let [x, y] = grid.to_plane((index / grid.samples()) as f64, (index % grid.samples()) as f64);
            if (x - y * tangent).abs() > 0.5 * WIDTH_MM {
                continue;
            }
            let [aside, down] = [x * cos - y * sin, x * sin + y * cos - away];
            let line = (aside / WIDTH_MM + 0.5) * (turned_grid.lines() - 1) as f64;
            let sample = down / sample_mm - 0.5;
            sums_of_looks[index] += between(&amplitudes, turned_grid.samples(), [line, sample]);
            counts[index] += 1.0;
        }
    }
    Ok(sums_of_looks
        .iter()
        .zip(counts)
        .map(|(sum, count)| sum / count)
        .collect())
}

/// Value between the scanlines and samples of a field.
fn between(field: &[f64], samples: usize, place: [f64; 2]) -> f64 {
    let [first, above] = place.map(|x| x.max(0.0) as usize);
    let [across, down] = [place[0] - first as f64, place[1] - above as f64];
    let at = |line: usize, sample: usize| field.get(line * samples + sample).copied().unwrap_or(0.0);
    let on_line = |line: usize| at(line, above) + down * (at(line, above + 1) - at(line, above));
    on_line(first) + across * (on_line((first + 1).min(field.len() / samples - 1)) - on_line(first))
}

/// Means of the cells of a field.
fn cells(field: &[f64], samples: usize) -> Vec<f64> {
    let lines = field.len() / samples;
    let cell = |index: usize| {
        let [line, sample] = [
            index / (samples / CELL[1]) * CELL[0],
            index % (samples / CELL[1]) * CELL[1],
        ];
        let row = |line: usize| field[line * samples + sample..][..CELL[1]].iter().sum::<f64>();
        (line..line + CELL[0]).map(row).sum::<f64>() / (CELL[0] * CELL[1]) as f64
    };
    (0..lines / CELL[0] * (samples / CELL[1])).map(cell).collect()
}

/// Time of looks, their error beside whole ones, and how even speckle is, with and without its reduction.
pub(super) fn looks(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, Error> {
    let state = FrameState::at(Matrix4::identity());
    let whole = whole_looks(options)?;
    let least = LEAST * mean(&whole);
    let mut rows = Vec::new();
    for looks in LOOKS {
        for (smoothing, smooths) in [("none", false), ("speckle reduction", true)] {
            let settings = settings(options, looks, smooths);
            let samples = settings.probe.samples as usize;
            let amplitudes = sums(body(), &settings, &state, 0)?;
            let pairs = cells(&amplitudes, samples).into_iter().zip(cells(&whole, samples));
            let errors: Vec<f64> = pairs
                .map(|(measured, expected)| {
                    let [measured, expected] = [measured, expected].map(|amplitude| amplitude.max(least));
                    (20.0 * (measured / expected).log10()).powi(2)
                })
                .collect();
            // Nothing in uniform tissue casts a shadow.
            let mut unshaded = settings.clone();
            unshaded.effects.shadow = None;
            let mut synth = Synthesizer::new(anatomies::uniform(PLAIN), unshaded.clone(), Backend::Cpu)?;
            let speckle = synth.render_until(last_pass(&unshaded), &state)?;
            let quarter = speckle.amplitude.len() / 4;
            let middle: Vec<f64> = speckle.amplitude[quarter..3 * quarter].to_vec();
            let mut synth = Synthesizer::new(body(), settings, Backend::Cpu)?;
            rows.push(Row {
                looks: looks.to_string(),
                smoothing,
                picture: picture(&mut synth, &state, options.patience)?,
                error_db: mean(&errors).sqrt(),
                evenness: mean(&middle) / std(&middle),
            });
        }
    }
    let title = "Looks of spatial compounding under a linear array, against looks rendered whole";
    let goal = Goal::new("median_ms", "error_db", SPECKLE).choosing("compounding");
    Ok(vec![
        Table::of("image_looks", title, &CHOICES, &COLUMNS, &rows)
            .against("9 looks, each rendered by a probe turned along it")
            .seeking(goal.beside(&["evenness"])),
    ])
}
