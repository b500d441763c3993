//! Motion of tissue between radio-frequency frames: normalised cross-correlation with prediction from prior estimates
//! (R. Zahiri-Azar and S. E. Salcudean, "Motion estimation in ultrasound images using time domain cross correlation
//! with prior estimates", IEEE Transactions on Biomedical Engineering 53, 2006).

use super::signal::upsampled;
use insonify_base::parallel::{self, chunks, chunks_mut, for_each};
use insonify_base::simd::{Lanes, Simd, WithSimd, dispatch};

/// Settings of the estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Sampling rate of the echoes, MHz.
    pub sampling_mhz: f64,
    /// Speed of sound, m/s.
    pub speed_m_s: f64,
    /// Distance between lines, mm.
    pub pitch_mm: f64,
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
    /// Correlation below which the prior is dropped and the wide search made.
    pub fallback: f64,
    /// Mean correlation below which a frame becomes the new reference.
    pub switch: f64,
    /// True if searches start from the estimates of neighbours; otherwise every search is wide.
    pub prior: bool,
}

/// Reach of the narrow search about the prior, samples after upsampling.
const NARROW: usize = 2;

impl Options {
    /// Windows of 1 mm, 120 a line, twofold upsampling.
    pub fn new(sampling_mhz: f64, pitch_mm: f64) -> Self {
        Self {
            sampling_mhz,
            speed_m_s: super::SPEED_M_S,
            pitch_mm,
            window_mm: 1.0,
            windows: 120,
            upsampling: 2,
            wide_mm: 0.8,
            wide_lines: 1,
            fallback: 0.8,
            switch: 0.95,
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

/// Where a window of the reference lies in a frame.
#[derive(Clone, Copy, Default)]
struct Match {
    /// Motion in samples and lines.
    shift: [f64; 2],
    correlation: f64,
}

/// Neighbours of a window in lines and windows, whose median motion it is compared with: some beam widths aside, as
/// windows on lines within a beam width have the same echoes and err together.
const ASIDE: [isize; 9] = [-16, -8, -4, -2, 0, 2, 4, 8, 16];
const ALONG: [isize; 3] = [-2, 0, 2];
/// Lateral motion beside that of the neighbours beyond which an estimate has strayed, lines.
const STRAY: f64 = 2.0;
/// Passes over the windows that differ from their neighbours; in the second most of the neighbours are right.
const RESEEKS: usize = 2;
/// Number of neighbours of a window.
const NEIGHBOURS: usize = ASIDE.len() * ALONG.len();

/// Share of the energy of a window without its mean, below which it is constant but for rounding.
const FLAT: f64 = 1e-9;

/// Correlation of places outside the frame.
const OUTSIDE: f64 = -2.0;

/// Estimate of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Motion away from the probe, um.
    pub axial_um: f64,
    /// Motion towards the marked side, um.
    pub lateral_um: f64,
    /// Correlation at the nearest sample.
    pub correlation: f64,
}

/// Lines of a frame after upsampling.
struct Frame {
    values: Vec<f32>,
    /// Running sums of the values and of their squares: where every search is wide they cost less than sums over each
    /// window.
    sums: Option<[Vec<f64>; 2]>,
}

/// Tracks motion frame by frame against the first one.
pub struct Tracker {
    options: Options,
    lines: usize,
    samples: usize,
    window: usize,
    reference: Frame,
    /// First sample of each window in the first frame.
    starts: Vec<usize>,
    /// Motion of the reference against the first frame, in samples and lines, for each window.
    carried: Vec<[f64; 2]>,
    /// Windows with echoes: those that correlated with the first frame after the reference. Noise alone does not change
    /// the reference.
    echoing: Option<Vec<bool>>,
    /// Half a period of the echoes, samples: neighbours further apart follow different periods.
    half_period: f64,
    /// Last estimate of each window against the reference that correlated, in samples and lines.
    last: Vec<Option<[f64; 2]>>,
    /// Number of correlations computed so far.
    pub correlations: u64,
    /// Number of changes of the reference.
    pub switches: usize,
}

impl Frame {
    fn new(values: Vec<f32>, samples: usize, summed: bool) -> Self {
        let running = |each: fn(f64) -> f64| {
            let mut sums = vec![0.0; values.len() / samples * (samples + 1)];
            let rows = (chunks_mut(&mut sums, samples + 1), chunks(&values, samples));
            for_each(rows, &|(sums, row)| {
                for (sample, value) in row.iter().enumerate() {
                    sums[sample + 1] = sums[sample] + each(f64::from(*value));
                }
            });
            sums
        };
        let sums = summed.then(|| [running(|value| value), running(|value| value * value)]);
        Self { values, sums }
    }
}

/// A window of the reference, its mean removed.
struct Template {
    values: Vec<f32>,
    norm: f64,
}

/// Sums over a window at consecutive places: of the products with the template, and with `moments` of the values and of
/// their squares.
struct Products<'a> {
    window: &'a [f32],
    values: &'a [f32],
    moments: bool,
    sums: &'a mut [[f64; 3]],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let length = self.window.len();
        let window = f32::vectors::<S>(self.window);
        let zero = f32::splat(simd, 0.0);
        let one = f32::splat(simd, 1.0);
        let whole = size_of_val(window) / size_of::<f32>();
        for (lag, out) in self.sums.iter_mut().enumerate() {
            let values = &self.values[lag..lag + length];
            let mut sums = [zero; 3];
            for (a, b) in window.iter().zip(f32::vectors::<S>(values)) {
                sums[0] = f32::multiply_add(simd, *a, *b, sums[0]);
                if self.moments {
                    sums[1] = f32::multiply_add(simd, *b, one, sums[1]);
                    sums[2] = f32::multiply_add(simd, *b, *b, sums[2]);
                }
            }
            for (total, sum) in out.iter_mut().zip(sums) {
                *total = f64::from(f32::total(simd, sum));
            }
            for (a, b) in self.window[whole..].iter().zip(&values[whole..]) {
                out[0] += f64::from(a * b);
                out[1] += f64::from(*b);
                out[2] += f64::from(b * b);
            }
        }
    }
}

/// Peak between samples of a cosine through three values (I. Cespedes et al., Ultrasonic Imaging 17, 1995): its offset
/// in samples and height.
fn cosine_peak([before, at, after]: [f64; 3]) -> (f64, f64) {
    let ratio = (before + after) / (2.0 * at);
    if !(at > 0.0 && before.min(after) > OUTSIDE && ratio.abs() < 1.0 && at >= before.max(after)) {
        return (0.0, at);
    }
    let omega = ratio.acos();
    let theta = ((before - after) / (2.0 * at * omega.sin())).atan();
    (-theta / omega, at / theta.cos())
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
        Self {
            options,
            lines,
            samples: wide,
            window,
            half_period: values.len() as f64 / turns.max(1) as f64,
            reference: Frame::new(values, wide, false),
            starts,
            carried: vec![[0.0; 2]; lines * options.windows],
            last: vec![None; lines * options.windows],
            echoing: None,
            correlations: 0,
            switches: 0,
        }
    }

    /// Estimates the motion of each window, line by line, from the first frame to this one.
    pub fn next(&mut self, frame: &[f32]) -> Vec<Estimate> {
        let options = &self.options;
        let values = upsampled(frame, frame.len() / self.lines, options.upsampling);
        let current = Frame::new(values, self.samples, !options.prior);
        let count = options.windows;
        let mut matches = vec![Match::default(); self.lines * count];
        let this = &*self;
        let counts = parallel::map((0.., chunks_mut(&mut matches, count)), &|(line, matches)| {
            this.line(&current, line, matches)
        });
        let mut correlations: u64 = counts.into_iter().sum();
        // Without a prior every search was wide: a window cannot have followed a neighbour astray.
        for _ in 0..if options.prior { RESEEKS } else { 0 } {
            let before = matches.clone();
            let counts = parallel::map((0.., chunks_mut(&mut matches, count)), &|(line, matches)| {
                this.reseek_outliers(&current, line, &before, matches)
            });
            correlations += counts.into_iter().sum::<u64>();
        }
        self.correlations += correlations;
        let scale = [self.options.sample_um(), self.options.pitch_mm * 1e3];
        let estimates: Vec<Estimate> = matches
            .iter()
            .zip(&self.carried)
            .map(|(Match { shift, correlation }, carried)| Estimate {
                axial_um: (shift[0] + carried[0]) * scale[0],
                lateral_um: (shift[1] + carried[1]) * scale[1],
                correlation: *correlation,
            })
            .collect();
        let fallback = self.options.fallback;
        let echoing = self
            .echoing
            .get_or_insert_with(|| matches.iter().map(|window| window.correlation >= fallback).collect());
        let heard = matches.iter().zip(&*echoing).filter(|(_, echoing)| **echoing);
        let (sum, number) = heard.fold((0.0, 0.0), |(sum, count), (window, _)| {
            (sum + window.correlation, count + 1.0)
        });
        if number > 0.0 && sum < self.options.switch * number {
            for (carried, matches) in self.carried.chunks_mut(count).zip(matches.chunks(count)) {
                for (window, carried) in carried.iter_mut().enumerate() {
                    // A window that does not correlate moves with the nearest one on its line that does.
                    let trusted = (0..count).filter(|other| matches[*other].correlation >= fallback);
                    let shift = trusted
                        .min_by_key(|other| other.abs_diff(window))
                        .map_or([0.0; 2], |other| matches[other].shift);
                    carried
                        .iter_mut()
                        .zip(shift)
                        .for_each(|(carried, shift)| *carried += shift);
                }
            }
            self.reference = current;
            self.switches += 1;
            self.echoing = None;
            self.last.fill(None);
        } else {
            for (last, window) in self.last.iter_mut().zip(&matches) {
                if window.correlation >= fallback {
                    *last = Some(window.shift);
                }
            }
        }
        estimates
    }

    fn search<'a>(&self, current: &'a Frame) -> Search<'a> {
        Search {
            frame: current,
            samples: self.samples,
            lines: self.lines as isize,
            template: Template {
                values: vec![0.0; self.window],
                norm: 0.0,
            },
            origin: [0, 0],
            sums: Vec::new(),
            count: 0,
        }
    }

    /// Takes a window of the reference, where the tissue of that window of the first frame is.
    fn take(&self, search: &mut Search, line: usize, window: usize) {
        let carried = self.carried[line * self.options.windows + window].map(|moved| moved.round() as isize);
        search.take(
            &self.reference,
            [self.starts[window] as isize + carried[0], line as isize + carried[1]],
        );
    }

    /// Seeks windows again that do not correlate, or that follow another period than their neighbours, from the median
    /// of those; returns the number of correlations.
    fn reseek_outliers(&self, current: &Frame, line: usize, before: &[Match], matches: &mut [Match]) -> u64 {
        let mut search = self.search(current);
        let mut near = [[0.0; 2]; NEIGHBOURS];
        for (number, window) in matches.iter_mut().enumerate() {
            let near = self.neighbours(line, number, before, &mut near);
            let differ =
                |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).abs() > self.half_period || (a[1] - b[1]).abs() > STRAY;
            let agreeing = near.iter().filter(|other| !differ(&window.shift, other)).count();
            // Fewer than three neighbours have no majority.
            if near.len() < 3 || window.correlation >= self.options.fallback && 2 * agreeing > near.len() {
                continue;
            }
            let median = [0, 1].map(|axis| {
                let half = near.len() / 2;
                near.select_nth_unstable_by(half, |a, b| a[axis].total_cmp(&b[axis])).1[axis]
            });
            self.take(&mut search, line, number);
            let (peak, correlation) = search.peak_nearby(median.map(|shift| shift.round() as isize));
            let refined = search.refined(peak);
            *window = if differ(&refined.shift, &median) {
                Match {
                    shift: median,
                    correlation: correlation.max(0.0),
                }
            } else {
                refined
            };
        }
        search.count
    }

    /// Motion of the neighbours of a window that correlate.
    fn neighbours<'a>(
        &self,
        line: usize,
        window: usize,
        matches: &[Match],
        near: &'a mut [[f64; 2]],
    ) -> &'a mut [[f64; 2]] {
        let count = self.options.windows;
        let mut number = 0;
        for line in ASIDE.iter().filter_map(|aside| line.checked_add_signed(*aside)) {
            for window in ALONG.iter().filter_map(|along| window.checked_add_signed(*along)) {
                if line < self.lines
                    && window < count
                    && matches[line * count + window].correlation >= self.options.fallback
                {
                    near[number] = matches[line * count + window].shift;
                    number += 1;
                }
            }
        }
        &mut near[..number]
    }

    /// Estimates along a line; returns the number of correlations.
    fn line(&self, current: &Frame, line: usize, matches: &mut [Match]) -> u64 {
        let mut search = self.search(current);
        let count = self.options.windows;
        let wide = (self.options.wide_mm * 1e3 / self.options.sample_um()).ceil() as isize;
        let across = self.options.wide_lines as isize;
        let mut prior: Option<[isize; 2]> = None;
        let mut trusted: Option<[isize; 2]> = None;
        for number in 0..count {
            let index = line * count + number;
            self.take(&mut search, line, number);
            let last_shift = self.last[index].map(|moved| moved.map(|moved| moved.round() as isize));
            let mut best = match prior.or(last_shift) {
                Some(start) if self.options.prior => search.peak_nearby(start),
                _ => ([0; 2], OUTSIDE),
            };
            if best.1 < self.options.fallback {
                let best_in_range = search.all(trusted.or(last_shift).unwrap_or_default(), [wide, across]);
                if best_in_range.1 > best.1 {
                    best = best_in_range;
                }
            }
            let window = search.refined(best.0);
            matches[number] = window;
            // A window that does not correlate is no start for the next one.
            let is_trusted = window.correlation >= self.options.fallback;
            prior = is_trusted.then(|| window.shift.map(|shift| shift.round() as isize));
            trusted = prior.or(trusted);
        }
        search.count
    }
}

/// Peak of the correlation along a line.
#[derive(Clone, Copy)]
struct LinePeak {
    /// Sample and line of the highest correlation.
    sample: [isize; 2],
    correlation: f64,
    /// Place of the peak between samples, from that sample on, and its height.
    offset: f64,
    height: f64,
}

/// Correlation of a window of the reference with places of the current frame.
struct Search<'a> {
    frame: &'a Frame,
    samples: usize,
    lines: isize,
    template: Template,
    /// First sample and line of the window in the reference.
    origin: [isize; 2],
    sums: Vec<[f64; 3]>,
    count: u64,
}

impl Search<'_> {
    fn take(&mut self, reference: &Frame, origin: [isize; 2]) {
        let length = self.template.values.len();
        let start = origin[0].clamp(0, (self.samples - length) as isize);
        let line = origin[1].clamp(0, self.lines - 1);
        self.origin = [start, line];
        let from = line as usize * self.samples + start as usize;
        let values = &reference.values[from..from + length];
        let mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / length as f64;
        self.template
            .values
            .iter_mut()
            .zip(values)
            .for_each(|(to, from)| *to = from - mean as f32);
        let energy = |values: &[f32]| values.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>();
        let varying = energy(&self.template.values);
        self.template.norm = if varying > FLAT * energy(values) {
            varying.sqrt()
        } else {
            0.0
        };
    }

    /// Correlations at `N` consecutive shifts along a line, the first of which is given; [`OUTSIDE`] outside the frame.
    fn row<const N: usize>(&mut self, [down, aside]: [isize; 2]) -> [f64; N] {
        let mut correlations = [OUTSIDE; N];
        self.fill([down, aside], &mut correlations);
        correlations
    }

    fn fill(&mut self, [down, aside]: [isize; 2], correlations: &mut [f64]) {
        let length = self.template.values.len();
        let (start, line) = (self.origin[0] + down, self.origin[1] + aside);
        correlations.fill(OUTSIDE);
        // Shifts that would lead out of the line stay `OUTSIDE`; those left are consecutive, for the products in vector
        // registers.
        let first = (-start).max(0);
        let count = (correlations.len() as isize).min((self.samples - length) as isize + 1 - start) - first;
        if count <= 0 || !(0..self.lines).contains(&line) {
            return;
        }
        let correlations = &mut correlations[first as usize..(first + count) as usize];
        let (start, line) = ((start + first) as usize, line as usize);
        self.count += correlations.len() as u64;
        self.sums.resize(correlations.len(), [0.0; 3]);
        let from = line * self.samples + start;
        dispatch(Products {
            window: &self.template.values,
            values: &self.frame.values[from..from + length + correlations.len() - 1],
            moments: self.frame.sums.is_none(),
            sums: &mut self.sums,
        });
        if let Some([sums, squares]) = &self.frame.sums {
            let from = from + line;
            for (lag, out) in self.sums.iter_mut().enumerate() {
                let over = |sums: &[f64]| sums[from + lag + length] - sums[from + lag];
                (out[1], out[2]) = (over(sums), over(squares));
            }
        }
        // The template has no mean, so that the product needs no mean of the echoes; their norm does.
        for (correlation, [product, sum, square]) in correlations.iter_mut().zip(&self.sums) {
            let norm = (square - sum * sum / length as f64).max(0.0).sqrt() * self.template.norm;
            *correlation = if norm > 0.0 { product / norm } else { 0.0 };
        }
    }

    /// Highest correlation within a narrow reach along the line.
    fn peak_nearby(&mut self, [down, aside]: [isize; 2]) -> ([isize; 2], f64) {
        const REACH: isize = NARROW as isize;
        let correlations: [f64; 2 * NARROW + 1] = self.row([down - REACH, aside]);
        let mut best = ([down, aside], correlations[NARROW]);
        for (step, value) in (-REACH..).zip(correlations) {
            if value > best.1 {
                best = ([down + step, aside], value);
            }
        }
        best
    }

    /// Highest correlation within a reach along and across lines.
    fn all(&mut self, start: [isize; 2], reach: [isize; 2]) -> ([isize; 2], f64) {
        let mut best = (start, OUTSIDE);
        let mut correlations = vec![OUTSIDE; 2 * reach[0] as usize + 1];
        for aside in -reach[1]..=reach[1] {
            let first = [start[0] - reach[0], start[1] + aside];
            self.fill(first, &mut correlations);
            for (step, value) in (0..).zip(&correlations) {
                if *value > best.1 {
                    best = ([first[0] + step, first[1]], *value);
                }
            }
        }
        best
    }

    /// Climbs along the line of a sample to the next peak.
    fn climb_line(&mut self, mut start: [isize; 2]) -> LinePeak {
        let mut three: [f64; 3] = self.row([start[0] - 1, start[1]]);
        loop {
            let [before, middle, after] = three;
            if before.max(after) <= middle {
                let (offset, height) = cosine_peak(three);
                return LinePeak {
                    sample: start,
                    correlation: middle,
                    offset,
                    height,
                };
            }
            let step = if before > after { -1 } else { 1 };
            start[0] += step;
            let [next] = self.row([start[0] + step, start[1]]);
            three = if step < 0 {
                [next, before, middle]
            } else {
                [middle, after, next]
            };
        }
    }

    /// Motion between samples and lines, from the peak above a place, and the correlation at the nearest sample.
    fn refined(&mut self, start: [isize; 2]) -> Match {
        let mut peak = self.climb_line(start);
        loop {
            let [down, line] = peak.sample;
            let beside = [-1, 1].map(|aside| self.climb_line([down, line + aside]));
            let highest = if beside[0].height > beside[1].height {
                &beside[0]
            } else {
                &beside[1]
            };
            if highest.height > peak.height {
                peak = *highest;
                continue;
            }
            let (aside, _) = cosine_peak([beside[0].height, peak.height, beside[1].height]);
            return Match {
                shift: [down as f64 + peak.offset, line as f64 + aside],
                correlation: peak.correlation,
            };
        }
    }
}
