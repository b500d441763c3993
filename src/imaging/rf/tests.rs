use std::f64::consts::{PI, TAU};

use rustfft::FftPlanner;
use rustfft::num_complex::Complex32;

use super::echoes::{Pulse, Scatterer, echoes};
use super::file::Echoes;
use super::motion::{Estimate, Options, Tracker};
use super::signal::Lines;
use super::*;
use crate::base::random::{hash3, unit};

const LINES: usize = 48;
const SAMPLES: usize = 1600;
const PITCH_MM: f64 = 0.1484;
const ACQUISITION: Acquisition = Acquisition {
    frequency_mhz: 5.0,
    bandwidth: 0.6,
    sampling_mhz: 40.0,
    snr_db: 30.0,
    per_cell: 10.0,
};
/// Standard deviation of the elevational and of the lateral profile, mm and lines.
const SIGMA: [f64; 2] = [0.535, 3.0];

fn random(item: i32, stream: i32) -> f64 {
    f64::from(unit(hash3([item, stream, 31], [8, 9])[0]))
}

fn normal(item: i32, stream: i32) -> f64 {
    (-2.0 * (1.0 - random(item, stream)).ln()).sqrt() * (TAU * random(item, stream + 1000)).cos()
}

/// Echoes of a random medium displaced by a function of depth and lateral position (mm), and noise 30 dB below them.
fn frame(noise: i32, moved: impl Fn(f64) -> [f64; 2]) -> Vec<f32> {
    let depth_mm = SAMPLES as f64 * ACQUISITION.sample_mm();
    // Ten in a cell of 0.23 x 1.05 x 1.26 mm.
    let count = (33.0 * (depth_mm + 2.0) * 3.2 * (LINES as f64 + 24.0) * PITCH_MM) as i32;
    let mut scatterers: Vec<Scatterer> = (0..count)
        .map(|item| {
            let z = random(item, 1) * (depth_mm + 2.0) - 1.0;
            let line = random(item, 2) * (LINES as f64 + 24.0) - 12.0;
            let beyond = (random(item, 3) - 0.5) * 3.2 / SIGMA[0];
            let [axial, lateral] = moved(z);
            Scatterer {
                line: (line + lateral / PITCH_MM) as f32,
                sample: (z + axial) / ACQUISITION.sample_mm(),
                amplitude: (normal(item, 4).signum() * (-0.5 * beyond * beyond).exp()) as f32,
                sigma: SIGMA[1] as f32,
            }
        })
        .collect();
    let mut found = echoes(&mut scatterers, &Pulse::new(&ACQUISITION), LINES, SAMPLES);
    let rms = (found.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>() / found.len() as f64).sqrt();
    let level = rms * 10_f64.powf(-ACQUISITION.snr_db / 20.0);
    for (at, value) in found.iter_mut().enumerate() {
        *value += (level * normal(at as i32, 50 + noise)) as f32;
    }
    found
}

fn options() -> Options {
    Options {
        windows: 50,
        ..Options::new(40.0, PITCH_MM)
    }
}

/// Bias and standard deviation of the axial and of the lateral error, um, away from the edges.
fn errors(found: &[Estimate], moved: impl Fn(f64) -> [f64; 2]) -> [[f64; 2]; 2] {
    let options = options();
    let centres = options.centres_mm(SAMPLES);
    let inner = || {
        let all = found
            .iter()
            .enumerate()
            .map(|(at, it)| (at / options.windows, at % options.windows, it));
        all.filter(|(line, window, _)| (4..LINES - 4).contains(line) && *window + 1 < options.windows)
    };
    let n = inner().count() as f64;
    [0, 1].map(|axis| {
        let error =
            |window: usize, it: &Estimate| [it.axial_um, it.lateral_um][axis] - 1e3 * moved(centres[window])[axis];
        let bias = inner().map(|(_, window, it)| error(window, it)).sum::<f64>() / n;
        let square = inner()
            .map(|(_, window, it)| (error(window, it) - bias).powi(2))
            .sum::<f64>()
            / n;
        [bias, square.sqrt()]
    })
}

#[test]
fn the_phase_of_an_echo_follows_its_depth() {
    let pulse = Pulse::new(&ACQUISITION);
    let phase = |depth_mm: f64| {
        let mut one = [Scatterer {
            line: 0.0,
            sample: depth_mm / ACQUISITION.sample_mm(),
            amplitude: 1.0,
            sigma: 1.0,
        }];
        let line = echoes(&mut one, &pulse, 1, 512);
        let mut spectrum: Vec<Complex32> = line.iter().map(|value| Complex32::new(*value, 0.0)).collect();
        FftPlanner::new().plan_fft_forward(512).process(&mut spectrum);
        // 64 periods of 5 MHz in 512 samples of 40 MHz.
        f64::from(spectrum[64].arg())
    };
    let start = phase(4.0);
    for moved_mm in [0.0001, 0.001, 0.01, 0.0377] {
        let expected = -2.0 * TAU * 5.0 * moved_mm / (SPEED_M_S * 1e-3);
        let found = phase(4.0 + moved_mm) - start;
        let off = (found - expected + PI).rem_euclid(TAU) - PI;
        // 2 d fs / c samples, to a thousandth of a sample.
        assert!(
            off.abs() < TAU * 5.0 / 40.0 * 1e-3,
            "{moved_mm} mm: {found} for {expected}"
        );
    }
    assert!((1.0 / ACQUISITION.sample_mm() - 51.95).abs() < 0.01);
}

#[test]
fn the_spectrum_is_that_of_the_pulse_and_the_envelope_is_rayleigh_distributed() {
    let found = frame(0, |_| [0.0; 2]);
    let envelope = Lines::new(SAMPLES, 1).envelope(&found);
    let n = envelope.len() as f64;
    let mean = envelope.iter().map(|value| f64::from(*value)).sum::<f64>() / n;
    let square = envelope
        .iter()
        .map(|value| (f64::from(*value) - mean).powi(2))
        .sum::<f64>()
        / n;
    let ratio = mean / square.sqrt();
    assert!(
        (ratio / 1.913 - 1.0).abs() < 0.06,
        "mean over standard deviation {ratio}"
    );
    let mut power = vec![0.0; 1024];
    for line in found.chunks(SAMPLES) {
        let mut spectrum: Vec<Complex32> = line[..1024].iter().map(|value| Complex32::new(*value, 0.0)).collect();
        FftPlanner::new().plan_fft_forward(1024).process(&mut spectrum);
        power
            .iter_mut()
            .zip(&spectrum)
            .for_each(|(sum, value)| *sum += f64::from(value.norm_sqr()));
    }
    // Without the white noise beyond the pulse.
    let floor = power[400..500].iter().sum::<f64>() / 100.0;
    let band = (1..400).map(|at| (at as f64 * 40.0 / 1024.0, (power[at] - floor).max(0.0)));
    let (sum, first) = band
        .clone()
        .fold((0.0, 0.0), |(sum, first), (f, p)| (sum + p, first + f * p));
    let centroid = first / sum;
    let width = (band.map(|(f, p)| (f - centroid).powi(2) * p).sum::<f64>() / sum).sqrt();
    assert!((centroid - 5.0).abs() < 0.05, "{centroid} MHz");
    // Power exp(-(2 pi (f - f0) s)^2): a standard deviation of 1 / (2 pi s sqrt 2).
    let expected = 1.0 / (TAU * ACQUISITION.sigma_us() * 2_f64.sqrt());
    assert!((width / expected - 1.0).abs() < 0.05, "{width} MHz for {expected}");
}

#[test]
fn upsampled_lines_pass_through_their_samples() {
    let found = frame(0, |_| [0.0; 2]);
    let twice = Lines::new(SAMPLES, 2).upsampled(&found);
    let most = found.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
    let off = found
        .iter()
        .zip(twice.iter().step_by(2))
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!(off < 1e-5 * most, "{off} of {most}");
}

#[test]
fn rigid_motion_is_found_to_a_fraction_of_a_micrometre() {
    let first = frame(0, |_| [0.0; 2]);
    // Walker and Trahey, IEEE Transactions on Ultrasonics, Ferroelectrics and Frequency Control 42, 1995, at correlation 1: noise counts within the band.
    let [f0, b, t] = [5.0, 0.6, 2e3 / SPEED_M_S];
    let snr2 = 10_f64.powf(ACQUISITION.snr_db / 10.0) * (ACQUISITION.sampling_mhz / 2.0) / (b * f0);
    let variance = 3.0 / (2.0 * f0.powi(3) * PI * PI * t * (b.powi(3) + 12.0 * b)) * ((1.0 + 1.0 / snr2).powi(2) - 1.0);
    let bound_um = variance.sqrt() * SPEED_M_S / 2.0;
    for axial_mm in [0.0, 0.005, 0.1234, 0.5] {
        let mut tracker = Tracker::new(options(), LINES, &first);
        let found = tracker.next(&frame(1, |_| [axial_mm, 0.0]));
        let [[bias, sd], [lateral_bias, lateral_sd]] = errors(&found, |_| [axial_mm, 0.0]);
        assert!(
            bias.abs() < 0.05 && sd < 0.3,
            "{axial_mm} mm: bias {bias} um, SD {sd} um"
        );
        assert!(
            (1.0..2.0).contains(&(sd / bound_um)),
            "{axial_mm} mm: SD {sd} um, bound {bound_um} um"
        );
        assert!(
            lateral_bias.abs() < 3.0 && lateral_sd < 30.0,
            "{lateral_bias} {lateral_sd}"
        );
    }
    let mut tracker = Tracker::new(options(), LINES, &first);
    let found = tracker.next(&frame(1, |_| [0.0, 0.2]));
    let [_, [bias, sd]] = errors(&found, |_| [0.0, 0.2]);
    assert!(bias.abs() < 6.0 && sd < 30.0, "lateral: bias {bias} um, SD {sd} um");
}

#[test]
fn strain_costs_correlation_and_a_prior_saves_searches() {
    let first = frame(0, |_| [0.0; 2]);
    let strained = |z: f64| [-0.01 * z, 0.0];
    let second = frame(1, strained);
    let mut tracker = Tracker::new(options(), LINES, &first);
    let [[bias, sd], _] = errors(&tracker.next(&second), strained);
    assert!(bias.abs() < 0.3 && sd < 2.0, "bias {bias} um, SD {sd} um");
    let all = Options {
        prior: false,
        ..options()
    };
    let mut exhaustive = Tracker::new(all, LINES, &first);
    let [[_, wide_sd], _] = errors(&exhaustive.next(&second), strained);
    assert!(
        wide_sd < 2.0 && exhaustive.correlations > 8 * tracker.correlations,
        "{wide_sd} um"
    );
}

#[test]
fn motion_adds_up_over_changes_of_the_reference() {
    let strained = |share: f64| move |z: f64| [-0.03 * share * z, 0.0];
    let mut tracker = Tracker::new(options(), LINES, &frame(0, |_| [0.0; 2]));
    let mut last = Vec::new();
    for step in 1..=6 {
        last = tracker.next(&frame(step, strained(f64::from(step) / 6.0)));
    }
    assert!((1..6).contains(&tracker.switches), "{}", tracker.switches);
    let centres = options().centres_mm(SAMPLES);
    let off = last
        .iter()
        .enumerate()
        .map(|(at, it)| it.axial_um - 1e3 * strained(1.0)(centres[at % 50])[0]);
    // Half a wavelength is 154 um: few windows lock onto a neighbouring period.
    let near: Vec<f64> = off.filter(|off| off.abs() < 50.0).collect();
    let n = near.len() as f64;
    let sd = (near.iter().map(|off| off * off).sum::<f64>() / n).sqrt();
    assert!(n > 0.95 * last.len() as f64 && sd < 8.0, "{sd} um of {n} windows");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let made = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let first = frame(0, |_| [0.0; 2]);
            let mut tracker = Tracker::new(options(), LINES, &first);
            let found = tracker.next(&frame(1, |z| [0.002 * z, 0.05]));
            (first, found, tracker.correlations)
        })
    };
    assert!(made(1) == made(3));
}

fn written(head: &str, values: &[i16]) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mha");
    let mut bytes = head.as_bytes().to_vec();
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn head(sizes: [usize; 3], more: &str) -> String {
    let [x, y, z] = sizes;
    format!(
        "NDims = 3\nDimSize = {x} {y} {z}\nElementSpacing = 1 1 1\nElementType = MET_SHORT\n{more}ElementDataFile = LOCAL\n"
    )
}

#[test]
fn sequences_of_scanners_are_read_line_by_line() {
    let values: Vec<i16> = (0..16 * 4).collect();
    let read = |sizes: [usize; 3], more: &str| {
        let (_folder, path) = written(&head(sizes, more), &values);
        Echoes::read(&path).unwrap()
    };
    let real = read(
        [16, 4, 1],
        "UltrasoundImageOrientation = FM\nUltrasoundImageType = RF_REAL\nRfSamplingMHz = 40\n",
    );
    assert_eq!((real.lines, real.samples, real.baseband), (4, 16, false));
    assert_eq!((real.frames[0][17], real.stated[0]), (17.0, Some(40.0)));
    // Rows of samples along the array, and samples that run up.
    let turned = read(
        [4, 16, 1],
        "UltrasoundImageOrientation = MF\nUltrasoundImageType = RF_REAL\n",
    );
    assert_eq!((turned.lines, turned.samples), (4, 16));
    assert_eq!(turned.frames[0][..3], [0.0, 4.0, 8.0]);
    let up = read(
        [16, 4, 1],
        "UltrasoundImageOrientation = NU\nUltrasoundImageType = RF_REAL\n",
    );
    assert_eq!(up.frames[0][..2], [63.0, 62.0]);
    let pairs = read(
        [32, 2, 1],
        "UltrasoundImageOrientation = FM\nUltrasoundImageType = RF_IQ_LINE\n",
    );
    assert_eq!((pairs.lines, pairs.samples, pairs.baseband), (2, 16, true));
    assert_eq!(bmode::envelope(&pairs, 0)[1], 2_f32.hypot(3.0));
    let rows = read(
        [16, 4, 1],
        "UltrasoundImageOrientation = FM\nUltrasoundImageType = RF_I_LINE_Q_LINE\n",
    );
    assert_eq!((rows.lines, rows.samples), (2, 16));
    assert_eq!(rows.frames[0][..4], [0.0, 16.0, 1.0, 17.0]);
    let slices = read([16, 2, 2], "");
    assert_eq!((slices.frames.len(), slices.notes.len()), (2, 2));
}

#[test]
fn sequences_without_echoes_are_refused() {
    let refused = |head: &str, values: &[i16], words: &str| {
        let (_folder, path) = written(head, values);
        let error = Echoes::read(&path).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("a.mha"), "{error}");
    };
    let values: Vec<i16> = (0..64).collect();
    refused(
        &head([16, 4, 1], "UltrasoundImageType = BRIGHTNESS\n"),
        &values,
        "images of type BRIGHTNESS",
    );
    refused(
        &head([16, 4, 1], "UltrasoundImageType = RF_REAL\n"),
        &[7; 64],
        "most neighbouring samples are equal",
    );
    refused(
        &head([8, 8, 1], "UltrasoundImageType = RF_REAL\n"),
        &values,
        "lines of at least 16 samples",
    );
}
