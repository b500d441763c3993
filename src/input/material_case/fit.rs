//! Parameters of tissue from measurements of a rheometer, after Kobayashi et al. 2010 (section 3.1): order and modulus of a
//! spring-pot from storage and loss moduli (figure 7), modulus, knee and stiffening from creep (equations 2 and 3, figure 8).

mod measured;
mod report;

pub use measured::{Creep, Measured, Modulus};

use libm::tgamma;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use serde::Serialize;

use crate::base::report::statistics::mean;
use crate::mechanics::tissue::viscoelastic::HistoryError;
use crate::mechanics::tissue::viscoelastic::point::{Body, Control, Knee, Loading, Method, Point, Structure};

/// Least number of frequencies for two unknowns, and of strains for three.
const FEWEST: [usize; 2] = [3, 4];
/// Number of tried knees between 0 and the largest strain.
const KNEES: usize = 400;
/// Relative deviation of the loss tangent from that of a spring-pot above which a warning is given.
const TANGENT: f64 = 0.1;
/// Ratio of the measured strains on both sides of a knee above which a warning is given.
const GAP: f64 = 1.3;
/// Stiffening counts if it explains this many times the variance of its two parameters in noise, and more than this relative
/// deviation from a constant modulus (root mean square).
const EXPLAINED: [f64; 2] = [10.0, 1e-3];
/// Iterations for `rate`, the change that ends them, and steps between two measured times.
const ROUNDS: usize = 20;
const SETTLED: f64 = 1e-6;
const SUBSTEPS: usize = 4;

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
pub struct Dynamic {
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
pub struct Stiffening {
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
pub struct Fit {
    /// From storage and loss moduli.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dynamic: Option<Dynamic>,
    /// From creep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub creep: Option<Stiffening>,
    /// Doubts about the result, for the user.
    pub warnings: Vec<String>,
}

impl Fit {
    /// Fits measurements. Creep is evaluated with the given order, else with that from the moduli, else with that of the strain in the test of
    /// the least stress, `gamma ~ t^k`. Equation 2 assumes that the stiffness of now divides the whole past (`load-integral`); for `rate` the
    /// parameters are corrected until simulated creep, evaluated in the same way, gives what the measurements give.
    ///
    /// # Errors
    /// The reason, for the user, if the measurements do not determine the parameters.
    pub fn new(measured: &Measured, order: Option<f64>, memory: Structure) -> Result<Fit, String> {
        let mut fit = Fit::default();
        if !measured.moduli.is_empty() {
            fit.dynamic = Some(dynamic(&measured.moduli, &mut fit.warnings)?);
        }
        if !measured.creep.is_empty() {
            let order = match order.or(fit.dynamic.as_ref().map(|dynamic| dynamic.order.value)) {
                Some(order) => order,
                None => of_creep(&measured.creep)?,
            };
            fit.creep = Some(creep(&measured.creep, order, memory, &mut fit.warnings)?);
        }
        Ok(fit)
    }
}

fn dynamic(points: &[Modulus], warnings: &mut Vec<String>) -> Result<Dynamic, String> {
    let mut frequencies: Vec<f64> = points.iter().map(|point| point.frequency_rad_s).collect();
    frequencies.sort_by(f64::total_cmp);
    frequencies.dedup();
    if frequencies.len() < FEWEST[0] {
        let (found, least) = (frequencies.len(), FEWEST[0]);
        return Err(format!("found moduli at {found} frequencies; expected at least {least}"));
    }
    let of = |of: fn(&Modulus) -> f64| points.iter().map(|point| of(point).ln()).collect::<Vec<f64>>();
    let (x, storage, loss) = (
        of(|it| it.frequency_rad_s),
        of(|it| it.storage_kpa),
        of(|it| it.loss_kpa),
    );
    let complex = of(|it| it.storage_kpa.hypot(it.loss_kpa));
    let middle = mean(&x);
    let spread: f64 = x.iter().map(|x| (x - middle).powi(2)).sum();
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
    let of_order = scatter / (2.0 * spread).sqrt();
    let modulus_kpa = (mean(&complex) - k * middle).exp();
    let (loss_tangent, expected) = ((mean(&loss) - mean(&storage)).exp(), (0.5 * std::f64::consts::PI * k).tan());
    if (loss_tangent / expected - 1.0).abs() > TANGENT {
        warnings.push(format!(
            "the loss tangent G''/G' is {loss_tangent:.3}, that of a spring-pot of order {k:.3} {expected:.3}: no spring-pot fits both slope and \
             loss in this range of frequencies"
        ));
    }
    Ok(Dynamic {
        order: Estimate {
            value: k,
            standard_error: of_order,
        },
        modulus_kpa: Estimate {
            value: modulus_kpa,
            standard_error: modulus_kpa * (scatter * scatter / count + (middle * of_order).powi(2)).sqrt(),
        },
        slopes,
        loss_tangent,
        spring_pot_loss_tangent: expected,
        points: points.to_vec(),
    })
}

/// Order from the slope of strain against time, on logarithmic scales, in the test of the least stress.
fn of_creep(tests: &[Creep]) -> Result<f64, String> {
    let least = tests.iter().min_by(|a, b| a.stress_kpa.total_cmp(&b.stress_kpa));
    let rows: Vec<[f64; 2]> = least.iter().flat_map(|test| test.rows.iter().copied()).collect();
    let (x, y): (Vec<f64>, Vec<f64>) = rows.iter().map(|[time, strain]| (time.ln(), strain.ln())).unzip();
    let expected = "expected `--order`, a file of moduli, or at least 3 times in that test at which the strain rises with a power above 0 and below 1";
    if rows.len() < FEWEST[0] {
        return Err(format!(
            "the order cannot be found from {} times in the test of the least stress; {expected}",
            rows.len()
        ));
    }
    let order = crate::base::report::statistics::slope(&x, &y);
    match order > 0.0 && order < 1.0 {
        true => Ok(order),
        false => Err(format!("the strain in the test of the least stress grows as time to the power {order:.3}; {expected}")),
    }
}

/// Shear strain and modulus by equation 2, `G = tau t^k / (gamma Gamma(1 + k))`.
fn moduli(tests: &[Creep], order: f64) -> Vec<[f64; 2]> {
    let scale = 1.0 / tgamma(1.0 + order);
    let of = |test: &Creep| {
        let stress = test.stress_kpa;
        let one = move |[time, strain]: &[f64; 2]| [*strain, stress * scale * time.powf(order) / strain];
        test.rows.iter().map(one).collect::<Vec<_>>()
    };
    tests.iter().flat_map(of).collect()
}

fn creep(tests: &[Creep], order: f64, memory: Structure, warnings: &mut Vec<String>) -> Result<Stiffening, String> {
    let points = moduli(tests, order);
    if points.len() < FEWEST[1] {
        let (found, least) = (points.len(), FEWEST[1]);
        return Err(format!("found {found} strains; expected at least {least}"));
    }
    let seen = Curve::fitted(&points);
    let errors = seen.errors(&points);
    let mut curve = seen;
    if memory == Structure::Rate && curve.has_knee() {
        curve = seen.corrected(tests, order).map_err(|error| error.to_string())?;
    }
    let estimate = |at: usize| Estimate {
        value: curve.0[at],
        standard_error: errors[at],
    };
    if seen.has_knee() {
        curve.doubt(&points, warnings);
    }
    let knee = curve.has_knee();
    Ok(Stiffening {
        order,
        modulus_kpa: estimate(0),
        knee_shear: knee.then(|| estimate(1)),
        stiffening: knee.then(|| estimate(2)),
        rms: (seen.square(&points) / points.len() as f64).sqrt(),
        memory,
        points,
    })
}

/// Modulus against strain: G0 (kPa s^k), gamma0 and a; gamma0 infinite and a 0 without a knee.
#[derive(Clone, Copy, Debug)]
struct Curve([f64; 3]);

impl Curve {
    fn has_knee(&self) -> bool {
        self.0[1].is_finite()
    }

    fn knee(&self) -> Knee {
        let [_, strain, stiffening] = self.0;
        Knee { strain, stiffening }
    }

    fn at(&self, strain: f64) -> f64 {
        self.0[0] * self.knee().factor(strain)
    }

    /// Sum of squared deviations of measured moduli, relative to each.
    fn square(&self, points: &[[f64; 2]]) -> f64 {
        points.iter().map(|[strain, g]| (self.at(*strain) / g - 1.0).powi(2)).sum()
    }

    /// Best curve with this knee: G0 and G0 a follow by linear least squares.
    fn with_knee(points: &[[f64; 2]], knee: f64) -> Curve {
        let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for [strain, g] in points {
            let row = Vector2::new(1.0, (strain - knee).max(0.0).powi(2)) / *g;
            matrix += row * row.transpose();
            right += row;
        }
        match matrix.try_inverse().map(|inverse| inverse * right) {
            Some(found) if found[0] > 0.0 && found[1] > 0.0 => Curve([found[0], knee, found[1] / found[0]]),
            _ => Curve([right[0] / matrix[(0, 0)], f64::INFINITY, 0.0]),
        }
    }

    fn fitted(points: &[[f64; 2]]) -> Curve {
        let largest = points.iter().map(|point| point[0]).fold(0.0, f64::max);
        let step = largest / KNEES as f64;
        let left = |knee: f64| Curve::with_knee(points, knee).square(points);
        let knees = (0..KNEES).map(|at| step * at as f64);
        let start = knees.min_by(|a, b| left(*a).total_cmp(&left(*b))).unwrap_or(0.0);
        // Golden-section search.
        let (mut low, mut high) = ((start - step).max(0.0), start + step);
        let golden = 0.5 * (5.0f64.sqrt() - 1.0);
        while high - low > 1e-9 * largest {
            let [a, b] = [high - golden * (high - low), low + golden * (high - low)];
            if left(a) < left(b) {
                high = b;
            } else {
                low = a;
            }
        }
        let (flat, curve) = (
            Curve::with_knee(points, f64::INFINITY),
            Curve::with_knee(points, 0.5 * (low + high)),
        );
        let (without, with) = (flat.square(points), curve.square(points));
        let count = points.len() as f64;
        let noise = with / (count - 3.0).max(1.0);
        let counts = without - with > 2.0 * EXPLAINED[0] * noise && (without / count).sqrt() > EXPLAINED[1];
        if counts { curve } else { flat }
    }

    /// Standard errors of the three parameters.
    fn errors(&self, points: &[[f64; 2]]) -> [f64; 3] {
        let [g0, knee, a] = self.0;
        let count = points.len() as f64;
        if !self.has_knee() {
            return [g0 * (self.square(points) / (count - 1.0) / count).sqrt(), 0.0, 0.0];
        }
        let mut matrix = Matrix3::zeros();
        for [strain, g] in points {
            let above = (strain - knee).max(0.0);
            let row = Vector3::new(1.0 + a * above * above, -2.0 * g0 * a * above, g0 * above * above) / *g;
            matrix += row * row.transpose();
        }
        let noise = self.square(points) / (count - 3.0).max(1.0);
        match matrix.try_inverse() {
            Some(inverse) => [0, 1, 2].map(|at| (noise * inverse[(at, at)]).max(0.0).sqrt()),
            None => [f64::INFINITY; 3],
        }
    }

    /// Parameters with which simulated creep under the `rate` law, evaluated by equation 2, shows this curve.
    fn corrected(self, tests: &[Creep], order: f64) -> Result<Curve, HistoryError> {
        let mut trial = self;
        for _ in 0..ROUNDS {
            let simulated: Result<Vec<Creep>, HistoryError> = tests.iter().map(|test| trial.creep(test, order)).collect();
            let shown = Curve::fitted(&moduli(&simulated?, order));
            if !shown.has_knee() {
                break;
            }
            let mut change = 0.0f64;
            for at in 0..3 {
                let off = self.0[at] - shown.0[at];
                let next = (trial.0[at] + off).max(0.1 * trial.0[at]);
                change = change.max((next - trial.0[at]).abs() / self.0[at].max(f64::MIN_POSITIVE));
                trial.0[at] = next;
            }
            if change < SETTLED {
                break;
            }
        }
        Ok(trial)
    }

    /// Creep at the stress and times of a test under the `rate` law.
    fn creep(&self, test: &Creep, order: f64) -> Result<Creep, HistoryError> {
        let point = Point {
            body: Body::SpringPot {
                order,
                modulus_kpa: self.0[0],
            },
            knee: self.knee(),
            structure: Structure::Rate,
        };
        let loading = Loading {
            control: Control::Stress,
            time_s: std::iter::once(0.0).chain(test.rows.iter().map(|row| row[0])).collect(),
            value: vec![test.stress_kpa; test.rows.len() + 1],
        };
        let strain = point.respond_in(&loading, Method::Exponentials, SUBSTEPS)?.strain;
        let rows = test.rows.iter().zip(&strain[1..]).map(|(row, strain)| [row[0], *strain]);
        Ok(Creep {
            rows: rows.collect(),
            ..*test
        })
    }

    /// Warns of a knee outside the measured strains, or in a gap between them.
    fn doubt(&self, points: &[[f64; 2]], warnings: &mut Vec<String>) {
        let knee = self.0[1];
        let strains = points.iter().map(|point| point[0]);
        let below = strains.clone().filter(|strain| *strain < knee).fold(0.0, f64::max);
        let above = strains.filter(|strain| *strain >= knee).fold(f64::INFINITY, f64::min);
        if below == 0.0 {
            warnings.push(format!(
                "no strain below the knee of {knee:.3} was measured: the modulus is extrapolated from strains from {above:.3} on"
            ));
        } else if above > GAP * below {
            warnings.push(format!(
                "the knee of {knee:.3} lies in a gap: no strain was measured between {below:.3} and {above:.3}"
            ));
        }
    }
}

#[cfg(test)]
mod tests;
