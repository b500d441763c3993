//! Measurement of the step time of a scenario by a trial run.

use std::time::{Duration, Instant};

use super::{Observer, Requests, Step, run};
use crate::input::scenario::Scenario;
use insonify_base::statistics::percentile;
use insonify_mechanics::insertion::{Model, StepError};

/// Step times of a trial run. Only steps that remesh count, as they take longest; all steps if there are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// Median of the counted steps, ms.
    pub ms: f64,
    /// Maximum of all steps, ms.
    pub longest_ms: f64,
    /// Number of steps that remesh.
    pub remeshing: usize,
    /// Number of steps over the limit.
    pub over: usize,
    /// Number of steps.
    pub steps: usize,
}

impl Scenario {
    /// Runs steps of a model made by [`Scenario::model`] from the start until the end of the scenario or until
    /// `patience` has elapsed, and counts those that take longer than `limit_ms`. `progress` receives the completed
    /// fraction, of the steps or of the time, whichever is larger.
    ///
    /// # Errors
    /// Errors of a step.
    pub fn trial(
        &self,
        model: &mut dyn Model,
        limit_ms: f64,
        patience: Duration,
        progress: impl FnMut(f64),
    ) -> Result<Trial, StepError> {
        let mut clock = Clock {
            start: Instant::now(),
            patience,
            steps: self.timing.steps as f64,
            step_ms: Vec::new(),
            remeshing: Vec::new(),
            progress,
        };
        match run(self, model, Requests::default(), &mut clock) {
            Ok(_) | Err(End::Late) => Ok(clock.trial(limit_ms)),
            Err(End::Failed(error)) => Err(error),
        }
    }
}

/// Records the times of steps.
struct Clock<F> {
    start: Instant,
    patience: Duration,
    steps: f64,
    step_ms: Vec<f64>,
    remeshing: Vec<f64>,
    progress: F,
}

/// Reason for the end of a trial before the end of the scenario.
enum End {
    Late,
    Failed(StepError),
}

impl From<StepError> for End {
    fn from(error: StepError) -> Self {
        End::Failed(error)
    }
}

impl<F: FnMut(f64)> Clock<F> {
    /// Number of steps between progress reports.
    const BETWEEN_REPORTS: u64 = 256;

    fn trial(mut self, limit_ms: f64) -> Trial {
        let over = self.step_ms.iter().filter(|ms| **ms > limit_ms).count();
        self.step_ms.sort_by(f64::total_cmp);
        self.remeshing.sort_by(f64::total_cmp);
        let counted = if self.remeshing.is_empty() {
            &self.step_ms
        } else {
            &self.remeshing
        };
        Trial {
            ms: percentile(counted, 0.5).unwrap_or(0.0),
            longest_ms: self.step_ms.last().copied().unwrap_or(0.0),
            remeshing: self.remeshing.len(),
            over,
            steps: self.step_ms.len(),
        }
    }
}

impl<F: FnMut(f64)> Observer for Clock<F> {
    type Error = End;

    fn step(&mut self, step: &Step<'_>) -> Result<(), End> {
        self.step_ms.push(step.ms);
        if step.outcome.remeshes > 0 {
            self.remeshing.push(step.ms);
        }
        let spent = self.start.elapsed();
        if spent >= self.patience {
            return Err(End::Late);
        }
        if step.number.is_multiple_of(Self::BETWEEN_REPORTS) {
            let patience = spent.as_secs_f64() / self.patience.as_secs_f64();
            (self.progress)(patience.max(step.number as f64 / self.steps));
        }
        Ok(())
    }
}
