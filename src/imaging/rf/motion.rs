//! Motion of tissue between radio-frequency frames: normalised cross-correlation with prediction from prior estimates
//! (R. Zahiri-Azar and S. E. Salcudean, "Motion estimation in ultrasound images using time domain cross correlation
//! with prior estimates", IEEE Transactions on Biomedical Engineering 53, 2006).

mod search;
mod strain;

use super::signal::upsampled;
use insonify_base::parallel::{self, chunks, chunks_mut, for_each};
use search::{Frame, Match, OUTSIDE, Search};
use strain::{Bend, FIT, Fit, beam_variance, beside, fitted};

/// Settings of the estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Sampling rate of the echoes, MHz.
    pub sampling_mhz: f64,
    /// Speed of sound, m/s.
    pub speed_m_s: f64,
    /// Distance between lines at the array, mm.
    pub pitch_mm: f64,
    /// Angle between lines, rad: 0 for parallel ones.
    pub line_angle: f64,
    /// Length of a window, mm.
    pub window_mm: f64,
    /// Windows along a line.
    pub windows: usize,
    /// Factor of band-limited upsampling.
    pub upsampling: usize,
    /// Reach of the wide search along a line, mm.
    pub wide_mm: f64,
    /// Reach of the wide search across lines.
    pub wide_lines: usize,
    /// Correlation below which the prior is dropped and the wide search made; what stays below it is lost.
    pub fallback: f64,
    /// Correlation (of the peak between samples) below which the echoes of a window in a frame become its new reference.
    pub switch: f64,
    /// True if searches start from the estimates of neighbours; otherwise every search is wide.
    pub prior: bool,
}

impl Options {
    /// Windows of 1 mm, 120 a line, twofold upsampling.
    pub fn new(sampling_mhz: f64, pitch_mm: f64) -> Self {
        Self {
            sampling_mhz,
            speed_m_s: super::SPEED_M_S,
            pitch_mm,
            line_angle: 0.0,
            window_mm: 1.0,
            windows: 120,
            upsampling: 2,
            wide_mm: 0.8,
            wide_lines: 1,
            fallback: 0.8,
            switch: 0.98,
            prior: true,
        }
    }

    /// Distance between samples after upsampling, um.
    fn sample_um(&self) -> f64 {
        self.speed_m_s / 2.0 / self.sampling_mhz / self.upsampling as f64
    }

    /// Length of a window and its first samples along a line of `samples`, after upsampling. A sample at either end
    /// stays free, so that peaks at no motion have neighbours.
    fn layout(&self, samples: usize) -> (usize, Vec<usize>) {
        let wide = samples * self.upsampling;
        let window = ((self.window_mm * 1e3 / self.sample_um()).round() as usize).clamp(8, wide / 2);
        let room = (wide - window - 2 * self.upsampling) as f64;
        let start = |window: usize| {
            self.upsampling + (room * window as f64 / (self.windows.max(2) - 1) as f64).round() as usize
        };
        (window, (0..self.windows).map(start).collect())
    }

    /// Depths of the centres of the windows in the first frame, mm.
    pub fn centres_mm(&self, samples: usize) -> Vec<f64> {
        let (window, starts) = self.layout(samples);
        let centre = |start: &usize| (*start as f64 + window as f64 / 2.0) * self.sample_um() * 1e-3;
        starts.iter().map(centre).collect()
    }
}

/// Neighbours of a window in lines and windows, whose median motion it is compared with: some beam widths aside, as
/// windows on lines within a beam width have the same echoes and err together.
const ASIDE: [isize; 9] = [-16, -8, -4, -2, 0, 2, 4, 8, 16];
const ALONG: [isize; 3] = [-2, 0, 2];
/// Lateral motion beside that of the neighbours beyond which an estimate has strayed, lines.
const STRAY: f64 = 2.0;
/// Passes over the windows that differ from their neighbours; in the second most of the neighbours are right.
const RESEEKS: usize = 2;
/// Fewest neighbours that have a majority.
const MAJORITY: usize = 3;
/// Largest correlation of a window that lies elsewhere than its neighbours want it, as a share of that which counts.
const UNMATCHED: f64 = 0.99;
/// Loss of correlation from one frame to the next beyond which a window takes no new reference, and is no
/// neighbour to follow.
const DROP: f64 = 0.1;
/// Largest effect of strain and shear within a window, as a share of half a period of the echoes: beyond, its tissue
/// tears or the motion about it is not known, and it is lost.
const MOST_BESIDE: f64 = 0.25;
/// Number of neighbours of a window.
const NEIGHBOURS: usize = ASIDE.len() * ALONG.len();
/// Least length of tissue along a line for which the fit is believed, as a share of that in the first frame.
const LEAST_LENGTH: f64 = 0.5;

/// Share of the energy of a window without its mean, below which it is constant but for rounding.
const FLAT: f64 = 1e-9;

/// Estimate of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Motion away from the probe, um.
    pub axial_um: f64,
    /// Motion towards the marked side, um.
    pub lateral_um: f64,
    /// Correlation with the window's reference, at the nearest sample.
    pub correlation: f64,
    /// Least correlation from the first frame to this one: that of this frame or of one that became a reference.
    pub least_correlation: f64,
}

impl Estimate {
    /// True if the window was never lost on the way here, by the least correlation that counts.
    pub fn is_trusted(&self, fallback: f64) -> bool {
        self.least_correlation >= fallback
    }
}

/// Echoes with which a window is compared, those of the first frame or of a later one.
#[derive(Clone, Copy)]
struct Reference {
    /// Norm of the template.
    norm: f64,
    /// First sample and line in its frame.
    origin: [isize; 2],
    /// Motion of the window from the first frame to that of the reference, samples and lines.
    carried: [f64; 2],
    /// Least correlation of the frames that became references of this window so far.
    least: f64,
    /// Moments of the energy of the echoes about the centre of the window in the first frame, by which derivatives of
    /// the motion act on the estimate.
    moments: [f64; 5],
    /// Derivatives of the motion in the frame of the reference.
    bend: Bend,
}

/// Tracks motion frame by frame against the first one.
pub struct Tracker {
    options: Options,
    lines: usize,
    samples: usize,
    window: usize,
    /// First sample of each window in the first frame.
    starts: Vec<usize>,
    /// Windows, line by line.
    references: Vec<Reference>,
    /// Echoes of the references without their means, `window` samples each.
    templates: Vec<f32>,
    /// Half a period of the echoes, samples: neighbours further apart follow different periods.
    half_period: f64,
    /// Variance of the energy across lines, that of the beam, lines squared.
    beam: f64,
    /// Share of each neighbour in the derivatives, where all of [`FIT`] correlate.
    weights: Vec<Bend>,
    /// Motion up to the last frame, samples and lines; windows that did not correlate moved with their neighbours.
    last: Vec<[f64; 2]>,
    /// Correlation in the last frame.
    before: Vec<f64>,
    /// Windows that correlated in the last frame, and had not lost much at once: those may do so by chance.
    kept: Vec<bool>,
    /// Number of correlations computed so far.
    pub correlations: u64,
    /// Changes of a reference, all windows together.
    switches: usize,
}

impl Tracker {
    /// Starts at the first frame: `lines` lines of equal length, one after the other.
    pub fn new(options: Options, lines: usize, frame: &[f32]) -> Self {
        let samples = frame.len() / lines;
        let wide = samples * options.upsampling;
        let (window, starts) = options.layout(samples);
        let values = upsampled(frame, samples, options.upsampling);
        // The half period is counted in the echoes themselves: attenuation lowers their frequency below the probe's.
        let turns = |line: &[f32]| {
            line.windows(2)
                .filter(|pair| (pair[0] < 0.0) != (pair[1] < 0.0))
                .count()
        };
        let turns: usize = parallel::map(chunks(&values, wide), &turns).into_iter().sum();
        let count = lines * options.windows;
        let first = Reference {
            norm: 0.0,
            origin: [0; 2],
            carried: [0.0; 2],
            least: 1.0,
            moments: [0.0; 5],
            bend: [0.0; 5],
        };
        let mut tracker = Self {
            weights: Vec::new(),
            options,
            lines,
            samples: wide,
            window,
            half_period: values.len() as f64 / turns.max(1) as f64,
            beam: beam_variance(&values, wide),
            starts,
            references: vec![first; count],
            templates: vec![0.0; count * window],
            last: vec![[0.0; 2]; count],
            before: vec![1.0; count],
            kept: vec![true; count],
            correlations: 0,
            switches: 0,
        };
        tracker.weights = Fit::shares(tracker.spacing());
        tracker.renew(&values, |_, _| Some(first));
        tracker
    }

    /// Takes the echoes of a frame as references of some windows.
    fn renew(&mut self, values: &[f32], reference: impl Fn(usize, &Reference) -> Option<Reference> + Sync) {
        let mut references = std::mem::take(&mut self.references);
        let mut templates = std::mem::take(&mut self.templates);
        let this = &*self;
        let windows = (0.., &mut references[..], chunks_mut(&mut templates, self.window));
        for_each(windows, &|(index, current, template)| {
            if let Some(next) = reference(index, current) {
                *current = this.reference(index, next, values, template);
            }
        });
        (self.references, self.templates) = (references, templates);
    }

    /// Takes the echoes where a window has been carried as its template.
    fn reference(&self, index: usize, reference: Reference, values: &[f32], template: &mut [f32]) -> Reference {
        let (line, window) = (index / self.options.windows, index % self.options.windows);
        let length = template.len();
        let [down, aside] = reference.carried;
        let exact = [self.starts[window] as f64 + down, line as f64 + aside];
        let start = (exact[0].round() as isize).clamp(0, (self.samples - length) as isize) as usize;
        let line = (exact[1].round() as isize).clamp(0, self.lines as isize - 1) as usize;
        let echoes = |line: usize| &values[line * self.samples + start..][..length];
        let here = echoes(line);
        let mean = (here.iter().map(|value| f64::from(*value)).sum::<f64>() / length as f64) as f32;
        template.iter_mut().zip(here).for_each(|(to, from)| *to = from - mean);
        let energy = |values: &[f32]| values.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>();
        let varying = energy(template);
        let flat = varying <= FLAT * energy(here);
        let mut moments = [0.0; 5];
        if !flat {
            // The echoes of a Gaussian beam of variance s change across lines as those of its scatterers times their
            // distance over s.
            let (before, after) = (echoes(line.saturating_sub(1)), echoes((line + 1).min(self.lines - 1)));
            let slope = |values: &[f32], sample: usize| f64::from(values[sample + 1] - values[sample]);
            let mut total = 0.0;
            for sample in 0..length - 1 {
                let away = sample as f64 + 0.5 - 0.5 * length as f64;
                let slope_here = slope(here, sample);
                let energy = slope_here * slope_here;
                let across = self.beam * slope_here * (slope(after, sample) - slope(before, sample));
                total += energy;
                let terms = [energy * away, across, energy * away * away, across * away];
                moments.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
            }
            let [z, x, zz, zx, _] = moments.map(|sum| sum / total);
            let xx = self.beam;
            let [down, aside] = [start as f64 - exact[0], line as f64 - exact[1]];
            let [z, x, zz, zx, xx] = [
                z + down,
                x + aside,
                zz + 2.0 * down * z + down * down,
                zx + down * x + aside * z + down * aside,
                xx + 2.0 * aside * x + aside * aside,
            ];
            // Back to the first frame.
            let [along, across, ..] = reference.bend;
            let along = (1.0 + along).max(LEAST_LENGTH);
            moments = [
                (z - across * x) / along,
                x,
                0.5 * (zz - 2.0 * across * zx + across * across * xx) / (along * along),
                (zx - across * xx) / along,
                0.5 * xx,
            ];
        }
        Reference {
            norm: if flat { 0.0 } else { varying.sqrt() },
            origin: [start as isize, line as isize],
            moments,
            ..reference
        }
    }

    /// Estimates the motion of each window, line by line, from the first frame to this one.
    pub fn next(&mut self, frame: &[f32]) -> Vec<Estimate> {
        let Options {
            windows: count,
            fallback,
            switch,
            prior,
            ..
        } = self.options;
        let values = upsampled(frame, frame.len() / self.lines, self.options.upsampling);
        let current = Frame::new(values, self.samples, !prior);
        let mut matches = vec![Match::default(); self.lines * count];
        let this = &*self;
        let counts = parallel::map((0.., chunks_mut(&mut matches, count)), &|(line, matches)| {
            this.line(&current, line, matches)
        });
        let mut correlations: u64 = counts.into_iter().sum();
        // Without a prior every search was wide: a window cannot have followed a neighbour astray.
        for _ in 0..if prior { RESEEKS } else { 0 } {
            let before = matches.clone();
            let counts = parallel::map((0.., chunks_mut(&mut matches, count)), &|(line, matches)| {
                this.reseek_outliers(&current, line, &before, matches)
            });
            correlations += counts.into_iter().sum::<u64>();
        }
        let this = &*self;
        let expected = |index: usize| {
            let is_by_chance = this.is_by_chance(index, &matches);
            is_by_chance.then(|| sum(this.last[index], this.common_step(index, &matches)))
        };
        let expected = parallel::map(0..matches.len(), &expected);
        for (found, expected) in matches.iter_mut().zip(expected) {
            if let Some(moved) = expected {
                (found.moved, found.correlation) = (moved, UNMATCHED * fallback);
            }
        }
        let this = &*self;
        let lateral = parallel::map(0..matches.len(), &|index: usize| this.common_lateral(index, &matches));
        let counts = parallel::map((0.., chunks_mut(&mut matches, count)), &|(line, matches)| {
            this.move_to_lines(&current, line, &lateral, matches)
        });
        correlations += counts.into_iter().sum::<u64>();
        self.correlations += correlations;
        let this = &*self;
        // Where the motion about a window is not known, it counts as unchanged since the reference: so does it without
        // a prior, as windows that follow another period would spoil the fit.
        let bend = |index: usize| {
            let fitted = prior.then(|| this.bend(index, &matches)).flatten();
            fitted.unwrap_or(this.references[index].bend)
        };
        let bends = parallel::map(0..matches.len(), &bend);
        let largest = MOST_BESIDE * self.half_period;
        for ((found, reference), bend) in matches.iter_mut().zip(&self.references).zip(&bends) {
            let correction = beside(bend, &reference.moments) - beside(&reference.bend, &reference.moments);
            if correction.abs() <= largest {
                found.moved[0] -= correction;
            } else {
                found.correlation = found.correlation.min(UNMATCHED * fallback);
            }
        }
        let estimate = |(index, found): (usize, &Match)| {
            let depth_mm = self.depth_mm(index % count);
            let pitch_mm = self.options.pitch_mm + self.options.line_angle * depth_mm;
            Estimate {
                axial_um: found.moved[0] * self.options.sample_um(),
                lateral_um: found.moved[1] * pitch_mm * 1e3,
                correlation: found.correlation,
                least_correlation: found.correlation.min(self.references[index].least),
            }
        };
        let estimates = matches.iter().enumerate().map(estimate).collect();
        let held = |(found, before): (&Match, &f64)| found.correlation >= fallback && found.correlation > before - DROP;
        let kept: Vec<bool> = matches.iter().zip(&self.before).map(held).collect();
        let is_renewed = |index: usize| kept[index] && matches[index].height < switch;
        self.switches += (0..matches.len()).filter(|index| is_renewed(*index)).count();
        self.renew(&current.values, |index, reference| {
            let found = &matches[index];
            is_renewed(index).then(|| Reference {
                // Lateral motion is uncertain by a good part of a line, and where the motion changes across lines that
                // error would add up to one along them.
                carried: [found.moved[0], lateral[index]],
                least: reference.least.min(found.correlation),
                bend: bends[index],
                ..*reference
            })
        });
        self.last = matches.iter().map(|found| found.moved).collect();
        self.kept = kept;
        self.before = matches.iter().map(|found| found.correlation).collect();
        estimates
    }

    /// Changes of the reference of a window, in the mean.
    pub fn references(&self) -> f64 {
        self.switches as f64 / self.references.len() as f64
    }

    /// Depth of the centre of a window in the first frame, mm.
    fn depth_mm(&self, window: usize) -> f64 {
        (self.starts[window] as f64 + self.window as f64 / 2.0) * self.options.sample_um() * 1e-3
    }

    /// True if a window was lost, or has lost much of its correlation at once, and most of its neighbours are lost.
    fn is_by_chance(&self, index: usize, matches: &[Match]) -> bool {
        let found = &matches[index];
        let was_lost = !self.kept[index];
        if !self.correlates(found) || !was_lost && found.correlation > self.before[index] - DROP {
            return false;
        }
        let others = self.around(index).filter(|other| was_lost || self.kept[*other]);
        let left = others.clone().filter(|other| self.correlates(&matches[*other]));
        2 * left.count() < others.count()
    }

    /// Median lateral motion of a window and its neighbours that correlate, lines.
    fn common_lateral(&self, index: usize, matches: &[Match]) -> f64 {
        let mut near = [0.0; NEIGHBOURS];
        let mut number = 0;
        for other in self.around(index).filter(|other| self.correlates(&matches[*other])) {
            near[number] = matches[other].moved[1];
            number += 1;
        }
        if number < MAJORITY {
            return matches[index].moved[1];
        }
        *near[..number].select_nth_unstable_by(number / 2, f64::total_cmp).1
    }

    fn correlates(&self, found: &Match) -> bool {
        found.correlation >= self.options.fallback
    }

    /// Estimates windows that correlate along the lines to which tissue has moved as a whole: each of its own would err
    /// by the change of the motion from line to line. Returns the number of correlations.
    fn move_to_lines(&self, current: &Frame, line: usize, lateral: &[f64], matches: &mut [Match]) -> u64 {
        let mut search = self.search(current);
        for (number, found) in matches.iter_mut().enumerate() {
            let index = line * self.options.windows + number;
            let right = (line as f64 + lateral[index]).round() as isize;
            if !self.correlates(found) || found.line == right {
                continue;
            }
            let carried = self.take(&mut search, index);
            let start = (found.moved[0] - carried[0]).round() as isize;
            let peak = search.climb_line([start, right - search.origin[1]]);
            if peak.correlation >= self.options.fallback {
                found.moved[0] = carried[0] + peak.sample[0] as f64 + peak.offset;
                (found.correlation, found.height, found.line) = (peak.correlation, peak.height, right);
            }
        }
        search.count
    }

    /// Derivatives of the motion about a window, fitted to the windows about it that correlate; none where these are
    /// few.
    fn bend(&self, index: usize, matches: &[Match]) -> Option<Bend> {
        let middle = matches[index].moved[0];
        let (count, [aside, along]) = (self.options.windows, FIT.map(|reach| reach as usize));
        let (line, window) = (index / count, index % count);
        let rows = |line: usize| &matches[line * count + window - along..][..2 * along + 1];
        let is_inner = (aside..self.lines.saturating_sub(aside)).contains(&line)
            && (along..count.saturating_sub(along)).contains(&window);
        if is_inner && (line - aside..=line + aside).all(|line| rows(line).iter().all(|found| self.correlates(found))) {
            let mut bend = [0.0; 5];
            let windows = (line - aside..=line + aside).flat_map(rows);
            for (found, share) in windows.zip(&self.weights) {
                let moved = found.moved[0] - middle;
                bend.iter_mut()
                    .zip(share)
                    .for_each(|(sum, share)| *sum += share * moved);
            }
            return Some(bend);
        }
        let mut fit = Fit::new();
        for (aside, along) in fitted() {
            let line = line.checked_add_signed(aside).filter(|line| *line < self.lines);
            let window = window.checked_add_signed(along).filter(|window| *window < count);
            let found = line.zip(window).map(|(line, window)| &matches[line * count + window]);
            if let Some(found) = found.filter(|found| self.correlates(found)) {
                fit.add((aside, along), found.moved[0] - middle);
            }
        }
        fit.bend(self.spacing())
    }

    /// Distance between windows along a line, samples.
    fn spacing(&self) -> f64 {
        (self.starts[self.starts.len() - 1] - self.starts[0]) as f64 / (self.starts.len() - 1).max(1) as f64
    }

    fn search<'a>(&'a self, current: &'a Frame) -> Search<'a> {
        Search {
            frame: current,
            samples: self.samples,
            lines: self.lines as isize,
            template: &[],
            norm: 0.0,
            origin: [0, 0],
            sums: Vec::new(),
            count: 0,
        }
    }

    /// Takes the reference of a window; returns its motion up to then.
    fn take<'a>(&'a self, search: &mut Search<'a>, index: usize) -> [f64; 2] {
        let reference = &self.references[index];
        search.template = &self.templates[index * self.window..][..self.window];
        (search.norm, search.origin) = (reference.norm, reference.origin);
        reference.carried
    }

    /// Seeks windows again that do not correlate, or that follow another period than their neighbours, from the median
    /// of those; returns the number of correlations.
    fn reseek_outliers(&self, current: &Frame, line: usize, before: &[Match], matches: &mut [Match]) -> u64 {
        let mut search = self.search(current);
        let mut near = [[0.0; 2]; NEIGHBOURS];
        let differ = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).abs() > self.half_period || (a[1] - b[1]).abs() > STRAY;
        for (number, window) in matches.iter_mut().enumerate() {
            let index = line * self.options.windows + number;
            let last = self.last[index];
            let step = difference(window.moved, last);
            let correlates = self.correlates(window);
            let agrees = |near: &[[f64; 2]]| {
                correlates && 2 * near.iter().filter(|other| !differ(&step, other)).count() > near.len()
            };
            let kept = self.around(index).filter(|other| self.kept[*other]);
            let (near, were) = (self.steps(kept.clone(), before, &mut near), kept.count());
            // A few neighbours have no majority. Where there were more, all have been lost: what correlates there does so by
            // chance, unless it agrees with others or moves as the nearest window on its line that was not lost.
            let is_right = if near.len() >= MAJORITY {
                agrees(near)
            } else if self.kept[index] && were < MAJORITY {
                true
            } else {
                let mut all = [[0.0; 2]; NEIGHBOURS];
                let all = self.steps(self.around(index), before, &mut all);
                all.len() >= MAJORITY && agrees(all)
            };
            if is_right {
                continue;
            }
            let expected = sum(last, self.common_step(index, before));
            let carried = self.take(&mut search, index);
            let (peak, correlation) =
                search.peak_nearby(difference(expected, carried).map(|shift| shift.round() as isize));
            let refined = search.refined(peak);
            let moved = sum(refined.moved, carried);
            // What does not correlate would stray, frame by frame.
            *window = if differ(&moved, &expected) || !self.correlates(&refined) {
                Match {
                    moved: expected,
                    correlation: correlation.clamp(0.0, UNMATCHED * self.options.fallback),
                    ..refined
                }
            } else {
                Match { moved, ..refined }
            };
        }
        search.count
    }

    /// Windows about one, as far as there are.
    fn around(&self, index: usize) -> impl Iterator<Item = usize> + Clone {
        let (count, lines) = (self.options.windows, self.lines);
        let (line, window) = (index / count, index % count);
        let near_lines = ASIDE.iter().filter_map(move |aside| line.checked_add_signed(*aside));
        near_lines.filter(move |line| *line < lines).flat_map(move |line| {
            let near_windows = ALONG.iter().filter_map(move |along| window.checked_add_signed(*along));
            near_windows
                .filter(move |window| *window < count)
                .map(move |window| line * count + window)
        })
    }

    /// Motion since the last frame of a window's neighbours, their median, or of the nearest window on its line.
    fn common_step(&self, index: usize, matches: &[Match]) -> [f64; 2] {
        let mut near = [[0.0; 2]; NEIGHBOURS];
        let near = self.steps(self.around(index).filter(|other| self.kept[*other]), matches, &mut near);
        if near.len() >= MAJORITY {
            return [0, 1].map(|axis| {
                let half = near.len() / 2;
                near.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis])).1[axis]
            });
        }
        let start = index / self.options.windows * self.options.windows;
        let on_line = (start..start + self.options.windows)
            .filter(|other| self.kept[*other] && self.correlates(&matches[*other]));
        let nearest = on_line.min_by_key(|other| other.abs_diff(index));
        nearest.map_or([0.0; 2], |other| difference(matches[other].moved, self.last[other]))
    }

    /// Motion since the last frame of some windows, of those that correlate.
    fn steps<'a>(
        &self,
        windows: impl Iterator<Item = usize>,
        matches: &[Match],
        steps: &'a mut [[f64; 2]],
    ) -> &'a mut [[f64; 2]] {
        let mut number = 0;
        for window in windows.filter(|window| self.correlates(&matches[*window])) {
            steps[number] = difference(matches[window].moved, self.last[window]);
            number += 1;
        }
        &mut steps[..number]
    }

    /// Estimates along a line; returns the number of correlations.
    fn line(&self, current: &Frame, line: usize, matches: &mut [Match]) -> u64 {
        let mut search = self.search(current);
        let count = self.options.windows;
        let wide = (self.options.wide_mm * 1e3 / self.options.sample_um()).ceil() as isize;
        let across = self.options.wide_lines as isize;
        // Motion since the last frame of the window above, and of the last one that correlated.
        let mut prior: Option<[f64; 2]> = None;
        let mut trusted: Option<[f64; 2]> = None;
        for (number, found) in matches.iter_mut().enumerate() {
            let index = line * count + number;
            let carried = self.take(&mut search, index);
            let last = self.last[index];
            let start = |step: Option<[f64; 2]>| {
                difference(sum(last, step.unwrap_or_default()), carried).map(|shift| shift.round() as isize)
            };
            let mut best = if self.options.prior {
                search.peak_nearby(start(prior))
            } else {
                ([0; 2], OUTSIDE)
            };
            if best.1 < self.options.fallback {
                let best_in_range = search.all(start(trusted), [wide, across]);
                if best_in_range.1 > best.1 {
                    best = best_in_range;
                }
            }
            let window = search.refined(best.0);
            *found = Match {
                moved: sum(window.moved, carried),
                ..window
            };
            // A window that does not correlate is no start for the next one.
            let is_trusted = window.correlation >= self.options.fallback;
            prior = is_trusted.then(|| difference(found.moved, last));
            trusted = prior.or(trusted);
        }
        search.count
    }
}

fn sum(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}
