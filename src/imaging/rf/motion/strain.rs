//! Strain and shear about a window, and their effect on the estimate of its motion.

use nalgebra::{Matrix6, Vector6};

/// Neighbours on either side, in lines and windows, over which the motion is fitted.
pub(super) const FIT: [isize; 2] = [5, 3];
/// Fewest windows of a fit, half of all: fewer may lie to one side.
const FEWEST: usize = 38;

/// Derivatives of the axial motion (samples) along a line (samples) and across lines: two first, and three second ones
/// (along, mixed, across).
pub(super) type Bend = [f64; 5];

/// Variance of the energy of a beam across lines, lines squared, from the correlations of neighbouring lines and of the
/// next but one: those of a Gaussian beam are exp(-n^2 / 8 v), and white noise lowers both alike.
pub(super) fn beam_variance(values: &[f32], samples: usize) -> f64 {
    let correlation = |apart: usize| {
        let later = &values[(apart * samples).min(values.len())..];
        let products = values.iter().zip(later).map(|(a, b)| f64::from(*a) * f64::from(*b));
        products.sum::<f64>() / later.len() as f64
    };
    let ratio = correlation(1) / correlation(2);
    // Beams wider than the fit are beyond its reach.
    let widest = (FIT[0] * FIT[0]) as f64;
    if ratio > 1.0 {
        (3.0 / (8.0 * ratio.ln())).min(widest)
    } else {
        0.0
    }
}

/// Terms of a fit at a distance in windows and lines: a constant, and those of the derivatives.
fn terms(along: isize, aside: isize) -> Vector6<f64> {
    let (x, y) = (along as f64, aside as f64);
    Vector6::new(1.0, x, y, 0.5 * x * x, x * y, 0.5 * y * y)
}

/// Neighbours of a fit, in lines and windows from its middle.
pub(super) fn fitted() -> impl Iterator<Item = (isize, isize)> {
    (-FIT[0]..=FIT[0]).flat_map(|aside| (-FIT[1]..=FIT[1]).map(move |along| (aside, along)))
}

/// Least-squares fit of motion by its derivatives.
pub(super) struct Fit {
    normal: Matrix6<f64>,
    right: Vector6<f64>,
    count: usize,
}

impl Fit {
    pub(super) fn new() -> Self {
        Self {
            normal: Matrix6::zeros(),
            right: Vector6::zeros(),
            count: 0,
        }
    }

    /// Adds the motion (samples) of a neighbour.
    pub(super) fn add(&mut self, (aside, along): (isize, isize), moved: f64) {
        let terms = terms(along, aside);
        self.normal += terms * terms.transpose();
        self.right += terms * moved;
        self.count += 1;
    }

    /// The derivatives, for windows `spacing` samples apart; `None` for few neighbours, and where they do not follow
    /// from these.
    pub(super) fn bend(&self, spacing: f64) -> Option<Bend> {
        let factor = (self.count >= FEWEST).then(|| self.normal.cholesky()).flatten()?;
        Some(derivatives(factor.solve(&self.right), spacing))
    }

    /// Share of each neighbour in the derivatives where all are there.
    pub(super) fn shares(spacing: f64) -> Vec<Bend> {
        let mut all = Self::new();
        fitted().for_each(|neighbour| all.add(neighbour, 0.0));
        let Some(factor) = all.normal.cholesky() else {
            return Vec::new();
        };
        let share = |(aside, along)| derivatives(factor.solve(&terms(along, aside)), spacing);
        fitted().map(share).collect()
    }
}

fn derivatives(fit: Vector6<f64>, spacing: f64) -> Bend {
    let [_, z, x, zz, zx, xx] = fit.into();
    [z / spacing, x, zz / (spacing * spacing), zx / spacing, xx]
}

/// Motion beside the centre of a window, on the average over its echoes.
pub(super) fn beside(bend: &Bend, moments: &[f64; 5]) -> f64 {
    bend.iter()
        .zip(moments)
        .map(|(derivative, moment)| derivative * moment)
        .sum()
}
