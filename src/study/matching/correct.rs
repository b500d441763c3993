//! Corrections of a model by comparing its phantoms with the real frame in the same windows.

use super::WindowMeasurements;
use super::bench::{Bench, DEPTHS, WINDOWS};
use super::model::Model;
use crate::realism::DARK_WINDOW;
use crate::realism::picture::Picture;
use crate::realism::texture::{Patch, Texture, Window, dark_windows};
use insonify_base::statistics::{mean, median, percentile, slope, std};
use insonify_imaging::anatomies::SILENT;
use insonify_imaging::effects::receiver::{CLUTTER_DB, Receiver};
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::synth::SynthError;

/// Number of correction rounds for noise and clutter.
const DARK_ROUNDS: usize = 3;
/// Least depth range over which a decay of clutter is fitted, mm.
const MIN_DECAY_EXTENT_MM: f64 = 10.0;
/// Largest dynamic range of a scene, dB.
pub(super) const MAX_RANGE_DB: f64 = 120.0;
/// Level below the noise assumed for clutter that no window shows, dB: there it adds half a dB.
const HIDDEN_DB: f64 = 10.0;

/// Noise and clutter found in dark windows.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DarkFindings {
    /// Number of windows of noise and of clutter.
    pub windows: [usize; 2],
    /// Spread of the levels found for noise and for clutter, dB.
    pub spread_db: [Option<f64>; 2],
    /// Whether the decay of clutter was fitted.
    pub fades: bool,
    /// Upper bound of the noise level, dB.
    pub bound_db: f64,
}

fn lowest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(f64::INFINITY, f64::min)
}

impl Bench<'_> {
    /// Corrects a model by its phantoms in one round and returns the largest relative change. Once grey levels are more
    /// even than speckle of any range, the range is held at its default.
    pub(crate) fn correct(
        &mut self,
        model: &mut Model,
        real: &WindowMeasurements,
        phantom: &WindowMeasurements,
    ) -> f64 {
        let before = model.clone();
        let ratio = |measure: &dyn Fn(&Texture) -> Option<f64>| {
            let [real, phantom] =
                [real, phantom].map(|side| median(side.windows.iter().flatten().filter_map(measure).collect()));
            let ratio = real? / phantom?;
            (ratio.is_finite() && ratio > 0.0).then_some(ratio)
        };
        let range = before.tone.dynamic_range_db / ratio(&|texture| Some(texture.std)).unwrap_or(1.0);
        if range > MAX_RANGE_DB {
            // The scanner has smoothed the speckle, and its range is not known.
            self.range_db.get_or_insert(Tone::default().dynamic_range_db);
        }
        model.tone.dynamic_range_db = self.range_db.unwrap_or(range.max(10.0));
        let axial = before.axial_mm * ratio(&|texture| texture.fwhm[0]).unwrap_or(1.0);
        model.axial_mm = axial.clamp(0.05, 10.0);
        let lateral_at = |model: &Model, depth: f64| model.spread(&model.probe(self.probe)).lateral_at(depth);
        let lengths = real.depths.iter().zip(&phantom.depths).filter_map(|(real, phantom)| {
            let length = lateral_at(&before, real.depth_mm) * real.lateral_mm? / phantom.lateral_mm?;
            Some([real.depth_mm, length])
        });
        let lengths: Vec<[f64; 2]> = lengths.collect();
        if !lengths.is_empty() {
            model.focus(&lengths, self.probe.depth_mm);
        }
        // Greys of the phantom follow from gain and range, so the gain can be solved for.
        let departure = |depth: f64| before.gain_db(depth) - before.tgc_db_cm() * depth / 10.0;
        let gains = real.depths.iter().zip(&phantom.depths).map(|(real, phantom)| {
            let shown_db = model.shown_db(real.grey) - before.shown_db(phantom.grey);
            [real.depth_mm, shown_db + departure(real.depth_mm)]
        });
        let gains: Vec<[f64; 2]> = gains.collect();
        let middle = mean(&gains.iter().map(|gain| gain[1]).collect::<Vec<f64>>());
        model.tone.gain_db = middle.clamp(-60.0, 60.0);
        model.tone.tgc_points = match gains.len() {
            1 => Vec::new(),
            _ => gains.iter().map(|[depth, gain]| [*depth, gain - middle]).collect(),
        };
        let gain_changes = gains.iter().map(|&[depth, gain]| 0.1 * (gain - departure(depth)).abs());
        let lateral = real
            .depths
            .iter()
            .map(|depth| lateral_at(model, depth.depth_mm) / lateral_at(&before, depth.depth_mm));
        let shares = [
            model.tone.dynamic_range_db / before.tone.dynamic_range_db,
            model.axial_mm / before.axial_mm,
        ];
        let changes = shares.into_iter().chain(lateral).map(|share| share.ln().abs());
        changes.chain(gain_changes).fold(0.0, f64::max)
    }

    /// Upper bound of the noise, dB: at no depth does it exceed the darkest 2 % of its row.
    fn noise_bound_db(&self, model: &Model, beam: &Picture, inside: &[bool]) -> f64 {
        let mut bound = f64::INFINITY;
        for sample in 0..beam.height {
            let row = sample * beam.width..(sample + 1) * beam.width;
            let mut greys: Vec<f64> = row
                .filter(|&pixel| inside[pixel])
                .map(|pixel| beam.grey[pixel])
                .collect();
            greys.sort_by(f64::total_cmp);
            if let Some(grey) = percentile(&greys, 0.02).filter(|_| 2 * greys.len() > beam.width) {
                bound = bound.min(model.level_db(grey, self.grid.sample_depth_mm(sample)));
            }
        }
        bound
    }

    /// Dark windows of noise, and of clutter.
    fn noise_and_clutter(&self, model: &Model, beam: &Picture, inside: &[bool]) -> [Vec<Window>; 2] {
        let spread = model.spread(&model.probe(self.probe));
        let mut windows: [Vec<Window>; 2] = Default::default();
        for window in dark_windows(beam, inside, [DARK_WINDOW; 2], DEPTHS * WINDOWS) {
            let depth = self.depth_mm(window);
            let width = self.widths(&Patch::of(&beam.grey, beam.width, window).texture(), depth)[1];
            // Clutter is an echo and at least as wide as the beam; noise is not.
            windows[usize::from(width.is_none_or(|width| width >= spread.lateral_at(depth)))].push(window);
        }
        windows
    }

    /// Sets noise and clutter from the dark windows of the real frame and returns what was found.
    pub(crate) fn darkness(&self, model: &mut Model) -> Result<DarkFindings, SynthError> {
        let (beam, inside) = self.beam(self.picture);
        let windows = self.noise_and_clutter(model, &beam, &inside);
        let mut findings = DarkFindings {
            bound_db: self.noise_bound_db(model, &beam, &inside).clamp(-200.0, 20.0),
            windows: [windows[0].len(), windows[1].len()],
            ..DarkFindings::default()
        };
        let dark = DarkWindows {
            greys: [0, 1].map(|kind| greys(&beam, &windows[kind])),
            depths_mm: [0, 1].map(|kind| windows[kind].iter().map(|&window| self.depth_mm(window)).collect()),
            windows,
        };
        findings.fades = dark.estimate(model, findings.bound_db);
        // Logarithms, sparse echoes and black bias a mean grey against the power: the remainder is corrected with the
        // echo-free phantom.
        for _ in 0..DARK_ROUNDS {
            if dark.windows.iter().all(Vec::is_empty) {
                break;
            }
            let silent = self.phantoms(model.probe(self.probe), &model.effects(), SILENT)?;
            let silent: Vec<Picture> = silent.iter().map(|frame| self.beam(frame).0).collect();
            let deficits = [0, 1].map(|kind| dark.deficit_db(model, kind, &silent));
            let Receiver {
                noise_db, clutter_db, ..
            } = &mut model.receiver;
            let clutter_db = clutter_db.get_or_insert(CLUTTER_DB);
            for (level_db, deficit) in [noise_db, clutter_db].into_iter().zip(&deficits) {
                if !deficit.is_empty() {
                    *level_db = (*level_db + lowest(deficit.iter().copied())).clamp(-200.0, 20.0);
                }
            }
            findings.spread_db = deficits.map(|deficit| (deficit.len() > 1).then(|| std(&deficit)));
        }
        Ok(findings)
    }
}

/// Dark windows of the real frame: of noise, and of clutter.
struct DarkWindows {
    windows: [Vec<Window>; 2],
    depths_mm: [Vec<f64>; 2],
    /// Mean grey levels.
    greys: [Vec<f64>; 2],
}

impl DarkWindows {
    /// Levels that give the windows of a kind their greys, dB.
    fn levels_db(&self, model: &Model, kind: usize, greys: &[f64]) -> Vec<f64> {
        let windows = greys.iter().zip(&self.depths_mm[kind]);
        windows.map(|(grey, depth)| model.level_db(*grey, *depth)).collect()
    }

    /// Levels of the real frame at the array, except for a decay, dB.
    fn lossless_db(&self, model: &Model, kind: usize) -> Vec<f64> {
        let levels = self.levels_db(model, kind, &self.greys[kind]);
        let windows = levels.into_iter().zip(&self.depths_mm[kind]);
        let lossless = windows.map(|(level, depth)| level + model.tgc_db_cm() * depth / 10.0);
        lossless.collect()
    }

    /// Sets noise and clutter from the real frame alone, and returns whether the decay of clutter was fitted.
    fn estimate(&self, model: &mut Model, noise_bound_db: f64) -> bool {
        let defaults = Receiver::default();
        model.receiver.noise_db = defaults.noise_db.min(noise_bound_db);
        let depths = &self.depths_mm[1];
        let extent = depths
            .iter()
            .fold(0.0, |largest: f64, depth| largest.max((depth - depths[0]).abs()));
        let fades = extent >= MIN_DECAY_EXTENT_MM;
        if fades {
            let fading = -10.0 * slope(depths, &self.lossless_db(model, 1));
            model.receiver.clutter_decay_db_cm = fading.clamp(0.0, 50.0);
        }
        let decay = model.receiver.clutter_decay_db_cm;
        // As tissue may echo in any window, the darkest counts.
        let at_array = |model: &Model, kind: usize| {
            let levels = self.lossless_db(model, kind).into_iter().zip(&self.depths_mm[kind]);
            lowest(levels.map(|(level, depth)| level + decay * depth / 10.0))
        };
        if !self.windows[0].is_empty() {
            let levels = self.levels_db(model, 0, &self.greys[0]);
            model.receiver.noise_db = lowest(levels.into_iter()).clamp(-200.0, 20.0);
            let quiet = at_array(model, 0) - HIDDEN_DB;
            model.receiver.clutter_db = Some(CLUTTER_DB.min(quiet).max(-200.0));
        }
        if !self.windows[1].is_empty() {
            model.receiver.clutter_db = Some(at_array(model, 1).clamp(-200.0, 20.0));
        }
        fades
    }

    /// Level of the real frame above the mean of echo-free phantoms, by window of a kind, dB.
    fn deficit_db(&self, model: &Model, kind: usize, silent: &[Picture]) -> Vec<f64> {
        let phantoms: Vec<Vec<f64>> = silent.iter().map(|beam| greys(beam, &self.windows[kind])).collect();
        let mean_grey = |window: usize| mean(&phantoms.iter().map(|greys| greys[window]).collect::<Vec<f64>>());
        let phantom: Vec<f64> = (0..self.windows[kind].len()).map(mean_grey).collect();
        let [real, phantom] = [&self.greys[kind], &phantom].map(|greys| self.levels_db(model, kind, greys));
        real.into_iter()
            .zip(phantom)
            .map(|(real, phantom)| real - phantom)
            .collect()
    }
}

/// Mean grey level of each window.
fn greys(frame: &Picture, windows: &[Window]) -> Vec<f64> {
    let mean_of = |window: &Window| mean(&Patch::of(&frame.grey, frame.width, *window).values);
    windows.iter().map(mean_of).collect()
}
