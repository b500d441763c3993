//! Fit of the slice's modulus, knee and stiffening to a measured needle force (section 4.2.2 of Kobayashi et al. 2010,
//! which fitted E0, e0 and a by hand).
//!
//! Only the first push is used, until the force drops, as in Kobayashi et al. 2010. All forces of the slice are
//! proportional to the modulus: it follows from knee and stiffening by linear least squares, and these two are fitted
//! by the Levenberg-Marquardt method, starting from the options. A curve that stays straight, or bends slowly, does not
//! distinguish the two: the result states how well it fits, not that no other would.

use std::ops::ControlFlow;
use std::path::Path;

use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use super::{PunctureOptions, pushing};
use crate::StudyError;
use insonify::Error;
use insonify_base::csv::Csv;

/// Least number of points for three unknowns.
const MIN_POINTS: usize = 4;
/// Fraction of the largest force so far at which the force counts as dropped: a membrane is punctured.
const DROP: f64 = 0.8;
/// Least drop in standard deviations of the noise: the largest force so far has some of it, too.
const CLEAR: f64 = 8.0;
/// Standard deviation of normal noise over the median of its magnitude.
const OF_MEDIAN: f64 = 1.4826;
/// Fewest points before the capsule from which the offset of the load cell is taken.
const MIN_BEFORE: usize = 5;
/// Force before the capsule, or at it, that is an offset, as a fraction of the largest.
const OFFSET: f64 = 0.02;
/// Maximum number of iterations.
const MAX_ITERATIONS: usize = 20;
/// Relative change of the squared residual that ends the iterations.
const SETTLED: f64 = 1e-4;
/// Squared residual that counts as zero, as a fraction of the squared forces.
const NEGLIGIBLE: f64 = 1e-9;
/// Finite difference of knee strain and of the logarithm of the stiffening for derivatives; forces are solved to 1e-6.
const DIFFERENCE: f64 = 1e-3;
/// Largest number of factors tried on the damping in an iteration.
const MAX_DAMPINGS: usize = 8;
/// Range of the stiffening.
const STIFFENING: [f64; 2] = [1e-3, 1e4];

/// Point of a force curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ForceSample {
    /// Travel of the needle from the undeformed capsule, mm.
    pub travel_mm: f64,
    /// Force on the needle, N.
    pub force_n: f64,
}

/// Result of a fit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PunctureFit {
    /// Young's modulus below the knee, E0, kPa (kPa s^order).
    pub young_kpa: f64,
    /// Knee strain e0.
    pub knee_strain: f64,
    /// Stiffening a.
    pub stiffening: f64,
    /// Coefficient of determination, 1 for a perfect fit.
    pub r_squared: f64,
    /// Root mean square of the residual, N.
    pub rms_n: f64,
    /// Measured points of the first push, less the offset.
    pub samples: Vec<ForceSample>,
    /// Offset of the load cell, N: the mean force at travels of 0 and less, if there are five or more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset_n: Option<f64>,
    /// Doubts about the curve, for the user.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Fitted force at each point, N.
    pub force_n: Vec<f64>,
    /// Number of iterations.
    pub iterations: usize,
}

/// Reads a curve from a CSV file whose header includes the columns `travel_mm` (ascending) and `force_n`, such as the
/// table that `insonify puncture` writes.
///
/// # Errors
/// [`CsvError`](insonify_base::csv::CsvError) if the file cannot be read or is malformed.
pub fn read(path: &Path) -> Result<Vec<ForceSample>, Error> {
    let table = Csv::open(path, &["travel_mm", "force_n"])?;
    let mut samples: Vec<ForceSample> = Vec::new();
    for row in table.rows() {
        let [travel_mm, force_n] = row.numbers(["travel_mm", "force_n"])?;
        if samples.last().is_some_and(|sample| travel_mm <= sample.travel_mm) {
            return Err(row.wrong("travel_mm", "a travel that rises from line to line").into());
        }
        samples.push(ForceSample { travel_mm, force_n });
    }
    Ok(samples)
}

/// Fits the slice to a curve, starting from the options' knee and stiffening. `progress` receives the completed
/// fraction before each iteration, and may say stop.
///
/// # Errors
/// [`Error`] for a curve with too few points before the force drops, and if the slice cannot be solved.
pub fn fit(
    options: &PunctureOptions,
    samples: &[ForceSample],
    progress: &mut dyn FnMut(f64) -> ControlFlow<()>,
) -> Result<PunctureFit, Error> {
    let (offset_n, notes) = offset(samples);
    let zeroed: Vec<ForceSample> = samples
        .iter()
        .map(|sample| ForceSample {
            force_n: sample.force_n - offset_n.unwrap_or(0.0),
            ..*sample
        })
        .collect();
    let samples = first_push(&zeroed)?;
    // The stiffening ranges over decades: its logarithm is fitted.
    let mut parameters = [options.knee_strain, options.stiffening.max(STIFFENING[0]).ln()];
    let mut best = Trial::of(options, &samples, parameters)?;
    let mut damping = 1e-3;
    let mut iterations = 0;
    let forces: f64 = samples.iter().map(|sample| sample.force_n * sample.force_n).sum();
    while iterations < MAX_ITERATIONS && best.square() > NEGLIGIBLE * forces {
        StudyError::unless_stopped(progress(iterations as f64 / MAX_ITERATIONS as f64))?;
        iterations += 1;
        let columns = [
            best.derivative(options, &samples, parameters, 0)?,
            best.derivative(options, &samples, parameters, 1)?,
        ];
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        // Damped as by K. Levenberg (1944) and D. W. Marquardt (1963): by the diagonal, so that units do not matter.
        let normal = Matrix2::from_fn(|row, column| dot(&columns[row], &columns[column]));
        let slope = Vector2::from_fn(|row, _| dot(&columns[row], &best.residuals));
        let before = best.square();
        let mut gained = false;
        for _ in 0..MAX_DAMPINGS {
            let damped = normal + Matrix2::from_diagonal(&(normal.diagonal() * damping));
            let Some(step) = damped.try_inverse().map(|inverse| -(inverse * slope)) else {
                break;
            };
            let next = [
                (parameters[0] + step[0]).max(0.0),
                (parameters[1] + step[1]).clamp(STIFFENING[0].ln(), STIFFENING[1].ln()),
            ];
            // A slice that cannot be solved counts as no improvement.
            match Trial::of(options, &samples, next) {
                Ok(trial) if trial.square() < before => {
                    (parameters, best, gained) = (next, trial, true);
                    damping = (0.2 * damping).max(1e-12);
                    break;
                }
                _ => damping *= 5.0,
            }
        }
        if !gained || before - best.square() < SETTLED * before {
            break;
        }
    }
    StudyError::unless_stopped(progress(1.0))?;
    let count = samples.len() as f64;
    let mean = samples.iter().map(|sample| sample.force_n).sum::<f64>() / count;
    let spread: f64 = samples.iter().map(|sample| (sample.force_n - mean).powi(2)).sum();
    Ok(PunctureFit {
        young_kpa: best.scale * options.young_kpa,
        knee_strain: parameters[0],
        stiffening: parameters[1].exp(),
        r_squared: 1.0 - best.square() / spread,
        rms_n: (best.square() / count).sqrt(),
        force_n: samples
            .iter()
            .zip(&best.residuals)
            .map(|(sample, residual)| sample.force_n + residual)
            .collect(),
        samples,
        offset_n,
        notes,
        iterations,
    })
}

/// The offset of the load cell, N, from the points before the capsule, and what is to be said of it.
fn offset(samples: &[ForceSample]) -> (Option<f64>, Vec<String>) {
    let before: Vec<f64> = samples
        .iter()
        .filter(|sample| sample.travel_mm <= 0.0)
        .map(|sample| sample.force_n)
        .collect();
    let mean = before.iter().sum::<f64>() / before.len().max(1) as f64;
    let largest = samples.iter().map(|sample| sample.force_n).fold(0.0, f64::max);
    let is_offset = mean.abs() > OFFSET * largest;
    match before.len() {
        MIN_BEFORE.. if is_offset => (
            Some(mean),
            vec![format!(
                "the load cell reads {mean:.4} N before the capsule: this offset was taken off"
            )],
        ),
        MIN_BEFORE.. => (Some(mean), Vec::new()),
        1.. if is_offset => (
            None,
            vec![format!(
                "the force at the capsule is {mean:.4} N and not 0: an offset of the load cell changes all three parameters; give {MIN_BEFORE} \
                 points or more at travels of 0 mm and less, from which it is taken off"
            )],
        ),
        _ => (None, Vec::new()),
    }
}

/// Standard deviation of the noise of a force, N: from the median of second differences, which a smooth curve and a few
/// punctures leave alone.
fn noise_n(samples: &[ForceSample]) -> f64 {
    let bends = samples.windows(3).map(|part| {
        let [before, here, after] = [0, 1, 2].map(|index| part[index].force_n);
        (before - 2.0 * here + after).abs()
    });
    let mut bends: Vec<f64> = bends.collect();
    bends.sort_by(f64::total_cmp);
    let median = bends.get(bends.len() / 2).copied().unwrap_or(0.0);
    // The coefficients 1, -2 and 1 add the variance of the noise six times.
    OF_MEDIAN * median / 6f64.sqrt()
}

/// Returns the points before the force drops.
fn first_push(samples: &[ForceSample]) -> Result<Vec<ForceSample>, Error> {
    let mut largest = (0, 0.0);
    let noise_n = noise_n(samples);
    for (index, sample) in samples.iter().enumerate() {
        if sample.force_n >= largest.1 {
            largest = (index, sample.force_n);
        } else if sample.force_n < DROP * largest.1 && largest.1 - sample.force_n > CLEAR * noise_n {
            break;
        }
    }
    let pushed = samples
        .iter()
        .take(largest.0 + 1)
        .filter(|sample| sample.travel_mm > 0.0);
    let pushed: Vec<ForceSample> = pushed.copied().collect();
    if pushed.len() < MIN_POINTS || largest.1 <= 0.0 {
        return Err(StudyError::refused(format!(
            "the curve: found {} points beyond 0 mm before the force drops; expected at least {MIN_POINTS}, with a force above 0 N",
            pushed.len()
        )));
    }
    Ok(pushed)
}

/// Trial of a knee and a stiffening.
struct Trial {
    /// Best-fitting factor on the modulus.
    scale: f64,
    /// Residual: force of the slice less the measured force, N.
    residuals: Vec<f64>,
}

impl Trial {
    fn of(options: &PunctureOptions, samples: &[ForceSample], [knee, stiffening]: [f64; 2]) -> Result<Trial, Error> {
        let options = PunctureOptions {
            knee_strain: knee,
            stiffening: stiffening.exp(),
            // The capsule never breaks, so the needle pushes throughout.
            capsule_n: f64::MAX,
            ..*options
        };
        let last_mm = samples[samples.len() - 1].travel_mm;
        let steps = (last_mm / options.step_mm).ceil();
        let (_, mut needle) = pushing(&options, steps, false)?;
        let mut curve = vec![[0.0, 0.0]];
        for index in 1..=steps as usize {
            let travel_mm = (index as f64 * options.step_mm).min(last_mm);
            // The last step is shorter but takes as long: forces depend on the travel.
            let pushed = needle.step(travel_mm, options.step_mm / options.speed_mm_per_s);
            let pushed = pushed.map_err(|cause| StudyError::Travel { travel_mm, cause })?;
            curve.push([travel_mm, pushed.force_n]);
        }
        let model: Vec<f64> = samples.iter().map(|sample| between(&curve, sample.travel_mm)).collect();
        let square: f64 = model.iter().map(|force| force * force).sum();
        let product: f64 = model
            .iter()
            .zip(samples)
            .map(|(force, sample)| force * sample.force_n)
            .sum();
        let scale = product / square;
        let residuals = model
            .iter()
            .zip(samples)
            .map(|(force, sample)| scale * force - sample.force_n);
        Ok(Trial {
            scale,
            residuals: residuals.collect(),
        })
    }

    /// Derivative of the residual by the knee (0) or the logarithm of the stiffening (1).
    fn derivative(
        &self,
        options: &PunctureOptions,
        samples: &[ForceSample],
        mut parameters: [f64; 2],
        axis: usize,
    ) -> Result<Vec<f64>, Error> {
        parameters[axis] += DIFFERENCE;
        let neighbour = Trial::of(options, samples, parameters)?;
        let pairs = neighbour.residuals.iter().zip(&self.residuals);
        Ok(pairs
            .map(|(beside_residual, residual)| (beside_residual - residual) / DIFFERENCE)
            .collect())
    }

    fn square(&self) -> f64 {
        self.residuals.iter().map(|residual| residual * residual).sum()
    }
}

/// Interpolates a curve linearly between its points.
fn between(curve: &[[f64; 2]], x: f64) -> f64 {
    let after = curve.partition_point(|point| point[0] < x).clamp(1, curve.len() - 1);
    let [[x0, y0], [x1, y1]] = [curve[after - 1], curve[after]];
    y0 + (x - x0) / (x1 - x0) * (y1 - y0)
}

#[cfg(test)]
mod tests;
