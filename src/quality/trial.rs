//! Picks that are tried before they are believed: costs come from something like what they are for, and a trial from the thing itself.

use super::{Choice, Costs, Picked, Setting, choose};

/// Trials at most: each takes as long as the thing itself.
const MOST: usize = 6;

/// What a trial found.
#[derive(Clone, Debug, PartialEq)]
pub struct Tried {
    /// The time that counts, ms.
    pub ms: f64,
    /// How it was found, and what else is to be known of it.
    pub measured: String,
}

/// Picks as [`pick`](super::pick) does, tries what is picked, takes the costs of all that has not been tried to be wrong by the factor
/// that those of this trial were wrong by, and picks again, until that has been tried already. Of all that was tried it takes what
/// errs least within `budget_ms`; where nothing stays within, the fastest. None where no dial is open.
///
/// # Errors
/// Those of `trial`.
pub fn pick_tried<E>(
    asked: &str,
    costs: &Costs,
    budget_ms: f64,
    open: impl Fn(&str) -> bool,
    mut trial: impl FnMut(&Picked) -> Result<Tried, E>,
) -> Result<Option<Picked>, E> {
    let mut factor = 1.0;
    let (mut all, mut known): (Vec<(Choice, Tried)>, Vec<(Vec<Setting>, f64)>) = (Vec::new(), Vec::new());
    while all.len() < MOST {
        let scaled = costs.times(factor);
        let Some(choice) = choose(&scaled, budget_ms, &open, &known) else {
            return Ok(None);
        };
        if known.iter().any(|(settings, _)| *settings == choice.settings) {
            break;
        }
        let tried = trial(&choice.picked(asked, budget_ms, costs, choice.ms, &costs.measured))?;
        let wrong_by = tried.ms / choice.ms;
        // Times that add up to nothing tell of no other.
        if wrong_by.is_finite() && wrong_by > 0.0 {
            factor *= wrong_by;
        }
        known.push((choice.settings.clone(), tried.ms));
        all.push((choice, tried));
    }
    let error = |(choice, _): &&(Choice, Tried)| choice.error;
    let ms = |(_, tried): &&(Choice, Tried)| tried.ms;
    let within = all.iter().filter(|it| ms(it) <= budget_ms);
    let taken = within
        .min_by(|a, b| error(a).total_cmp(&error(b)))
        .or_else(|| all.iter().min_by(|a, b| ms(a).total_cmp(&ms(b))));
    Ok(taken.map(|(choice, tried)| choice.picked(asked, budget_ms, costs, tried.ms, &tried.measured)))
}

impl Costs {
    /// All times multiplied.
    fn times(&self, factor: f64) -> Costs {
        let mut scaled = self.clone();
        scaled.base_ms *= factor;
        let rungs = scaled.dials.iter_mut().flat_map(|dial| &mut dial.rungs);
        rungs.for_each(|rung| rung.extra_ms *= factor);
        scaled
    }
}
