//! Fractional derivatives built on fractional integrals.

use super::history::{History, HistoryError};
use super::kernel::of_jump;

/// Exact derivative of order k of a piecewise linear function: the integral of order 1 - k of its slopes, constant over
/// each step, plus the contribution of the initial jump (L1 rule).
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    order: f64,
    initial: Vec<f64>,
    newest: Vec<f64>,
    slopes: Vec<f64>,
    /// Integral of order 1 - k of piecewise constant functions.
    inner: Box<dyn History>,
}

impl Slopes {
    /// Creates the derivative from `inner`, the integral of order `1 - order`.
    pub(super) fn new(order: f64, initial: &[f64], inner: Box<dyn History>) -> Self {
        Slopes {
            order,
            initial: initial.to_vec(),
            newest: initial.to_vec(),
            slopes: vec![0.0; initial.len()],
            inner,
        }
    }
}

impl History for Slopes {
    fn components(&self) -> usize {
        self.inner.components()
    }

    fn time_s(&self) -> f64 {
        self.inner.time_s()
    }

    fn predict(&mut self, step_s: f64, history: &mut [f64]) -> Result<f64, HistoryError> {
        let weight = self.inner.predict(step_s, history)? / step_s;
        let jump = of_jump(-self.order, self.inner.time_s() + step_s);
        for ((sum, newest), initial) in history.iter_mut().zip(&self.newest).zip(&self.initial) {
            *sum += jump * initial - weight * newest;
        }
        Ok(weight)
    }

    fn commit(&mut self, step_s: f64, value: &[f64]) -> Result<(), HistoryError> {
        HistoryError::check_step(step_s)?;
        HistoryError::check_components(value.len(), self.newest.len())?;
        HistoryError::check_value(value)?;
        for ((slope, value), newest) in self.slopes.iter_mut().zip(value).zip(&self.newest) {
            *slope = (value - newest) / step_s;
        }
        self.inner.commit(step_s, &self.slopes)?;
        self.newest.copy_from_slice(value);
        Ok(())
    }

    fn bytes(&self) -> usize {
        3 * self.newest.len() * size_of::<f64>() + self.inner.bytes()
    }

    fn boxed(&self) -> Box<dyn History> {
        Box::new(self.clone())
    }
}

/// Derivative as the inverse of an integral: the integrand that yields the function minus its initial value, plus the
/// exact contribution of the initial jump.
#[derive(Clone, Debug)]
pub(super) struct Inverse {
    order: f64,
    initial: Vec<f64>,
    integrand: Vec<f64>,
    /// Integral of the same order.
    inner: Box<dyn History>,
}

impl Inverse {
    /// Creates the derivative from `inner`, the integral of order `order`, started from 0.
    pub(super) fn new(order: f64, initial: &[f64], inner: Box<dyn History>) -> Self {
        Inverse {
            order,
            initial: initial.to_vec(),
            integrand: vec![0.0; initial.len()],
            inner,
        }
    }
}

impl History for Inverse {
    fn components(&self) -> usize {
        self.inner.components()
    }

    fn time_s(&self) -> f64 {
        self.inner.time_s()
    }

    fn predict(&mut self, step_s: f64, history: &mut [f64]) -> Result<f64, HistoryError> {
        let weight = 1.0 / self.inner.predict(step_s, history)?;
        let jump = of_jump(-self.order, self.inner.time_s() + step_s) - weight;
        for (sum, initial) in history.iter_mut().zip(&self.initial) {
            *sum = jump * initial - weight * *sum;
        }
        Ok(weight)
    }

    fn commit(&mut self, step_s: f64, value: &[f64]) -> Result<(), HistoryError> {
        HistoryError::check_components(value.len(), self.initial.len())?;
        HistoryError::check_value(value)?;
        let weight = self.inner.predict(step_s, &mut self.integrand)?;
        for ((integrand, value), initial) in self.integrand.iter_mut().zip(value).zip(&self.initial) {
            *integrand = (value - initial - *integrand) / weight;
        }
        self.inner.commit(step_s, &self.integrand)
    }

    fn bytes(&self) -> usize {
        2 * self.initial.len() * size_of::<f64>() + self.inner.bytes()
    }

    fn boxed(&self) -> Box<dyn History> {
        Box::new(self.clone())
    }
}
