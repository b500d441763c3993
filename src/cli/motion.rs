//! `insonify motion`: motion of tissue between radio-frequency frames.

mod picture;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use insonify_base::csv::Csv;
use insonify_base::output::{atomic, png};
use insonify_imaging::rf::SPEED_M_S;
use insonify_imaging::rf::file::Echoes;
use insonify_imaging::rf::motion::{Estimate, Options, Tracker};
use insonify_study::stability::Effort;
use insonify_study::tradeoff::Axis;
use insonify_study::tradeoff::motion::validation;
use insonify_tracking::TrackingError;

use super::failure::{Error, usage};
use super::output::Force;
use super::rf::Geometry;
use super::study::Printed;
use super::terminal;
use picture::Shown;

const EXAMPLES: &str = "\
Each window of the first frame is sought in the others by normalised cross-correlation: in a narrow search about the estimate of the window above,
and in a wide one where the correlation falls below --fallback. Where its correlation falls below --switch, the echoes of that window in that frame
become its reference, and motion adds up. A window that is lost moves with its neighbours until its echoes are found again. The table has a row for
each window of each frame after the first:
  frame,line,window,depth_mm,axial_um,lateral_um,correlation,least_correlation
least_correlation: the least from the first frame to this one; below --fallback a window is lost, and its motion a guess.
Indices count from 0; depth_mm: window centre in the first frame. Motion since then: axial away from the probe, lateral to the marked side.

Examples:
  insonify rf two-layer-insertion -o rf.igs.mha --truth truth.csv
  insonify motion rf.igs.mha -o u.csv --truth truth.csv            errors against the truth
  insonify motion --validate -o study                              accuracy on media and an insertion of known motion, with plots
  insonify motion rf.igs.mha --truth truth.csv --validate -o study  the same plots of a sequence
  insonify motion rf.igs.mha -o u.csv --strain strain.png          axial strain in colour over the B-mode, where it is largest
  insonify motion rf.mha -o u.csv --sampling-mhz 40 --pitch-mm 0.15

docs/motion.md has the model, its accuracy and its cost.";

/// Estimates the motion of tissue from radio-frequency frames
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Motion {
    /// Sequence of echoes: RF_REAL, at least two frames
    #[arg(value_name = "RF", required_unless_present = "validate")]
    input: Option<PathBuf>,
    /// Table to write; with --validate a folder
    #[arg(short, long, value_name = "FILE.csv")]
    output: PathBuf,
    /// Sampling rate, if the file does not state it
    #[arg(long, value_name = "MHZ")]
    sampling_mhz: Option<f64>,
    /// Speed of sound
    #[arg(long, value_name = "M_S", default_value_t = SPEED_M_S)]
    speed_m_s: f64,
    #[command(flatten)]
    geometry: Geometry,
    /// Windows along a line
    #[arg(long, value_name = "N", default_value = "120", value_parser = clap::value_parser!(u16).range(2..=10_000))]
    windows: u16,
    /// Length of a window
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    window_mm: f64,
    /// Factor of upsampling before the search
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u8).range(1..=8))]
    upsampling: u8,
    /// Reach of the wide search along a line
    #[arg(long, value_name = "MM", default_value_t = 0.8)]
    wide_mm: f64,
    /// Correlation below which the wide search is made, and a window that it does not find is lost
    #[arg(long, value_name = "SHARE", default_value_t = 0.8)]
    fallback: f64,
    /// Correlation below which the echoes of a window become its new reference
    #[arg(long, value_name = "SHARE", default_value_t = 0.98)]
    switch: f64,
    /// Search widely for every window, as a comparison
    #[arg(long)]
    exhaustive: bool,
    /// Report errors against the true motion, as `insonify rf --truth` writes it
    #[arg(long, value_name = "FILE.csv")]
    truth: Option<PathBuf>,
    /// Draw estimates against the truth into the folder -o, as Dehghan et al. 2008: those of RF against --truth, or
    /// without RF those of media and an insertion whose motion is known
    #[arg(long, conflicts_with_all = ["strain", "displacement"])]
    validate: bool,
    /// With --validate and without RF: smaller media and a shorter insertion
    #[arg(long, requires = "validate", conflicts_with = "input")]
    quick: bool,
    /// Write the axial strain of a frame in colour over its B-mode
    #[arg(long, value_name = "FILE.png")]
    strain: Option<PathBuf>,
    /// Write the axial motion of a frame in colour over its B-mode
    #[arg(long, value_name = "FILE.png")]
    displacement: Option<PathBuf>,
    /// Frame of the pictures, from 1 [default: that of the largest mean motion, or of the largest strain, before windows
    /// are lost]
    #[arg(long, value_name = "N", conflicts_with = "validate")]
    frame: Option<usize>,
    #[command(flatten)]
    force: Force,
    /// Print JSON: `frames`, `lines`, `windows`, `correlation` (mean), `trusted` (share of windows that are
    /// not lost), `correlations` (count), `references` (changes of a window's reference, mean), `lost` (frames in which a
    /// fifth of the windows are lost), and with --truth `errors`
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct MotionReport {
    frames: usize,
    lines: usize,
    windows: usize,
    /// Mean correlation of the windows.
    correlation: f64,
    /// Share of the windows that are not lost.
    trusted: f64,
    /// Number of correlations computed.
    correlations: u64,
    /// Changes of the reference of a window, in the mean.
    references: f64,
    /// Frames in which the share of windows that are not lost falls to less than [`KEPT`] of that of the best frame
    /// before.
    lost: Vec<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    errors: Option<Errors>,
}

/// Errors of windows that are not lost, um.
#[derive(Serialize)]
struct Errors {
    windows: usize,
    axial: Spread,
    lateral: Spread,
}

#[derive(Serialize)]
struct Spread {
    bias_um: f64,
    sd_um: f64,
    /// Largest magnitude of the mean error of a frame.
    worst_mean_um: f64,
    /// Largest standard deviation of a frame.
    worst_sd_um: f64,
}

/// Share of the windows that are not lost which must be left from one frame to the next: below it tissue moved further
/// than the search reaches.
const KEPT: f64 = 0.8;

impl Motion {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if self.validate {
            return self.validation();
        }
        let read: Vec<PathBuf> = self.input.iter().chain(&self.truth).cloned().collect();
        self.force.check_ending([&self.output], "csv", "tables", &read)?;
        let pictures = self.strain.iter().chain(&self.displacement);
        self.force.check_ending(pictures, "png", "pictures", &read)?;
        let (echoes, options) = self.echoes()?;
        let truth = self.known(&echoes)?;
        if let Some(frame) = self.frame.filter(|frame| !(1..echoes.frames.len()).contains(frame)) {
            let expected = format!("give a frame from 1 to {}", echoes.frames.len() - 1);
            return Err(usage(format!("--frame {frame}"), expected));
        }
        let depths = options.centres_mm(echoes.samples);
        let mut tracker = Tracker::new(options, echoes.lines, &echoes.frames[0]);
        let stage = terminal::frames("tracking motion", echoes.frames.len() - 1);
        let mut summary = Summary::new(self, options.fallback);
        atomic::write(&self.output, |file| {
            writeln!(
                file,
                "frame,line,window,depth_mm,axial_um,lateral_um,correlation,least_correlation"
            )?;
            for (frame, values) in echoes.frames.iter().enumerate().skip(1) {
                let estimates = tracker.next(values);
                write_rows(file, frame, &estimates, &depths)?;
                let truth = truth.as_ref().map(|truth| truth[frame].as_slice());
                summary.add(frame, estimates, truth, &depths);
                stage.frame();
            }
            Ok(())
        })?;
        drop(stage);
        let shown = [(&self.displacement, &summary.moved), (&self.strain, &summary.strained)];
        for (path, shown) in shown {
            if let (Some(path), Some(shown)) = (path, shown) {
                let picture = self.picture(&echoes, &depths, shown)?;
                png::write_rgb(path, picture.width() as usize, picture.height() as usize, &picture)?;
            }
        }
        let frames = echoes.frames.len() - 1;
        let count = (echoes.lines * options.windows) as f64;
        let report = MotionReport {
            frames: frames + 1,
            lines: echoes.lines,
            windows: options.windows,
            correlation: summary.correlation / (frames as f64 * count),
            trusted: summary.trusted / frames as f64,
            correlations: tracker.correlations,
            references: tracker.references(),
            lost: summary.losses.frames.clone(),
            errors: truth.is_some().then(|| summary.tally.errors()),
        };
        summary.losses.warning(options.wide_mm).iter().for_each(terminal::warn);
        terminal::show(&report, self.json, || report.text())
    }

    fn echoes(&self) -> Result<(Echoes, Options), Error> {
        let path = self.input.as_deref().unwrap_or(Path::new(""));
        let echoes = Echoes::read(path)?;
        terminal::notes(&echoes.notes);
        let options = self.options(path, &echoes)?;
        Ok((echoes, options))
    }

    /// True axial and lateral motion of the windows, by frame, if asked for.
    fn known(&self, echoes: &Echoes) -> Result<Option<Vec<Vec<[f64; 2]>>>, Error> {
        let read = |path| truth(path, echoes, usize::from(self.windows));
        self.truth.as_deref().map(read).transpose()
    }

    fn validation(&self) -> Result<(), Error> {
        let printed = Printed::new(Some(self.output.clone()), self.force, self.json);
        if self.input.is_none() {
            let effort = if self.quick { Effort::Quick } else { Effort::Whole };
            return printed.run(|progress| validation::study(effort, progress));
        }
        printed.check()?;
        let (echoes, options) = self.echoes()?;
        let Some(truth) = self.known(&echoes)? else {
            let expected = "give --truth, as `insonify rf --truth` writes it";
            return Err(usage("--validate of a sequence without its true motion", expected));
        };
        printed.run(|progress| {
            let axis = Axis::linear("frame", "frame", "frame");
            let mut course = validation::Course::new(options, echoes.lines, echoes.samples, axis);
            let mut tracker = Tracker::new(options, echoes.lines, &echoes.frames[0]);
            let name = "sequence";
            for (frame, (values, truth)) in echoes.frames.iter().zip(&truth).enumerate().skip(1) {
                progress(name, frame as f64 / echoes.frames.len() as f64);
                let estimates = tracker.next(values);
                course.push(name, frame as f64, &estimates, truth);
                course.push_places(frame as f64, &estimates, truth);
            }
            course.end(name, tracker.references());
            let line = &echoes.frames[0][echoes.lines / 2 * echoes.samples..][..echoes.samples];
            let about = [self.input.as_deref(), self.truth.as_deref()].into_iter().flatten();
            let about = ["echoes", "truth"]
                .into_iter()
                .zip(about.map(|path| path.display().to_string()));
            Ok(course.study(line, about.collect()))
        })
    }

    fn options(&self, path: &Path, echoes: &Echoes) -> Result<Options, Error> {
        let wrong = |found: String, expected: &str| Err(usage(found, expected));
        let file = path.display();
        if echoes.baseband {
            return wrong(
                format!("{file}: baseband values (IQ)"),
                "give radio-frequency echoes (RF_REAL)",
            );
        }
        if echoes.frames.len() < 2 {
            return wrong(format!("{file}: one frame"), "give a sequence of two frames or more");
        }
        let Some(sampling_mhz) = self.sampling_mhz.or(echoes.stated[0]) else {
            return wrong(
                format!("{file}: the sampling rate is not stated"),
                "give --sampling-mhz",
            );
        };
        let curved = echoes.stated[2].zip(echoes.stated[3]);
        let angle = self.geometry.radius_mm.zip(self.geometry.angle_deg).or(curved);
        // Lines of a curved array diverge: their distance is taken along the arc of the array itself.
        let at_array = angle.map(|(radius, angle)| radius * angle.to_radians() / (echoes.lines.max(2) - 1) as f64);
        let Some(pitch_mm) = self.geometry.pitch_mm.or(echoes.stated[1]).or(at_array) else {
            return wrong(
                format!("{file}: the distance between lines is not stated"),
                "give --pitch-mm",
            );
        };
        let length_mm = echoes.samples as f64 * self.speed_m_s * 1e-3 / (2.0 * sampling_mhz);
        let line_angle = match (self.geometry.pitch_mm, angle) {
            (None, Some((_, angle))) => angle.to_radians() / (echoes.lines.max(2) - 1) as f64,
            _ => 0.0,
        };
        for (name, value, greatest) in [
            ("--sampling-mhz", sampling_mhz, 1000.0),
            ("--speed-m-s", self.speed_m_s, 10_000.0),
            ("--window-mm", self.window_mm, length_mm / 2.0),
            ("--wide-mm", self.wide_mm, length_mm),
            ("--fallback", self.fallback, 1.0),
            ("--switch", self.switch, 1.0),
        ] {
            if !(value > 0.0 && value <= greatest) {
                return wrong(
                    format!("{name} {value}"),
                    &format!("give a number above 0, at most {greatest:.3}"),
                );
            }
        }
        Ok(Options {
            speed_m_s: self.speed_m_s,
            window_mm: self.window_mm,
            windows: usize::from(self.windows),
            upsampling: usize::from(self.upsampling),
            wide_mm: self.wide_mm,
            fallback: self.fallback,
            switch: self.switch,
            line_angle,
            prior: !self.exhaustive,
            ..Options::new(sampling_mhz, pitch_mm)
        })
    }
}

/// True axial and lateral motion by frame, in the order of the estimates.
fn truth(path: &Path, echoes: &Echoes, windows: usize) -> Result<Vec<Vec<[f64; 2]>>, Error> {
    let table = Csv::read(
        path,
        &["frame", "line", "window", "axial_um", "lateral_um"],
        &["depth_mm", "elevational_um"],
    )?;
    let mut truth = vec![vec![[f64::NAN; 2]; echoes.lines * windows]; echoes.frames.len()];
    for row in table.rows() {
        let (frame, line, window) = (row.count("frame")?, row.count("line")?, row.count("window")?);
        if frame >= truth.len() || line >= echoes.lines || window >= windows {
            let expected = format!(
                "{} frames of {} lines with {windows} windows",
                truth.len(),
                echoes.lines
            );
            return Err(row.wrong("window", expected).into());
        }
        truth[frame][line * windows + window] = row.numbers(["axial_um", "lateral_um"])?;
    }
    if truth.iter().flatten().any(|pair| pair[0].is_nan()) {
        Err(TrackingError::new(format!(
            "{}: rows are missing; expected one for each of {} frames, {} lines and {windows} windows",
            path.display(),
            truth.len(),
            echoes.lines
        ))
        .into())
    } else {
        Ok(truth)
    }
}

/// Writes the rows of a frame.
fn write_rows(file: &mut impl Write, frame: usize, estimates: &[Estimate], depths_mm: &[f64]) -> io::Result<()> {
    for (index, estimate) in estimates.iter().enumerate() {
        let (line, window) = (index / depths_mm.len(), index % depths_mm.len());
        writeln!(
            file,
            "{frame},{line},{window},{:.4},{:.3},{:.3},{:.5},{:.5}",
            depths_mm[window], estimate.axial_um, estimate.lateral_um, estimate.correlation, estimate.least_correlation
        )?;
    }
    Ok(())
}

/// Statistics of a sequence, and the frames for its pictures.
#[derive(Default)]
struct Summary {
    /// Correlation below which a window is lost.
    fallback: f64,
    /// Frame of the pictures, if it is asked for.
    requested: Option<usize>,
    /// Pictures of motion and of strain that are wanted.
    wanted: [bool; 2],
    /// Sum of the correlations of all windows.
    correlation: f64,
    /// Sum over the frames of the share of windows that are not lost.
    trusted: f64,
    losses: Losses,
    moved: Option<Shown>,
    strained: Option<Shown>,
    tally: Tally,
}

impl Summary {
    fn new(options: &Motion, fallback: f64) -> Self {
        Self {
            fallback,
            requested: options.frame,
            wanted: [options.displacement.is_some(), options.strain.is_some()],
            ..Self::default()
        }
    }

    /// Takes the estimates of a frame, and its true motion if it is known. Shown is the requested frame, or else the
    /// one that moves or is strained most.
    fn add(&mut self, frame: usize, estimates: Vec<Estimate>, truth: Option<&[[f64; 2]]>, depths: &[f64]) {
        let fallback = self.fallback;
        for estimate in &estimates {
            self.correlation += estimate.correlation;
        }
        let trusted = estimates.iter().filter(|estimate| estimate.is_trusted(fallback));
        let share = trusted.count() as f64 / estimates.len() as f64;
        self.trusted += share;
        self.losses.see(frame, share);
        if let Some(truth) = truth {
            self.tally.add(&estimates, truth, fallback);
        }
        let [moved, strained] = self.wanted;
        let pictures = [
            (
                moved,
                &mut self.moved,
                Shown::motion as fn(_, &[Estimate], &[f64], _) -> Shown,
            ),
            (strained, &mut self.strained, Shown::strain),
        ];
        for (_, shown, new) in pictures.into_iter().filter(|(wanted, ..)| *wanted) {
            // Once windows are lost, large motions are likely false matches: such a frame is not picked for the picture.
            let is_next = match (self.requested, &*shown) {
                (Some(requested), _) => requested == frame,
                (None, Some(_)) => self.losses.frames.is_empty(),
                (None, None) => true,
            };
            if is_next {
                let candidate = new(frame, &estimates, depths, fallback);
                if shown.as_ref().is_none_or(|shown| candidate.size() > shown.size()) {
                    *shown = Some(candidate);
                }
            }
        }
    }
}

/// Frames in which windows were lost.
#[derive(Default)]
struct Losses {
    frames: Vec<usize>,
    /// Largest share of windows that correlate of the frames so far.
    best: f64,
    /// Share in the first of the frames, and largest before.
    fall: [f64; 2],
}

impl Losses {
    /// Takes the share of the windows of a frame that correlate.
    fn see(&mut self, frame: usize, share: f64) {
        if share < KEPT * self.best {
            if self.frames.is_empty() {
                self.fall = [share, self.best];
            }
            self.frames.push(frame);
        }
        self.best = self.best.max(share);
    }

    /// Warning about the frames, given the reach of the search.
    fn warning(&self, wide_mm: f64) -> Option<String> {
        let first = self.frames.first()?;
        let [after, before] = self.fall.map(|share| 100.0 * share);
        let others = match self.frames.len() {
            1 => String::new(),
            2 => ", and a later frame loses windows too".to_owned(),
            n => format!(", and {} later frames lose windows too", n - 1),
        };
        Some(format!(
            "frame {first}: only {after:.0} % of the windows correlate, {before:.0} % before{others}. Tissue moved \
             further than the search reaches ({wide_mm} mm), or tore: windows that are lost stay so until their echoes are \
             found again (least_correlation); record more frames a second"
        ))
    }
}

/// Sums of the errors, frame by frame.
#[derive(Default)]
struct Tally {
    /// Count, and mean and standard deviation of the axial and the lateral error of each frame.
    frames: Vec<(f64, [[f64; 2]; 2])>,
}

impl Tally {
    fn add(&mut self, estimates: &[Estimate], truth: &[[f64; 2]], fallback: f64) {
        let trusted = || {
            estimates
                .iter()
                .zip(truth)
                .filter(|(estimate, _)| estimate.is_trusted(fallback))
        };
        let n = trusted().count().max(1) as f64;
        let moments = |error: fn(&Estimate, &[f64; 2]) -> f64| {
            let mean = trusted().map(|(estimate, truth)| error(estimate, truth)).sum::<f64>() / n;
            let square = trusted()
                .map(|(estimate, truth)| (error(estimate, truth) - mean).powi(2))
                .sum::<f64>()
                / n;
            [mean, square.sqrt()]
        };
        let both = [
            moments(|estimate, truth| estimate.axial_um - truth[0]),
            moments(|estimate, truth| estimate.lateral_um - truth[1]),
        ];
        self.frames.push((n, both));
    }

    fn errors(&self) -> Errors {
        let n: f64 = self.frames.iter().map(|(n, _)| n).sum();
        let spread = |axis: usize| {
            let frames = || self.frames.iter().map(|(n, both)| (*n, both[axis]));
            let bias = frames().map(|(n, [mean, _])| n * mean).sum::<f64>() / n;
            let square = frames()
                .map(|(n, [mean, sd])| n * (sd * sd + (mean - bias).powi(2)))
                .sum::<f64>()
                / n;
            Spread {
                bias_um: bias,
                sd_um: square.sqrt(),
                worst_mean_um: frames().map(|(_, [mean, _])| mean.abs()).fold(0.0, f64::max),
                worst_sd_um: frames().map(|(_, [_, sd])| sd).fold(0.0, f64::max),
            }
        };
        Errors {
            windows: n as usize,
            axial: spread(0),
            lateral: spread(1),
        }
    }
}

impl MotionReport {
    fn text(&self) -> String {
        let mut text = format!(
            "{} frames of {} lines with {} windows: mean correlation {:.4}, {:.1} % of the windows are not lost, \
             {:.2} changes of a window's reference, {:.1} correlations a window",
            self.frames,
            self.lines,
            self.windows,
            self.correlation,
            100.0 * self.trusted,
            self.references,
            self.correlations as f64 / ((self.frames - 1) * self.lines * self.windows) as f64
        );
        if let Some(errors) = &self.errors {
            for (name, spread) in [("axial", &errors.axial), ("lateral", &errors.lateral)] {
                text += &format!(
                    "\n{name} error: bias {:.3} um, SD {:.3} um; by frame up to {:.3} and {:.3} um",
                    spread.bias_um, spread.sd_um, spread.worst_mean_um, spread.worst_sd_um
                );
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture of motion shows the frame that moved most, that of strain the one that is strained most.
    #[test]
    fn pictures_show_the_largest_motion_and_the_largest_strain() {
        let depths: Vec<f64> = (0..20).map(f64::from).collect();
        let frame = |moved: fn(f64) -> f64| -> Vec<Estimate> {
            let estimate = |depth: &f64| Estimate {
                axial_um: moved(*depth),
                correlation: 1.0,
                least_correlation: 1.0,
                ..Estimate::default()
            };
            depths.iter().map(estimate).collect()
        };
        let shown = |requested| {
            let mut summary = Summary {
                fallback: 0.8,
                requested,
                wanted: [true; 2],
                ..Summary::default()
            };
            let frames: [fn(f64) -> f64; 3] = [|_| 10.0, |_| 500.0, |depth| 10.0 * depth];
            for (number, moved) in frames.into_iter().enumerate() {
                summary.add(number + 1, frame(moved), None, &depths);
            }
            [summary.moved, summary.strained].map(|shown| shown.expect("a frame").frame)
        };
        assert_eq!(shown(None), [2, 3]);
        assert_eq!(shown(Some(1)), [1, 1]);
    }

    #[test]
    fn frames_that_lose_their_windows_are_told() {
        let mut losses = Losses::default();
        for (index, share) in [0.9, 0.97, 0.8, 0.97, 0.58, 0.9, 0.6].into_iter().enumerate() {
            losses.see(index + 1, share);
        }
        assert_eq!((&losses.frames[..], losses.fall), (&[5, 7][..], [0.58, 0.97]));
        let warning = losses.warning(0.8).expect("a warning");
        assert!(
            warning.starts_with(
                "frame 5: only 58 % of the windows correlate, 97 % before, and a later frame loses windows too"
            ),
            "{warning}"
        );
        assert_eq!(Losses::default().warning(0.8), None);
    }
}
