//! Validation of estimated motion after Dehghan et al. 2008 ("TDPE validation"): their figures 6, 8 and 9 and table I,
//! in this program's numbers, and the accuracy under shifts and strains beside the bound of Walker and Trahey.

use std::f64::consts::TAU;

use super::{Errors, MOTIONS, Moved, about, beads, bound_um, field, insertion, medium, strained_correlation};
use crate::stability::Effort;
use crate::tradeoff::gather::Progress;
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Study, Table};
use insonify::Error;
use insonify_base::machine::Machine;
use insonify_base::statistics::{mean, std};
use insonify_imaging::rf::medium::{Medium, PITCH_MM};
use insonify_imaging::rf::motion::{Estimate, Options, Tracker};

/// Frames a second of the sinusoids.
pub(super) const FRAMES_PER_S: f64 = 20.0;

const TRUTH: [&str; 2] = ["true", "estimated"];

/// Errors of the axial motion of a sequence.
#[derive(Default)]
struct ErrorsRow {
    motion: String,
    /// Largest mean error and largest standard deviation of a frame, um.
    worst_um: [f64; 2],
    /// Mean error of the last frame, um.
    drift_um: f64,
    /// Changes of the reference of a window, in the mean.
    switches: f64,
    frames: usize,
    /// Share of the windows that are not lost in the last frame.
    trusted: f64,
}

const MOTION: Factor = Factor::new("motion", "motion");

const ERRORS_CHOICES: [Choice<ErrorsRow>; 1] = [MOTION.of(|row| row.motion.clone())];

const ERRORS: [Column<ErrorsRow>; 6] = [
    Axis::linear("mean_error_um", "mean um", "largest mean error of a frame, um").of(|row| Some(row.worst_um[0])),
    Axis::linear("sd_um", "SD um", "largest standard deviation of a frame, um").of(|row| Some(row.worst_um[1])),
    Axis::linear("drift_um", "drift um", "mean error of the last frame, um").of(|row| Some(row.drift_um)),
    Axis::linear("switches", "references", "changes of the reference of a window, mean").of(|row| Some(row.switches)),
    Axis::linear("frames", "frames", "frames").of(|row| Some(row.frames as f64)),
    Axis::linear("trusted", "not lost", "share of windows not lost in the last frame").of(|row| Some(row.trusted)),
];

/// True or estimated motion of something at a time.
struct CourseRow {
    /// Moving part: the medium under a motion, a place or a side of the image.
    name: String,
    source: &'static str,
    time: f64,
    moved_mm: Option<f64>,
}

/// Rows of the true and of the estimated motion, um.
fn both(name: &str, time: f64, um: [Option<f64>; 2]) -> impl Iterator<Item = CourseRow> {
    std::iter::zip(TRUTH, um).map(move |(source, um)| CourseRow {
        name: name.to_owned(),
        source,
        time,
        moved_mm: um.map(|um| um * 1e-3),
    })
}

/// Estimates of a sequence beside its true motion: the summary of table I and the courses of figures 8 and 9.
pub struct Course {
    options: Options,
    lines: usize,
    /// Depths of the windows, mm.
    depths: Vec<f64>,
    /// Horizontal axis of the courses.
    time: Axis,
    errors: Vec<ErrorsRow>,
    means: Vec<CourseRow>,
    places: Vec<CourseRow>,
    sides: Vec<CourseRow>,
    /// Errors of the sequence under way.
    current: ErrorsRow,
}

/// Places in the image whose courses are drawn, along the middle line.
const PLACES: usize = 6;

const PLACES_TITLE: &str = "Figure 9 c: axial motion of places on the middle line";
const SIDES_TITLE: &str = "Figure 9 d: lateral motion of the halves of the image";

impl Course {
    /// Prepares the tables of sequences with these settings; `time` is the horizontal axis of the courses.
    pub fn new(options: Options, lines: usize, samples: usize, time: Axis) -> Self {
        Self {
            depths: options.centres_mm(samples),
            options,
            lines,
            time,
            errors: Vec::new(),
            means: Vec::new(),
            places: Vec::new(),
            sides: Vec::new(),
            current: ErrorsRow::default(),
        }
    }

    /// Goes on with sequences of other settings.
    pub(super) fn over(&mut self, options: Options, lines: usize, samples: usize) {
        (self.options, self.lines, self.depths) = (options, lines, options.centres_mm(samples));
    }

    /// Adds a frame: estimates and true axial and lateral motion (um) of the windows, line by line. Windows that are
    /// lost are left out.
    pub fn push(&mut self, motion: &str, time: f64, estimates: &[Estimate], truth: &[[f64; 2]]) {
        let fallback = self.options.fallback;
        let kept = || {
            let pairs = estimates.iter().zip(truth);
            pairs.filter(|(estimate, _)| estimate.is_trusted(fallback))
        };
        let errors: Vec<f64> = kept().map(|(estimate, truth)| estimate.axial_um - truth[0]).collect();
        if errors.is_empty() {
            return;
        }
        let (error, spread) = (mean(&errors), std(&errors));
        let worst = &mut self.current.worst_um;
        *worst = [worst[0].max(error.abs()), worst[1].max(spread)];
        self.current.drift_um = error;
        self.current.frames += 1;
        self.current.trusted = errors.len() as f64 / estimates.len() as f64;
        let true_um = mean(&kept().map(|(_, truth)| truth[0]).collect::<Vec<_>>());
        let um = [true_um, true_um + error].map(Some);
        self.means.extend(both(motion, time, um));
    }

    /// Adds the courses of places and of the halves of the image at a frame.
    pub fn push_places(&mut self, time: f64, estimates: &[Estimate], truth: &[[f64; 2]]) {
        let (count, fallback) = (self.options.windows, self.options.fallback);
        for place in 0..PLACES.min(count) {
            let window = (2 * place + 1) * count / (2 * PLACES);
            let index = self.lines / 2 * count + window;
            let name = format!("{:.0}", self.depths[window]);
            let estimated = estimates[index]
                .is_trusted(fallback)
                .then_some(estimates[index].axial_um);
            self.places
                .extend(both(&name, time, [Some(truth[index][0]), estimated]));
        }
        let half = self.lines / 2 * count;
        for (name, range) in [("unmarked", 0..half), ("marked", half..estimates.len())] {
            let pairs = estimates[range.clone()].iter().zip(&truth[range]);
            let kept: Vec<_> = pairs.filter(|(estimate, _)| estimate.is_trusted(fallback)).collect();
            if kept.is_empty() {
                continue;
            }
            let true_um = mean(&kept.iter().map(|(_, truth)| truth[1]).collect::<Vec<_>>());
            let estimated_um = mean(&kept.iter().map(|(estimate, _)| estimate.lateral_um).collect::<Vec<_>>());
            self.sides.extend(both(name, time, [true_um, estimated_um].map(Some)));
        }
    }

    /// Ends a sequence: its row of table I.
    pub fn end(&mut self, motion: &str, switches: f64) {
        self.errors.push(ErrorsRow {
            motion: motion.to_owned(),
            switches,
            ..std::mem::take(&mut self.current)
        });
    }

    fn figures(&self) -> Vec<Figure> {
        let course = |file: String, title: &str, table, y, colour: &'static str| Figure {
            marker: vec!["source"],
            ..Figure::new(file, title, table, [self.time.key, y], colour)
        };
        let mut motions: Vec<&String> = self.means.iter().map(|row| &row.name).collect();
        motions.dedup();
        let means = motions.iter().enumerate().map(|(index, motion)| Figure {
            only: vec![("motion", (*motion).clone())],
            ..course(
                format!("figure-8-{}", index + 1),
                &format!("Figure 8: {motion}"),
                "courses",
                "axial_mm",
                "source",
            )
        });
        let mut figures: Vec<Figure> = means.collect();
        figures.push(course(
            "figure-9c".to_owned(),
            PLACES_TITLE,
            "places",
            "axial_mm",
            "place",
        ));
        figures.push(course(
            "figure-9d".to_owned(),
            SIDES_TITLE,
            "sides",
            "lateral_mm",
            "side",
        ));
        figures
    }

    /// Study of all that was added, and of the line of a frame (figure 6).
    pub fn study(self, line: &[f32], about: Vec<(&'static str, String)>) -> Study {
        let figures = [vec![line_figure()], self.figures()].concat();
        let course = |key: &'static str, title: &str, factor: Factor, axis: Axis, rows: &[CourseRow]| {
            let choices = [
                factor.of(|row: &CourseRow| row.name.clone()),
                Factor::new("source", "source").of(|row| row.source.to_owned()),
            ];
            let columns = [
                self.time.of(|row: &CourseRow| Some(row.time)),
                axis.of(|row| row.moved_mm),
            ];
            Table::of(key, title, &choices, &columns, rows).unlisted()
        };
        let moved = Axis::linear("axial_mm", "axial mm", "mean axial motion, mm");
        let axial = Axis::linear("axial_mm", "axial mm", "axial motion, mm");
        let lateral = Axis::linear("lateral_mm", "lateral mm", "mean lateral motion, mm");
        let place = Factor::new("place", "depth, mm");
        let side = Factor::new("side", "half of the image");
        let errors_title = "Table I: errors of axial motion";
        let means_title = "Figure 8: motion of the medium";
        Study {
            name: "motion-validation",
            title: "Motion from echoes against the truth",
            about,
            machine: Machine::here(),
            tables: vec![
                Table::of("errors", errors_title, &ERRORS_CHOICES, &ERRORS, &self.errors),
                line_table(&self.options, line),
                course("courses", means_title, MOTION, moved, &self.means),
                course("places", PLACES_TITLE, place, axial, &self.places),
                course("sides", SIDES_TITLE, side, lateral, &self.sides),
            ],
            figures,
            notes: Vec::new(),
        }
    }
}

/// A sample of a line of echoes, or of a window of it.
struct LineRow {
    part: String,
    depth_mm: f64,
    /// Share of the largest value.
    value: f64,
}

const LINE_CHOICES: [Choice<LineRow>; 1] = [Factor::new("part", "part").of(|row| row.part.clone())];

const LINE: [Column<LineRow>; 2] = [
    Axis::linear("depth_mm", "depth mm", "depth, mm").of(|row| Some(row.depth_mm)),
    Axis::linear("value", "value", "share of the largest value; windows are drawn lower").of(|row| Some(row.value)),
];

/// Figure 6: a portion of a line, and three windows of it.
fn line_table(options: &Options, line: &[f32]) -> Table {
    let depths = options.centres_mm(line.len());
    let sample_mm = options.speed_m_s * 1e-3 / (2.0 * options.sampling_mhz);
    let sample = |mm: f64| ((mm / sample_mm).round().max(0.0) as usize).min(line.len());
    let around = |centre: f64| sample(centre - options.window_mm / 2.0)..sample(centre + options.window_mm / 2.0);
    let three = 0..depths.len().min(3);
    let portion = 0..sample(depths[three.end - 1] + options.window_mm);
    let most = line[portion.clone()]
        .iter()
        .fold(0.0_f32, |most, value| most.max(value.abs()));
    let parts = three.clone().map(|window| {
        let name = format!("window {window}");
        (name, around(depths[window]), 2.0 * (window + 1) as f64)
    });
    let mut rows = Vec::new();
    for (part, samples, lower) in std::iter::once(("line".to_owned(), portion, 0.0)).chain(parts) {
        rows.extend(samples.map(|sample| LineRow {
            part: part.clone(),
            depth_mm: sample as f64 * sample_mm,
            value: f64::from(line[sample] / most.max(f32::MIN_POSITIVE)) - lower,
        }));
    }
    let title = "Figure 6: a line of echoes and three windows";
    Table::of("line", title, &LINE_CHOICES, &LINE, &rows).unlisted()
}

fn line_figure() -> Figure {
    Figure {
        marked: false,
        ..Figure::new(
            "figure-6",
            "Figure 6: a line of echoes and three windows",
            "line",
            ["depth_mm", "value"],
            "part",
        )
    }
}

/// Shifts and strains beside those of the trade-off.
const MEDIA: [(&str, Moved); 6] = [
    ("at rest", |_| [0.0; 2]),
    ("moved by 5 um", |_| [0.005, 0.0]),
    ("moved by 0.5 mm", |_| [0.5, 0.0]),
    ("moved by 0.2 mm across the lines", |_| [0.0, 0.2]),
    ("moved by -0.7 mm", |_| [-0.7, 0.0]),
    ("strained by 0.2 %", |z| [-0.002 * z, 0.0]),
];

/// A medium after a shift or strain.
struct MediumRow {
    motion: &'static str,
    errors: Errors,
    /// Least axial standard deviation of any estimator, um.
    bound_um: f64,
    /// Correlations of a frame.
    correlations: u64,
}

const MEDIA_CHOICES: [Choice<MediumRow>; 1] = [MOTION.of(|row| row.motion.to_owned())];

const MEDIA_COLUMNS: [Column<MediumRow>; 9] = [
    Axis::linear("bias_um", "bias um", "axial bias, um").of(|row| Some(row.errors.axial[0])),
    Axis::linear("sd_um", "SD um", "axial standard deviation, um").of(|row| Some(row.errors.axial[1])),
    Axis::linear("bound_um", "bound um", "least axial standard deviation, um").of(|row| Some(row.bound_um)),
    Axis::linear("lateral_bias_um", "lateral bias um", "lateral bias, um").of(|row| Some(row.errors.lateral[0])),
    Axis::linear("lateral_sd_um", "lateral SD um", "lateral standard deviation, um")
        .of(|row| Some(row.errors.lateral[1])),
    Axis::linear("correlation", "correlation", "mean correlation at the nearest sample")
        .of(|row| Some(row.errors.correlation)),
    Axis::linear("trusted", "correlate", "share of windows that correlate").of(|row| Some(row.errors.trusted)),
    Axis::linear("wrong", "wrong", "share of these at a wrong place").of(|row| Some(row.errors.wrong)),
    Axis::linear("correlations", "correlations", "correlations of a frame").of(|row| Some(row.correlations as f64)),
];

/// Accuracy under shifts and strains.
fn media(effort: Effort, progress: Progress<'_>) -> Table {
    let (medium, options) = medium(effort);
    let mut rows = Vec::new();
    let first = medium.frame(0, |_| [0.0; 2]);
    for (index, &(motion, moved)) in MEDIA.iter().chain(&MOTIONS).enumerate() {
        progress(motion, 0.3 * index as f64 / (MEDIA.len() + MOTIONS.len()) as f64);
        let mut tracker = Tracker::new(options, medium.lines, &first);
        let estimates = tracker.next(&medium.frame(1, moved));
        // Motions are linear in depth, so that 1 mm gives the strain. It decorrelates windows even without
        // noise, and no estimator can be better than this correlation allows.
        let strain = moved(1.0)[0] - moved(0.0)[0];
        let rho = strained_correlation(&medium.acquisition, options.window_mm, strain);
        rows.push(MediumRow {
            motion,
            errors: Errors::of(&options, &medium, &estimates, moved),
            bound_um: bound_um(&medium.acquisition, options.window_mm, rho),
            correlations: tracker.correlations,
        });
    }
    let title = format!(
        "Shifts and strains: {} lines with {} windows",
        medium.lines, options.windows
    );
    Table::of("media", title, &MEDIA_CHOICES, &MEDIA_COLUMNS, &rows)
}

/// A medium that swings once: amplitude from end to end, frequency, and what swings.
struct Swing {
    name: &'static str,
    hz: f64,
    most: Moved,
}

const SWINGS: [Swing; 6] = [
    Swing {
        name: "0.5 mm at 0.25 Hz",
        hz: 0.25,
        most: |_| [0.5, 0.0],
    },
    Swing {
        name: "1 mm at 0.25 Hz",
        hz: 0.25,
        most: |_| [1.0, 0.0],
    },
    Swing {
        name: "2 mm at 0.25 Hz",
        hz: 0.25,
        most: |_| [2.0, 0.0],
    },
    Swing {
        name: "1 mm at 0.5 Hz",
        hz: 0.5,
        most: |_| [1.0, 0.0],
    },
    Swing {
        name: "1 mm at 1 Hz",
        hz: 1.0,
        most: |_| [1.0, 0.0],
    },
    Swing {
        name: "strain of 4 % at 0.25 Hz",
        hz: 0.25,
        most: |z| [0.04 * z, 0.0],
    },
];

fn swing(swing: &Swing, course: &mut Course, medium: &Medium, options: Options, progress: &mut dyn FnMut(f64)) {
    let frames = (FRAMES_PER_S / swing.hz).round() as i32;
    let share = |frame: i32| 0.5 - 0.5 * (TAU * f64::from(frame) / f64::from(frames)).cos();
    let centres = options.centres_mm(medium.samples);
    let length_mm = medium.samples as f64 * medium.acquisition.sample_mm();
    // The outer lines see beyond the array, and the tissue of the last windows leaves the image.
    let of_interest = |index: usize| {
        let (line, z) = (index / options.windows, centres[index % options.windows]);
        let stays = z + (swing.most)(z)[0] + options.window_mm < length_mm;
        (super::EDGE..medium.lines - super::EDGE).contains(&line) && stays
    };
    let mut tracker = Tracker::new(options, medium.lines, &medium.frame(0, |_| [0.0; 2]));
    for frame in 1..=frames {
        progress(f64::from(frame) / f64::from(frames));
        let moved = |z: f64| (swing.most)(z).map(|mm| mm * share(frame));
        let estimates = tracker.next(&medium.frame(frame, moved));
        let pairs = estimates.iter().enumerate().filter(|(index, _)| of_interest(*index));
        let (estimates, truth): (Vec<Estimate>, Vec<[f64; 2]>) = pairs
            .map(|(index, estimate)| (*estimate, moved(centres[index % options.windows]).map(|mm| mm * 1e3)))
            .unzip();
        course.push(swing.name, f64::from(frame) / FRAMES_PER_S, &estimates, &truth);
    }
    course.end(swing.name, tracker.references());
}

/// Frames of the dent.
pub(super) const DENT_FRAMES: i32 = 20;

/// A dent beside a needle: tissue 20 mm deep moves by 1 mm over a standard deviation of 2 mm, so that strains and
/// shears reach 30 %, the rest of the image stays.
pub(super) struct Dent<'a> {
    medium: &'a Medium,
    windows: usize,
    /// Depths of the windows, mm.
    centres: Vec<f64>,
    /// Depth and distance from the first line of its middle, mm.
    pub middle: [f64; 2],
}

impl<'a> Dent<'a> {
    pub(super) fn new(medium: &'a Medium, options: Options) -> Self {
        let length_mm = medium.samples as f64 * medium.acquisition.sample_mm();
        Self {
            medium,
            windows: options.windows,
            centres: options.centres_mm(medium.samples),
            middle: [0.5 * length_mm, 0.5 * (medium.lines - 1) as f64 * PITCH_MM],
        }
    }

    /// Depth and distance from the first line of a window, mm.
    pub(super) fn place(&self, index: usize) -> [f64; 2] {
        let line = (index / self.windows) as f64;
        [self.centres[index % self.windows], line * PITCH_MM]
    }

    /// Axial and lateral motion at a place in a frame, mm.
    pub(super) fn moved(&self, frame: i32, [z, x]: [f64; 2]) -> [f64; 2] {
        let square = (z - self.middle[0]).powi(2) + (x - self.middle[1]).powi(2);
        [f64::from(frame) / f64::from(DENT_FRAMES) * (-square / 8.0).exp(), 0.0]
    }

    /// Echoes of a frame.
    pub(super) fn frame(&self, frame: i32) -> Vec<f32> {
        self.medium.frame_in_plane(frame, |z, x| self.moved(frame, [z, x]))
    }
}

/// Estimates of the dent. Counted are windows within 4 x 3 mm of its middle.
fn dent(course: &mut Course, medium: &Medium, options: Options, progress: &mut dyn FnMut(f64)) {
    const NAME: &str = "dent of 1 mm";
    let dent = Dent::new(medium, options);
    let of_interest = |index: &usize| {
        let [z, x] = dent.place(*index);
        (z - dent.middle[0]).abs() < 4.0 && (x - dent.middle[1]).abs() < 3.0
    };
    let mut tracker = Tracker::new(options, medium.lines, &dent.frame(0));
    for number in 1..=DENT_FRAMES {
        progress(f64::from(number) / f64::from(DENT_FRAMES));
        let estimates = tracker.next(&dent.frame(number));
        let inside = (0..estimates.len()).filter(of_interest);
        let (estimates, truth): (Vec<Estimate>, Vec<[f64; 2]>) = inside
            .map(|index| {
                let truth = dent.moved(number, dent.place(index));
                (estimates[index], truth.map(|mm| mm * 1e3))
            })
            .unzip();
        course.push(NAME, f64::from(number) / FRAMES_PER_S, &estimates, &truth);
    }
    course.end(NAME, tracker.references());
}

/// Runs the validation.
///
/// # Errors
/// Errors of the insertion.
pub fn study(effort: Effort, progress: Progress<'_>) -> Result<Study, Error> {
    let media = media(effort, progress);
    let time = Axis::linear("time_s", "time s", "time, s");
    let (small, options) = field(effort.pick([24, 1000, 32], [48, 1600, 50]));
    let mut course = Course::new(options, small.lines, small.samples, time);
    let swings = &SWINGS[effort.pick(4, 0)..];
    for (index, swung) in swings.iter().enumerate() {
        let begun = 0.3 + 0.25 * index as f64 / swings.len() as f64;
        // Tissue that comes into the image, and goes out of it.
        let medium = Medium {
            before_mm: 1.0 + (swung.most)(0.0)[0],
            ..small
        };
        swing(swung, &mut course, &medium, options, &mut |share| {
            progress(swung.name, begun + 0.25 * share / swings.len() as f64);
        });
    }
    let (dented, options) = field(effort.pick([48, 1000, 60], [100, 2078, 120]));
    course.over(options, dented.lines, dented.samples);
    dent(&mut course, &dented, options, &mut |share| {
        progress("dent", 0.55 + 0.02 * share)
    });
    let beads = beads::beads(&dented, options, &mut |share| progress("beads", 0.57 + 0.03 * share));
    let needle = insertion::run_into(effort, &mut course, &mut |share| {
        progress("insertion", 0.6 + 0.4 * share)
    })?;
    let first = small.frame(0, |_| [0.0; 2]);
    let line = &first[small.lines / 2 * small.samples..][..small.samples];
    let mut study = course.study(line, about(&small));
    study.tables.splice(0..0, [media]);
    study.tables.extend(beads);
    study.tables.push(needle);
    study.figures.push(beads::figure());
    study.figures.extend(insertion::figures());
    let length_mm = small.samples as f64 * small.acquisition.sample_mm();
    let swings = format!(
        "{} lines of {length_mm:.0} mm at {FRAMES_PER_S} frames a second, one cycle",
        small.lines
    );
    study.about.push(("sinusoids", swings));
    study.about.push(("insertion", insertion::ABOUT.to_owned()));
    study.notes = vec![
        "figure 7, the set-up of a moving probe in water, has no counterpart: the medium is moved".to_owned(),
        "table I and figure 9 count windows that are not lost".to_owned(),
        "the dent has 5 % of the motion in each frame; counted are windows within 4 x 3 mm of its middle".to_owned(),
        "beads are points 30 dB above the echoes around them, in the middle of windows".to_owned(),
    ];
    progress("done", 1.0);
    Ok(study)
}
