//! Fractional integral with the kernel as a sum of decaying exponentials. Each stores one number per component, so a
//! step costs the same for any length of the history.

mod quadrature;

use super::history::{History, HistoryError, Span};
use super::kernel::{Basis, Moments};
use insonify_base::simd::{Kernel, vectorised};
use quadrature::Quadrature;

/// Fractional integral with the newest step exact and a sum of exponentials for all earlier ones.
#[derive(Clone, Debug)]
pub(super) struct Exponentials {
    basis: Basis,
    moments: Moments,
    span: Span,
    /// Rates of the exponentials, 1/s.
    rates: Vec<f64>,
    /// Weights of the exponentials in the kernel.
    weights: Vec<f64>,
    time_s: f64,
    /// Newest value.
    newest: Vec<f64>,
    /// Integral of exponential times function, for each exponential and component.
    modes: Vec<f64>,
    step: Step,
}

/// Effect of a step of some length on each exponential.
#[derive(Clone, Debug)]
struct Step {
    step_s: f64,
    /// Decay of each mode over the step.
    decays: Vec<f64>,
    /// Decay of each mode times its weight.
    weighted: Vec<f64>,
    /// Contribution of the value at the start of the step to each mode.
    starts: Vec<f64>,
    /// Contribution of the value at the end of the step to each mode.
    ends: Vec<f64>,
    /// Weights of the values at both ends of the step itself.
    step_weights: [f64; 2],
}

/// Relative rounding by which a history may exceed its span.
const SLACK: f64 = 1e-9;

impl Exponentials {
    /// # Errors
    /// [`HistoryError::Span`] for an invalid span.
    pub(super) fn new(basis: Basis, order: f64, span: Span, initial: &[f64]) -> Result<Self, HistoryError> {
        let Quadrature { rates, weights } = Quadrature::new(order, span)?;
        let none = || vec![0.0; rates.len()];
        Ok(Exponentials {
            basis,
            moments: Moments::new(basis, order),
            span,
            time_s: 0.0,
            newest: initial.to_vec(),
            modes: vec![0.0; rates.len() * initial.len()],
            step: Step {
                step_s: 0.0,
                decays: none(),
                weighted: none(),
                starts: none(),
                ends: none(),
                step_weights: [0.0; 2],
            },
            rates,
            weights,
        })
    }

    fn check(&self, step_s: f64, components: usize) -> Result<(), HistoryError> {
        HistoryError::check_step(step_s)?;
        HistoryError::check_components(components, self.newest.len())?;
        if step_s < self.span.shortest_s * (1.0 - SLACK) {
            let (found, shortest) = (step_s, self.span.shortest_s);
            return Err(HistoryError::Short { found, shortest });
        }
        let end_s = self.time_s + step_s;
        if end_s > self.span.longest_s * (1.0 + SLACK) {
            let longest = self.span.longest_s;
            return Err(HistoryError::Long { found: end_s, longest });
        }
        Ok(())
    }

    /// Sets `step` to a step of this length.
    fn prepare(&mut self, step_s: f64) {
        let step = &mut self.step;
        if step.step_s == step_s {
            return;
        }
        step.step_s = step_s;
        let step_weights = self.moments.weights(0.0, step_s);
        step.step_weights = [step_weights.start, step_weights.end];
        for (index, rate) in self.rates.iter().enumerate() {
            let z = rate * step_s;
            let decay = (-z).exp();
            step.decays[index] = decay;
            step.weighted[index] = decay * self.weights[index];
            let [start, end] = match self.basis {
                Basis::Constant => [0.0, mean(z)],
                Basis::Mean => [0.5 * mean(z); 2],
                Basis::Linear => ends(z, decay),
            };
            step.starts[index] = start * step_s;
            step.ends[index] = end * step_s;
        }
    }
}

/// Returns `(1 - e^-z) / z`.
fn mean(z: f64) -> f64 {
    if z == 0.0 { 1.0 } else { -(-z).exp_m1() / z }
}

/// Returns the integrals over a step, relative to its length, of the exponential `e^-z(1-q)` times 1 - q and times q, q
/// from 0 to 1; `decay` is `e^-z`.
fn ends(z: f64, decay: f64) -> [f64; 2] {
    let mean = mean(z);
    if z > 0.5 {
        return [(mean - decay) / z, (1.0 - mean) / z];
    }
    let (mut end, mut term, mut m) = (0.0, 0.5, 0.0);
    while f64::abs(term) > 0.1 * f64::EPSILON {
        end += term;
        term *= -z / (m + 3.0);
        m += 1.0;
    }
    [mean - end, end]
}

/// Advances all modes by a step: decay, and contributions of both ends.
struct Advance<'a> {
    step: &'a Step,
    newest: &'a [f64],
    value: &'a [f64],
    modes: &'a mut [f64],
}

impl Kernel for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Step {
            decays, starts, ends, ..
        } = self.step;
        if let ([newest], [value]) = (self.newest, self.value) {
            let rates = decays.iter().zip(starts).zip(ends);
            for (mode, ((decay, start), end)) in self.modes.iter_mut().zip(rates) {
                *mode = decay * *mode + (start * newest + end * value);
            }
            return;
        }
        let components = self.newest.len().max(1);
        for (index, modes) in self.modes.chunks_exact_mut(components).enumerate() {
            let (decay, start, end) = (decays[index], starts[index], ends[index]);
            for ((mode, newest), value) in modes.iter_mut().zip(self.newest).zip(self.value) {
                *mode = decay * *mode + (start * newest + end * value);
            }
        }
    }
}

/// Sums all modes at the end of a step.
struct Recall<'a> {
    weighted: &'a [f64],
    modes: &'a [f64],
    sums: &'a mut [f64],
}

const LANES: usize = 8;

impl Kernel for Recall<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        if let [sum] = self.sums {
            let mut lanes = [0.0; LANES];
            let (weights, modes) = (self.weighted.chunks_exact(LANES), self.modes.chunks_exact(LANES));
            let tail = weights.remainder().iter().zip(modes.remainder());
            let tail_sum: f64 = tail.map(|(weight, mode)| weight * mode).sum();
            for (weight, mode) in weights.zip(modes) {
                for lane in 0..LANES {
                    lanes[lane] += weight[lane] * mode[lane];
                }
            }
            *sum += lanes.iter().sum::<f64>() + tail_sum;
            return;
        }
        let modes = self.modes.chunks_exact(self.sums.len().max(1));
        for (weight, modes) in self.weighted.iter().zip(modes) {
            for (sum, mode) in self.sums.iter_mut().zip(modes) {
                *sum += weight * mode;
            }
        }
    }
}

impl History for Exponentials {
    fn components(&self) -> usize {
        self.newest.len()
    }

    fn time_s(&self) -> f64 {
        self.time_s
    }

    fn predict(&mut self, step_s: f64, history: &mut [f64]) -> Result<f64, HistoryError> {
        self.check(step_s, history.len())?;
        self.prepare(step_s);
        let [start, end] = self.step.step_weights;
        for (sum, newest) in history.iter_mut().zip(&self.newest) {
            *sum = start * newest;
        }
        vectorised(Recall {
            weighted: &self.step.weighted,
            modes: &self.modes,
            sums: history,
        });
        Ok(end)
    }

    fn commit(&mut self, step_s: f64, value: &[f64]) -> Result<(), HistoryError> {
        self.check(step_s, value.len())?;
        HistoryError::check_value(value)?;
        self.prepare(step_s);
        vectorised(Advance {
            step: &self.step,
            newest: &self.newest,
            value,
            modes: &mut self.modes,
        });
        self.newest.copy_from_slice(value);
        self.time_s += step_s;
        Ok(())
    }

    fn remembered(&self) -> Vec<f64> {
        [&[self.time_s][..], &self.newest, &self.modes].concat()
    }

    fn recall(&mut self, remembered: &[f64]) -> Result<(), HistoryError> {
        let found = remembered.len();
        let fits = found == 1 + self.newest.len() + self.modes.len();
        if !fits || remembered.iter().any(|x| !x.is_finite()) {
            return Err(HistoryError::Remembered { found });
        }
        let (newest, modes) = remembered[1..].split_at(self.newest.len());
        self.time_s = remembered[0];
        self.newest.copy_from_slice(newest);
        self.modes.copy_from_slice(modes);
        Ok(())
    }

    fn bytes(&self) -> usize {
        // Rates, weights and step data: six numbers per exponential.
        (6 * self.rates.len() + self.modes.len() + self.newest.len()) * size_of::<f64>()
    }

    fn boxed(&self) -> Box<dyn History> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
