//! Corrections of a model by comparing its phantoms with the real frame in the same windows.

use super::WindowMeasurements;
use super::bench::{Bench, DEPTHS, WINDOWS};
use super::model::Model;
use crate::realism::DARK_WINDOW;
use crate::realism::picture::Picture;
use crate::realism::texture::{Patch, Texture, Window, dark_windows};
use insonify_base::statistics::{mean, median, percentile, slope, std};
use insonify_imaging::anatomies::SILENT;
use insonify_imaging::effects::receiver::Receiver;
use insonify_imaging::synth::SynthError;

/// Number of correction rounds for noise and clutter.
const DARK_ROUNDS: usize = 3;
/// Least depth range over which a decay of clutter is fitted, mm.
const MIN_DECAY_EXTENT_MM: f64 = 10.0;

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
    /// Corrects a model by its phantoms in one round and returns the largest relative change.
    pub(crate) fn correct(&self, model: &mut Model, real: &WindowMeasurements, phantom: &WindowMeasurements) -> f64 {
        let before = model.clone();
        let ratio = |measure: &dyn Fn(&Texture) -> Option<f64>| {
            let [real, phantom] =
                [real, phantom].map(|side| median(side.windows.iter().flatten().filter_map(measure).collect()));
            let ratio = real? / phantom?;
            (ratio.is_finite() && ratio > 0.0).then_some(ratio)
        };
        let range = before.tone.dynamic_range_db / ratio(&|texture| Some(texture.std)).unwrap_or(1.0);
        model.tone.dynamic_range_db = range.clamp(10.0, 120.0);
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
        let mut dark = DarkFindings {
            bound_db: self.noise_bound_db(model, &beam, &inside).clamp(-200.0, 20.0),
            windows: [windows[0].len(), windows[1].len()],
            ..DarkFindings::default()
        };
        let real = [0, 1].map(|kind| greys(&beam, &windows[kind]));
        let depths = [0, 1].map(|kind| {
            windows[kind]
                .iter()
                .map(|&window| self.depth_mm(window))
                .collect::<Vec<f64>>()
        });
        let defaults = Receiver::default();
        model.receiver.noise_db = defaults.noise_db.min(dark.bound_db);
        let level = |model: &Model, kind: usize, greys: &[f64]| -> Vec<f64> {
            greys
                .iter()
                .zip(&depths[kind])
                .map(|(grey, depth)| model.level_db(*grey, *depth))
                .collect()
        };
        // Level of a window at the array, except for the loss in tissue; as tissue may echo in any window, the darkest counts.
        let lossless = |model: &Model, kind: usize| -> Vec<f64> {
            let levels = level(model, kind, &real[kind]).into_iter().zip(&depths[kind]);
            levels
                .map(|(level, depth)| level + model.tgc_db_cm() * depth / 10.0)
                .collect()
        };
        let extent = depths[1]
            .iter()
            .fold(0.0, |largest: f64, d| largest.max((d - depths[1][0]).abs()));
        if extent >= MIN_DECAY_EXTENT_MM {
            dark.fades = true;
            let fading = -10.0 * slope(&depths[1], &lossless(model, 1));
            model.receiver.clutter_decay_db_cm = fading.clamp(0.0, 50.0);
        }
        let decay = model.receiver.clutter_decay_db_cm;
        let at_array = |model: &Model, kind: usize| {
            let levels = lossless(model, kind).into_iter().zip(&depths[kind]);
            lowest(levels.map(|(level, depth)| level + decay * depth / 10.0))
        };
        if !windows[0].is_empty() {
            model.receiver.noise_db = lowest(level(model, 0, &real[0]).into_iter()).clamp(-200.0, 20.0);
            let quiet = at_array(model, 0) - HIDDEN_DB;
            model.receiver.clutter_db = defaults.clutter_db.min(quiet).max(-200.0);
        }
        if !windows[1].is_empty() {
            model.receiver.clutter_db = at_array(model, 1).clamp(-200.0, 20.0);
        }
        // Logarithms, sparse echoes and black bias a mean grey against the power: the remainder is corrected with the echo-free phantom.
        for _ in 0..DARK_ROUNDS {
            if windows.iter().all(Vec::is_empty) {
                break;
            }
            let silent = self.phantoms(model.probe(self.probe), &model.effects(), SILENT)?;
            let silent: Vec<Picture> = silent.iter().map(|frame| self.beam(frame).0).collect();
            let deficit = [0, 1].map(|kind| -> Vec<f64> {
                let phantom: Vec<Vec<f64>> = silent.iter().map(|beam| greys(beam, &windows[kind])).collect();
                let phantom = |class: usize| mean(&phantom.iter().map(|greys| greys[class]).collect::<Vec<f64>>());
                let phantom: Vec<f64> = (0..windows[kind].len()).map(phantom).collect();
                let pairs = level(model, kind, &real[kind])
                    .into_iter()
                    .zip(level(model, kind, &phantom));
                pairs.map(|(real, phantom)| real - phantom).collect()
            });
            dark.spread_db = [0, 1].map(|kind| (deficit[kind].len() > 1).then(|| std(&deficit[kind])));
            if !deficit[0].is_empty() {
                model.receiver.noise_db =
                    (model.receiver.noise_db + lowest(deficit[0].iter().copied())).clamp(-200.0, 20.0);
            }
            if !deficit[1].is_empty() {
                model.receiver.clutter_db =
                    (model.receiver.clutter_db + lowest(deficit[1].iter().copied())).clamp(-200.0, 20.0);
            }
        }
        Ok(dark)
    }
}

/// Mean grey level of each window.
fn greys(frame: &Picture, windows: &[Window]) -> Vec<f64> {
    let mean_of = |window: &Window| mean(&Patch::of(&frame.grey, frame.width, *window).values);
    windows.iter().map(mean_of).collect()
}
