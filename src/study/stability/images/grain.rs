//! Cases of speckle and noise: distributions and hashes.

use nalgebra::{Matrix4, Vector3};

use crate::stability::fixtures::{everywhere, gpus, name, settings, straight};
use crate::stability::record::{Record, Unexpected};
use insonify_base::random::{hash3, seed_words};
use insonify_gpu::{Access, Dispatch, Gpu, GpuError, Loops, Parameters, PassSource, Pipeline, Readback, StorageBuffer};
use insonify_imaging::anatomies::{self, Acoustics, PLAIN};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::noise::Noise;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::synth::tables::Settings;
use insonify_imaging::synth::{FrameState, Synthesizer};
use insonify_tracking::probe::{Linear, ProbeShape};

/// Number of frames in the criterion.
const FRAMES: u64 = 10_000;
const SEEDS: [u64; 3] = [0, 1, u64::MAX];
const DEPTH_MM: f64 = 48.0;
const WIDTH_MM: f64 = 38.0;
const LINES: usize = 96;
const SAMPLES: usize = 240;

/// Limit in standard errors, exceeded by one of two million draws.
const UNLIKELY: f64 = 5.0;

pub(super) fn any(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    for gpu in &gpus {
        let [differing, compared] = differing_hashes(gpu, &SEEDS, 20_000)?;
        let adapter = &gpu.report().name;
        record.zero(
            format!("{adapter}: hashes that differ, of {compared}"),
            differing as f64,
        );
    }
    record.done(0.05);
    speckle(record, &gpus)?;
    noise(record, &gpus)
}

/// Tests the ratio of mean to standard deviation of samples three correlation lengths apart, in the first and last
/// frames of a sweep.
fn speckle(record: &mut Record<'_>, gpus: &[Gpu]) -> Result<(), Unexpected> {
    let speckle = Speckle {
        receive_bandwidth: None,
        axial_mm: Some(0.8),
        lateral_mm: Some(1.5),
        elevational_mm: Some(1.6),
        focus_mm: None,
        focal_zone_mm: Some(10_000.0),
    };
    let effects = Effects {
        speckle: Some(speckle),
        ..Effects::default()
    };
    let shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
    let settings = settings(shape, DEPTH_MM, [LINES as u32, SAMPLES as u32], effects);
    let fields = record.effort().pick(6, 30);
    let mut synths = everywhere(&anatomies::uniform(PLAIN), &settings, gpus)?;
    let count = synths.len();
    for (index, synth) in synths.iter_mut().enumerate() {
        let backend = name(synth);
        for seed in SEEDS {
            synth.set(Settings {
                seed,
                ..settings.clone()
            })?;
            for first_frame in [0, FRAMES - fields] {
                let deviation = rayleigh(synth, first_frame, fields)?;
                record.under(
                    format!(
                        "{backend}, seed {seed}, frames from {first_frame}: mean over deviation, standard errors from 1.913"
                    ),
                    deviation,
                    UNLIKELY,
                );
            }
        }
        // Speckle is fixed to the tissue: a returning probe sees the same pattern.
        let frame_state = |frame: u64| FrameState { frame, ..straight() };
        let before = synth.render_until("speckle_lateral", &frame_state(0))?.amplitude;
        let after = synth
            .render_until("speckle_lateral", &frame_state(FRAMES - 1))?
            .amplitude;
        let changed = before.iter().zip(&after).filter(|(a, b)| a != b).count();
        record.zero(
            format!("{backend}: echoes that another frame number changes"),
            changed as f64,
        );
        record.done(0.05 + 0.65 * (index + 1) as f64 / count as f64);
    }
    Ok(())
}

/// Returns the deviation of the ratio of mean to standard deviation from that of a Rayleigh distribution, sqrt(pi /
/// (4 - pi)), in standard errors; by the delta method the estimated ratio has the variance 1.85 / n.
fn rayleigh(synth: &mut Synthesizer, first_frame: u64, fields: u64) -> Result<f64, Unexpected> {
    // Three lengths apart, intensities are correlated by 1e-11 or less.
    let (line_step, sample_step) = (12, 12);
    let mut sample = Vec::new();
    for frame in first_frame..first_frame + fields {
        // More than three elevational lengths from the previous frame, and never in step with the lattice.
        let position =
            Vector3::new(0.137, 0.211, 5.319) * frame as f64 * 0.01 + Vector3::z() * 5.0 * (frame - first_frame) as f64;
        let state = FrameState {
            frame,
            ..FrameState::at(Matrix4::new_translation(&position))
        };
        let beam = synth.render_until("speckle_lateral", &state)?;
        for line in (0..LINES).step_by(sample_step) {
            let samples = (20..SAMPLES - 20).step_by(line_step);
            sample.extend(samples.map(|sample_index| beam.amplitude[line * SAMPLES + sample_index]));
        }
    }
    let [mean, variance] = moments(&sample);
    let expected = (std::f64::consts::PI / (4.0 - std::f64::consts::PI)).sqrt();
    Ok((mean / variance.sqrt() - expected).abs() / (1.85 / sample.len() as f64).sqrt())
}

/// Tests grey levels of constant tissue over the frames: mean, variance, and correlation of neighbouring frames.
fn noise(record: &mut Record<'_>, gpus: &[Gpu]) -> Result<(), Unexpected> {
    const STD_GREY: f64 = 6.0;
    let level = 127.3f64;
    let tissue = Acoustics {
        echo_db: 20.0 * (level / 255.0).log10(),
        ..PLAIN
    };
    let effects = Effects {
        noise: Some(Noise { std_grey: STD_GREY }),
        ..Effects::default()
    };
    let mut settings = settings(ProbeShape::Linear(Linear { width_mm: 20.0 }), 20.0, [4, 8], effects);
    (settings.image.width, settings.image.height) = (24, 16);
    settings.image.margin = 0.0;
    let frames = record.effort().pick(200, FRAMES);
    let mut synths = everywhere(&anatomies::uniform(tissue), &settings, gpus)?;
    let count = synths.len();
    for (index, synth) in synths.iter_mut().enumerate() {
        let backend = name(synth);
        // Different seeds give different noise: the frames are divided between the extreme seeds.
        for seed in [0, u64::MAX] {
            synth.set(Settings {
                seed,
                ..settings.clone()
            })?;
            let inside: Vec<usize> = (0..settings.image.width * settings.image.height)
                .filter(|pixel| synth.tables().scan_map[*pixel][0] >= 0.0)
                .collect();
            let (mut sum, mut squares, mut products, mut before) = (0.0, 0.0, 0.0, Vec::new());
            for frame in 0..frames {
                // Up to the last of the 1e4 frames, however few are rendered.
                let number = FRAMES - frames + frame;
                let pixels = &synth
                    .render(&FrameState {
                        frame: number,
                        ..straight()
                    })?
                    .pixels;
                let deviations: Vec<f64> = inside.iter().map(|pixel| f64::from(pixels[*pixel]) - level).collect();
                sum += deviations.iter().sum::<f64>();
                squares += deviations.iter().map(|x| x * x).sum::<f64>();
                products += deviations
                    .iter()
                    .zip(&before)
                    .map(|(a, b): (&f64, &f64)| a * b)
                    .sum::<f64>();
                before = deviations;
            }
            let n = (inside.len() as u64 * frames) as f64;
            // Rounding to integer grey levels adds 1/12.
            let variance = STD_GREY * STD_GREY + 1.0 / 12.0;
            let errors = [
                ("mean", (sum / n).abs() / (variance / n).sqrt()),
                (
                    "variance",
                    (squares / n - variance).abs() / (variance * (2.0 / n).sqrt()),
                ),
                (
                    "correlation of neighbouring frames",
                    (products / n).abs() / (variance / n.sqrt()),
                ),
            ];
            for (statistic, error) in errors {
                record.under(
                    format!("{backend}, seed {seed}: {statistic} of the noise, standard errors"),
                    error,
                    UNLIKELY,
                );
            }
        }
        record.done(0.7 + 0.3 * (index + 1) as f64 / count as f64);
    }
    Ok(())
}

fn moments(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    [mean, values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0)]
}

/// Hash of each point, where `points` holds each point followed by its seed.
const SHADER: &str = concat!(
    include_str!("../../../../shaders/common/hash.wgsl"),
    "
@group(0) @binding(1) var<storage, read> points: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read_write> words: array<vec4<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&words) {
        let seed = bitcast<vec2<u32>>(points[2u * id.x + 1u].xy);
        words[id.x] = vec4<u32>(hash3(points[2u * id.x].xyz, seed), 0u);
    }
}
"
);

/// Returns lattice points at the ends of the integer range, and a spread of others.
fn points(count: usize) -> Vec<[i32; 3]> {
    let ends = [0, 1, -1, i32::MIN, i32::MAX];
    let corners =
        (0..125).map(|index| [index % 5, index / 5 % 5, index / 25].map(|coordinate| ends[coordinate as usize]));
    let spread = (0..).map(|index: i32| hash3([index, 0, 0], [3, 5]).map(|word| word as i32));
    corners.chain(spread).take(count).collect()
}

/// Returns how many hashes differ from those of the CPU, and how many were compared.
///
/// # Errors
/// [`GpuError`] if the device cannot run the hash.
pub(super) fn differing_hashes(gpu: &Gpu, seeds: &[u64], count: usize) -> Result<[usize; 2], GpuError> {
    let points = points(count);
    let pairs = || {
        seeds
            .iter()
            .flat_map(|&seed| points.iter().map(move |&point| (point, seed_words(seed))))
    };
    let input: Vec<[i32; 4]> = pairs()
        .flat_map(|([x, y, z], seed)| [[x, y, z, 0], [seed[0] as i32, seed[1] as i32, 0, 0]])
        .collect();
    let expected: Vec<[u32; 3]> = pairs().map(|(point, seed)| hash3(point, seed)).collect();
    let points = StorageBuffer::upload(gpu, "points", &input)?;
    let bytes = (expected.len() * 16) as u64;
    let words = StorageBuffer::zeroed(gpu, "words", bytes)?;
    let pipeline = Pipeline::new(
        gpu,
        &PassSource {
            label: "hash",
            source: SHADER,
            entry: "main",
            storage: &[Access::Read, Access::Write],
            loops: Loops::COUNTED,
        },
    )?;
    let parameters = Parameters::new(gpu, "none", 1)?;
    let bindings = pipeline.bind(gpu, &parameters, &[&points, &words])?;
    let mut readback = Readback::new(gpu, "words", bytes)?;
    gpu.submit("hashes", |recorder| {
        recorder.run(
            "hashes",
            [Dispatch {
                pipeline: &pipeline,
                bindings: &bindings,
                slot: 0,
                workgroups: [expected.len().div_ceil(64) as u32, 1, 1],
            }],
        )?;
        recorder.read_back(&words, &readback)
    })?;
    // The shader writes four words a hash, as three would take the space of four in a storage array.
    let mut hashes = vec![[0u32; 4]; expected.len()];
    readback.read(gpu, &mut hashes)?;
    let differing = expected.iter().zip(&hashes).filter(|(a, b)| a[..] != b[..3]).count();
    Ok([differing, expected.len()])
}
