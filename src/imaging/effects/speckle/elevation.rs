//! Elevational point spread: number, distance and weights of the sub-planes from which scatterers are gathered.

use std::sync::OnceLock;

use super::power::lattice_correlation;
use super::tables::MAX_PLANES;

/// Weights and distance of the sub-planes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Elevation {
    /// Distance between sub-planes, lattice steps.
    pub spacing: f64,
    /// Weights, from the most negative elevation to the most positive.
    pub weights: Vec<f64>,
}

/// Minimum number of sub-planes: two can only have equal weights.
const FEWEST: usize = 3;

/// Standard deviation of the weights, as number of sub-planes per sigma: the outermost of any number of them then weigh
/// a third to three quarters of the middle.
const PLANES_PER_SIGMA: f64 = 2.5;

/// Candidate ranges of the distance between sub-planes, lattice steps, with the minimum number of sub-planes for each.
/// At multiples of a lattice step, or near them, sub-planes parallel to the lattice all have the same fractional
/// position between lattice points, and the total power varies with the position of the scan plane: by 2.8 dB at one
/// step, by less than 0.7 dB at these distances. Wider ones leave a shoulder in the correlation, below one half for
/// fewer than four.
const DISTANCES: [(usize, [f64; 2]); 4] = [
    (3, [0.55, 0.66]),
    (4, [1.25, 1.4]),
    (6, [1.18, 1.25]),
    (8, [0.72, 0.86]),
];

/// Step between the distances tried, lattice steps.
const STEP: f64 = 0.01;

/// Relative error of the width above which more sub-planes are used.
const TOLERANCE: f64 = 0.03;

impl Elevation {
    /// Smallest number of sub-planes whose echo intensity has a correlation of full width at half maximum `width`
    /// lattice steps; the closest one if none has it.
    pub(crate) fn of_width(width: f64) -> Self {
        let mut best = (f64::INFINITY, &Self::candidates(FEWEST)[0].1);
        for count in FEWEST..=MAX_PLANES {
            for (reached, candidate) in Self::candidates(count) {
                let error = (reached / width - 1.0).abs();
                if error < best.0 {
                    best = (error, candidate);
                }
            }
            if best.0 <= TOLERANCE {
                break;
            }
        }
        best.1.clone()
    }

    /// Returns the spreads tried with a number of sub-planes, each with its width: the same for all probes.
    fn candidates(count: usize) -> &'static [(f64, Self)] {
        static CANDIDATES: [OnceLock<Vec<(f64, Elevation)>>; MAX_PLANES + 1] =
            [const { OnceLock::new() }; MAX_PLANES + 1];
        CANDIDATES[count].get_or_init(|| {
            let ranges = DISTANCES.into_iter().filter(|(from, _)| count >= *from);
            let distances = ranges.flat_map(|(_, [low, high])| {
                (0..=((high - low) / STEP).round() as usize).map(move |step| low + step as f64 * STEP)
            });
            let candidates = distances.map(|distance| Self::spaced(count, distance));
            candidates.map(|candidate| (candidate.width(), candidate)).collect()
        })
    }

    fn spaced(count: usize, spacing: f64) -> Self {
        let sigma = count as f64 / PLANES_PER_SIGMA;
        let middle = (count - 1) as f64 / 2.0;
        let weights = (0..count).map(|plane| (-0.5 * ((plane as f64 - middle) / sigma).powi(2)).exp());
        Self {
            spacing,
            weights: weights.collect(),
        }
    }

    /// Correlation of the intensity at an elevational distance in lattice steps: for normally distributed echoes the
    /// square of that of the field.
    fn correlation(&self, distance: f64) -> f64 {
        let field = |distance: f64| -> f64 {
            let mut sum = 0.0;
            for (i, a) in self.weights.iter().enumerate() {
                for (j, b) in self.weights.iter().enumerate() {
                    sum += a * b * lattice_correlation(distance + (i as f64 - j as f64) * self.spacing);
                }
            }
            sum
        };
        (field(distance) / field(0.0)).powi(2)
    }

    /// Full width at half maximum of [`Self::correlation`], lattice steps.
    fn width(&self) -> f64 {
        // Beyond the spread of all sub-planes and the reach of the interpolation the correlation vanishes.
        let (mut inside, mut outside) = (0.0, self.weights.len() as f64 * self.spacing + 2.0);
        for _ in 0..40 {
            let middle = 0.5 * (inside + outside);
            if self.correlation(middle) > 0.5 {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        2.0 * inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_those_asked() {
        for hundredths in 150..=620 {
            let requested = f64::from(hundredths) / 100.0;
            let elevation = Elevation::of_width(requested);
            let off = elevation.width() / requested - 1.0;
            assert!(
                off.abs() < 0.05,
                "{requested}: {} with {elevation:?}",
                elevation.width()
            );
        }
        assert_eq!(Elevation::of_width(1.6).weights.len(), 3);
        assert_eq!(Elevation::of_width(3.5).weights.len(), 4);
    }

    #[test]
    fn correlations_fall_like_a_gaussian() {
        for requested in [1.6, 2.0, 2.4, 3.1, 3.5, 5.9] {
            let elevation = Elevation::of_width(requested);
            for step in 0..100 {
                let distance = f64::from(step) * 0.05;
                let correlation = elevation.correlation(distance);
                let gaussian = (-4.0 * std::f64::consts::LN_2 * (distance / requested).powi(2)).exp();
                assert!(
                    (correlation - gaussian).abs() < 0.15,
                    "{requested} at {distance}: {correlation}, not {gaussian}"
                );
            }
        }
    }

    #[test]
    fn power_hardly_depends_on_where_the_planes_lie_in_the_lattice() {
        for tenths in 15..=62 {
            let elevation = Elevation::of_width(f64::from(tenths) / 10.0);
            let powers = (0..50).map(|phase| {
                // Weights of the lattice points between which planes parallel to the lattice interpolate.
                let mut lattice = [0.0; 40];
                for (plane, weight) in elevation.weights.iter().enumerate() {
                    let place = 10.0 + f64::from(phase) / 50.0 + plane as f64 * elevation.spacing;
                    let (point, share) = (place as usize, place.fract());
                    let norm = share.hypot(1.0 - share);
                    lattice[point] += weight * (1.0 - share) / norm;
                    lattice[point + 1] += weight * share / norm;
                }
                lattice.iter().map(|x| x * x).sum::<f64>()
            });
            let (low, high) = powers.fold((f64::INFINITY, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
            let ripple_db = 10.0 * (high / low).log10();
            assert!(
                ripple_db < 0.85,
                "{} planes {} apart: {ripple_db} dB",
                elevation.weights.len(),
                elevation.spacing
            );
        }
    }

    #[test]
    fn what_cannot_be_reached_is_the_widest() {
        let widest = Elevation::of_width(100.0);
        assert_eq!(widest.weights.len(), MAX_PLANES);
        assert!((6.0..7.5).contains(&widest.width()), "{}", widest.width());
    }
}
