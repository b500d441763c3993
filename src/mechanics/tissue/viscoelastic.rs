//! Tissue with fading memory: fractional integrals and derivatives of a history, step by step.
//!
//! A spring-pot obeys `G d^k gamma / dt^k = tau`, with `k` from 0 (a spring) to 1 (a dashpot); porcine liver has k of
//! about 0.1 (Kobayashi et al. 2010, equation 1). Its response depends on the entire past: the integral of order k is
//!
//! ```text
//! I^k F (t) = 1 / Gamma(k) * integral from 0 to t of (t - s)^(k-1) F(s) ds
//! ```
//!
//! Every [`Rule`] evaluates it at the end of a step as `w_0 F_n + history_n`, where the history covers the values up to
//! n-1 and `w_0` is the weight of the new value, known before that value is. [`History::predict`] returns both;
//! [`History::commit`] then records the new value. The same trait serves the derivative of order k ([`Operator`]).
//!
//! ```
//! use insonify_mechanics::tissue::viscoelastic::{Operator, Rule};
//!
//! // Creep of a spring-pot under a stress of 2 kPa that is there from the start: gamma = 2 t^k / (G Gamma(1 + k)).
//! let (order, modulus_kpa) = (0.5, 4.0);
//! let mut integral = Rule::Trapezoid.start(Operator::Integral(order), &[2.0])?;
//! let mut strain = 0.0;
//! for _ in 0..10 {
//!     let mut history = [0.0];
//!     let weight = integral.predict(0.1, &mut history)?;
//!     strain = (weight * 2.0 + history[0]) / modulus_kpa;
//!     integral.commit(0.1, &[2.0])?;
//! }
//! assert!((strain - 2.0 / (4.0 * 0.886226925452758)).abs() < 1e-14);
//! # Ok::<(), insonify_mechanics::tissue::viscoelastic::HistoryError>(())
//! ```
//!
//! # Two structural laws
//!
//! While the stiffness K is constant, two forms of memory in `K U = F` are equivalent:
//!
//! - `load-integral`, as Kobayashi et al. 2010 solve it (equation 12): `K(U) U = I^k F`, each component of the loads
//!   integrated separately. At a prescribed displacement the reaction is the unknown: `K(U) U_n = w_0 F_n + history_n`.
//! - `rate`, as the material law is stated (equation 4): `K(U) D^k U = F`. In integral form `U = I^k (K(U)^-1 F)`.
//!
//! They differ as soon as K depends on U: in the first the *current* stiffness divides all past loads, in the second
//! each load acts through the stiffness of *its* time. Under constant load past the knee the first is stiffer, as
//! earlier loads acted on tissue that had not yet stiffened.
//!
//! # Rules
//!
//! | rule | function between two times | order | steps | cost per step |
//! |---|---|---|---|---|
//! | [`Rule::Rectangle`] | constant, equal to its end value | 1 | any | O(n) |
//! | [`Rule::TimeScaledTrapezoid`] | constant, equal to the mean of both values | 1 + k | any | O(n) |
//! | [`Rule::Trapezoid`] | linear | 2 | any | O(n) |
//! | [`Rule::GruenwaldLetnikov`] | (a difference quotient) | 1 | equal | O(n) |
//! | [`Rule::Exponentials`] | linear | 2, down to its bound | in its [`Span`] | O(1) |
//!
//! Weights are computed from the lengths of steps, summed backwards from the newest, and never as differences of powers
//! that cancel: steps of 1e-6 s and of 1e3 s may occur in one history.

mod derivative;
mod exponentials;
mod full;
mod gruenwald;
mod history;
mod kernel;
pub mod point;

pub use history::{History, HistoryError, Operator, Rule, Span};

use derivative::{Inverse, Slopes};
use exponentials::Exponentials;
use full::Full;
use gruenwald::GruenwaldLetnikov;
use kernel::Basis;

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
            // The derivative of order k is the integral of order 1 - k of the slopes, which are constant over a step.
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
