//! Kernels that have one length around a point and another in speckle.

use std::f64::consts::SQRT_2;
use std::sync::LazyLock;

/// A kernel whose amplitude spectrum is (1 + flatness k^2 / 2) exp(-k^2 / 2), with k in units of 1 / sigma: that of a
/// Gaussian at 0, flat in its middle at 1, with raised edges above.
///
/// The spectrum of an aperture has sharper edges than a Gaussian's: its echo of a point, half as high at both ends of
/// that length, is longer than its speckle, whose intensity is half correlated over that length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shape {
    /// Standard deviation of the Gaussian, mm.
    pub sigma_mm: f64,
    /// Flatness of the spectrum.
    pub flatness: f64,
}

/// Largest flatness, at which a point is 1.2 times as long as speckle.
const FLATTEST: f64 = 3.0;

/// Lengths around a point and in speckle for a sigma of 1, at equal steps of flatness from 0.
static LENGTHS: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    (0..=STEPS)
        .map(|step| {
            let shape = Shape {
                sigma_mm: 1.0,
                flatness: flatness_at(step as f64),
            };
            [
                2.0 * half(&|away| shape.weight(away), 0.5),
                2.0 * half(&|away| shape.correlation(away), 0.5f64.sqrt()),
            ]
        })
        .collect()
});

const STEPS: usize = 48;

fn flatness_at(step: f64) -> f64 {
    FLATTEST * step / STEPS as f64
}

/// Lengths of a unit sigma around a point and in speckle.
fn lengths(flatness: f64) -> [f64; 2] {
    let at = (flatness / FLATTEST).clamp(0.0, 1.0) * STEPS as f64;
    let before = (at as usize).min(STEPS - 1);
    let share = at - before as f64;
    [0, 1].map(|of| LENGTHS[before][of] + share * (LENGTHS[before + 1][of] - LENGTHS[before][of]))
}

/// Distance at which a curve that falls from 1 reaches a level.
fn half(curve: &impl Fn(f64) -> f64, level: f64) -> f64 {
    let (mut inside, mut outside) = (0.0, 2.5);
    for _ in 0..40 {
        let middle = 0.5 * (inside + outside);
        if curve(middle) > level {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    inside
}

impl Shape {
    /// The kernel with these lengths, full widths at half maximum: of the amplitude around a point, and of the
    /// correlation of intensity in speckle from scatterers whose own spread has the variance `scatterers_mm2`. Where no
    /// flatness gives both, their geometric mean is kept.
    pub(crate) fn new(point_mm: f64, speckle_mm: f64, scatterers_mm2: f64) -> Self {
        let of_point = |flatness: f64| Self {
            sigma_mm: point_mm / lengths(flatness)[0],
            flatness,
        };
        let ratio = |step: usize| of_point(flatness_at(step as f64)).speckle_mm(scatterers_mm2) / speckle_mm;
        // Speckle becomes shorter with flatness.
        let mut before = ratio(0);
        if before <= 1.0 {
            return of_point(0.0).scaled(before);
        }
        for step in 1..=STEPS {
            let here = ratio(step);
            if here <= 1.0 {
                return of_point(flatness_at(step as f64 - (1.0 - here) / (before - here)));
            }
            before = here;
        }
        of_point(FLATTEST).scaled(before)
    }

    /// This kernel, whose speckle is too long by a factor, with half of that mended.
    fn scaled(self, too_long: f64) -> Self {
        Self {
            sigma_mm: self.sigma_mm / too_long.sqrt(),
            ..self
        }
    }

    /// Length in speckle.
    fn speckle_mm(&self, scatterers_mm2: f64) -> f64 {
        // The scatterers narrow the spectrum, not its factor of k^2.
        let variance = self.sigma_mm * self.sigma_mm;
        let sigma_mm = (variance + scatterers_mm2).sqrt();
        sigma_mm * lengths(self.flatness * variance / (sigma_mm * sigma_mm))[1]
    }

    /// Amplitude at a distance, mm; 1 in the middle.
    pub(crate) fn weight(&self, away_mm: f64) -> f64 {
        let squared = (away_mm / self.sigma_mm).powi(2);
        (1.0 + 0.5 * self.flatness * (1.0 - squared)) / (1.0 + 0.5 * self.flatness) * (-0.5 * squared).exp()
    }

    /// Correlation of its speckle, before detection, at a distance in mm.
    fn correlation(&self, away_mm: f64) -> f64 {
        // Transform of the squared spectrum, term by term.
        let squared = (away_mm / self.sigma_mm).powi(2);
        let of = |squared: f64| {
            1.0 + self.flatness * (0.5 - 0.25 * squared)
                + 0.25 * self.flatness * self.flatness * (0.75 - 0.75 * squared + squared * squared / 16.0)
        };
        of(squared) / of(0.0) * (-0.25 * squared).exp()
    }

    /// Distance beyond which the amplitude is below 0.2 % of its peak, mm.
    pub(crate) fn reach_mm(&self) -> f64 {
        // A Gaussian ends there at 3.53 sigma, lobes of raised edges a little farther out.
        self.sigma_mm * (3.56 + 0.25 * SQRT_2 * self.flatness.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_have_both_lengths() {
        for (point, speckle, scatterers) in [(1.0, 1.0, 0.0), (1.1, 1.0, 0.0), (1.1, 1.0, 0.04), (0.3, 0.26, 0.002)] {
            let shape = Shape::new(point, speckle, scatterers);
            let length = 2.0 * half(&|away| shape.weight(away), 0.5);
            assert!(
                (length / point - 1.0).abs() < 2e-3,
                "{length} around a point, not {point}"
            );
            // The correlation of the kernel, summed, with the scatterers' own: a Gaussian of that variance.
            let step = point / 50.0;
            let wide = Shape {
                sigma_mm: scatterers.sqrt().max(1e-6),
                flatness: 0.0,
            };
            let spread: Vec<f64> = (-250i32..=250)
                .map(|at| {
                    (-250i32..=250)
                        .map(|from| shape.weight(f64::from(at - from) * step) * wide.weight(f64::from(from) * step))
                        .sum()
                })
                .collect();
            let correlation = |lag: usize| spread.iter().zip(&spread[lag..]).map(|(a, b)| a * b).sum::<f64>();
            let crossing = (1..)
                .find(|lag| (correlation(*lag) / correlation(0)).powi(2) < 0.5)
                .unwrap();
            let [above, below] = [crossing - 1, crossing].map(|lag| (correlation(lag) / correlation(0)).powi(2));
            let length = 2.0 * step * (crossing as f64 - (0.5 - below) / (above - below));
            assert!(
                (length / speckle - 1.0).abs() < 5e-3,
                "{length} in speckle, not {speckle}"
            );
        }
    }

    #[test]
    fn what_no_flatness_gives_keeps_the_mean() {
        for (point, speckle) in [(1.0, 1.3), (1.5, 1.0)] {
            let shape = Shape::new(point, speckle, 0.0);
            let lengths = lengths(shape.flatness).map(|length| shape.sigma_mm * length);
            assert!(
                (lengths[0] * lengths[1] / (point * speckle) - 1.0).abs() < 1e-3,
                "{lengths:?}"
            );
        }
    }

    #[test]
    fn nothing_lies_beyond_the_reach() {
        for flatness in [0.0, 0.3, 1.0, 2.0, FLATTEST] {
            let shape = Shape {
                sigma_mm: 1.0,
                flatness,
            };
            for away in 0..200 {
                let beyond = shape.reach_mm() + f64::from(away) * 0.02;
                assert!(
                    shape.weight(beyond).abs() < 0.002,
                    "{flatness}: {} at {beyond}",
                    shape.weight(beyond)
                );
            }
        }
    }
}
