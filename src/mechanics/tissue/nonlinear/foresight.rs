//! Where an increment is likely to end, from where the one before did.

/// What a kept factor proposed first in the increment before, and what that missed.
///
/// It misses alike in increments that are alike: of a load that grows or wanes, of a plate or a needle that goes on or back. The
/// proposal is linear in what is asked for, so that the share of the last one in it says how much alike they are.
#[derive(Clone, Debug, Default)]
pub(super) struct Foresight {
    proposal: Vec<f64>,
    missed: Vec<f64>,
    /// Where the contact was, if there was one: weights of degrees of freedom.
    contact: Vec<(u32, f64)>,
    stage: Stage,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    /// Nothing is known.
    #[default]
    Blank,
    /// There is a proposal; what it misses is not known yet.
    Proposed,
    /// Both are known.
    Known,
}

/// Proposals are of the same kind while the square of the cosine between them is this at least.
const ALIKE: f64 = 0.5;

/// How much longer than the last a proposal may be that is told of by it.
const LONGEST: f64 = 4.0;

impl Foresight {
    /// Forgets what was: another factor, another state.
    pub fn clear(&mut self) {
        self.stage = Stage::Blank;
    }

    /// Adds to the first proposal of an increment, with a contact of these weights or none, what it is likely to miss. Returns
    /// whether there was anything to add.
    pub fn improve(&mut self, change: &mut [f64], contact: &[(u32, f64)]) -> bool {
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

    /// Takes what the whole increment changed, whose first proposal was told.
    pub fn learn(&mut self, change: impl Iterator<Item = f64>) {
        if self.stage == Stage::Proposed {
            let missed = change.zip(&self.proposal).map(|(change, proposal)| change - proposal);
            self.missed.clear();
            self.missed.extend(missed);
            self.stage = Stage::Known;
        }
    }

    /// How often the last proposal is in this one; 0 where they are not alike.
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
