//! Criterion for refactoring the tangent instead of reusing a factor.

/// Iterations that take as long as a factorisation, both in single precision; 10 and 12 were measured at 9,300 degrees
/// of freedom.
const PRICE: usize = 11;

/// Excess of the iterations of increments over those of the first increment with this factor.
///
/// A stale factor costs a few more iterations in each increment. It is replaced when these add up to the cost of a
/// factorisation: the total is then at most twice that of the best choice in hindsight (as in the ski rental problem).
#[derive(Clone, Debug, Default)]
pub(super) struct RefactorisationPolicy {
    /// Iterations of the first increment with this factor.
    usual: Option<usize>,
    excess: usize,
}

impl RefactorisationPolicy {
    /// Resets the count for a new factor.
    pub(crate) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Counts the iterations of an increment with the current factor.
    pub(crate) fn record_iterations(&mut self, iterations: usize) {
        let usual = *self.usual.get_or_insert(iterations);
        self.excess += iterations.saturating_sub(usual);
    }

    /// Whether a new factor is due.
    pub(crate) fn is_due(&self) -> bool {
        self.excess >= PRICE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_is_due_when_it_has_cost_as_much_as_a_new_one() {
        let mut policy = RefactorisationPolicy::default();
        for iterations in [3, 2, 3, 3] {
            policy.record_iterations(iterations);
        }
        assert!(!policy.is_due());
        // Two more than usual each time.
        let until = (1..).find(|_| {
            policy.record_iterations(5);
            policy.is_due()
        });
        assert_eq!(until, Some(PRICE.div_ceil(2)));
        policy.reset();
        policy.record_iterations(20);
        assert!(!policy.is_due());
    }
}
