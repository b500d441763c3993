//! Construction of a history from a rule and an operator.

use super::derivative::{Inverse, Slopes};
use super::exponentials::Exponentials;
use super::full::Full;
use super::gruenwald::GruenwaldLetnikov;
use super::history::{History, HistoryError, Operator, Rule};
use super::kernel::Basis;

impl Rule {
    /// Creates a history that starts with this value at time 0, one number per component.
    ///
    /// # Errors
    /// [`HistoryError`] for an order outside 0 to 1, an initial value that is not finite, or an invalid span.
    pub fn start(&self, operator: Operator, initial: &[f64]) -> Result<Box<dyn History>, HistoryError> {
        let order = operator.order();
        if !(0.0..=1.0).contains(&order) {
            return Err(HistoryError::Order { found: order });
        }
        HistoryError::check_value(initial)?;
        let zero = vec![0.0; initial.len()];
        Ok(match (self, operator) {
            (Rule::Rectangle, Operator::Integral(k)) => Box::new(Full::new(Basis::Constant, k, initial)),
            (Rule::Rectangle, Operator::Derivative(k)) => {
                let inner = Full::new(Basis::Constant, k, &zero);
                Box::new(Inverse::new(k, initial, Box::new(inner)))
            }
            (Rule::TimeScaledTrapezoid, Operator::Integral(k)) => Box::new(Full::new(Basis::Mean, k, initial)),
            (Rule::Trapezoid, Operator::Integral(k)) => Box::new(Full::new(Basis::Linear, k, initial)),
            (Rule::Trapezoid | Rule::TimeScaledTrapezoid, Operator::Derivative(k)) => {
                let inner = Full::new(Basis::Constant, 1.0 - k, &zero);
                Box::new(Slopes::new(k, initial, Box::new(inner)))
            }
            (Rule::GruenwaldLetnikov, Operator::Integral(k)) => Box::new(GruenwaldLetnikov::new(k, initial)),
            (Rule::GruenwaldLetnikov, Operator::Derivative(k)) => Box::new(GruenwaldLetnikov::new(-k, initial)),
            (Rule::Exponentials(span), Operator::Integral(k)) => {
                Box::new(Exponentials::new(Basis::Linear, k, *span, initial)?)
            }
            (Rule::Exponentials(span), Operator::Derivative(k)) => {
                let inner = Exponentials::new(Basis::Constant, 1.0 - k, *span, &zero)?;
                Box::new(Slopes::new(k, initial, Box::new(inner)))
            }
        })
    }
}
