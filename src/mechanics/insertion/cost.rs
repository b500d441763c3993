//! Wall time of a step by what it is spent on.

use std::time::{Duration, Instant};

/// Kinds of work in a step of finite elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Following the tip through the tissue, and nodes that touch the probe.
    Search,
    /// Moving nodes to the tip and back: the update of the compliance.
    Remeshing,
    /// Condensing the compliance to the contacts, and passing their forces to the tissue.
    Condensation,
    /// Solving for contact forces with stick and slip.
    Friction,
    /// Bending the needle under these forces, and sliding contacts along it.
    Bending,
    /// The rest: the outcome of the step, and work deferred from steps that remesh.
    Rest,
}

impl Work {
    /// All kinds of work with their names in reports.
    pub const ALL: [(Work, &str); 6] = [
        (Work::Search, "search"),
        (Work::Remeshing, "remeshing"),
        (Work::Condensation, "condensation"),
        (Work::Friction, "friction"),
        (Work::Bending, "bending"),
        (Work::Rest, "rest"),
    ];
}

/// Wall time of the last step by kind of work.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepCost {
    spent: [Duration; Work::ALL.len()],
    last: Option<Instant>,
}

impl StepCost {
    /// Begins a step.
    pub(super) fn start(&mut self) {
        *self = StepCost {
            last: Some(Instant::now()),
            ..StepCost::default()
        };
    }

    /// Counts the time since the last call, or since the beginning of the step, to a kind of work.
    pub(super) fn count(&mut self, work: Work) {
        let now = Instant::now();
        if let Some(last) = self.last.replace(now) {
            self.spent[work as usize] += now - last;
        }
    }

    /// Returns the time of a kind of work, ms.
    pub fn ms(&self, work: Work) -> f64 {
        self.spent[work as usize].as_secs_f64() * 1e3
    }
}
