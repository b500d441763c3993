//! Beads implanted in tissue that deforms, tracked by the estimator and by the envelopes of their own echoes (Dehghan et
//! al. 2008, "Discussion": validation in the presence of deformation).

use std::f64::consts::SQRT_2;

use super::validation::{DENT_FRAMES, Dent, FRAMES_PER_S};
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Table};
use insonify_base::statistics::{mean, std};
use insonify_imaging::rf::medium::{Medium, PITCH_MM};
use insonify_imaging::rf::motion::{Options, Tracker};
use insonify_imaging::rf::signal::Lines;

/// Distances of beads from the middle of the dent, across and along the lines, mm.
const APART_MM: [f64; 2] = [2.2, 3.0];
/// Echo of a bead above those of the tissue, dB.
const BEAD_DB: f64 = 30.0;
/// Distance of the largest sample of a bead's envelope from where it was a frame ago, at most, lines and samples: twice
/// its motion, and the lateral error.
const REACH: [isize; 2] = [2, 6];
/// Distance of the three points through which its peak is taken, lines and samples: a standard deviation.
const SPACING: [isize; 2] = [3, 5];

/// Errors of a bead in a frame, um.
struct CourseRow {
    bead: String,
    time_s: f64,
    /// Axial motion by the estimator less that by the envelope.
    difference_um: Option<f64>,
}

/// A bead after all frames.
struct BeadRow {
    bead: String,
    /// Axial motion in the last frame, um.
    moved_um: f64,
    /// Errors of all frames by the estimator, axial and lateral, um; those of lost windows are left out.
    estimator_um: [Vec<f64>; 2],
    /// Errors of all frames by the envelope, axial and lateral, um.
    envelope_um: [Vec<f64>; 2],
    lost: usize,
}

const BEAD: Factor = Factor::new("bead", "depth and distance from the first line, mm");

/// Mean of the squares, rooted.
fn rms(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| mean(values).hypot(std(values)))
}

const CHOICES: [Choice<BeadRow>; 1] = [BEAD.of(|row| row.bead.clone())];

const COLUMNS: [Column<BeadRow>; 6] = [
    Axis::linear("moved_um", "moved um", "axial motion in the last frame, um").of(|row| Some(row.moved_um)),
    Axis::linear(
        "estimator_um",
        "estimator um",
        "axial error of the estimator over all frames (RMS), um",
    )
    .of(|row| rms(&row.estimator_um[0])),
    Axis::linear(
        "envelope_um",
        "envelope um",
        "axial error of the bead's envelope over all frames (RMS), um",
    )
    .of(|row| rms(&row.envelope_um[0])),
    Axis::linear(
        "estimator_lateral_um",
        "estimator lateral um",
        "lateral error of the estimator (RMS), um",
    )
    .of(|row| rms(&row.estimator_um[1])),
    Axis::linear(
        "envelope_lateral_um",
        "envelope lateral um",
        "lateral error of the envelope (RMS), um",
    )
    .of(|row| rms(&row.envelope_um[1])),
    Axis::linear("lost", "lost", "frames in which the window of the bead is lost").of(|row| Some(row.lost as f64)),
];

const COURSE_CHOICES: [Choice<CourseRow>; 1] = [BEAD.of(|row| row.bead.clone())];

const COURSE: [Column<CourseRow>; 2] = [
    Axis::linear("time_s", "time s", "time, s").of(|row| Some(row.time_s)),
    Axis::linear(
        "difference_um",
        "difference um",
        "axial motion by the estimator less that by the envelope, um",
    )
    .of(|row| row.difference_um),
];

/// Moves the dent with nine beads in it. Returns a row for each bead, and their courses.
pub(super) fn beads(medium: &Medium, options: Options, progress: &mut dyn FnMut(f64)) -> [Table; 2] {
    let dent = Dent::new(medium, options);
    let tissue = dent.frame(0);
    let rms = (tissue.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>() / tissue.len() as f64).sqrt();
    let amplitude = SQRT_2 * rms * 10_f64.powf(BEAD_DB / 20.0);
    // In the middle of windows, so that both methods tell of the same tissue.
    let nearest = |[z, x]: [f64; 2]| {
        let apart = |index: &usize| {
            let [depth, across] = dent.place(*index);
            (depth - z).hypot(across - x)
        };
        (0..medium.lines * options.windows).min_by(|a, b| apart(a).total_cmp(&apart(b)))
    };
    let places = [-1.0, 0.0, 1.0].map(|along| {
        [-1.0, 0.0, 1.0].map(|across| {
            [
                dent.middle[0] + along * APART_MM[1],
                dent.middle[1] + across * APART_MM[0],
            ]
        })
    });
    let windows: Vec<usize> = places.into_iter().flatten().filter_map(nearest).collect();
    let frame = |number: i32| {
        let moved = windows.iter().map(|index| {
            let place = dent.place(*index);
            let [axial, lateral] = dent.moved(number, place);
            [place[0] + axial, place[1] + lateral]
        });
        let beads = medium.beads(&moved.collect::<Vec<_>>(), amplitude as f32);
        let echoes: Vec<f32> = dent.frame(number).iter().zip(beads).map(|(a, b)| a + b).collect();
        echoes
    };
    let envelopes = Lines::new(medium.samples);
    let sample_mm = medium.acquisition.sample_mm();
    let first = frame(0);
    let peak_of = |envelope: &[f32], from: [f64; 2]| peak(envelope, medium.samples, from);
    let rest = envelopes.envelope(&first);
    let starts = windows.iter().map(|index| {
        let [z, x] = dent.place(*index);
        peak_of(&rest, [x / PITCH_MM, z / sample_mm])
    });
    let starts: Vec<[f64; 2]> = starts.collect();
    let mut peaks = starts.clone();
    let mut rows: Vec<BeadRow> = windows
        .iter()
        .map(|index| {
            let place = dent.place(*index);
            BeadRow {
                bead: format!("{:.1}, {:.1}", place[0], place[1]),
                moved_um: 1e3 * dent.moved(DENT_FRAMES, place)[0],
                estimator_um: Default::default(),
                envelope_um: Default::default(),
                lost: 0,
            }
        })
        .collect();
    let mut courses = Vec::new();
    let mut tracker = Tracker::new(options, medium.lines, &first);
    for number in 1..=DENT_FRAMES {
        progress(f64::from(number) / f64::from(DENT_FRAMES));
        let echoes = frame(number);
        let estimates = tracker.next(&echoes);
        let envelope = envelopes.envelope(&echoes);
        for (bead, (row, index)) in rows.iter_mut().zip(&windows).enumerate() {
            peaks[bead] = peak_of(&envelope, peaks[bead]);
            let [lines, samples] = [0, 1].map(|axis| peaks[bead][axis] - starts[bead][axis]);
            let by_envelope = [samples * sample_mm, lines * PITCH_MM].map(|mm| 1e3 * mm);
            let truth = dent.moved(number, dent.place(*index)).map(|mm| 1e3 * mm);
            let estimate = &estimates[*index];
            let is_kept = estimate.is_trusted(options.fallback);
            row.lost += usize::from(!is_kept);
            for (axis, by_estimator) in [estimate.axial_um, estimate.lateral_um].into_iter().enumerate() {
                row.envelope_um[axis].push(by_envelope[axis] - truth[axis]);
                if is_kept {
                    row.estimator_um[axis].push(by_estimator - truth[axis]);
                }
            }
            courses.push(CourseRow {
                bead: row.bead.clone(),
                time_s: f64::from(number) / FRAMES_PER_S,
                difference_um: is_kept.then_some(estimate.axial_um - by_envelope[0]),
            });
        }
    }
    [
        Table::of("beads", "Beads in the dent", &CHOICES, &COLUMNS, &rows),
        Table::of("bead-courses", FIGURE_TITLE, &COURSE_CHOICES, &COURSE, &courses).unlisted(),
    ]
}

const FIGURE_TITLE: &str = "Beads in the dent: the estimator against the envelope";

pub(super) fn figure() -> Figure {
    Figure {
        marked: false,
        ..Figure::new(
            "beads",
            FIGURE_TITLE,
            "bead-courses",
            ["time_s", "difference_um"],
            "bead",
        )
    }
}

/// Peak (line and sample) of an envelope near a place: that of parabolas through the logarithms of three points, which
/// is exact for a Gaussian.
fn peak(envelope: &[f32], samples: usize, from: [f64; 2]) -> [f64; 2] {
    let lines = envelope.len() / samples;
    let value = |[line, sample]: [isize; 2]| {
        let line = line.clamp(0, lines as isize - 1) as usize;
        let sample = sample.clamp(0, samples as isize - 1) as usize;
        f64::from(envelope[line * samples + sample])
    };
    let [line, sample] = from.map(|place| place.round() as isize);
    let around = (-REACH[0]..=REACH[0]).flat_map(|across| (-REACH[1]..=REACH[1]).map(move |along| [across, along]));
    let around = around.map(|[across, along]| [line + across, sample + along]);
    let largest = around
        .max_by(|a, b| value(*a).total_cmp(&value(*b)))
        .unwrap_or([line, sample]);
    [0, 1].map(|axis| {
        let logarithm = |step: isize| {
            let mut position = largest;
            position[axis] += step * SPACING[axis];
            value(position).max(f64::MIN_POSITIVE).ln()
        };
        let [before, middle, behind] = [-1, 0, 1].map(logarithm);
        let bend = before - 2.0 * middle + behind;
        let shift = if bend < 0.0 {
            0.5 * (before - behind) / bend
        } else {
            0.0
        };
        largest[axis] as f64 + shift.clamp(-0.5, 0.5) * SPACING[axis] as f64
    })
}
