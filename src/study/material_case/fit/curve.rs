//! Modulus against strain, fitted to creep.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::{CreepTest, moduli};
use insonify_mechanics::tissue::viscoelastic::HistoryError;
use insonify_mechanics::tissue::viscoelastic::point::{Control, Knee, Loading, Method, Point, Rheology, Structure};

/// Number of tried knees between 0 and the largest strain.
const TRIED_KNEES: usize = 400;
/// Ratio of the measured strains on both sides of a knee above which a warning is given.
const MAX_GAP_RATIO: f64 = 1.3;
/// Stiffening counts if it explains this many times the variance of its two parameters in noise.
const MIN_VARIANCE_RATIO: f64 = 10.0;
/// Stiffening counts if moduli deviate from a constant one by more than this (root mean square, relative).
const MIN_DEVIATION: f64 = 1e-3;
/// Most iterations, of a fit and of its correction for `rate`.
const ROUNDS: usize = 20;
/// Relative change that ends the iterations.
const SETTLED: f64 = 1e-6;
/// Steps between two measured times in simulated creep.
const SUBSTEPS: usize = 4;
/// Most halvings of a Gauss-Newton step.
const HALVINGS: i32 = 12;
/// Most Newton iterations for a strain.
const MAX_NEWTON: usize = 60;

/// Modulus against strain: G0 (kPa s^k), gamma0 and a; gamma0 infinite and a 0 without a knee.
#[derive(Clone, Copy, Debug)]
pub(super) struct StiffeningCurve(pub [f64; 3]);

impl StiffeningCurve {
    pub(super) fn has_knee(&self) -> bool {
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
    pub(super) fn square(&self, points: &[[f64; 2]]) -> f64 {
        points
            .iter()
            .map(|[strain, g]| (self.at(*strain) / g - 1.0).powi(2))
            .sum()
    }

    /// Best curve with this knee: G0 and G0 a follow by linear least squares.
    fn with_knee(points: &[[f64; 2]], knee: f64) -> StiffeningCurve {
        let (mut matrix, mut right_side) = (Matrix2::zeros(), Vector2::zeros());
        for [strain, g] in points {
            let row = Vector2::new(1.0, (strain - knee).max(0.0).powi(2)) / *g;
            matrix += row * row.transpose();
            right_side += row;
        }
        match matrix.try_inverse().map(|inverse| inverse * right_side) {
            Some(solution) if solution[0] > 0.0 && solution[1] > 0.0 => {
                StiffeningCurve([solution[0], knee, solution[1] / solution[0]])
            }
            _ => StiffeningCurve([right_side[0] / matrix[(0, 0)], f64::INFINITY, 0.0]),
        }
    }

    pub(super) fn fitted(points: &[[f64; 2]]) -> StiffeningCurve {
        let largest = points.iter().map(|point| point[0]).fold(0.0, f64::max);
        let step = largest / TRIED_KNEES as f64;
        let square = |knee: f64| StiffeningCurve::with_knee(points, knee).square(points);
        let knees = (0..TRIED_KNEES).map(|knee| step * knee as f64);
        let start = knees.min_by(|a, b| square(*a).total_cmp(&square(*b))).unwrap_or(0.0);
        // The square has several minima: tried knees find the deepest, a golden-section search its bottom.
        let (mut low, mut high) = ((start - step).max(0.0), start + step);
        let golden = 0.5 * (5.0f64.sqrt() - 1.0);
        while high - low > 1e-9 * largest {
            let [a, b] = [high - golden * (high - low), low + golden * (high - low)];
            if square(a) < square(b) {
                high = b;
            } else {
                low = a;
            }
        }
        let (flat, curve) = (
            StiffeningCurve::with_knee(points, f64::INFINITY),
            StiffeningCurve::with_knee(points, 0.5 * (low + high)),
        );
        let (flat_square, curved) = (flat.square(points), curve.square(points));
        let count = points.len() as f64;
        let noise = curved / (count - 3.0).max(1.0);
        let counts =
            flat_square - curved > 2.0 * MIN_VARIANCE_RATIO * noise && (flat_square / count).sqrt() > MIN_DEVIATION;
        if counts { curve.refined(points) } else { flat }
    }

    /// Best curve in strain, by Gauss-Newton steps from this one: a measured strain that errs falsifies both
    /// coordinates of its modulus, and a fit of moduli alone would find too little stiffening.
    fn refined(self, points: &[[f64; 2]]) -> StiffeningCurve {
        let (mut best, mut log_square) = (self, self.log_square(points));
        for _ in 0..ROUNDS {
            let (matrix, right_side) = normal(&best, points);
            let Some(step) = matrix.try_inverse().map(|inverse| inverse * right_side) else {
                break;
            };
            let tried = (0..HALVINGS).map(|halving| {
                let share = 0.5f64.powi(halving);
                StiffeningCurve([0, 1, 2].map(|axis| best.0[axis] - share * step[axis]))
            });
            let mut valid = tried.filter(|curve| curve.0[0] > 0.0 && curve.0[1] >= 0.0 && curve.0[2] > 0.0);
            let Some((next, square)) = valid.find_map(|curve| {
                let square = curve.log_square(points);
                (square < log_square).then_some((curve, square))
            }) else {
                break;
            };
            let gained = log_square - square;
            (best, log_square) = (next, square);
            if gained <= SETTLED * log_square {
                break;
            }
        }
        best
    }

    /// Strain at which the modulus times the strain is `product`.
    fn strain(&self, product: f64) -> f64 {
        let (knee, g0) = (self.knee(), self.0[0]);
        // From the strain without stiffening, Newton's iteration descends without overshoot: the product is convex.
        let mut strain = product / g0;
        for _ in 0..MAX_NEWTON {
            let factor = knee.factor(strain);
            let step = (g0 * factor * strain - product) / (g0 * (factor + knee.slope(strain) * strain));
            strain -= step;
            if step.abs() <= f64::EPSILON * strain {
                break;
            }
        }
        strain
    }

    /// Sum of squared logarithms of measured over expected strains.
    fn log_square(&self, points: &[[f64; 2]]) -> f64 {
        let square = |[strain, g]: &[f64; 2]| (strain / self.strain(strain * g)).ln().powi(2);
        points.iter().map(square).sum()
    }

    /// Standard errors of the three parameters.
    pub(super) fn errors(&self, points: &[[f64; 2]]) -> [f64; 3] {
        let g0 = self.0[0];
        let count = points.len() as f64;
        if !self.has_knee() {
            return [g0 * (self.square(points) / (count - 1.0) / count).sqrt(), 0.0, 0.0];
        }
        let noise = self.log_square(points) / (count - 3.0).max(1.0);
        match normal(self, points).0.try_inverse() {
            Some(inverse) => [0, 1, 2].map(|parameter| (noise * inverse[(parameter, parameter)]).max(0.0).sqrt()),
            None => [f64::INFINITY; 3],
        }
    }

    /// Parameters with which simulated creep under the `rate` law, evaluated by equation 2, shows this curve.
    pub(super) fn corrected(self, tests: &[CreepTest], order: f64) -> Result<StiffeningCurve, HistoryError> {
        let mut trial = self;
        for _ in 0..ROUNDS {
            let simulated: Result<Vec<CreepTest>, HistoryError> =
                tests.iter().map(|test| trial.creep(test, order)).collect();
            let refitted = StiffeningCurve::fitted(&moduli(&simulated?, order));
            if !refitted.has_knee() {
                break;
            }
            let mut change = 0.0f64;
            for parameter in 0..3 {
                let lack = self.0[parameter] - refitted.0[parameter];
                let next = (trial.0[parameter] + lack).max(0.1 * trial.0[parameter]);
                change = change.max((next - trial.0[parameter]).abs() / self.0[parameter].max(f64::MIN_POSITIVE));
                trial.0[parameter] = next;
            }
            if change < SETTLED {
                break;
            }
        }
        Ok(trial)
    }

    /// Creep at the stress and times of a test under the `rate` law.
    fn creep(&self, test: &CreepTest, order: f64) -> Result<CreepTest, HistoryError> {
        let point = Point {
            body: Rheology::SpringPot {
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
        let rows = test
            .rows
            .iter()
            .zip(&strain[1..])
            .map(|(row, strain)| [row[0], *strain]);
        Ok(CreepTest {
            rows: rows.collect(),
            ..*test
        })
    }

    /// Warns of a knee outside the measured strains, or in a gap between them.
    pub(super) fn doubt(&self, points: &[[f64; 2]], warnings: &mut Vec<String>) {
        let knee = self.0[1];
        let strains = points.iter().map(|point| point[0]);
        let below = strains.clone().filter(|strain| *strain < knee).fold(0.0, f64::max);
        let above = strains.filter(|strain| *strain >= knee).fold(f64::INFINITY, f64::min);
        if below == 0.0 {
            warnings.push(format!(
                "no strain below the knee of {knee:.3} was measured: the modulus is extrapolated from strains from {above:.3} on"
            ));
        } else if above.is_infinite() {
            warnings.push(format!(
                "no strain above the knee of {knee:.3} was measured: the stiffening is extrapolated from strains up to {below:.3}"
            ));
        } else if above > MAX_GAP_RATIO * below {
            warnings.push(format!(
                "the knee of {knee:.3} lies in a gap: no strain was measured between {below:.3} and {above:.3}"
            ));
        }
    }
}

/// Normal equations of the logarithms of strains about a curve: matrix, and right-hand side.
fn normal(curve: &StiffeningCurve, points: &[[f64; 2]]) -> (Matrix3<f64>, Vector3<f64>) {
    let ([g0, _, a], knee) = (curve.0, curve.knee());
    let (mut matrix, mut right_side) = (Matrix3::zeros(), Vector3::zeros());
    for [strain, g] in points {
        let expected = curve.strain(strain * g);
        let above = (expected - knee.strain).max(0.0);
        let factor = knee.factor(expected);
        let row = Vector3::new(factor, -2.0 * g0 * a * above, g0 * above * above);
        let row = row / (g0 * (factor + knee.slope(expected) * expected));
        matrix += row * row.transpose();
        right_side += row * (strain / expected).ln();
    }
    (matrix, right_side)
}
