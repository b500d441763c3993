//! Correlation of windows with the echoes of a frame.

use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::simd::{Lanes, Simd, WithSimd, dispatch};

/// Reach of the narrow search about the prior, samples after upsampling.
const NARROW: usize = 2;
/// Correlation of places outside the frame.
pub(super) const OUTSIDE: f64 = -2.0;

/// Position of a window in a frame.
#[derive(Clone, Copy, Default)]
pub(super) struct Match {
    /// Motion since the first frame, samples and lines.
    pub moved: [f64; 2],
    /// At the nearest sample, and at the peak between samples.
    pub correlation: f64,
    pub height: f64,
    /// Line of the nearest sample.
    pub line: isize,
}

/// Lines of a frame after upsampling.
pub(super) struct Frame {
    pub values: Vec<f32>,
    /// Running sums of the values and of their squares: where every search is wide they cost less than sums over each
    /// window.
    sums: Option<[Vec<f64>; 2]>,
}

impl Frame {
    pub(super) fn new(values: Vec<f32>, samples: usize, summed: bool) -> Self {
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

/// Peak of the correlation along a line.
#[derive(Clone, Copy)]
pub(super) struct LinePeak {
    /// Sample and line of the highest correlation.
    pub sample: [isize; 2],
    pub correlation: f64,
    /// Place of the peak between samples, from that sample on, and its height.
    pub offset: f64,
    pub height: f64,
}

/// Correlation of the reference of a window with places of the current frame.
pub(super) struct Search<'a> {
    pub frame: &'a Frame,
    pub samples: usize,
    pub lines: isize,
    /// Reference of the window, its mean removed, and its norm.
    pub template: &'a [f32],
    pub norm: f64,
    /// First sample and line of the reference.
    pub origin: [isize; 2],
    pub sums: Vec<[f64; 3]>,
    pub count: u64,
}

impl Search<'_> {
    /// Correlations at `N` consecutive shifts along a line, the first of which is given; [`OUTSIDE`] outside the frame.
    fn row<const N: usize>(&mut self, [down, aside]: [isize; 2]) -> [f64; N] {
        let mut correlations = [OUTSIDE; N];
        self.fill([down, aside], &mut correlations);
        correlations
    }

    fn fill(&mut self, [down, aside]: [isize; 2], correlations: &mut [f64]) {
        let length = self.template.len();
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
            window: self.template,
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
            let norm = (square - sum * sum / length as f64).max(0.0).sqrt() * self.norm;
            *correlation = if norm > 0.0 { product / norm } else { 0.0 };
        }
    }

    /// Highest correlation within a narrow reach along the line.
    pub(super) fn peak_nearby(&mut self, [down, aside]: [isize; 2]) -> ([isize; 2], f64) {
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
    pub(super) fn all(&mut self, start: [isize; 2], reach: [isize; 2]) -> ([isize; 2], f64) {
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
    pub(super) fn climb_line(&mut self, mut start: [isize; 2]) -> LinePeak {
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
    pub(super) fn refined(&mut self, start: [isize; 2]) -> Match {
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
                moved: [down as f64 + peak.offset, line as f64 + aside],
                correlation: peak.correlation,
                height: peak.height,
                line: self.origin[1] + line,
            };
        }
    }
}
