//! Verification of picked settings: costs are measured on a similar problem, and a trial runs the actual one.

use super::{Choice, Costs, Picked, Setting, choose};
use insonify_base::pareto;

/// Maximum number of trials: each takes as long as the problem itself.
const MAX: usize = 6;

/// Result of a trial.
#[derive(Clone, Debug, PartialEq)]
pub struct Tried {
    /// The time that counts, ms.
    pub ms: f64,
    /// Description of the measurement and its conditions.
    pub measured: String,
}

/// Picks as [`pick`](super::pick) does, tries the picked settings, scales the costs of all untried settings by the
/// ratio of measured to predicted time, and picks again, until the pick has been tried already. Of all tried settings
/// it returns the one with the smallest error within `budget_ms`; if none is within the budget, the fastest. `None` if
/// no setting is open.
///
/// # Errors
/// Errors of `trial`.
pub fn pick_tried<E>(
    asked: &str,
    costs: &Costs,
    budget_ms: f64,
    open: impl Fn(&str) -> bool,
    mut trial: impl FnMut(&Picked) -> Result<Tried, E>,
) -> Result<Option<Picked>, E> {
    let mut factor = 1.0;
    let (mut all, mut known): (Vec<(Choice, Tried)>, Vec<(Vec<Setting>, f64)>) = (Vec::new(), Vec::new());
    while all.len() < MAX {
        let scaled = costs.times(factor);
        let Some(choice) = choose(&scaled, budget_ms, &open, &known) else {
            return Ok(None);
        };
        if known.iter().any(|(settings, _)| *settings == choice.settings) {
            break;
        }
        let tried = trial(&choice.picked(asked, budget_ms, costs, choice.ms, &costs.measured))?;
        let wrong_by = tried.ms / choice.ms;
        // A prediction of zero gives no ratio.
        if wrong_by.is_finite() && wrong_by > 0.0 {
            factor *= wrong_by;
        }
        known.push((choice.settings.clone(), tried.ms));
        all.push((choice, tried));
    }
    let cheapest = pareto::choose(&all, budget_ms, 1.0, |(choice, tried)| [tried.ms, choice.error]);
    Ok(cheapest.map(
        |pareto::Choice {
             taken: (choice, tried), ..
         }| { choice.picked(asked, budget_ms, costs, tried.ms, &tried.measured) },
    ))
}

impl Costs {
    /// Returns the costs with all times multiplied by `factor`.
    fn times(&self, factor: f64) -> Costs {
        let mut scaled = self.clone();
        scaled.base_ms *= factor;
        let options = scaled.settings.iter_mut().flat_map(|setting| &mut setting.options);
        options.for_each(|option| option.extra_ms *= factor);
        scaled
    }
}
