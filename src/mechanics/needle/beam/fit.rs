//! Least-squares fit of materials to measured stretch and stress (Wang et al. 2023, section III-A).
//!
//! Each material has its own fit, made of `factor`, `factors` and `residual`. Where models with similar fits
//! diverge beyond the data, none of them should be trusted there: Wang et al. 2023 reject one for that.

#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, Vector2};

use super::material::{Compression, Law, Material};

/// Relative difference of stress from which a model counts as diverging from the others.
pub const PARTED: f64 = 0.1;
/// Lowest compression ratio that is examined.
const LOWEST: f64 = 0.05;
/// Step of the compression ratio down to [`LOWEST`].
const STEP: f64 = 0.01;

/// A measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Length over length at rest, above 0; below 1 in compression.
    pub stretch: f64,
    /// Stress, kPa; negative in compression.
    pub stress_kpa: f64,
}

/// Best fit of one material model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitted {
    /// The material.
    pub material: Material,
    /// Coefficient of determination: 1 for a perfect fit.
    pub r_squared: f64,
    /// Root mean square residual, kPa.
    pub rms_kpa: f64,
}

/// Divergence of a model from the others, in compression beyond the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parting {
    /// Name of the model.
    pub model: &'static str,
    /// Highest stretch below the data at which its stress differs by [`PARTED`] from the median of all models.
    pub stretch: f64,
}

/// Fits of all models to the same data.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Kind of stress that was measured.
    pub compression: Compression,
    /// Least and largest stretch of the data.
    pub range: [f64; 2],
    /// One fit per model, in the order of [`ModelName`](super::ModelName).
    pub models: Vec<Fitted>,
    /// Models that diverge from the others.
    pub partings: Vec<Parting>,
}

/// Reason why data cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Too few samples.
    #[error("found {found} points at different stretches other than 1; expected at least 3")]
    TooFew {
        /// Number of samples.
        found: usize,
    },
    /// A number that is not a valid stretch or stress.
    #[error("found stretch {stretch} with stress {stress_kpa} kPa; expected finite numbers, the stretch above 0")]
    Number {
        /// Rejected stretch.
        stretch: f64,
        /// Rejected stress, kPa.
        stress_kpa: f64,
    },
    /// A model whose parameters are not finite.
    #[error("the fit of {model} has no finite numbers; expected stretches and stresses as of a test of tissue")]
    NotFinite {
        /// Name of the model.
        model: &'static str,
    },
    /// Stress of the wrong sign.
    #[error(
        "stress has the wrong sign: found {stress_kpa} kPa at stretch {stretch}; expected negative stress where stretch is below 1"
    )]
    Sign {
        /// Stretch of the sample farthest from rest.
        stretch: f64,
        /// Stress at that stretch, kPa.
        stress_kpa: f64,
    },
}

impl Fit {
    /// Fits every model to samples of a stress.
    ///
    /// # Errors
    /// [`FitError`].
    pub fn new(samples: &[Sample], compression: Compression) -> Result<Fit, FitError> {
        check(samples)?;
        let models: Vec<Fitted> = Material::fitted(samples, compression)
            .into_iter()
            .map(|material| judged(samples, material, compression))
            .collect();
        for model in &models {
            let mut parameters = model.material.parameters().into_iter().map(|(_, value)| value);
            if !(parameters.all(f64::is_finite) && model.r_squared.is_finite() && model.rms_kpa.is_finite()) {
                let model = model.material.model();
                return Err(FitError::NotFinite { model });
            }
        }
        let stretches = samples.iter().map(|sample| sample.stretch);
        let range = stretches.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], x| {
            [low.min(x), high.max(x)]
        });
        let partings = partings(&models, compression, range[0].min(1.0));
        Ok(Fit {
            compression,
            range,
            models,
            partings,
        })
    }
}

fn check(samples: &[Sample]) -> Result<(), FitError> {
    for &Sample { stretch, stress_kpa } in samples {
        if !(stretch > 0.0 && stretch.is_finite() && stress_kpa.is_finite()) {
            return Err(FitError::Number { stretch, stress_kpa });
        }
    }
    let mut stretches: Vec<f64> = samples
        .iter()
        .map(|sample| sample.stretch)
        .filter(|x| *x != 1.0)
        .collect();
    stretches.sort_by(f64::total_cmp);
    stretches.dedup();
    if stretches.len() < 3 {
        return Err(FitError::TooFew { found: stretches.len() });
    }
    // By the work of all samples: noise may give the stress next to rest either sign.
    let work: f64 = samples
        .iter()
        .map(|sample| (sample.stretch - 1.0) * sample.stress_kpa)
        .sum();
    let away = |sample: &&Sample| (sample.stretch - 1.0).abs();
    match samples.iter().max_by(|a, b| away(a).total_cmp(&away(b))) {
        Some(&Sample { stretch, stress_kpa }) if work <= 0.0 => Err(FitError::Sign { stretch, stress_kpa }),
        _ => Ok(()),
    }
}

/// Returns the best-fitting factor of a law.
pub(super) fn factor(samples: &[Sample], law: &Law) -> f64 {
    let (mut along, mut square) = (0.0, 0.0);
    for sample in samples {
        let stress = law.at(sample.stretch).stress_kpa;
        along += stress * sample.stress_kpa;
        square += stress * stress;
    }
    along / square
}

/// Returns the best-fitting factors of the sum of two laws.
pub(super) fn factors(samples: &[Sample], laws: [&Law; 2]) -> [f64; 2] {
    let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for sample in samples {
        let stress = Vector2::from(laws.map(|law| law.at(sample.stretch).stress_kpa));
        matrix += stress * stress.transpose();
        right += stress * sample.stress_kpa;
    }
    // Laws may differ in magnitude by orders.
    let scale = matrix.diagonal().map(|x| 1.0 / x.sqrt());
    let matrix = Matrix2::from_diagonal(&scale) * matrix * Matrix2::from_diagonal(&scale);
    match matrix.lu().solve(&right.component_mul(&scale)) {
        Some(factors) => factors.component_mul(&scale).into(),
        None => [factor(samples, laws[0]), 0.0],
    }
}

/// Returns the sum of squared residuals of a material, kPa^2.
pub(super) fn residual(samples: &[Sample], material: &Material, compression: Compression) -> f64 {
    let law = Law::new(material, compression);
    let square = |sample: &Sample| (law.at(sample.stretch).stress_kpa - sample.stress_kpa).powi(2);
    samples.iter().map(square).sum()
}

fn judged(samples: &[Sample], material: Material, compression: Compression) -> Fitted {
    let count = samples.len() as f64;
    let mean = samples.iter().map(|sample| sample.stress_kpa).sum::<f64>() / count;
    let spread: f64 = samples.iter().map(|sample| (sample.stress_kpa - mean).powi(2)).sum();
    let squares = residual(samples, &material, compression);
    Fitted {
        material,
        r_squared: 1.0 - squares / spread,
        rms_kpa: (squares / count).sqrt(),
    }
}

fn partings(models: &[Fitted], compression: Compression, from: f64) -> Vec<Parting> {
    let laws: Vec<Law> = models
        .iter()
        .map(|model| Law::new(&model.material, compression))
        .collect();
    // From the data downwards, so that the first difference seen is the highest. The median stands for the models that
    // agree: no one of them is known to be right.
    let mut parted = vec![None; models.len()];
    let steps = ((from - LOWEST) / STEP).max(0.0) as usize;
    for stretch in (0..=steps).map(|index| from - STEP * index as f64) {
        let stresses: Vec<f64> = laws.iter().map(|law| law.at(stretch).stress_kpa).collect();
        let mut sorted = stresses.clone();
        sorted.sort_by(f64::total_cmp);
        let half = sorted.len() / 2;
        let median = 0.5 * (sorted[half] + sorted[(sorted.len() - 1) / 2]);
        for (parted, stress) in parted.iter_mut().zip(&stresses) {
            if parted.is_none() && (stress - median).abs() > PARTED * median.abs() {
                *parted = Some(stretch);
            }
        }
    }
    let all = models.iter().zip(parted);
    all.filter_map(|(model, stretch)| {
        Some(Parting {
            model: model.material.model(),
            stretch: stretch?,
        })
    })
    .collect()
}
