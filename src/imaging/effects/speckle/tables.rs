//! Lattice, kernels and factors of the speckle of a probe at given settings.

use super::elevation::Elevation;
use super::power::{correlations, lattice_correlation, power, restored, unit_power};
use crate::effects::compound::{Steering, gains_and_phasors};
use crate::effects::lateral::{FWHM_PER_SIGMA, LateralKernel, MAX_REACH};
use crate::effects::point_spread::{PointSpread, Shape};
use insonify_base::parallel;
use insonify_base::real::{Numbers, Real};
use insonify_tracking::probe::BeamGrid;

/// Precomputed speckle data of a probe at given settings.
#[derive(Clone, Debug, PartialEq)]
pub struct SpeckleTables {
    /// Point spread.
    pub spread: PointSpread,
    /// Distance between lattice points, mm.
    pub lattice_mm: f64,
    /// Number of fine scanlines per scanline.
    pub oversampling: usize,
    /// Distance between sub-planes, mm.
    pub plane_mm: f64,
    /// Weights of the sub-planes, from the most negative elevation to the most positive.
    pub planes: Vec<f64>,
    /// Weights along the beam, a row for each of [`SpeckleTables::bands`].
    pub axial: Numbers,
    /// Number of equal bands of depth, each with its own axial length.
    pub bands: usize,
    /// Smallest ratio of actual to requested axial length: below 1 if a kernel would exceed the maximum reach.
    pub axial_share: f64,
    /// Per sample: factor that compensates for the truncation of the axial kernel at the ends of a scanline.
    pub ends: Numbers,
    /// Per sample: factor by which a surface perpendicular to the beam preserves its echo through both kernels, the
    /// step between two samples being shared by them.
    pub specular: Numbers,
    /// Weights across fine scanlines.
    pub lateral: LateralKernel,
    /// Factors that compensate for the truncation of the lateral kernel at the outermost scanlines: from either side
    /// inwards, scanline by scanline, each a row over the sample depths.
    pub edges: Numbers,
    /// Gains and phasors of the steered looks of `compound`: per look a row over the samples, then per look and fine
    /// scanline cosine and sine.
    pub phasors: Numbers,
}

/// Distance of lattice points over the shortest standard deviation of the point spread. Linear interpolation between
/// points widens it in speckle, by a variance of h^2 / 6, and not around a single echo: [`Shape`] makes up for that.
const LATTICE_PER_SIGMA: f64 = 1.5;

/// Elevational length in lattice distances that four sub-planes reach: more cost time, and do not show in one frame.
const AFFORDED: f64 = 3.5;

/// Number of bands of depth where pulses lengthen: by half down to the farthest, so that steps are below 7 %.
const BANDS: usize = 8;

/// Maximum number of sub-planes in the parameter block.
pub(super) const MAX_PLANES: usize = 8;

/// Maximum number of fine scanlines per scanline.
const MAX_OVERSAMPLING: usize = 4;

/// Distance of scanlines above which they are refined, in lattice distances.
const COARSEST: f64 = 1.4;

impl SpeckleTables {
    /// Computes lattice, kernels and scales for a probe.
    pub(crate) fn new(spread: PointSpread, grid: &BeamGrid, steering: Option<&Steering>) -> Self {
        let shortest = spread.axial_mm.min(spread.lateral_mm).min(spread.elevational_mm) / FWHM_PER_SIGMA;
        let lattice_mm = LATTICE_PER_SIGMA * shortest;
        let correlation = |mm: f64| lattice_correlation(mm / lattice_mm);
        // Variance of the interpolation of the lattice, whose triangles have a half-width of one of its distances.
        let interpolation_mm2 = lattice_mm * lattice_mm / 6.0;

        let widest = if spread.is_elevational_stated {
            f64::INFINITY
        } else {
            AFFORDED
        };
        let elevation = Elevation::of_width((spread.elevational_mm / lattice_mm).min(widest));
        let plane_mm = elevation.spacing * lattice_mm;
        let planes = unit_power(elevation.weights, |steps| correlation(steps * plane_mm));

        let sample_mm = grid.sample_spacing_mm();
        let along = |steps: f64| correlation(steps * sample_mm);
        let pulse = |depth_mm: f64| {
            let [point_mm, speckle_mm] = spread.axial_lengths(depth_mm);
            let requested = Shape::new(point_mm, speckle_mm, interpolation_mm2);
            let share = (MAX_REACH as f64 * sample_mm / requested.reach_mm()).min(1.0);
            let shape = Shape {
                sigma_mm: share * requested.sigma_mm,
                ..requested
            };
            let weights = weights(shape.reach_mm() / sample_mm, |tap| shape.weight(tap * sample_mm));
            (unit_power(weights, along), share)
        };
        let lengthens = spread.axial_lengths(grid.depth_mm()) != spread.axial_lengths(0.0);
        let bands = if lengthens { BANDS.min(grid.samples()) } else { 1 };
        let pulses: Vec<(Vec<f64>, f64)> = (0..bands)
            .map(|band| pulse((band as f64 + 0.5) / bands as f64 * grid.depth_mm()))
            .collect();
        let axial_share = pulses.iter().fold(1.0f64, |least, (_, share)| least.min(*share));
        let of_sample = |sample: usize| &pulses[sample * bands / grid.samples()].0;
        let ends = (0..grid.samples()).map(|sample| {
            let axial = of_sample(sample);
            restored(axial, sample, grid.samples(), &correlations(axial.len(), along))
        });
        let ends = Numbers::new(ends.collect());
        let reach = pulses.iter().map(|(weights, _)| weights.len() / 2).max().unwrap_or(0);
        let padded = |weights: &[f64]| {
            let beyond = vec![0.0; reach - weights.len() / 2];
            [&beyond, weights, &beyond].concat()
        };
        let axial: Vec<f64> = pulses.iter().flat_map(|(weights, _)| padded(weights)).collect();

        let widest = grid
            .lateral_spacing_mm(grid.depth_mm())
            .max(grid.lateral_spacing_mm(0.0));
        // Scanlines farther apart than the lattice would step over scatterers, which would flicker as the probe moves.
        let oversampling = if grid.lines() == 1 {
            1
        } else {
            ((widest / (COARSEST * lattice_mm)).ceil() as usize).clamp(1, MAX_OVERSAMPLING)
        };
        // At the apex of a sector all scanlines meet: the least distance keeps widths in scanlines finite.
        let fine_mm =
            |sample: usize| (grid.lateral_spacing_mm(grid.sample_depth_mm(sample)) / oversampling as f64).max(1e-6);
        let across =
            |sample: usize, weights: &[f64]| correlations(weights.len(), |steps| correlation(steps * fine_mm(sample)));
        let row = |sample: usize| {
            let (depth_mm, fine_mm) = (grid.sample_depth_mm(sample), fine_mm(sample));
            let [point_mm, speckle_mm] = spread.lateral_lengths(depth_mm);
            let requested = Shape::new(point_mm, speckle_mm, interpolation_mm2);
            let share = (MAX_REACH as f64 * fine_mm / requested.reach_mm()).min(1.0);
            let shape = Shape {
                sigma_mm: share * requested.sigma_mm,
                ..requested
            };
            let reach_mm = shape.reach_mm().max(spread.lobes_mm(depth_mm));
            let mut row = weights(reach_mm / fine_mm, |tap| spread.across(&shape, depth_mm, tap * fine_mm));
            let factor = 1.0 / power(&row, &across(sample, &row)).sqrt();
            row.iter_mut().for_each(|weight| *weight *= factor);
            (row, share)
        };
        let rows = parallel::map(0..grid.samples(), &row);
        let least_share = rows.iter().fold(1.0f64, |least, (_, share)| least.min(*share));
        let rows: Vec<Vec<f64>> = rows.into_iter().map(|(row, _)| row).collect();
        let lateral = LateralKernel::of(&rows, least_share);
        let fine_lines = (grid.lines() - 1) * oversampling + 1;
        // The kernels have unit power for scatterers, whose phases are random. A surface adds up coherently: its gain,
        // the sum of the weights and not the root of their squares, is undone.
        let specular = rows
            .iter()
            .enumerate()
            .map(|(sample, weights)| 1.0 / (step_weight(of_sample(sample)) * weights.iter().sum::<f64>()))
            .collect();
        // Both ends of the array are alike: one row of factors serves either side.
        let edge_lines = lateral.reach.div_ceil(oversampling).min(grid.lines().div_ceil(2));
        let edges_by_depth = parallel::map(0..grid.samples(), &|sample| {
            let (weights, correlated) = (&rows[sample], across(sample, &rows[sample]));
            let edge = |line: usize| restored(weights, line * oversampling, fine_lines, &correlated);
            (0..edge_lines).map(edge).collect::<Vec<_>>()
        });
        let edges = (0..edge_lines).flat_map(|line| edges_by_depth.iter().map(move |edges| edges[line]));
        let edges = Numbers::new(edges.collect());
        let phasors = steering.map(|steering| {
            let power_of = |sample: usize, turn: f64| {
                let across = across(sample, &rows[sample]).into_iter().enumerate();
                let in_phase: Vec<f64> = across.map(|(apart, c)| c * (turn * apart as f64).cos()).collect();
                power(&rows[sample], &in_phase)
            };
            gains_and_phasors(steering, [grid.samples(), fine_lines, oversampling], power_of)
        });
        Self {
            spread,
            lattice_mm,
            oversampling,
            plane_mm,
            planes,
            axial: Numbers::new(axial),
            bands,
            axial_share,
            ends,
            specular: Numbers::new(specular),
            lateral,
            edges,
            phasors: phasors.unwrap_or_default(),
        }
    }

    /// Gain of the axial kernel in the middle of the image for an echo that extends over `reach_mm` to either side,
    /// sampled every `sample_mm`, relative to that of a surface.
    pub(crate) fn thick_gain(&self, reach_mm: f64, sample_mm: f64) -> f64 {
        let taps = 2 * self.axial_reach() + 1;
        let axial = &self.axial.of::<f64>()[self.bands / 2 * taps..][..taps];
        let middle = (taps / 2) as f64;
        let inside = axial
            .iter()
            .enumerate()
            .filter(|(tap, _)| (*tap as f64 - middle).abs() * sample_mm <= reach_mm);
        (inside.map(|(_, weight)| weight).sum::<f64>() / step_weight(axial)).max(1.0)
    }

    /// Number of fine scanlines.
    pub fn fine_lines(&self, lines: usize) -> usize {
        (lines - 1) * self.oversampling + 1
    }

    /// Row of a scanline in [`SpeckleTables::edges`], if the lateral kernel extends past the array there.
    pub fn edge(&self, line: usize, lines: usize) -> Option<usize> {
        let from_side = line.min(lines - 1 - line);
        (from_side * self.oversampling < self.lateral.reach).then_some(from_side)
    }

    /// Offset of [`SpeckleTables::specular`] behind the axial weights and the factors of the ends.
    pub(crate) fn specular_at(&self) -> usize {
        self.axial.of::<f64>().len() + self.ends.of::<f64>().len()
    }

    pub(super) fn axial_reach(&self) -> usize {
        self.axial.of::<f64>().len() / self.bands / 2
    }

    /// Weights along the beam at a sample.
    pub(super) fn axial_at<T: Real>(&self, sample: usize, samples: usize) -> &[T] {
        let taps = 2 * self.axial_reach() + 1;
        &self.axial.of::<T>()[sample * self.bands / samples * taps..][..taps]
    }
}

/// A kernel of an odd number of taps, as far as `reach` to each side and [`MAX_REACH`] at most.
fn weights(reach: f64, weight: impl Fn(f64) -> f64) -> Vec<f64> {
    let reach = reach.ceil().min(MAX_REACH as f64) as i32;
    (-reach..=reach).map(|tap| weight(f64::from(tap))).collect()
}

/// Response of the axial kernel to a step whose echo is shared by two samples.
fn step_weight(axial: &[f64]) -> f64 {
    let middle = axial.len() / 2;
    0.5 * (axial[middle] + axial.get(middle + 1).copied().unwrap_or(0.0))
}
