//! Secant predictor for the next increment.

/// First proposal of a reused factor in the previous increment, and its error.
///
/// The error is similar in similar increments: of a load that grows or wanes, of a plate or a needle that advances or
/// retracts. The proposal is linear in the prescribed change, so the component of a new proposal along the previous one
/// measures their similarity.
#[derive(Clone, Debug, Default)]
pub(super) struct Predictor {
    proposal: Vec<f64>,
    missed: Vec<f64>,
    /// Contact of the proposal, if any: weights of degrees of freedom.
    contact: Vec<(u32, f64)>,
    stage: Stage,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    /// Nothing is stored.
    #[default]
    Blank,
    /// A proposal is stored, but not yet its error.
    Proposed,
    /// Proposal and error are stored.
    Known,
}

/// Smallest squared cosine between proposals that count as similar.
const ALIKE: f64 = 0.5;

/// Largest ratio of a proposal to the previous one for which the prediction is used.
const LONGEST: f64 = 4.0;

impl Predictor {
    /// Clears the predictor, for another factor or state.
    pub(super) fn clear(&mut self) {
        self.stage = Stage::Blank;
    }

    /// Adds the predicted error to the first proposal of an increment, with a contact of these weights or none. Returns
    /// whether anything was added.
    pub(super) fn apply(&mut self, change: &mut [f64], contact: &[(u32, f64)]) -> bool {
        let share = if self.stage == Stage::Known && self.contact == contact {
            self.share(change)
        } else {
            0.0
        };
        self.proposal.clear();
        self.proposal.extend_from_slice(change);
        self.contact.clear();
        self.contact.extend_from_slice(contact);
        self.stage = Stage::Proposed;
        if share != 0.0 {
            let missed = self.missed.iter().map(|missed| share * missed);
            change.iter_mut().zip(missed).for_each(|(x, missed)| *x += missed);
        }
        share != 0.0
    }

    /// Records the total change of the increment whose first proposal was stored.
    pub(super) fn record(&mut self, change: impl Iterator<Item = f64>) {
        if self.stage == Stage::Proposed {
            let missed = change.zip(&self.proposal).map(|(change, proposal)| change - proposal);
            self.missed.clear();
            self.missed.extend(missed);
            self.stage = Stage::Known;
        }
    }

    /// Returns the multiple of the last proposal contained in this one; 0 where they are not similar.
    fn share(&self, change: &[f64]) -> f64 {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let before = dot(&self.proposal, &self.proposal);
        let both = dot(change, &self.proposal);
        let alike = both * both >= ALIKE * before * dot(change, change);
        let share = both / before;
        if alike && share.abs() <= LONGEST { share } else { 0.0 }
    }
}

#[cfg(test)]
mod tests;
