//! First-order, second-order and spectral statistics of the texture in rectangles of grey levels.

use std::f64::consts::TAU;

use nalgebra::{SMatrix, SVector};

use super::picture::Picture;
use super::sector::{BLACK, dark_limit};
use insonify_base::statistics::{full_width, mean, skewness, slope, std};
use insonify_imaging::rf::fft::{Complex32, Fft};

/// Dynamic range assumed for 255 grey levels when converting to echoes, dB: that of a real frame is unknown.
pub const RANGE_DB: f64 = 60.0;
/// Grey levels of the co-occurrence matrix, over 6 standard deviations about the mean.
const LEVELS: f64 = 32.0;
/// Frequency range in which slopes of power are fitted, cycles per pixel.
const BAND: [f64; 2] = [0.04, 0.35];
/// Number of rings of equal width in the band.
const RINGS: usize = 11;
/// Spacing of trial windows, pixels.
const STEP: usize = 8;

/// Rectangle of grey levels, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Patch {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels, 0 to 255.
    pub values: Vec<f64>,
}

/// Window of a frame, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Texture statistics of a window; pairs are axial (along columns), lateral (along rows).
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Mean grey level.
    pub mean: f64,
    /// Standard deviation of the detrended grey levels.
    pub std: f64,
    /// Skewness of the detrended grey levels.
    pub skewness: f64,
    /// Ratio of mean to standard deviation of the grey levels.
    pub snr_log: f64,
    /// Ratio of mean to standard deviation of the echo amplitude at [`RANGE_DB`]; 1.91 in fully developed speckle.
    pub snr_linear: f64,
    /// Nakagami's m, the squared mean over the variance of the echo intensity at [`RANGE_DB`]; 1 in fully developed
    /// speckle.
    pub nakagami: f64,
    /// Autocorrelation of the grey levels at lags of 0, 1, 2, ... pixels.
    pub autocorrelation: [Vec<f64>; 2],
    /// Full width at half maximum of the autocorrelation, pixels; `None` if it stays above one half.
    pub fwhm: [Option<f64>; 2],
    /// Contrast of the co-occurrence matrix of neighbours.
    pub contrast: [f64; 2],
    /// Correlation of the co-occurrence matrix of neighbours.
    pub correlation: [f64; 2],
    /// Slopes of power against frequency, both logarithmic: axial, lateral, radial.
    pub slopes: [f64; 3],
}

impl Patch {
    /// Copies a window from the grey levels of a frame with rows of `width` pixels.
    pub(crate) fn of(grey: &[f64], width: usize, window: Window) -> Self {
        let rows = (window.y..window.y + window.height).map(|y| &grey[y * width + window.x..][..window.width]);
        Self {
            width: window.width,
            height: window.height,
            values: rows.flatten().copied().collect(),
        }
    }

    /// Subtracts the least-squares quadratic surface, keeping the mean.
    pub(crate) fn detrended(&self) -> Self {
        let basis = |pixel: usize| {
            let x = (pixel % self.width) as f64 / self.width as f64 - 0.5;
            let y = (pixel / self.width) as f64 / self.height as f64 - 0.5;
            SVector::<f64, 6>::from([1.0, x, y, x * y, x * x, y * y])
        };
        let mut normal = SMatrix::<f64, 6, 6>::zeros();
        let mut right_side = SVector::<f64, 6>::zeros();
        for (pixel, value) in self.values.iter().enumerate() {
            let row = basis(pixel);
            normal += row * row.transpose();
            right_side += row * *value;
        }
        // A patch with fewer than three columns or rows does not determine the surface: only its mean is subtracted.
        let surface = normal
            .cholesky()
            .map(|factor| factor.solve(&right_side))
            .unwrap_or_default();
        let residual: Vec<f64> = (0..self.values.len())
            .map(|pixel| self.values[pixel] - surface.dot(&basis(pixel)))
            .collect();
        let shift = mean(&self.values) - mean(&residual);
        Self {
            values: residual.iter().map(|value| value + shift).collect(),
            ..*self
        }
    }

    /// Returns the normalised autocovariance at a lag of `dx` columns and `dy` rows.
    pub(crate) fn autocorrelation(&self, [dx, dy]: [usize; 2]) -> f64 {
        let middle = mean(&self.values);
        let row = |y: usize| &self.values[y * self.width..][..self.width];
        let products = (0..self.height - dy).flat_map(|y| {
            let pairs = row(y).iter().zip(&row(y + dy)[dx..]);
            pairs.map(|(a, b)| (a - middle) * (b - middle))
        });
        let count = (self.width - dx) * (self.height - dy);
        let variance = self.values.iter().map(|a| (a - middle).powi(2)).sum::<f64>() / self.values.len() as f64;
        products.sum::<f64>() / count as f64 / variance
    }

    /// Returns contrast and correlation of the symmetric co-occurrence matrix (R. M. Haralick et al., IEEE Transactions
    /// on Systems, Man, and Cybernetics 3 (1973) 610) of pixels `dx` columns and `dy` rows apart, in 32 levels over 6
    /// standard deviations.
    fn co_occurrence(&self, [dx, dy]: [usize; 2]) -> [f64; 2] {
        let (middle, spread) = (mean(&self.values), std(&self.values));
        let level = |pixel: usize| {
            let level = (self.values[pixel] - middle) / spread * LEVELS / 6.0 + LEVELS / 2.0;
            level.clamp(0.0, LEVELS - 1.0).floor()
        };
        let places = (0..self.height - dy).flat_map(|y| (0..self.width - dx).map(move |x| (x, y)));
        let pairs: Vec<[f64; 2]> = places
            .map(|(x, y)| [level(y * self.width + x), level((y + dy) * self.width + x + dx)])
            .collect();
        let over_pairs = |product: &dyn Fn(f64, f64) -> f64| {
            pairs.iter().map(|[a, b]| product(*a, *b)).sum::<f64>() / pairs.len() as f64
        };
        let centre = over_pairs(&|a, b| 0.5 * (a + b));
        let variance = over_pairs(&|a, b| 0.5 * ((a - centre).powi(2) + (b - centre).powi(2)));
        [
            over_pairs(&|a, b| (a - b).powi(2)),
            over_pairs(&|a, b| (a - centre) * (b - centre)) / variance,
        ]
    }

    /// Returns the log-log slopes of power against frequency, axial, lateral and radial, under a Hann window.
    fn power_slopes(&self) -> [f64; 3] {
        let (width, height) = (self.width, self.height);
        let middle = mean(&self.values);
        let hann = |n: usize, count: usize| 0.5 - 0.5 * (TAU * n as f64 / (count as f64 - 1.0)).cos();
        let windowed = |x: usize, y: usize| (self.values[y * width + x] - middle) * hann(x, width) * hann(y, height);
        let mut rows: Vec<Complex32> = (0..width * height)
            .map(|n| (windowed(n % width, n / width) as f32).into())
            .collect();
        // Lines of a transform lie one after another in memory: transposed between the two axes, and back when the
        // power is read.
        Fft::new(width).forward(&mut rows);
        let mut columns: Vec<Complex32> = (0..width * height)
            .map(|n| rows[n % height * width + n / height])
            .collect();
        Fft::new(height).forward(&mut columns);
        let power: Vec<f64> = (0..width * height)
            .map(|n| f64::from(columns[n % width * height + n / width].norm_sqr()))
            .collect();
        let frequency = |n: usize, count: usize| n.min(count - n) as f64 / count as f64;
        let inside = |f: f64| f > BAND[0] && f < BAND[1];
        let fit = |points: Vec<[f64; 2]>| {
            let log = |axis: usize| points.iter().map(|p| p[axis].log10()).collect::<Vec<f64>>();
            slope(&log(0), &log(1))
        };
        let axial = (1..=height / 2).map(|l| [frequency(l, height), power[l * width..][..width].iter().sum()]);
        let lateral = (1..=width / 2).map(|k| [frequency(k, width), power[k..].iter().step_by(width).sum()]);
        let mut rings = vec![[0.0; 3]; RINGS];
        for (bin, power) in power.iter().enumerate() {
            let f = frequency(bin % width, width).hypot(frequency(bin / width, height));
            if (BAND[0]..BAND[1]).contains(&f) {
                let ring = ((f - BAND[0]) / (BAND[1] - BAND[0]) * RINGS as f64) as usize;
                let sums = [1.0, f, *power];
                (0..3).for_each(|i| rings[ring.min(RINGS - 1)][i] += sums[i]);
            }
        }
        let radial = rings
            .iter()
            .filter(|sums| sums[0] > 0.0)
            .map(|sums| [sums[1] / sums[0], sums[2] / sums[0]]);
        [
            fit(axial.filter(|p| inside(p[0])).collect()),
            fit(lateral.filter(|p| inside(p[0])).collect()),
            fit(radial.collect()),
        ]
    }

    /// Computes all texture statistics of the patch.
    pub(crate) fn texture(&self) -> Texture {
        let even = self.detrended();
        let (middle, spread) = (mean(&even.values), std(&even.values));
        // Grey levels are logarithms: statistics of Rayleigh and Nakagami are those of the amplitude.
        let amplitude: Vec<f64> = even
            .values
            .iter()
            .map(|grey| 10f64.powf(grey / 255.0 * RANGE_DB / 20.0))
            .collect();
        let intensity: Vec<f64> = amplitude.iter().map(|a| a * a).collect();
        let autocorrelation = [
            (0..self.height)
                .map(|lag| even.autocorrelation([0, lag]))
                .collect::<Vec<f64>>(),
            (0..self.width).map(|lag| even.autocorrelation([lag, 0])).collect(),
        ];
        let [axial, lateral] = [self.co_occurrence([0, 1]), self.co_occurrence([1, 0])];
        Texture {
            mean: middle,
            std: spread,
            skewness: skewness(&even.values),
            snr_log: middle / spread,
            snr_linear: mean(&amplitude) / std(&amplitude),
            nakagami: (mean(&intensity) / std(&intensity)).powi(2),
            fwhm: [0, 1].map(|axis| full_width(&autocorrelation[axis], 1.0)),
            autocorrelation,
            contrast: [axial[0], lateral[0]],
            correlation: [axial[1], lateral[1]],
            slopes: even.power_slopes(),
        }
    }

    /// Returns the standard deviation of the means of `across` x `across` equal blocks, a linear trend along depth
    /// removed, dB at [`RANGE_DB`].
    pub(crate) fn block_spread_db(&self, across: usize) -> f64 {
        let block = |column: usize, row: usize| {
            let [x, y] = [column * self.width / across, row * self.height / across];
            let window = Window {
                x,
                y,
                width: (column + 1) * self.width / across - x,
                height: (row + 1) * self.height / across - y,
            };
            mean(&Patch::of(&self.values, self.width, window).values) * RANGE_DB / 255.0
        };
        let places = || (0..across).flat_map(|row| (0..across).map(move |column| (column, row)));
        let means: Vec<f64> = places().map(|(column, row)| block(column, row)).collect();
        let depth: Vec<f64> = places().map(|(_, row)| row as f64).collect();
        let trend = slope(&depth, &means);
        std(&means
            .iter()
            .zip(&depth)
            .map(|(mean, depth)| mean - trend * depth)
            .collect::<Vec<f64>>())
    }
}

/// Summed-area table: sums over rectangles, from the sums over everything above and to the left.
struct Sums(Vec<f64>, usize);

impl Sums {
    fn of(width: usize, height: usize, value: impl Fn(usize) -> f64) -> Self {
        let stride = width + 1;
        let mut sums = vec![0.0; stride * (height + 1)];
        for y in 0..height {
            let mut row = 0.0;
            for x in 0..width {
                row += value(y * width + x);
                sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + row;
            }
        }
        Self(sums, stride)
    }

    fn mean(&self, Window { x, y, width, height }: Window) -> f64 {
        let sum_to = |x: usize, y: usize| self.0[y * self.1 + x];
        let sum = sum_to(x + width, y + height) - sum_to(x, y + height) - sum_to(x + width, y) + sum_to(x, y);
        sum / (width * height) as f64
    }
}

/// Selection criteria of a candidate window.
struct WindowStatistics {
    window: Window,
    mean: f64,
    std: f64,
    /// Largest differences between the means of its quarters, and between their standard deviations.
    uneven: [f64; 2],
    black: f64,
    white: f64,
}

/// Evaluates all windows of a size that lie in the sector, every 8 pixels.
fn window_statistics(picture: &Picture, mask: &[bool], [width, height]: [usize; 2]) -> Vec<WindowStatistics> {
    let sums = |value: &dyn Fn(usize) -> f64| Sums::of(picture.width, picture.height, value);
    let grey = |pixel: usize| picture.grey[pixel];
    let inside = sums(&|pixel| f64::from(u8::from(mask[pixel])));
    let greys = sums(&grey);
    let squares = sums(&|pixel| grey(pixel).powi(2));
    let black = sums(&|pixel| f64::from(u8::from(grey(pixel) <= BLACK)));
    let white = sums(&|pixel| f64::from(u8::from(grey(pixel) >= 254.0)));
    let places = |size: usize, extent: usize| (0..extent.saturating_sub(size)).step_by(STEP);
    let windows = places(height, picture.height)
        .flat_map(|y| places(width, picture.width).map(move |x| Window { x, y, width, height }));
    windows
        // Sums of zeros and ones are exact.
        .filter(|&window| inside.mean(window) == 1.0)
        .map(|window| {
            let moments = |window: Window| {
                let mean = greys.mean(window);
                [mean, (squares.mean(window) - mean * mean).max(0.0).sqrt()]
            };
            let (width, height) = (width / 2, height / 2);
            let quarters = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, down)| {
                let x = window.x + right * width;
                let y = window.y + down * height;
                moments(Window { x, y, width, height })
            });
            let extreme = |extreme_of: fn(f64, f64) -> f64, moment: usize| {
                quarters.map(|quarter| quarter[moment]).into_iter().reduce(extreme_of)
            };
            let range = |moment| Some(extreme(f64::max, moment)? - extreme(f64::min, moment)?);
            let [mean, std] = moments(window);
            WindowStatistics {
                window,
                mean,
                std,
                uneven: [0, 1].map(|moment| range(moment).unwrap_or(0.0)),
                black: black.mean(window),
                white: white.mean(window),
            }
        })
        .collect()
}

/// Picks up to `max_windows` in ascending order of their score, each separate from those before.
fn first_separate(
    mut windows: Vec<(f64, Window)>,
    max_windows: usize,
    are_separate: impl Fn(Window, Window) -> bool,
) -> Vec<Window> {
    windows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut chosen: Vec<Window> = Vec::new();
    for (_, window) in windows {
        if chosen.len() < max_windows && chosen.iter().all(|&earlier| are_separate(window, earlier)) {
            chosen.push(window);
        }
    }
    chosen
}

/// Selects the most uniform windows of a size in the sector: those whose quarters differ least in mean and in standard
/// deviation, both added and relative to the mean. Their mean is in `grey`, at most 2 % of them is black or white, and
/// they are half a window apart.
pub(crate) fn uniform_windows(
    picture: &Picture,
    mask: &[bool],
    size: [usize; 2],
    max_windows: usize,
    grey: [f64; 2],
) -> Vec<Window> {
    let fits = |window: &WindowStatistics| {
        (grey[0]..=grey[1]).contains(&window.mean) && window.black <= 0.02 && window.white <= 0.02 && window.std > 0.0
    };
    let windows = window_statistics(picture, mask, size).into_iter().filter(fits);
    let are_separate = |a: Window, b: Window| a.x.abs_diff(b.x) + a.y.abs_diff(b.y) >= size[1] / 2;
    let chosen_by = |window: WindowStatistics| ((window.uneven[0] + window.uneven[1]) / window.mean, window.window);
    first_separate(windows.map(chosen_by).collect(), max_windows, are_separate)
}

/// Selects the darkest windows of a size in the sector that show texture: mean below half that of the sector, standard
/// deviation of at least one grey level, at most half black, and unevenness (see [`uniform_windows`]) of at most 1.
/// They do not overlap.
pub(crate) fn dark_windows(picture: &Picture, mask: &[bool], size: [usize; 2], max_windows: usize) -> Vec<Window> {
    let limit = dark_limit(picture, mask);
    let fits = |window: &WindowStatistics| {
        window.mean < limit
            && window.std >= 1.0
            && window.black <= 0.5
            && window.uneven[0] + window.uneven[1] <= window.mean
    };
    let windows = window_statistics(picture, mask, size).into_iter().filter(fits);
    let are_separate = |a: Window, b: Window| a.x.abs_diff(b.x) >= size[0] || a.y.abs_diff(b.y) >= size[1];
    first_separate(
        windows.map(|window| (window.mean, window.window)).collect(),
        max_windows,
        are_separate,
    )
}
