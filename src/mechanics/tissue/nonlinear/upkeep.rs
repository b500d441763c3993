//! When a kept factor has cost more than a new one would.

/// Iterations that take as long as a factorisation, both in single precision: 10 and 12 were measured at 9,300 degrees of freedom.
const PRICE: usize = 11;

/// Iterations of increments, against those that the factor served best with.
///
/// A factor that grows stale costs a few iterations more at each increment. It is made anew when these add up to what that takes:
/// whatever comes, that is at most twice what the best choice in hindsight would have taken (as whoever rents skis buys them when
/// the rents come to their price).
#[derive(Clone, Debug, Default)]
pub(super) struct Upkeep {
    /// Iterations of the first increment with this factor.
    usual: Option<usize>,
    excess: usize,
}

impl Upkeep {
    /// A new factor.
    pub fn renew(&mut self) {
        *self = Self::default();
    }

    /// An increment took so many iterations with the factor at hand.
    pub fn took(&mut self, iterations: usize) {
        let usual = *self.usual.get_or_insert(iterations);
        self.excess += iterations.saturating_sub(usual);
    }

    /// Whether a new factor is due.
    pub fn is_due(&self) -> bool {
        self.excess >= PRICE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_factor_is_due_when_it_has_cost_as_much_as_a_new_one() {
        let mut upkeep = Upkeep::default();
        for iterations in [3, 2, 3, 3] {
            upkeep.took(iterations);
        }
        assert!(!upkeep.is_due());
        // Two more than usual each time.
        let until = (1..).find(|_| {
            upkeep.took(5);
            upkeep.is_due()
        });
        assert_eq!(until, Some(PRICE.div_ceil(2)));
        upkeep.renew();
        upkeep.took(20);
        assert!(!upkeep.is_due());
    }
}
