//! Stick-slip element along the shaft with bounded force: friction at a contact, or cutting at the tip.

use serde::{Deserialize, Serialize};

/// Stick-slip state along the shaft.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum State {
    /// The point keeps its place on the shaft.
    Stuck,
    /// The point is pushed along the shaft with the maximum force: towards the tip (1.0) while the needle advances, or back
    /// (-1.0).
    Slipping(f64),
}

/// A bounded force with its stick-slip state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Slider {
    pub state: State,
    /// Bounds of the force on the tissue while it slips, towards the tip and back: [most, least], N.
    #[serde(skip)]
    pub sliding: [f64; 2],
    /// Bounds of the force on the tissue while it sticks: [most, least], N.
    #[serde(skip)]
    pub holding: [f64; 2],
}

/// Relative tolerance by which a force may exceed its bound.
const BOUND: f64 = 1e-11;
/// Slip in the direction of friction that counts as rounding of positions, mm.
const REST: f64 = 1e-9;

impl Slider {
    pub fn new(state: State) -> Slider {
        Slider {
            state,
            sliding: [0.0; 2],
            holding: [0.0; 2],
        }
    }

    pub fn is_stuck(&self) -> bool {
        self.state == State::Stuck
    }

    /// Sets the bounds for both states.
    pub fn set_bounds(&mut self, bounds: [f64; 2]) {
        (self.sliding, self.holding) = (bounds, bounds);
    }

    /// Returns the force on the tissue if it slips, N.
    pub fn force(&self) -> Option<f64> {
        match self.state {
            State::Stuck => None,
            State::Slipping(direction) => Some(self.sliding[usize::from(direction < 0.0)]),
        }
    }

    /// Returns the state to change to where Coulomb's law is violated: a force (N) out of bounds, or a slip (mm, of the
    /// tissue towards the tip) in the direction of the friction that should resist it.
    pub fn breaks(&self, force: f64, slip: f64) -> Option<State> {
        let [most, least] = self.holding;
        match self.state {
            State::Stuck if force > most + BOUND * most.abs() => Some(State::Slipping(1.0)),
            State::Stuck if force < least - BOUND * least.abs() => Some(State::Slipping(-1.0)),
            // Tissue pushed towards the tip must move towards the base; tissue without friction may move either way.
            State::Slipping(direction) if slip * direction > REST && self.sliding != [0.0; 2] => Some(State::Stuck),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_of_coulomb() {
        let mut slider = Slider::new(State::Stuck);
        (slider.sliding, slider.holding) = ([2.0, -1.0], [3.0, -1.5]);
        let cases = [
            (2.9, None),
            (3.1, Some(State::Slipping(1.0))),
            (-1.4, None),
            (-1.6, Some(State::Slipping(-1.0))),
        ];
        for (force, state) in cases {
            assert_eq!(slider.breaks(force, 7.0), state);
        }
        assert_eq!((slider.is_stuck(), slider.force()), (true, None));
        slider.state = State::Slipping(1.0);
        assert_eq!(slider.force(), Some(2.0));
        assert_eq!(
            (slider.breaks(9.0, -0.1), slider.breaks(9.0, 0.1)),
            (None, Some(State::Stuck))
        );
        slider.state = State::Slipping(-1.0);
        assert_eq!(slider.force(), Some(-1.0));
        assert_eq!(
            (slider.breaks(9.0, 0.1), slider.breaks(9.0, -0.1)),
            (None, Some(State::Stuck))
        );
        // Without friction it slips at the least force.
        let nothing = Slider::new(State::Stuck);
        assert_eq!(
            (nothing.breaks(0.0, 0.0), nothing.breaks(1e-300, 0.0)),
            (None, Some(State::Slipping(1.0)))
        );
    }
}
