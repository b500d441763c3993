//! Lattice, kernels and factors of the speckle of a probe at given settings.

use super::elevation::Elevation;
use super::power::{correlations, lattice_correlation, power, restored, unit_power};
use crate::effects::lateral::{FWHM_PER_SIGMA, LateralKernel, MAX_REACH};
use crate::effects::point_spread::PointSpread;
use insonify_base::parallel;
use insonify_base::real::Numbers;
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
    /// Weights along the beam.
    pub axial: Numbers,
    /// Ratio of the actual to the requested axial length: below 1 if its kernel would exceed the maximum reach.
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
}

/// Distance of lattice points over the shortest standard deviation of the point spread. Linear interpolation between
/// points widens it in speckle, by a variance of h^2 / 6, and not around a single echo: at 1.25 the axial kernel, which
/// a flat spectrum makes wider around an echo than in speckle, has the same length in both to within 3 %.
const LATTICE_PER_SIGMA: f64 = 1.25;

/// Variance of the axial kernel over that of a Gaussian with the same length in speckle, and the share of the squared
/// distance of lattice points that is subtracted from it: solved numerically for that length.
const FLAT_VARIANCE: f64 = 2.11;
const FLAT_LATTICE: f64 = 0.261;
/// Standard deviations to each side at which the axial kernel ends: there it is below 1 % of its peak.
const FLAT_REACH: f64 = 3.5;

/// Elevational length in lattice distances that four sub-planes reach: more cost time, and do not show in one frame.
const AFFORDED: f64 = 3.5;

/// Maximum number of sub-planes in the parameter block.
pub(super) const MAX_PLANES: usize = 8;

/// Maximum number of fine scanlines per scanline.
const MAX_OVERSAMPLING: usize = 4;

/// Distance of scanlines above which they are refined, in lattice distances.
const COARSEST: f64 = 1.4;

impl SpeckleTables {
    /// Computes lattice, kernels and scales for a probe.
    pub fn new(spread: PointSpread, grid: &BeamGrid) -> Self {
        let shortest = spread.axial_mm.min(spread.lateral_mm).min(spread.elevational_mm) / FWHM_PER_SIGMA;
        let lattice_mm = LATTICE_PER_SIGMA * shortest;
        let correlation = |mm: f64| lattice_correlation(mm / lattice_mm);
        // Remaining width for a kernel after subtracting the variance of the lattice interpolation: its triangles of
        // half-width h have h^2 / 6, and the variances of kernels in a row add.
        let left = |length_mm: f64| {
            let sigma = length_mm / FWHM_PER_SIGMA;
            (sigma * sigma - lattice_mm * lattice_mm / 6.0).max(0.0).sqrt()
        };

        let widest = if spread.is_elevational_stated { f64::INFINITY } else { AFFORDED };
        let elevation = Elevation::of_width((spread.elevational_mm / lattice_mm).min(widest));
        let plane_mm = elevation.spacing * lattice_mm;
        let planes = unit_power(elevation.weights, |steps| correlation(steps * plane_mm));

        let sample_mm = grid.sample_spacing_mm();
        let gaussian_variance = (spread.axial_mm / FWHM_PER_SIGMA).powi(2);
        let variance = FLAT_VARIANCE * gaussian_variance - FLAT_LATTICE * lattice_mm * lattice_mm;
        let requested = variance.sqrt() / sample_mm;
        let axial_sigma = requested.min(MAX_REACH as f64 / FLAT_REACH);
        let along = |steps: f64| correlation(steps * sample_mm);
        let axial = unit_power(flat(axial_sigma), along);
        let correlated = correlations(axial.len(), along);
        let ends = (0..grid.samples())
            .map(|sample| restored(&axial, sample, grid.samples(), &correlated))
            .collect();

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
        let sigma = |sample: usize| left(spread.lateral_at(grid.sample_depth_mm(sample))) / fine_mm(sample);
        let across =
            |sample: usize, weights: &[f64]| correlations(weights.len(), |steps| correlation(steps * fine_mm(sample)));
        let scale = |sample: usize, weights: &[f64]| 1.0 / power(weights, &across(sample, weights)).sqrt();
        let lateral = LateralKernel::gaussian(grid.samples(), sigma, scale);
        let fine_lines = (grid.lines() - 1) * oversampling + 1;
        let by_depth: Vec<Vec<f64>> = (0..grid.samples()).map(|sample| lateral.near(sample)).collect();
        let step = step_weight(&axial);
        // The kernels have unit power for scatterers, whose phases are random. A surface adds up coherently: its gain,
        // the sum of the weights and not the root of their squares, is undone.
        let specular = by_depth
            .iter()
            .map(|weights| 1.0 / (step * weights.iter().sum::<f64>()))
            .collect();
        // Both ends of the array are alike: one row of factors serves either side.
        let edge_lines = lateral.reach.div_ceil(oversampling).min(grid.lines().div_ceil(2));
        let edges_by_depth = parallel::map(0..grid.samples(), &|sample| {
            let (weights, correlated) = (&by_depth[sample], across(sample, &by_depth[sample]));
            let edge = |line: usize| restored(weights, line * oversampling, fine_lines, &correlated);
            (0..edge_lines).map(edge).collect::<Vec<_>>()
        });
        let edges = (0..edge_lines).flat_map(|line| edges_by_depth.iter().map(move |edges| edges[line]));
        let edges = Numbers::new(edges.collect());
        Self {
            spread,
            lattice_mm,
            oversampling,
            plane_mm,
            planes,
            axial: Numbers::new(axial),
            axial_share: if requested > axial_sigma {
                axial_sigma / requested
            } else {
                1.0
            },
            ends: Numbers::new(ends),
            specular: Numbers::new(specular),
            lateral,
            edges,
        }
    }

    /// Gain of the axial kernel for an echo that extends over `reach_mm` to either side, sampled every `sample_mm`,
    /// relative to that of a surface.
    pub(crate) fn thick_gain(&self, reach_mm: f64, sample_mm: f64) -> f64 {
        let axial = self.axial.of::<f64>();
        let middle = (axial.len() / 2) as f64;
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

    pub(super) fn axial_reach(&self) -> usize {
        self.axial.of::<f64>().len() / 2
    }
}

/// Weights along the beam whose amplitude spectrum, (1 + k^2 / 2) exp(-k^2 / 2), is flat at its middle, as those of
/// arrays are, and not a Gaussian's.
fn flat(sigma: f64) -> Vec<f64> {
    let reach = (FLAT_REACH * sigma).ceil() as i32;
    let weight = |tap: i32| {
        let squared = (f64::from(tap) / sigma).powi(2);
        (1.5 - 0.5 * squared) * (-0.5 * squared).exp()
    };
    (-reach..=reach).map(weight).collect()
}

/// Response of the axial kernel to a step whose echo is shared by two samples.
fn step_weight(axial: &[f64]) -> f64 {
    let middle = axial.len() / 2;
    0.5 * (axial[middle] + axial.get(middle + 1).copied().unwrap_or(0.0))
}
