use std::f64::consts::{PI, TAU};

use crate::rf::fft::{Complex32, Fft};

use super::device::Device;
use super::echoes::{Pulse, Scatterer, echoes};
use super::file::Echoes;
use super::medium::{Medium, PITCH_MM};
use super::motion::{Estimate, Options, Tracker};
use super::signal::{Lines, upsampled};
use super::*;

const LINES: usize = 48;
const SAMPLES: usize = 1600;

fn medium() -> Medium {
    Medium::new(LINES, SAMPLES)
}

/// Echoes of a medium displaced by a function of depth, with noise 30 dB below them.
fn frame(noise: i32, moved: impl Fn(f64) -> [f64; 2] + Sync) -> Vec<f32> {
    medium().frame(noise, moved)
}

fn acquisition() -> Acquisition {
    medium().acquisition
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
    let pulse = Pulse::new(&acquisition(), 1.0);
    let phase = |depth_mm: f64| {
        let mut one = [Scatterer {
            line: 0.0,
            sample: depth_mm / acquisition().sample_mm(),
            amplitude: 1.0,
            sigma: 1.0,
            centre: 1.0,
        }];
        let line: Vec<f32> = echoes(&mut one, &pulse, 1, 512);
        let mut spectrum: Vec<Complex32> = line.iter().map(|value| Complex32::new(*value, 0.0)).collect();
        Fft::new(512).forward(&mut spectrum);
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
    assert!((1.0 / acquisition().sample_mm() - 51.95).abs() < 0.01);
}

#[test]
fn the_spectrum_is_that_of_the_pulse_and_the_envelope_is_rayleigh_distributed() {
    let found = frame(0, |_| [0.0; 2]);
    let envelope = Lines::new(SAMPLES).envelope(&found);
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
        Fft::new(1024).forward(&mut spectrum);
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
    let expected = 1.0 / (TAU * acquisition().sigma_us() * 2_f64.sqrt());
    assert!((width / expected - 1.0).abs() < 0.05, "{width} MHz for {expected}");
}

#[test]
fn upsampled_lines_pass_through_their_samples() {
    let found = frame(0, |_| [0.0; 2]);
    let twice = upsampled(&found, SAMPLES, 2);
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
    // Walker and Trahey, IEEE Transactions on Ultrasonics, Ferroelectrics and Frequency Control 42, 1995, at
    // correlation 1: noise counts within the band.
    let [f0, b, t] = [5.0, 0.6, 2e3 / SPEED_M_S];
    let snr2 = 10_f64.powf(acquisition().snr_db / 10.0) * (acquisition().sampling_mhz / 2.0) / (b * f0);
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

/// Windows at the array whose tissue has left the image, or came in, find no place of their own; none below may follow
/// them.
#[test]
fn no_window_follows_a_wrong_place_near_the_array() {
    for moved in [
        (|z| [-0.5 - 0.01 * z, 0.0]) as fn(f64) -> [f64; 2],
        |_| [0.6, 0.0],
        |_| [-0.7, 0.0],
    ] {
        let medium = Medium {
            before_mm: 3.0,
            ..medium()
        };
        let mut tracker = Tracker::new(options(), LINES, &medium.frame(0, |_| [0.0; 2]));
        let found = tracker.next(&medium.frame(1, moved));
        let centres = options().centres_mm(SAMPLES);
        let trusted = found.iter().enumerate().filter(|(_, it)| it.correlation >= 0.8);
        let errors: Vec<f64> = trusted
            .map(|(at, it)| it.axial_um - 1e3 * moved(centres[at % 50])[0])
            .collect();
        let wrong = errors.iter().filter(|error| error.abs() > 20.0).count();
        assert!(
            errors.len() * 100 > found.len() * 95,
            "{} of {}",
            errors.len(),
            found.len()
        );
        assert!(
            wrong * 1000 <= errors.len(),
            "{wrong} of {} at a wrong place",
            errors.len()
        );
    }
}

#[test]
fn motion_adds_up_over_changes_of_the_reference() {
    let strained = |share: f64| move |z: f64| [-0.03 * share * z, 0.0];
    let mut tracker = Tracker::new(options(), LINES, &frame(0, |_| [0.0; 2]));
    let mut last = Vec::new();
    for step in 1..=6 {
        last = tracker.next(&frame(step, strained(f64::from(step) / 6.0)));
    }
    assert!((1.0..6.0).contains(&tracker.references()), "{}", tracker.references());
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

/// Tissue beside a needle: a tenth of the image is strained and sheared by up to 30 %, 1.5 % in each frame, and the
/// rest stays.
#[test]
fn windows_in_a_dent_are_right_or_reported_as_lost() {
    const LINES: usize = 100;
    let medium = Medium::new(LINES, 2078);
    let options = Options::new(40.0, PITCH_MM);
    let centres = options.centres_mm(medium.samples);
    let middle = [20.0, 49.5 * PITCH_MM];
    let dented = |frame: i32, [z, x]: [f64; 2]| {
        let square = (z - middle[0]).powi(2) + (x - middle[1]).powi(2);
        0.05 * f64::from(frame) * (-square / 8.0).exp()
    };
    let frame = |number: i32| medium.frame_in_plane(number, |z, x| [dented(number, [z, x]), 0.0]);
    let mut tracker = Tracker::new(options, LINES, &frame(0));
    for number in 1..=20 {
        let found = tracker.next(&frame(number));
        let near = found.iter().enumerate().filter_map(|(index, estimate)| {
            let place = [
                centres[index % options.windows],
                (index / options.windows) as f64 * PITCH_MM,
            ];
            let is_near = (place[0] - middle[0]).abs() < 4.0 && (place[1] - middle[1]).abs() < 3.0;
            is_near.then(|| (estimate, estimate.axial_um - 1e3 * dented(number, place)))
        });
        let near: Vec<_> = near.collect();
        let trusted = near
            .iter()
            .filter(|(estimate, _)| estimate.is_trusted(options.fallback));
        let errors: Vec<f64> = trusted.map(|(_, error)| *error).collect();
        let share = errors.len() as f64 / near.len() as f64;
        let bias = insonify_base::statistics::mean(&errors);
        let spread = insonify_base::statistics::std(&errors);
        let largest = errors.iter().fold(0.0_f64, |largest, error| largest.max(error.abs()));
        assert!(
            spread < 5.0 && bias.abs() < 1.0 && largest < 50.0,
            "frame {number}: bias {bias} um, SD {spread} um, largest {largest} um"
        );
        assert!(share > 0.9, "frame {number}: {share} not lost");
    }
    assert!((1.0..4.0).contains(&tracker.references()), "{}", tracker.references());
}

/// A window whose echoes are exchanged is lost, and found again with its motion when they return.
#[test]
fn a_lost_window_keeps_its_reference_until_it_is_found() {
    let moved = |frame: i32| move |_: f64| [0.04 * f64::from(frame), 0.0];
    let elsewhere = Medium::new(LINES, SAMPLES).frame(9, |z| [7.3, 3.0 + 0.1 * z]);
    let options = options();
    let centres = options.centres_mm(SAMPLES);
    let mut tracker = Tracker::new(options, LINES, &frame(0, moved(0)));
    for number in 1..=6 {
        let mut echoes = frame(number, moved(number));
        let exchanged = (2..=4).contains(&number);
        if exchanged {
            // 6 mm of depth across the image.
            for (line, other) in echoes.chunks_mut(SAMPLES).zip(elsewhere.chunks(SAMPLES)) {
                line[600..912].copy_from_slice(&other[600..912]);
            }
        }
        let found = tracker.next(&echoes);
        let inside = found.iter().enumerate().filter(|(index, _)| {
            let sample = centres[index % options.windows] / acquisition().sample_mm();
            (660.0..852.0).contains(&sample)
        });
        let (mut trusted, mut wrong, mut all) = (0, 0, 0);
        for (_, estimate) in inside {
            all += 1;
            if estimate.is_trusted(options.fallback) {
                trusted += 1;
                wrong += usize::from((estimate.axial_um - 40.0 * f64::from(number)).abs() > 5.0);
            }
        }
        let expected = if exchanged { 0..=all / 50 } else { all * 2 / 3..=all };
        assert!(expected.contains(&trusted), "frame {number}: {trusted} of {all}");
        assert!(exchanged || wrong == 0, "frame {number}: {wrong} wrong");
    }
}

#[test]
fn lateral_motion_grows_with_the_distance_between_diverging_lines() {
    let first = frame(0, |_| [0.0; 2]);
    let second = frame(1, |_| [0.0, 0.2]);
    let lateral = |line_angle: f64| {
        let options = Options {
            line_angle,
            ..options()
        };
        Tracker::new(options, LINES, &first).next(&second)
    };
    let angle = 0.01;
    let centres = options().centres_mm(SAMPLES);
    for (index, (parallel, fan)) in lateral(0.0).iter().zip(&lateral(angle)).enumerate() {
        let expected = parallel.lateral_um * (1.0 + angle * centres[index % options().windows] / PITCH_MM);
        assert!((fan.lateral_um - expected).abs() < 1e-6 && fan.axial_um == parallel.axial_um);
    }
}

/// Rounding unit of single precision.
const UNIT: f64 = 0.5 * f32::EPSILON as f64;
/// Largest relative error of a lateral weight, rounding units. WGSL allows exp(x) 3 + 2 |x| ULP of 2 units and a
/// division 2.5; |x| is at most 4.5. The exponent x = -(a / s)^2 / 2 has the roundings of a difference, a division
/// twice, and two products: 2 (1 + 5) + 2 = 14 units, which exp turns into 4.5 times that. Rust's exp and division are
/// closer.
const WEIGHT: f64 = 2.0 * (3.0 + 2.0 * 4.5) + 4.5 * 14.0;

/// Bound on the rounding error of the sum of pulses in single precision: each has the errors of its weight and of two
/// products, and that of the interpolation between two rows of its table, five roundings of the larger one; a sum of n
/// terms adds n units of the sum of their magnitudes.
fn rounding(scatterers: &[Scatterer], pulse: &Pulse, lines: usize, samples: usize) -> Vec<f64> {
    let mut sums = vec![[0.0; 3]; lines * samples];
    let length = pulse.length() as i64;
    for it in scatterers {
        let Some([low, high]) = it.lines(lines) else { continue };
        let start = it.sample.floor();
        let row = (it.row(pulse.rows()) as usize).min(pulse.rows() - 2) * pulse.length();
        for (line, along) in (low..=high).flat_map(|line| (0..length).map(move |along| (line, along))) {
            let sample = start as i64 - (length / 2 - 1) + along;
            if !(0..samples as i64).contains(&sample) {
                continue;
            }
            let away = (line as f64 - f64::from(it.line)) / f64::from(it.sigma);
            let weight = f64::from(it.amplitude).abs() * (-0.5 * away * away).exp();
            let [a, b] = [0, pulse.length()].map(|next| f64::from(pulse.table()[row + next + along as usize]).abs());
            let sum = &mut sums[line * samples + sample as usize];
            let most = weight * a.max(b);
            (sum[0], sum[1], sum[2]) = (sum[0] + (WEIGHT + 2.0 + 5.0) * most, sum[1] + most, sum[2] + 1.0);
        }
    }
    // Products of errors, and numbers below the normal ones, which GPUs may take as 0.
    sums.iter()
        .map(|[each, total, n]| 1.01 * UNIT * (each + n * total) + n * f64::from(f32::MIN_POSITIVE))
        .collect()
}

#[test]
fn both_backends_add_up_echoes_to_within_their_roundings() {
    let gpu = insonify_testing::gpu::gpu_or_skip();
    let wide = |it: Scatterer| Scatterer {
        sigma: 0.2 + (it.sample as f32 / 40.0).rem_euclid(9.0),
        ..it
    };
    let attenuated = |it: Scatterer| Scatterer {
        centre: 1.0 - (it.sample as f32 / 400.0).clamp(0.0, 0.6),
        ..it
    };
    let narrow = Acquisition {
        bandwidth: 0.05,
        ..acquisition()
    };
    let crowd = (0..70_000).map(|at| Scatterer {
        line: (at % 7) as f32 * 0.3,
        sample: 50.0 + f64::from(at % 1000) * 0.01,
        amplitude: 1.0 - (at % 3) as f32,
        sigma: 2.0,
        centre: 1.0,
    });
    let scattered = |lines, samples| Medium::new(lines, samples).scatterers(|z| [0.01 * z, 0.1]);
    let cases = [
        ("usual", acquisition(), 20, 500, scattered(20, 500)),
        (
            "beams of any width",
            acquisition(),
            20,
            300,
            scattered(20, 300).into_iter().map(wide).collect(),
        ),
        (
            "pulses of any centre",
            acquisition(),
            5,
            200,
            scattered(5, 200).into_iter().map(attenuated).collect(),
        ),
        ("long pulses", narrow, 5, 200, scattered(5, 200)),
        ("one line", acquisition(), 1, 63, scattered(1, 63)),
        ("none", acquisition(), 3, 100, Vec::new()),
        ("more than a dispatch adds", acquisition(), 3, 100, crowd.collect()),
    ];
    for (name, acquisition, lines, samples, mut scatterers) in cases {
        let pulse = Pulse::new(&acquisition, 0.5);
        let bound = rounding(&scatterers, &pulse, lines, samples);
        let exact: Vec<f64> = echoes(&mut scatterers, &pulse, lines, samples);
        let single: Vec<f32> = echoes(&mut scatterers, &pulse, lines, samples);
        let mut found = vec![("CPU", single)];
        if let Some(gpu) = &gpu {
            let mut device = Device::new(gpu, &pulse, lines, samples).unwrap();
            let first = device.echoes(&scatterers).unwrap();
            // The order of the sums is fixed, and buffers are used again.
            scatterers.reverse();
            scatterers.sort_by(|a, b| a.line.total_cmp(&b.line).then(a.sample.total_cmp(&b.sample)));
            device.echoes(&scatterers[..scatterers.len() / 2]).unwrap();
            let again = device.echoes(&scatterers).unwrap();
            assert!(again == device.echoes(&scatterers).unwrap(), "{name}");
            found.extend([("GPU", first), ("GPU again", again)]);
        }
        assert!(name == "none" || exact.iter().any(|value| value.abs() > 0.1), "{name}");
        for (backend, found) in found {
            for (at, (value, exact)) in found.iter().zip(&exact).enumerate() {
                let off = (f64::from(*value) - exact).abs();
                assert!(
                    off <= bound[at],
                    "{name}, {backend}: sample {at} is {value}, off by {off:e}, allowed {:e}",
                    bound[at]
                );
            }
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let made = |threads: usize| {
        let pool = insonify_base::parallel::Pool::new(threads).unwrap();
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
