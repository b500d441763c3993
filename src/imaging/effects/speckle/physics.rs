//! Speckle on a constant tissue, before any blur: first- and second-order statistics.

use insonify_imaging::effects::shadow::Shadow;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::rf::Acquisition;
use insonify_imaging::rf::scatterers::RfSynthesizer;
use insonify_imaging::rf::signal::Lines;
use insonify_imaging::simulated::{self, AXIAL, CURVED_SPECKLE, LINEAR_SPECKLE};
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::Settings;
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_tracking::probe::{Apodisation, Linear, ProbeShape};
use nalgebra::{Matrix4, Vector3};

use crate::anatomies::Acoustics;
use crate::support::anatomy::{self, PLAIN};
use crate::support::scene;
use crate::support::scene::{precisions, synthesizer};
use crate::support::stats::{correlation, full_width, kolmogorov_smirnov, mean, std};

const LINES: usize = 96;
const SAMPLES: usize = 240;
const DEPTH_MM: f64 = 48.0;
const WIDTH_MM: f64 = 38.0;
const SAMPLE_MM: f64 = DEPTH_MM / SAMPLES as f64;
const LINE_MM: f64 = WIDTH_MM / (LINES as f64 - 1.0);

fn settings(speckle: Speckle) -> Settings {
    let probe = scene::probe(
        ProbeShape::Linear(Linear { width_mm: WIDTH_MM }),
        DEPTH_MM,
        LINES as u32,
        SAMPLES as u32,
    );
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.speckle = Some(speckle);
    settings
}

/// Speckle whose lateral width is the same at all depths.
fn even(axial_mm: f64, lateral_mm: f64, elevational_mm: f64) -> Speckle {
    Speckle {
        receive_bandwidth: None,
        axial_mm: Some(axial_mm),
        lateral_mm: Some(lateral_mm),
        elevational_mm: Some(elevational_mm),
        focus_mm: None,
        focal_zone_mm: Some(10_000.0),
    }
}

fn field(synthesizer: &mut Synthesizer, state: &FrameState) -> Beam {
    synthesizer.render_until("speckle_lateral", state).expect("a beam")
}

/// Speckle under `count` seeds, each at another place, so that the lattice of scatterers is met in all its phases.
fn fields(settings: &Settings, backend: Backend, count: u64) -> Vec<Beam> {
    let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), settings, backend);
    (0..count)
        .map(|number| {
            let seed = (number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            synthesizer
                .set(Settings {
                    seed,
                    ..settings.clone()
                })
                .expect("another seed");
            let translation = Vector3::new(0.137, 0.211, 0.319) * number as f64;
            field(
                &mut synthesizer,
                &FrameState::at(Matrix4::new_translation(&translation)),
            )
        })
        .collect()
}

/// A probe moved out of its plane.
fn beside(z: f64) -> FrameState {
    FrameState::at(Matrix4::new_translation(&Vector3::new(0.0, 0.0, z)))
}

/// Correlations of intensity at 0, 1, 2, ... samples along the beam, or scanlines across it, over all fields.
fn autocorrelation(fields: &[Beam], stride: usize, reach: usize, rows: std::ops::Range<usize>) -> Vec<f64> {
    (0..reach)
        .map(|lag| {
            let (mut a, mut b) = (Vec::new(), Vec::new());
            for beam in fields {
                for line in 0..beam.lines {
                    for sample in rows.clone() {
                        let (index, other) = (
                            line * beam.samples + sample,
                            line * beam.samples + sample + lag * stride,
                        );
                        let stays = if stride == 1 {
                            sample + lag < rows.end
                        } else {
                            line + lag < beam.lines
                        };
                        if stays {
                            a.push(beam.amplitude[index].powi(2));
                            b.push(beam.amplitude[other].powi(2));
                        }
                    }
                }
            }
            correlation(&a, &b)
        })
        .collect()
}

#[test]
fn amplitudes_are_rayleigh_distributed() {
    for (name, backend) in precisions() {
        // Three lengths apart, where intensities are correlated by (1/2)^36 = 1e-11 or less, samples count as
        // independent.
        let speckle = even(0.8, 1.5, 1.6);
        let (down, across) = ((2.4 / SAMPLE_MM).ceil() as usize, (4.5 / LINE_MM).ceil() as usize);
        let mut sample = Vec::new();
        for beam in fields(&settings(speckle), backend, 30) {
            for line in (0..LINES).step_by(across) {
                sample.extend(
                    (20..SAMPLES - 20)
                        .step_by(down)
                        .map(|i| beam.amplitude[line * SAMPLES + i]),
                );
            }
        }
        let n = sample.len() as f64;
        // Mean over standard deviation is sqrt(pi / (4 - pi)) = 1.913. By the delta method its estimate has the
        // variance (1 - r g + r^2 (k - 1) / 4) / n = 1.85 / n, with r the ratio, skewness g = 0.631 and kurtosis k =
        // 3.245.
        let ratio = mean(&sample) / std(&sample);
        assert!(
            (ratio - 1.913).abs() < 4.0 * (1.85 / n).sqrt(),
            "{name}: mean over standard deviation {ratio}, n {n}"
        );
        let distance = kolmogorov_smirnov(sample, |a| 1.0 - (-a * a).exp());
        println!("{name}: {n} samples, mean/std {ratio:.3}, Kolmogorov-Smirnov {distance:.3}");
        assert!(
            distance < 1.628,
            "{name}: not Rayleigh of power 1: {distance} above the 1 % level"
        );
    }
}

#[test]
fn mean_power_is_one_at_every_depth_and_line_edges_included() {
    for (name, backend) in precisions() {
        let speckle = Speckle {
            focal_zone_mm: Some(15.0),
            ..even(0.8, 1.5, 1.6)
        };
        let fields = fields(&settings(speckle), backend, 60);
        let check = |what: &str, position: usize, samples: &dyn Fn(&Beam) -> Vec<f64>| {
            let powers: Vec<f64> = fields
                .iter()
                .map(|beam| mean(&samples(beam).iter().map(|a| a * a).collect::<Vec<_>>()))
                .collect();
            let error = std(&powers) / (powers.len() as f64).sqrt();
            let deviation = (mean(&powers) - 1.0).abs();
            // Of 336 rows one in 1,500 runs lies beyond 5 standard errors.
            assert!(
                deviation < 5.0 * error,
                "{name}: power {} at {what} {position}, standard error {error}",
                mean(&powers)
            );
        };
        for sample in 0..SAMPLES {
            check("sample", sample, &|beam| {
                (0..LINES).map(|line| beam.amplitude[line * SAMPLES + sample]).collect()
            });
        }
        for line in 0..LINES {
            check("line", line, &|beam| {
                beam.amplitude[line * SAMPLES..][..SAMPLES].to_vec()
            });
        }
    }
}

#[test]
fn correlation_lengths_are_those_asked() {
    for (axial, lateral, elevational) in [(0.8, 1.5, 1.6), (1.2, 1.2, 1.2), (0.6, 2.4, 2.2), (1.0, 4.0, 1.5)] {
        let settings = settings(even(axial, lateral, elevational));
        let fields = fields(&settings, Backend::CpuF64, 12);
        let found_axial = full_width(&autocorrelation(&fields, 1, 16, 20..SAMPLES - 20), SAMPLE_MM);
        let found_lateral = full_width(&autocorrelation(&fields, SAMPLES, 24, 20..SAMPLES - 20), LINE_MM);
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, Backend::CpuF64);
        let step = elevational / 8.0;
        let intensity = |synthesizer: &mut Synthesizer, z: f64| -> Vec<f64> {
            field(synthesizer, &beside(z)).amplitude.iter().map(|a| a * a).collect()
        };
        // Several places, so that the lattice is met in all its phases.
        let places = [0.0, 11.3, 24.9, 37.1, 51.7, 66.2];
        let mut by_distance = vec![0.0; 14];
        for position in places {
            let first = intensity(&mut synthesizer, position);
            for (lag, sum) in by_distance.iter_mut().enumerate() {
                *sum += correlation(&first, &intensity(&mut synthesizer, position + lag as f64 * step))
                    / places.len() as f64;
            }
        }
        let found_elevational = full_width(&by_distance, step);
        println!(
            "asked {axial} x {lateral} x {elevational} mm, found {found_axial:.3} x {found_lateral:.3} x {found_elevational:.3}"
        );
        let lengths = [
            ("axial", axial, found_axial),
            ("lateral", lateral, found_lateral),
            ("elevational", elevational, found_elevational),
        ];
        for (what, expected, measured) in lengths {
            assert!(
                (measured / expected - 1.0).abs() < 0.12,
                "{what} length {measured} mm instead of {expected}"
            );
        }
    }
}

#[test]
fn lateral_length_grows_away_from_the_focus() {
    let speckle = Speckle {
        focus_mm: Some(12.0),
        focal_zone_mm: Some(12.0),
        ..even(0.8, 1.5, 1.6)
    };
    let fields = fields(&settings(speckle), Backend::CpuF64, 30);
    for depth in [12.0, 24.0, 36.0] {
        let expected = 1.5 * (1.0f64 + ((depth - 12.0) / 12.0f64).powi(2)).sqrt();
        let middle = (depth / SAMPLE_MM) as usize;
        let width = full_width(
            &autocorrelation(&fields, SAMPLES, 24, middle - 12..middle + 12),
            LINE_MM,
        );
        println!("{depth} mm: asked {expected:.2}, found {width:.2}");
        assert!(
            (width / expected - 1.0).abs() < 0.12,
            "{width} mm at {depth} mm, not {expected}"
        );
    }
}

#[test]
fn speckle_decorrelates_out_of_plane_and_between_seeds() {
    for (name, backend) in precisions() {
        let settings = settings(even(0.8, 1.5, 1.6));
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, backend);
        let first = field(&mut synthesizer, &beside(0.0)).amplitude;
        // Cells of one correlation area each: a correlation of independent fields has a standard deviation of 1 /
        // sqrt(n).
        let cells = WIDTH_MM / 1.5 * DEPTH_MM / 0.8;
        let limit = 4.0 / cells.sqrt();
        let beside = field(&mut synthesizer, &beside(4.0)).amplitude;
        let measured = correlation(&first, &beside);
        assert!(
            measured.abs() < limit,
            "{name}: correlation {measured} at 2.5 elevational lengths"
        );
        let near = field(&mut synthesizer, &self::beside(0.2)).amplitude;
        // By a Gaussian of that width 2^-(1/16) = 0.96 is left.
        let left = correlation(&first, &near);
        assert!(
            (left - 0.96).abs() < 0.03,
            "{name}: {left} is left of the correlation at an eighth of a length"
        );
        let seed = settings.seed ^ (1 << 40);
        synthesizer
            .set(Settings {
                seed,
                ..settings.clone()
            })
            .expect("another seed");
        let other = field(&mut synthesizer, &scene::straight()).amplitude;
        let measured = correlation(&first, &other);
        assert!(
            measured.abs() < limit,
            "{name}: correlation {measured} between seeds that differ in one high bit"
        );
    }
}

/// Fields of an array of the simulation.
fn fields_of(is_curved: bool, apodisation: Apodisation, count: u64) -> Vec<Beam> {
    let mut settings = scene::settings(simulated::probe(is_curved, apodisation), scene::bare());
    settings.effects.speckle = Some(Speckle::default());
    fields(&settings, Backend::Cpu, count)
}

#[test]
fn arrays_have_the_speckle_of_a_simulator_of_waves() {
    // The axial length does not change with depth there: it is the mean, of lengths that scatter by 5 %.
    for (is_curved, axial_mm, rows) in [
        (false, AXIAL[0][1], &LINEAR_SPECKLE[..]),
        (true, AXIAL[1][1], &CURVED_SPECKLE),
    ] {
        for apodisation in [Apodisation::Hann, Apodisation::None] {
            let beams = fields_of(is_curved, apodisation, 3);
            let sample_mm = if is_curved { 145.0 / 2417.0 } else { 0.025 };
            for [depth_mm, hann_mm, none_mm] in rows {
                let lateral_mm = if apodisation == Apodisation::Hann {
                    hann_mm
                } else {
                    none_mm
                };
                let line_mm = if is_curved { 0.004 * (49.57 + depth_mm) } else { 0.2 };
                let half_mm = if is_curved { 7.5 } else { 3.0 };
                let window = ((depth_mm - half_mm) / sample_mm) as usize..((depth_mm + half_mm) / sample_mm) as usize;
                let lengths = [
                    (1, sample_mm, axial_mm, 0.1),
                    (beams[0].samples, line_mm, *lateral_mm, 0.15),
                ];
                for (stride, step_mm, expected_mm, within) in lengths {
                    let correlation = autocorrelation(&beams, stride, 16, window.clone());
                    let length_mm = full_width(&correlation, step_mm);
                    let off = length_mm / expected_mm - 1.0;
                    println!("{apodisation:?} {depth_mm} mm: {length_mm:.3} mm, simulated {expected_mm:.3}");
                    assert!(
                        off.abs() < within,
                        "{apodisation:?} {depth_mm} mm: {length_mm}, not {expected_mm}"
                    );
                }
            }
            // Rayleigh: 1.913, and 5.57 dB. The power ripples a little where scanlines run along the lattice.
            let amplitudes: Vec<f64> = beams.iter().flat_map(|beam| beam.amplitude.iter().copied()).collect();
            let ratio = mean(&amplitudes) / std(&amplitudes);
            let levels: Vec<f64> = amplitudes.iter().map(|amplitude| 20.0 * amplitude.log10()).collect();
            let deviation = std(&levels);
            println!("{apodisation:?}: mean over standard deviation {ratio:.3}, {deviation:.2} dB");
            assert!((1.85..1.95).contains(&ratio), "mean over standard deviation {ratio}");
            assert!((5.4..5.8).contains(&deviation), "{deviation} dB");
        }
    }
}

/// Echoes of point scatterers, each with its pulse and the beam where it lies, are another route to the same grain.
#[test]
fn radio_frequency_echoes_have_the_speckle_of_the_simulator() {
    let settings = scene::settings(simulated::probe(false, Apodisation::Hann), scene::bare());
    let acquisition = Acquisition {
        bandwidth: 0.55,
        ..Acquisition::new(7.6)
    };
    let mut synthesizer =
        RfSynthesizer::new(anatomy::uniform(PLAIN), settings, acquisition).expect("a synthesiser of echoes");
    let echoes = synthesizer.render(&scene::straight()).expect("echoes");
    let (lines, samples) = (synthesizer.lines(), synthesizer.samples());
    let envelope = Lines::new(samples).envelope(&echoes);
    let beam = Beam {
        lines,
        samples,
        amplitude: envelope.into_iter().map(f64::from).collect(),
        ..Beam::default()
    };
    let (beams, sample_mm) = ([beam], acquisition.sample_mm());
    for [depth_mm, lateral_mm, _] in LINEAR_SPECKLE {
        let window = ((depth_mm - 3.0) / sample_mm) as usize..((depth_mm + 3.0) / sample_mm) as usize;
        for (stride, step_mm, expected_mm) in [(1, sample_mm, AXIAL[0][1]), (samples, 0.2, lateral_mm)] {
            let length_mm = full_width(&autocorrelation(&beams, stride, 24, window.clone()), step_mm);
            println!("{depth_mm} mm: {length_mm:.3} mm, simulated {expected_mm:.3}");
            let off = length_mm / expected_mm - 1.0;
            assert!(off.abs() < 0.15, "{depth_mm} mm: {length_mm}, not {expected_mm}");
        }
    }
}

/// Centroids of SIMUS' pulses at 0.5 dB/cm/MHz (closed form), over that at the surface. Crossings of zero count the
/// root mean square of the frequency, which goes with the centre.
#[test]
fn radio_frequency_echoes_sink_in_frequency_as_tissue_attenuates() {
    let mut settings = scene::settings(simulated::probe(false, Apodisation::Hann), scene::bare());
    settings.effects.shadow = Some(Shadow::default());
    let acquisition = Acquisition {
        snr_db: 100.0,
        ..Acquisition::new(7.6)
    };
    let attenuating = Acoustics {
        attenuation_db_cm_mhz: 0.5,
        ..PLAIN
    };
    let mut synthesizer =
        RfSynthesizer::new(anatomy::uniform(attenuating), settings, acquisition).expect("a synthesiser of echoes");
    let echoes = synthesizer.render(&scene::straight()).expect("echoes");
    let samples = synthesizer.samples();
    let frequency_mhz = |depth_mm: f64| {
        let [from, to] = [-4.0, 4.0].map(|mm| ((depth_mm + mm) / acquisition.sample_mm()) as usize);
        let crossings = echoes.chunks(samples).flat_map(|line| line[from..to].windows(2));
        let count = crossings.clone().filter(|pair| pair[0] * pair[1] < 0.0).count();
        0.5 * acquisition.sampling_mhz * count as f64 / crossings.count() as f64
    };
    // Centre 7.6 MHz, and a power spectrum of 0.6 / 2.355 / sqrt 2 of it.
    let surface_mhz = 7.6 * (1.0 + (0.6 / 2.355_f64).powi(2) / 2.0).sqrt();
    for (depth_mm, centroid_mhz) in [(10.0, 6.860), (20.0, 6.455), (30.0, 6.118), (40.0, 5.845)] {
        let off = frequency_mhz(depth_mm) / surface_mhz / (centroid_mhz / 7.321) - 1.0;
        println!("{depth_mm} mm: off by {off:.3}");
        assert!(off.abs() < 0.03, "{} MHz at {depth_mm} mm", frequency_mhz(depth_mm));
    }
}
