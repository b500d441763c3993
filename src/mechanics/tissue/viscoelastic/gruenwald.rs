//! Gruenwald-Letnikov rule for equal steps: powers of the backward difference quotient.

use super::full::add_weighted;
use super::history::{History, HistoryError};
use super::kernel::of_jump;

/// Integral of order nu, or for negative nu derivative of order -nu, of the function minus its initial value, plus that
/// of the initial value exactly. (Otherwise a jump at the start would cost accuracy at all times.)
///
/// `h^nu * sum over j of (nu)_j / j! * F_(n-j)`, with the rising factorial: I. Podlubny, "Fractional Differential
/// Equations", 1999.
#[derive(Clone, Debug)]
pub(super) struct GruenwaldLetnikov {
    components: usize,
    /// Exponent nu.
    exponent: f64,
    initial: Vec<f64>,
    /// Values after each step minus the initial one.
    rises: Vec<f64>,
    /// Common length of all steps, s; `None` before the first.
    step_s: Option<f64>,
    steps: usize,
    /// `(nu)_j / j!` for j from 1, times `h^nu` for the step `weights_step_s`.
    weights: Vec<f64>,
    weights_step_s: f64,
}

/// Largest relative difference of steps treated as equal, as for times in decimals.
const EQUAL: f64 = 1e-9;

impl GruenwaldLetnikov {
    pub(super) fn new(exponent: f64, initial: &[f64]) -> Self {
        GruenwaldLetnikov {
            components: initial.len(),
            exponent,
            initial: initial.to_vec(),
            rises: Vec::new(),
            step_s: None,
            steps: 0,
            weights: Vec::new(),
            weights_step_s: 0.0,
        }
    }

    /// Returns the common length of all steps.
    fn equal(&self, step_s: f64) -> Result<f64, HistoryError> {
        HistoryError::check_step(step_s)?;
        let expected = self.step_s.unwrap_or(step_s);
        if (step_s - expected).abs() > EQUAL * expected {
            let found = step_s;
            return Err(HistoryError::Uneven { found, expected });
        }
        Ok(expected)
    }

    /// Computes weights for `count` values before the new one.
    fn reach(&mut self, step_s: f64, count: usize) {
        if self.weights_step_s != step_s {
            self.weights.clear();
            self.weights_step_s = step_s;
        }
        let nu = self.exponent;
        let mut weight = self.weights.last().copied().unwrap_or(step_s.powf(nu));
        for j in self.weights.len() + 1..=count {
            weight *= (j as f64 - 1.0 + nu) / j as f64;
            self.weights.push(weight);
        }
    }
}

impl History for GruenwaldLetnikov {
    fn components(&self) -> usize {
        self.components
    }

    fn time_s(&self) -> f64 {
        self.steps as f64 * self.step_s.unwrap_or(0.0)
    }

    fn predict(&mut self, step_s: f64, history: &mut [f64]) -> Result<f64, HistoryError> {
        let step = self.equal(step_s)?;
        HistoryError::check_components(history.len(), self.components)?;
        self.reach(step, self.steps);
        let weight = step.powf(self.exponent);
        let start = of_jump(self.exponent, (self.steps + 1) as f64 * step) - weight;
        for (sum, initial) in history.iter_mut().zip(&self.initial) {
            *sum = start * initial;
        }
        add_weighted::<true>(&self.weights[..self.steps], &self.rises, history);
        Ok(weight)
    }

    fn commit(&mut self, step_s: f64, value: &[f64]) -> Result<(), HistoryError> {
        let step = self.equal(step_s)?;
        HistoryError::check_components(value.len(), self.components)?;
        HistoryError::check_value(value)?;
        self.step_s = Some(step);
        self.steps += 1;
        let rises = value.iter().zip(&self.initial).map(|(value, initial)| value - initial);
        self.rises.extend(rises);
        Ok(())
    }

    fn bytes(&self) -> usize {
        (self.initial.len() + self.rises.len() + self.weights.len()) * size_of::<f64>()
    }

    fn boxed(&self) -> Box<dyn History> {
        Box::new(self.clone())
    }
}
