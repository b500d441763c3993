//! Elevational profile of the beam: how much of its energy lies within a distance from the plane.

use std::f64::consts::LN_2;

/// Number of steps at which a profile is known, and their distance in lengths.
const STEPS: usize = 24;
const STEP: f64 = 0.1;

/// Energy of the two-way beam across the plane at a depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Profile {
    /// Full width at half maximum of the amplitude, mm.
    pub length_mm: f64,
    /// Share of the energy up to each step to either side.
    within: [f64; STEPS + 1],
}

impl Profile {
    /// The profile with this energy at distances in lengths.
    pub(super) fn new(length_mm: f64, energy: impl Fn(f64) -> f64) -> Self {
        let mut within = [0.0; STEPS + 1];
        let mut before = energy(0.0);
        for step in 1..=STEPS {
            let here = energy(STEP * step as f64);
            within[step] = within[step - 1] + before + here;
            before = here;
        }
        let total = within[STEPS];
        within.iter_mut().for_each(|share| *share /= total);
        Self { length_mm, within }
    }

    /// The profile of a Gaussian beam.
    pub(crate) fn gaussian(length_mm: f64) -> Self {
        Self::new(length_mm, |lengths| (-8.0 * LN_2 * lengths * lengths).exp())
    }

    /// Share of the energy up to a distance to either side.
    pub(crate) fn within(&self, mm: f64) -> f64 {
        let at = (mm / self.length_mm / STEP).clamp(0.0, STEPS as f64);
        let before = (at as usize).min(STEPS - 1);
        self.within[before] + (at - before as f64) * (self.within[before + 1] - self.within[before])
    }

    /// The profile between this one and another.
    pub(super) fn towards(&self, other: &Self, share: f64) -> Self {
        let between = |a: f64, b: f64| a + share * (b - a);
        Self {
            length_mm: between(self.length_mm, other.length_mm),
            within: std::array::from_fn(|step| between(self.within[step], other.within[step])),
        }
    }
}
