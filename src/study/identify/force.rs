//! Piecewise-linear model of a force over the depth of the needle (Dehghan et al. 2008, Figure 12): for each layer a
//! region in which it is punctured, and one of normal penetration behind.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::search::nelder_mead;

/// Places tried for a break along the curve.
const TRIAL_BREAKS: usize = 50;
/// Most sweeps over all breaks.
const MAX_SWEEPS: usize = 8;
/// Least width of a region as a share of the curve.
const MIN_WIDTH_SHARE: f64 = 0.02;
/// Least number of points in a region.
const MIN_POINTS: usize = 3;
/// Factor by which the squared residual must rise where a break is left out.
const MIN_GAIN: f64 = 1.1;
/// Residual that counts as nothing, as a share of the largest force.
const NEGLIGIBLE_SHARE: f64 = 2e-3;

/// A continuous curve through 0 with a slope for each region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Piecewise {
    /// Depths between neighbouring regions, mm.
    pub breaks_mm: Vec<f64>,
    /// Slope in each region, N/mm.
    pub slopes_n_per_mm: Vec<f64>,
    /// Depth at the end of the last region, mm.
    pub end_mm: f64,
    /// Root mean square of the residual, N.
    pub rms_n: f64,
}

/// Lengths of the regions up to a depth.
fn lengths(breaks: &[f64], depth: f64) -> impl Iterator<Item = f64> + '_ {
    let ends = breaks.iter().copied().chain([f64::INFINITY]);
    let starts = [0.0].into_iter().chain(breaks.iter().copied());
    starts
        .zip(ends)
        .map(move |(start, end)| (depth.min(end) - start).max(0.0))
}

impl Piecewise {
    /// Force at a depth (mm), N.
    pub fn at(&self, depth: f64) -> f64 {
        let parts = lengths(&self.breaks_mm, depth).zip(&self.slopes_n_per_mm);
        parts.map(|(length, slope)| length * slope).sum()
    }

    /// Region at a depth, from 0.
    pub fn region(&self, depth: f64) -> usize {
        self.breaks_mm.iter().filter(|end| depth > **end).count()
    }

    /// Ends of a region, mm.
    pub fn ends(&self, region: usize) -> [f64; 2] {
        let start = region.checked_sub(1).map_or(0.0, |before| self.breaks_mm[before]);
        [start, self.breaks_mm.get(region).copied().unwrap_or(self.end_mm)]
    }

    /// Width of a region, mm.
    pub fn width(&self, region: usize) -> f64 {
        let [start, end] = self.ends(region);
        end - start
    }

    /// Least squares over all slopes at given breaks; `None` where a region is too narrow or has too few points.
    fn through(curve: &[[f64; 2]], breaks: &[f64]) -> Option<Self> {
        let end_mm = curve.last()?[0];
        let mut start = 0.0;
        for end in breaks.iter().copied().chain([end_mm]) {
            let points =
                curve.partition_point(|point| point[0] <= end) - curve.partition_point(|point| point[0] <= start);
            if end - start < MIN_WIDTH_SHARE * end_mm || points < MIN_POINTS {
                return None;
            }
            start = end;
        }
        // The force is linear in the slopes: the row of a point has the lengths of the regions up to its depth.
        let count = breaks.len() + 1;
        let (mut normal, mut right_side) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let mut row = vec![0.0; count];
        for [depth, force] in curve {
            row.iter_mut()
                .zip(lengths(breaks, *depth))
                .for_each(|(lower, upper)| *lower = upper);
            for i in 0..count {
                right_side[i] += row[i] * force;
                for j in 0..=i {
                    normal[(i, j)] += row[i] * row[j];
                }
            }
        }
        let slopes = normal.cholesky()?.solve(&right_side);
        let mut model = Self {
            breaks_mm: breaks.to_vec(),
            slopes_n_per_mm: slopes.iter().copied().collect(),
            end_mm,
            rms_n: 0.0,
        };
        let squares: f64 = curve
            .iter()
            .map(|[depth, force]| (model.at(*depth) - force).powi(2))
            .sum();
        model.rms_n = (squares / curve.len() as f64).sqrt();
        Some(model)
    }

    /// Fits slopes and breaks of `regions` regions to points (depth from above 0, mm, rising; force, N): breaks one
    /// after another at the best of equidistant places, then as [`refined`](Self::refined). `None` if the curve has too
    /// few points for this number of regions.
    pub fn fit(curve: &[[f64; 2]], regions: usize) -> Option<Self> {
        let end = curve.last()?[0];
        let mut best = Self::through(curve, &[])?;
        let fitted = |breaks: &[f64]| {
            let tried = (0..TRIAL_BREAKS).filter_map(|step| {
                let mut breaks = breaks.to_vec();
                breaks.push(end * (step as f64 + 0.5) / TRIAL_BREAKS as f64);
                breaks.sort_by(f64::total_cmp);
                Self::through(curve, &breaks)
            });
            tried.min_by(|a, b| a.rms_n.total_cmp(&b.rms_n))
        };
        // The residual has many minima in the breaks: each is sought over the whole curve before all are refined
        // together.
        while best.breaks_mm.len() + 1 < regions {
            best = fitted(&best.breaks_mm)?;
            for _ in 0..MAX_SWEEPS {
                let before = best.rms_n;
                for removed in 0..best.breaks_mm.len() {
                    let mut fewer = best.breaks_mm.clone();
                    fewer.remove(removed);
                    if let Some(better) = fitted(&fewer).filter(|fit| fit.rms_n < best.rms_n) {
                        best = better;
                    }
                }
                if best.rms_n >= before {
                    break;
                }
            }
        }
        best.refined(curve)
    }

    /// Fits all breaks together by Nelder and Mead's method, starting from those of `self`; the slopes follow by least
    /// squares each time.
    pub fn refined(&self, curve: &[[f64; 2]]) -> Option<Self> {
        let count = self.breaks_mm.len();
        let start = Self::through(curve, &self.breaks_mm);
        if count == 0 {
            return start;
        }
        let squares = curve.iter().map(|point| point[1] * point[1]).sum::<f64>() / curve.len() as f64;
        let steps = vec![self.end_mm / TRIAL_BREAKS as f64; count];
        // Breaks out of order cost more than no model at all.
        let cost = |breaks: &[f64]| {
            let model = Self::through(curve, breaks);
            Ok::<f64, ()>(model.map_or(10.0 * squares, |model| model.rms_n.powi(2)))
        };
        let minimum = nelder_mead(&self.breaks_mm, &steps, 1e-13 * squares, 400, cost).ok()?;
        let minimum = Self::through(curve, &minimum.point);
        [minimum, start]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.rms_n.total_cmp(&b.rms_n))
    }

    /// Why the curve does not have these regions, if it does not: a slope that is not positive, or a break that it does
    /// not need.
    pub fn doubt(&self, curve: &[[f64; 2]]) -> Option<String> {
        let mm = |[start, end]: [f64; 2]| format!("{start:.1} to {end:.1} mm");
        if let Some(index) = self.slopes_n_per_mm.iter().position(|slope| *slope <= 0.0) {
            let (slope, ends) = (self.slopes_n_per_mm[index], mm(self.ends(index)));
            return Some(format!(
                "a force that does not rise in region {} ({ends}): {slope:.4} N/mm",
                index + 1
            ));
        }
        let largest = curve.iter().map(|point| point[1].abs()).fold(0.0, f64::max);
        // Of two perfect fits one may be better by any factor, by rounding alone.
        let floor = (NEGLIGIBLE_SHARE * largest).powi(2);
        for (index, break_mm) in self.breaks_mm.iter().enumerate() {
            let mut fewer = self.breaks_mm.clone();
            fewer.remove(index);
            let without = Self::through(curve, &fewer)?;
            if without.rms_n.powi(2) + floor < MIN_GAIN * (self.rms_n.powi(2) + floor) {
                let regions = self.slopes_n_per_mm.len();
                return Some(format!(
                    "a force of fewer than {regions} regions: without a break at {break_mm:.1} mm its model errs by {:.2e} N in place of {:.2e} N",
                    without.rms_n, self.rms_n
                ));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insonify_base::random::{hash3, unit};

    fn curve(noise: f64) -> (Piecewise, Vec<[f64; 2]>) {
        let exact = Piecewise {
            breaks_mm: vec![6.3, 20.9, 29.2],
            slopes_n_per_mm: vec![0.06, 0.015, 0.085, 0.03],
            end_mm: 58.0,
            rms_n: 0.0,
        };
        let points = (1..=290).map(|step| {
            let depth = 0.2 * f64::from(step);
            [
                depth,
                exact.at(depth) + noise * (f64::from(unit(hash3([step, 0, 0], [7, 9])[0])) - 0.5),
            ]
        });
        let points = points.collect();
        (exact, points)
    }

    /// Seven parameters of a curve that has them return; with noise of 20 mN to a few per cent.
    #[test]
    fn seven_parameters_return() {
        for (noise, tolerance) in [(0.0, 1e-5), (0.02, 0.03)] {
            let (exact, points) = curve(noise);
            let fit = Piecewise::fit(&points, 4).unwrap();
            let pairs = exact.breaks_mm.iter().zip(&fit.breaks_mm);
            for (exact, fit) in pairs.chain(exact.slopes_n_per_mm.iter().zip(&fit.slopes_n_per_mm)) {
                assert!((fit / exact - 1.0).abs() < tolerance, "{noise}: {exact} {fit}");
            }
            assert_eq!(fit.doubt(&points), None);
            assert_eq!(fit.region(25.0), 2);
            assert!((fit.width(2) - 8.3).abs() < 0.3);
        }
    }

    #[test]
    fn curves_without_four_rising_regions_are_doubted() {
        for noise in [0.0, 0.02] {
            let (exact, points) = curve(noise);
            let three: Vec<[f64; 2]> = points
                .iter()
                .map(|[depth, force]| [*depth, force - exact.at(*depth) + 0.02 * depth])
                .collect();
            let doubt = Piecewise::fit(&three, 4).unwrap().doubt(&three);
            assert!(
                doubt.as_ref().is_some_and(|text| text.contains("fewer than 4 regions")),
                "{doubt:?}"
            );
            let falling: Vec<[f64; 2]> = points
                .iter()
                .map(|[depth, force]| [*depth, force - 0.035 * depth])
                .collect();
            let doubt = Piecewise::fit(&falling, 4).unwrap().doubt(&falling);
            assert!(
                doubt
                    .as_ref()
                    .is_some_and(|text| text.contains("does not rise in region 2")),
                "{doubt:?}"
            );
        }
        assert_eq!(Piecewise::fit(&[[1.0, 0.1], [2.0, 0.2], [3.0, 0.3]], 4), None);
    }
}
