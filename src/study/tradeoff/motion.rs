//! Motion from radio-frequency echoes: error and cost by window length, upsampling and use of prior estimates. Echoes
//! are those of a uniform medium whose motion is known.

mod beads;
mod insertion;
#[cfg(test)]
mod tests;
pub mod validation;

use std::f64::consts::{PI, TAU};
use std::time::Instant;

use super::entry::{About, Backends, Context, Entry, StudyOption};
use super::{Axis, Choice, Column, Factor, Figure, Goal, Study, Table};
use crate::stability::Effort;
use insonify_base::machine::Machine;
use insonify_base::statistics::{Spread, mean, std};
use insonify_imaging::rf::medium::{Medium, PITCH_MM};
use insonify_imaging::rf::motion::{Estimate, Options, Tracker};
use insonify_imaging::rf::{Acquisition, SPEED_M_S};

/// Registration of this study.
pub(crate) const ENTRY: Entry<Effort> = Entry {
    about: About {
        name: "motion",
        title: "Motion from echoes",
        question: "How long may windows be, how far must echoes be upsampled, and what do prior estimates save?",
        help: "Motion from echoes: length of windows, upsampling, prior estimates",
        examples: "\
Examples:
  insonify tradeoff motion --quick       a small field, in seconds
  insonify tradeoff motion -o study      178 lines of 75 mm, with plots

A row with a star is a best choice: no other is both faster and nearer to the truth. insonify motion --validate has the
accuracy under shifts, strains and sinusoids, and around a needle.",
        backends: Backends::Cpu,
    },
    options: &[StudyOption::quick("A small field")],
    settings: |effort| effort,
    in_report: |effort| effort,
    run: |effort, Context { progress, .. }| Ok(study(*effort, progress)),
};

/// Lines left out at either side of the array, where the beam sees beyond it.
const EDGE: usize = 4;
/// Tolerance of the axial standard deviation, um, with its reason.
const SD_UM: (f64, &str) = (2.0, "a fifth of the 10 um by which 1 % of strain stretches 1 mm");
/// Error beyond which a window follows a wrong place, um.
const WRONG_UM: f64 = 20.0;
const REPEATS: usize = 5;

/// Displacement (mm) away from the array and across the lines at a depth (mm).
type Moved = fn(f64) -> [f64; 2];

/// A medium of some lines and samples, and the settings of the estimator for it.
fn field([lines, samples, windows]: [usize; 3]) -> (Medium, Options) {
    let medium = Medium::new(lines, samples);
    let options = Options {
        windows,
        ..Options::new(medium.acquisition.sampling_mhz, PITCH_MM)
    };
    (medium, options)
}

/// The field of Dehghan et al. 2008, or a part of it.
fn medium(effort: Effort) -> (Medium, Options) {
    field(effort.pick([32, 1000, 32], [178, 3896, 120]))
}

/// Errors of the windows that correlate, away from the edges.
struct Errors {
    /// Mean and standard deviation of the axial and of the lateral error, um.
    axial: [f64; 2],
    lateral: [f64; 2],
    /// Mean correlation.
    correlation: f64,
    /// Share of these windows that err by more than [`WRONG_UM`].
    wrong: f64,
    /// Share of all windows that correlate.
    trusted: f64,
}

impl Errors {
    fn of(options: &Options, medium: &Medium, estimates: &[Estimate], displacement: impl Fn(f64) -> [f64; 2]) -> Self {
        let centres = options.centres_mm(medium.samples);
        let is_inner = |line: usize| (EDGE..medium.lines - EDGE).contains(&line);
        let inside = estimates
            .chunks(options.windows)
            .enumerate()
            .filter(|(line, _)| is_inner(*line));
        // The last window ends where the echoes of the medium do.
        let inside: Vec<_> = inside
            .flat_map(|(_, line)| line.iter().zip(&centres).take(centres.len() - 1))
            .collect();
        let trusted: Vec<_> = inside
            .iter()
            .filter(|(estimate, _)| estimate.is_trusted(options.fallback))
            .collect();
        let errors_of = |axis: usize| -> Vec<f64> {
            let error = |estimate: &Estimate, depth: f64| {
                [estimate.axial_um, estimate.lateral_um][axis] - 1e3 * displacement(depth)[axis]
            };
            trusted
                .iter()
                .map(|(estimate, depth)| error(estimate, **depth))
                .collect()
        };
        let (axial, lateral) = (errors_of(0), errors_of(1));
        let misses = axial.iter().filter(|error| error.abs() > WRONG_UM).count();
        Self {
            wrong: misses as f64 / trusted.len() as f64,
            trusted: trusted.len() as f64 / inside.len() as f64,
            correlation: mean(
                &trusted
                    .iter()
                    .map(|(estimate, _)| estimate.correlation)
                    .collect::<Vec<_>>(),
            ),
            axial: [mean(&axial), std(&axial)],
            lateral: [mean(&lateral), std(&lateral)],
        }
    }
}

/// Least axial standard deviation, um, of any estimator of delays between two windows (W. F. Walker and G. E. Trahey,
/// IEEE Transactions on Ultrasonics, Ferroelectrics and Frequency Control 42, 1995), for echoes whose noise-free
/// correlation is `rho`. Noise counts within the band.
fn bound_um(acquisition: &Acquisition, window_mm: f64, rho: f64) -> f64 {
    let (f0, b, t) = (
        acquisition.frequency_mhz,
        acquisition.bandwidth,
        2e3 * window_mm / SPEED_M_S,
    );
    let snr2 = 10_f64.powf(acquisition.snr_db / 10.0) * (acquisition.sampling_mhz / 2.0) / (b * f0);
    let spread = ((1.0 + 1.0 / snr2) / rho).powi(2) - 1.0;
    (1.5 / (f0.powi(3) * PI * PI * t * (b.powi(3) + 12.0 * b)) * spread).sqrt() * SPEED_M_S / 2.0
}

/// Correlation that a uniform strain leaves between two windows: the mean over the window of the autocorrelation of the
/// pulse, exp(-t^2 / 4 s^2) cos(2 pi f0 t), at the delays by which the strain moves its parts.
fn strained_correlation(acquisition: &Acquisition, window_mm: f64, strain: f64) -> f64 {
    const PARTS: usize = 100;
    let part_of_window = |part: usize| {
        let away_mm = ((part as f64 + 0.5) / PARTS as f64 - 0.5) * window_mm;
        let delay_us = 2e3 * strain * away_mm / SPEED_M_S;
        let envelope = (-0.25 * (delay_us / acquisition.sigma_us()).powi(2)).exp();
        envelope * (TAU * acquisition.frequency_mhz * delay_us).cos()
    };
    (0..PARTS).map(part_of_window).sum::<f64>() / PARTS as f64
}

/// Estimates with some options, of one motion.
struct MotionRow {
    options: Options,
    motion: &'static str,
    /// Median time of a frame, ms, and correlations of a window.
    median_ms: Option<f64>,
    correlations: Option<f64>,
    errors: Errors,
}

/// Without windows that correlate there are no errors.
fn finite(error: f64) -> Option<f64> {
    Some(error).filter(|error| error.is_finite())
}

const CHOICES: [Choice<MotionRow>; 4] = [
    Factor::new("window_mm", "window, mm").of(|row| row.options.window_mm.to_string()),
    Factor::new("upsampling", "upsampling").of(|row| row.options.upsampling.to_string()),
    Factor::new("search", "search").of(|row| if row.options.prior { "prior" } else { "exhaustive" }.to_owned()),
    Factor::new("motion", "motion").of(|row| row.motion.to_owned()),
];

const COLUMNS: [Column<MotionRow>; 7] = [
    Axis::log("median_ms", "ms", "time of a frame (median), ms").of(|row| row.median_ms),
    Axis::log("correlations", "correlations", "correlations of a window").of(|row| row.correlations),
    Axis::linear("bias_um", "bias um", "axial bias, um").of(|row| finite(row.errors.axial[0])),
    Axis::log("sd_um", "SD um", "axial standard deviation, um").of(|row| finite(row.errors.axial[1])),
    Axis::linear("lateral_sd_um", "lateral SD um", "lateral standard deviation, um")
        .of(|row| finite(row.errors.lateral[1])),
    Axis::linear("trusted", "correlate", "share of windows that correlate").of(|row| finite(row.errors.trusted)),
    Axis::linear("wrong", "wrong", "share of these at a wrong place").of(|row| finite(row.errors.wrong)),
];
const MOTIONS: [(&str, Moved); 3] = [
    ("moved by 0.1234 mm", |_| [0.1234, 0.0]),
    ("strained by 1 %", |z| [-0.01 * z, 0.0]),
    ("strained by 2 %", |z| [-0.02 * z, 0.0]),
];

/// Median time (ms) of a frame's motion, with motion known from the frame before as in a sequence, and correlations for
/// each window.
fn cost(options: &Options, lines: usize, [earlier, later]: [&[f32]; 2]) -> [Option<f64>; 2] {
    let mut times = Vec::new();
    let mut correlations = None;
    for _ in 0..REPEATS {
        let mut tracker = Tracker::new(*options, lines, earlier);
        tracker.next(later);
        let (before, start) = (tracker.correlations, Instant::now());
        tracker.next(later);
        times.push(start.elapsed().as_secs_f64() * 1e3);
        correlations = Some((tracker.correlations - before) as f64 / (lines * options.windows) as f64);
    }
    [Spread::of(times).map(|spread| spread.median_ms), correlations]
}

/// Runs the study.
pub(crate) fn study(effort: Effort, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Study {
    let (medium, usual) = medium(effort);
    let window = |window_mm| Options { window_mm, ..usual };
    let upsampled = |upsampling| Options { upsampling, ..usual };
    let exhaustive = Options { prior: false, ..usual };
    let windows = [0.5, 1.0, 2.0, 4.0].map(window);
    let upsamplings = [1, 4].map(upsampled);
    let variants: Vec<Options> = windows.into_iter().chain(upsamplings).chain([exhaustive]).collect();
    progress("the medium at rest", 0.0);
    // One first frame for all: rows then differ by their settings and motions, not by the scatterers drawn.
    let start = medium.frame(0, |_| [0.0; 2]);
    let work = (MOTIONS.len() * variants.len()) as f64;
    let mut rows = Vec::new();
    for (name, displacement) in MOTIONS {
        let next = medium.frame(1, displacement);
        for &options in &variants {
            progress(name, rows.len() as f64 / work);
            let mut tracker = Tracker::new(options, medium.lines, &start);
            let errors = Errors::of(&options, &medium, &tracker.next(&next), displacement);
            let [median_ms, correlations] = cost(&options, medium.lines, [&start, &next]);
            rows.push(MotionRow {
                options,
                motion: name,
                median_ms,
                correlations,
                errors,
            });
        }
    }
    let title = format!(
        "Windows, upsampling and search: {} lines of {:.1} mm with {} windows, noise at -30 dB",
        medium.lines,
        medium.samples as f64 * medium.acquisition.sample_mm(),
        usual.windows
    );
    let goal = Goal::new("median_ms", "sd_um", SD_UM)
        .over(&["motion"])
        .choosing("windows, upsampling and search of motion");
    let table = Table::of("motion", title, &CHOICES, &COLUMNS, &rows)
        .against("the motion that the medium was given")
        .seeking(goal);
    progress("done", 1.0);
    Study {
        name: "tradeoff-motion",
        title: ENTRY.about.title,
        about: about(&medium),
        machine: Machine::here(),
        tables: vec![table],
        figures: vec![Figure {
            marker: vec!["upsampling", "search"],
            joined: false,
            ..Figure::new("motion-error-time", "Motion from echoes", "motion", ["median_ms", "sd_um"], "window_mm")
        }],
        notes: vec![
            "errors are those of windows with a correlation of 0.8 or more, without the last window and four lines on either side".to_owned(),
            format!("at a wrong place: more than {WRONG_UM} um off"),
        ],
    }
}

fn about(medium: &Medium) -> Vec<(&'static str, String)> {
    let Acquisition {
        frequency_mhz,
        sampling_mhz,
        bandwidth,
        snr_db,
        ..
    } = medium.acquisition;
    vec![
        (
            "echoes",
            format!("{frequency_mhz} MHz, bandwidth {bandwidth}, sampled at {sampling_mhz} MHz, noise at -{snr_db} dB"),
        ),
        (
            "medium",
            format!("uniform, ten scatterers in a resolution cell, lines {PITCH_MM} mm apart"),
        ),
    ]
}
