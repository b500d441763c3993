//! Motion of tissue between radio-frequency frames: normalised cross-correlation with prediction from prior estimates (R. Zahiri-Azar and
//! S. E. Salcudean, "Motion estimation in ultrasound images using time domain cross correlation with prior estimates", IEEE Transactions on
//! Biomedical Engineering 53, 2006).

use rayon::prelude::*;

use super::signal::Lines;

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
const NARROW: isize = 2;

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

    /// Length of a window and its first samples along a line of `samples`, after upsampling. A sample at either end stays free, so that peaks at
    /// no motion have neighbours.
    fn layout(&self, samples: usize) -> (usize, Vec<usize>) {
        let wide = samples * self.upsampling;
        let window = ((self.window_mm * 1e3 / self.sample_um()).round() as usize).clamp(8, wide / 2);
        let room = (wide - window - 2 * self.upsampling) as f64;
        let start =
            |at: usize| self.upsampling + (room * at as f64 / (self.windows.max(2) - 1) as f64).round() as usize;
        (window, (0..self.windows).map(start).collect())
    }

    /// Depths of the centres of the windows in the first frame, mm.
    pub fn centres_mm(&self, samples: usize) -> Vec<f64> {
        let (window, starts) = self.layout(samples);
        let centre = |start: &usize| (*start as f64 + window as f64 / 2.0) * self.sample_um() * 1e-3;
        starts.iter().map(centre).collect()
    }
}

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

/// Lines of a frame after upsampling, with running sums for means and energies.
struct Frame {
    values: Vec<f32>,
    sums: Vec<f64>,
    squares: Vec<f64>,
}

/// Tracks motion frame by frame against the first one.
pub struct Tracker {
    options: Options,
    lines: usize,
    samples: usize,
    window: usize,
    transform: Lines,
    reference: Frame,
    /// First sample of each window in the first frame.
    starts: Vec<usize>,
    /// Motion of the reference against the first frame, in samples and lines, for each window.
    carried: Vec<[f64; 2]>,
    /// Windows with echoes: those that correlated with the first frame after the reference. Noise alone does not change the reference.
    echoing: Option<Vec<bool>>,
    /// Last estimate of each window against the reference that correlated, in samples and lines.
    last: Vec<Option<[f64; 2]>>,
    /// Number of correlations computed so far.
    pub correlations: u64,
    /// Number of changes of the reference.
    pub switches: usize,
}

impl Frame {
    fn new(values: Vec<f32>, samples: usize) -> Self {
        let rows = values.len() / samples;
        let mut sums = vec![0.0; rows * (samples + 1)];
        let mut squares = sums.clone();
        let both = sums
            .par_chunks_mut(samples + 1)
            .zip(squares.par_chunks_mut(samples + 1));
        both.zip(values.par_chunks(samples)).for_each(|((sums, squares), row)| {
            for (at, value) in row.iter().enumerate() {
                let value = f64::from(*value);
                sums[at + 1] = sums[at] + value;
                squares[at + 1] = squares[at] + value * value;
            }
        });
        Self { values, sums, squares }
    }
}

/// A window of the reference, its mean removed.
struct Template {
    values: Vec<f32>,
    norm: f64,
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0_f32; 16];
    let (a16, b16) = (a.chunks_exact(16), b.chunks_exact(16));
    let rest: f32 = a16.remainder().iter().zip(b16.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a16.zip(b16) {
        for lane in 0..16 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().map(|sum| f64::from(*sum)).sum::<f64>() + f64::from(rest)
}

/// Peak between samples of a cosine through three values (I. Cespedes et al., Ultrasonic Imaging 17, 1995): its offset in samples and height.
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
        let transform = Lines::new(samples, options.upsampling);
        let wide = samples * options.upsampling;
        let (window, starts) = options.layout(samples);
        Self {
            options,
            lines,
            samples: wide,
            window,
            reference: Frame::new(transform.upsampled(frame), wide),
            transform,
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
        let current = Frame::new(self.transform.upsampled(frame), self.samples);
        let count = self.options.windows;
        let mut found = vec![([0.0; 2], 0.0); self.lines * count];
        let this = &*self;
        let correlations: u64 = found
            .par_chunks_mut(count)
            .enumerate()
            .map(|(line, found)| this.line(&current, line, found))
            .sum();
        self.correlations += correlations;
        let scale = [self.options.sample_um(), self.options.pitch_mm * 1e3];
        let estimates: Vec<Estimate> = found
            .iter()
            .zip(&self.carried)
            .map(|((moved, correlation), carried)| Estimate {
                axial_um: (moved[0] + carried[0]) * scale[0],
                lateral_um: (moved[1] + carried[1]) * scale[1],
                correlation: *correlation,
            })
            .collect();
        let fallback = self.options.fallback;
        let echoing = self
            .echoing
            .get_or_insert_with(|| found.iter().map(|(_, correlation)| *correlation >= fallback).collect());
        let heard = found.iter().zip(&*echoing).filter(|(_, echoing)| **echoing);
        let (sum, number) = heard.fold((0.0, 0.0), |(sum, count), ((_, correlation), _)| {
            (sum + correlation, count + 1.0)
        });
        if number > 0.0 && sum < self.options.switch * number {
            for (carried, found) in self.carried.chunks_mut(count).zip(found.chunks(count)) {
                for (at, carried) in carried.iter_mut().enumerate() {
                    // A window that does not correlate moves with the nearest one on its line that does.
                    let trusted = (0..count).filter(|other| found[*other].1 >= fallback);
                    let moved = trusted
                        .min_by_key(|other| other.abs_diff(at))
                        .map_or([0.0; 2], |other| found[other].0);
                    carried
                        .iter_mut()
                        .zip(moved)
                        .for_each(|(carried, moved)| *carried += moved);
                }
            }
            self.reference = current;
            self.switches += 1;
            self.echoing = None;
            self.last.fill(None);
        } else {
            for (last, (moved, correlation)) in self.last.iter_mut().zip(&found) {
                if *correlation >= fallback {
                    *last = Some(*moved);
                }
            }
        }
        estimates
    }

    /// Estimates along a line; returns the number of correlations.
    fn line(&self, current: &Frame, line: usize, found: &mut [([f64; 2], f64)]) -> u64 {
        let mut search = Search {
            frame: current,
            samples: self.samples,
            lines: self.lines as isize,
            template: Template {
                values: vec![0.0; self.window],
                norm: 0.0,
            },
            origin: [0, 0],
            count: 0,
        };
        let count = self.options.windows;
        let wide = (self.options.wide_mm * 1e3 / self.options.sample_um()).ceil() as isize;
        let across = self.options.wide_lines as isize;
        let mut prior: Option<[isize; 2]> = None;
        let mut trusted: Option<[isize; 2]> = None;
        for at in 0..count {
            let index = line * count + at;
            let carried = self.carried[index];
            search.take(
                &self.reference,
                [
                    self.starts[at] as isize + carried[0].round() as isize,
                    line as isize + carried[1].round() as isize,
                ],
            );
            let last = self.last[index].map(|moved| moved.map(|moved| moved.round() as isize));
            let mut best = match prior.or(last) {
                Some(start) if self.options.prior => search.climb(start, NARROW),
                _ => ([0; 2], OUTSIDE),
            };
            if best.1 < self.options.fallback {
                let all = search.all(trusted.or(last).unwrap_or_default(), [wide, across]);
                if all.1 > best.1 {
                    best = all;
                }
            }
            let (moved, correlation) = search.refined(best.0);
            found[at] = (moved, correlation);
            prior = (correlation >= self.options.fallback).then(|| moved.map(|moved| moved.round() as isize));
            trusted = prior.or(trusted);
        }
        search.count
    }
}

/// Correlation of a window of the reference with places of the current frame.
struct Search<'a> {
    frame: &'a Frame,
    samples: usize,
    lines: isize,
    template: Template,
    /// First sample and line of the window in the reference.
    origin: [isize; 2],
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
        self.template.norm = dot(&self.template.values, &self.template.values).sqrt();
    }

    /// Correlation at a shift; -1 outside the frame.
    fn at(&mut self, [down, aside]: [isize; 2]) -> f64 {
        let length = self.template.values.len();
        let (start, line) = (self.origin[0] + down, self.origin[1] + aside);
        if start < 0 || start as usize + length > self.samples || !(0..self.lines).contains(&line) {
            return OUTSIDE;
        }
        self.count += 1;
        let (start, line) = (start as usize, line as usize);
        let from = line * self.samples + start;
        let product = dot(&self.template.values, &self.frame.values[from..from + length]);
        let sums = line * (self.samples + 1) + start;
        let sum = self.frame.sums[sums + length] - self.frame.sums[sums];
        let square = self.frame.squares[sums + length] - self.frame.squares[sums];
        let norm = (square - sum * sum / length as f64).max(0.0).sqrt() * self.template.norm;
        if norm > 0.0 { product / norm } else { 0.0 }
    }

    /// Highest correlation within a reach along the line, followed while it lies at the end of the reach.
    fn climb(&mut self, start: [isize; 2], reach: isize) -> ([isize; 2], f64) {
        let mut best = (start, self.at(start));
        for step in 1..=reach {
            for down in [-step, step] {
                let place = [start[0] + down, start[1]];
                let value = self.at(place);
                if value > best.1 {
                    best = (place, value);
                }
            }
        }
        best
    }

    /// Highest correlation within a reach along and across lines.
    fn all(&mut self, start: [isize; 2], reach: [isize; 2]) -> ([isize; 2], f64) {
        let mut best = (start, OUTSIDE);
        for aside in -reach[1]..=reach[1] {
            for down in -reach[0]..=reach[0] {
                let place = [start[0] + down, start[1] + aside];
                let value = self.at(place);
                if value > best.1 {
                    best = (place, value);
                }
            }
        }
        best
    }

    /// Peak along the line through a place: its offset, height and the sample below it.
    fn along(&mut self, mut place: [isize; 2]) -> (f64, f64, [isize; 2], f64) {
        let mut middle = self.at(place);
        loop {
            let (before, after) = (self.at([place[0] - 1, place[1]]), self.at([place[0] + 1, place[1]]));
            if before.max(after) <= middle {
                let (offset, height) = cosine_peak([before, middle, after]);
                return (offset, height, place, middle);
            }
            place[0] += if before > after { -1 } else { 1 };
            middle = before.max(after);
        }
    }

    /// Motion between samples and lines from the nearest ones, and the correlation there.
    fn refined(&mut self, mut place: [isize; 2]) -> ([f64; 2], f64) {
        let (mut down, mut height, mut at, mut nearest) = self.along(place);
        loop {
            let beside = [-1, 1].map(|aside| self.along([at[0], at[1] + aside]));
            let higher = beside
                .iter()
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .filter(|it| it.1 > height);
            match higher {
                Some(it) => (down, height, at, nearest) = (it.0, it.1, it.2, it.3),
                None => {
                    let (aside, _) = cosine_peak([beside[0].1, height, beside[1].1]);
                    place = at;
                    return ([place[0] as f64 + down, place[1] as f64 + aside], nearest);
                }
            }
        }
    }
}
