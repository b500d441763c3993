//! Parameters of tissue from measurements of a rheometer, after Kobayashi et al. 2010 (section 3.1): order and modulus
//! of a spring-pot from storage and loss moduli (figure 7), modulus, knee and stiffening from creep (equations 2 and 3,
//! figure 8).

mod curve;
mod measured;
mod report;

pub use measured::{CreepTest, Measurements, Modulus};

use libm::tgamma;
use serde::Serialize;

use curve::StiffeningCurve;
use insonify_base::statistics::mean;
use insonify_mechanics::tissue::viscoelastic::point::Structure;

/// Difference of orders from which one law does not fit two tests, and clear differences in standard errors.
const OTHER_ORDER: f64 = 0.05;
const CLEAR: f64 = 3.0;
/// Least number of frequencies, for two unknowns.
const MIN_FREQUENCIES: usize = 3;
/// Least number of strains, for three unknowns.
const MIN_STRAINS: usize = 4;
/// Relative deviation of the loss tangent from that of a spring-pot above which a warning is given.
const MAX_TANGENT_DEVIATION: f64 = 0.1;

/// A parameter with its standard error, from the scatter of the measurements about the fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Standard error.
    pub standard_error: f64,
}

/// Spring-pot fitted to storage and loss moduli: `G* = G (i w)^k`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpringPotFit {
    /// Order k: common slope of both moduli against frequency on logarithmic scales.
    pub order: Estimate,
    /// Modulus G, kPa s^k: geometric mean of |G*| / w^k.
    pub modulus_kpa: Estimate,
    /// Slopes of G' and G'' on logarithmic scales.
    pub slopes: [f64; 2],
    /// Loss tangent G''/G', geometric mean.
    pub loss_tangent: f64,
    /// Loss tangent of a spring-pot of the fitted order, tan(pi k / 2).
    pub spring_pot_loss_tangent: f64,
    /// Measurements.
    #[serde(skip)]
    pub points: Vec<Modulus>,
}

/// Modulus against strain fitted to creep: `G = G0 (1 + a (gamma - gamma0)^2)` above the knee gamma0.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StiffeningFit {
    /// Order k that the creep was evaluated with.
    pub order: f64,
    /// Modulus below the knee G0, kPa s^k.
    pub modulus_kpa: Estimate,
    /// Knee gamma0, shear strain; `None` if the modulus does not rise with strain.
    pub knee_shear: Option<Estimate>,
    /// Stiffening coefficient a; `None` without a knee.
    pub stiffening: Option<Estimate>,
    /// Root mean square of the relative deviation of measured moduli from the fit.
    pub rms: f64,
    /// Position of the stiffness relative to the memory.
    pub memory: Structure,
    /// Shear strain and modulus by equation 2, kPa s^k, of each measurement.
    #[serde(skip)]
    pub points: Vec<[f64; 2]>,
}

/// Parameters from all measurements given.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MaterialFit {
    /// From storage and loss moduli.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dynamic: Option<SpringPotFit>,
    /// From creep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub creep: Option<StiffeningFit>,
    /// Doubts about the result, for the user.
    pub warnings: Vec<String>,
}

impl MaterialFit {
    /// Fits measurements. Creep is evaluated with the given order, else with that from the moduli, else with that of
    /// the strain in the test of the least stress, `gamma ~ t^k`. Equation 2 assumes that the current stiffness divides
    /// the integral of the entire load history (`load-integral`); for `rate` the parameters are corrected until
    /// simulated creep, evaluated in the same way, gives what the measurements give.
    ///
    /// # Errors
    /// The reason, for the user, if the measurements do not determine the parameters.
    pub fn new(measured: &Measurements, order: Option<f64>, memory: Structure) -> Result<MaterialFit, String> {
        let mut fit = MaterialFit::default();
        if !measured.moduli.is_empty() {
            fit.dynamic = Some(dynamic(&measured.moduli, &mut fit.warnings)?);
        }
        if !measured.creep.is_empty() {
            let of_creep = order_of_creep(&measured.creep);
            let order = match order.or(fit.dynamic.as_ref().map(|dynamic| dynamic.order.value)) {
                Some(order) => {
                    if let Ok(own) = &of_creep
                        && (own.value - order).abs() > OTHER_ORDER.max(CLEAR * own.standard_error)
                    {
                        fit.warnings.push(format!(
                            "creep is evaluated with the order {order:.3}, and strain in the test of the least stress grows as time to the power \
                             {:.3} +- {:.3}: one spring-pot does not fit both",
                            own.value, own.standard_error
                        ));
                    }
                    order
                }
                None => {
                    let own = of_creep?;
                    if own.value < CLEAR * own.standard_error {
                        fit.warnings.push(format!(
                            "the order {:.4} +- {:.4}, of the strain in the test of the least stress, is not clearly above 0: state it with `--order`, or \
                             give moduli",
                            own.value, own.standard_error
                        ));
                    }
                    own.value
                }
            };
            fit.creep = Some(creep(&measured.creep, order, memory, &mut fit.warnings)?);
        }
        Ok(fit)
    }
}

fn dynamic(points: &[Modulus], warnings: &mut Vec<String>) -> Result<SpringPotFit, String> {
    let mut frequencies: Vec<f64> = points.iter().map(|point| point.frequency_rad_s).collect();
    frequencies.sort_by(f64::total_cmp);
    frequencies.dedup();
    if frequencies.len() < MIN_FREQUENCIES {
        let (count, least) = (frequencies.len(), MIN_FREQUENCIES);
        return Err(format!(
            "found moduli at {count} frequencies; expected at least {least}"
        ));
    }
    let logs = |part: fn(&Modulus) -> f64| points.iter().map(|point| part(point).ln()).collect::<Vec<f64>>();
    let (x, storage, loss) = (
        logs(|modulus| modulus.frequency_rad_s),
        logs(|modulus| modulus.storage_kpa),
        logs(|modulus| modulus.loss_kpa),
    );
    let complex = logs(|modulus| modulus.storage_kpa.hypot(modulus.loss_kpa));
    // About the mean frequency, order and level are independent.
    let middle = mean(&x);
    let spread: f64 = x.iter().map(|x| (x - middle).powi(2)).sum();
    // Both moduli of a spring-pot grow as the frequency to the power of its order: two lines with one slope, k, and two
    // levels.
    let slope = |y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - middle) * y).sum::<f64>() / spread;
    let slopes = [slope(&storage), slope(&loss)];
    let k = 0.5 * (slopes[0] + slopes[1]);
    if !(k > 0.0 && k < 1.0) {
        return Err(format!(
            "both moduli together grow as the frequency to the power {k:.3}; expected a power above 0 and below 1, as of a spring-pot"
        ));
    }
    let count = points.len() as f64;
    let square = |y: &[f64]| -> f64 {
        let level = mean(y) - k * middle;
        x.iter().zip(y).map(|(x, y)| (y - level - k * x).powi(2)).sum()
    };
    let scatter = ((square(&storage) + square(&loss)) / (2.0 * count - 3.0)).sqrt();
    let order_error = scatter / (2.0 * spread).sqrt();
    let modulus_kpa = (mean(&complex) - k * middle).exp();
    let (loss_tangent, expected) = (
        (mean(&loss) - mean(&storage)).exp(),
        (0.5 * std::f64::consts::PI * k).tan(),
    );
    if (loss_tangent / expected - 1.0).abs() > MAX_TANGENT_DEVIATION {
        warnings.push(format!(
            "the loss tangent G''/G' is {loss_tangent:.3}, that of a spring-pot of order {k:.3} {expected:.3}: no spring-pot fits both slope and \
             loss in this range of frequencies"
        ));
    }
    Ok(SpringPotFit {
        order: Estimate {
            value: k,
            standard_error: order_error,
        },
        modulus_kpa: Estimate {
            value: modulus_kpa,
            standard_error: modulus_kpa * (scatter * scatter / count + (middle * order_error).powi(2)).sqrt(),
        },
        slopes,
        loss_tangent,
        spring_pot_loss_tangent: expected,
        points: points.to_vec(),
    })
}

/// Order from the slope of strain against time, on logarithmic scales, in the test of the least stress.
fn order_of_creep(tests: &[CreepTest]) -> Result<Estimate, String> {
    let least = tests.iter().min_by(|a, b| a.stress_kpa.total_cmp(&b.stress_kpa));
    let rows: Vec<[f64; 2]> = least.iter().flat_map(|test| test.rows.iter().copied()).collect();
    let (x, y): (Vec<f64>, Vec<f64>) = rows.iter().map(|[time, strain]| (time.ln(), strain.ln())).unzip();
    let expected = "expected `--order`, a file of moduli, or at least 3 times in that test at which the strain rises with a power above 0 and below 1";
    if rows.len() < MIN_FREQUENCIES {
        return Err(format!(
            "the order cannot be found from {} times in the test of the least stress; {expected}",
            rows.len()
        ));
    }
    let order = insonify_base::statistics::slope(&x, &y);
    let (middle, level) = (mean(&x), mean(&y));
    let residual = |(x, y): (&f64, &f64)| (y - level - order * (x - middle)).powi(2);
    let residuals: f64 = x.iter().zip(&y).map(residual).sum();
    let spread: f64 = x.iter().map(|x| (x - middle).powi(2)).sum();
    if order > 0.0 && order < 1.0 {
        Ok(Estimate {
            value: order,
            standard_error: (residuals / (x.len() as f64 - 2.0) / spread).sqrt(),
        })
    } else {
        Err(format!(
            "the strain in the test of the least stress grows as time to the power {order:.3}; {expected}"
        ))
    }
}

/// Shear strain and modulus by equation 2, `G = tau t^k / (gamma Gamma(1 + k))`.
fn moduli(tests: &[CreepTest], order: f64) -> Vec<[f64; 2]> {
    let scale = 1.0 / tgamma(1.0 + order);
    let pairs = |test: &CreepTest| {
        let stress = test.stress_kpa;
        let stress_over_strain = move |[time, strain]: &[f64; 2]| [*strain, stress * scale * time.powf(order) / strain];
        test.rows.iter().map(stress_over_strain).collect::<Vec<_>>()
    };
    tests.iter().flat_map(pairs).collect()
}

fn creep(
    tests: &[CreepTest],
    order: f64,
    memory: Structure,
    warnings: &mut Vec<String>,
) -> Result<StiffeningFit, String> {
    let points = moduli(tests, order);
    if points.len() < MIN_STRAINS {
        let (count, least) = (points.len(), MIN_STRAINS);
        return Err(format!("found {count} strains; expected at least {least}"));
    }
    let fitted = StiffeningCurve::fitted(&points);
    let errors = fitted.errors(&points);
    if !errors.iter().all(|error| error.is_finite()) {
        return Err(format!(
            "{} strains do not determine modulus, knee and stiffening together; expected strains on both sides of the knee",
            points.len()
        ));
    }
    let mut curve = fitted;
    // Equation 2 applies the current stiffness to the entire past, which a memory of rates does not.
    if memory == Structure::Rate && curve.has_knee() {
        curve = fitted.corrected(tests, order).map_err(|error| error.to_string())?;
    }
    let estimate = |parameter: usize| Estimate {
        value: curve.0[parameter],
        standard_error: errors[parameter],
    };
    if fitted.has_knee() {
        curve.doubt(&points, warnings);
    }
    let knee = curve.has_knee();
    Ok(StiffeningFit {
        order,
        modulus_kpa: estimate(0),
        knee_shear: knee.then(|| estimate(1)),
        stiffening: knee.then(|| estimate(2)),
        rms: (fitted.square(&points) / points.len() as f64).sqrt(),
        memory,
        points,
    })
}

#[cfg(test)]
mod tests;
