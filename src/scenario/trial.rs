//! How long the steps of a scenario take on this machine, found by making them.

use std::time::{Duration, Instant};

use super::Scenario;
use super::run::{Asked, Deformed, Moment, Observer, Step, run};
use crate::error::Error;
use crate::mechanics::insertion::StepError;
use crate::study::spread::percentile;

/// What steps of a scenario took. Those that remesh count, as they take longest; where none does, all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// Median of those that count, ms.
    pub ms: f64,
    /// The longest of all, ms.
    pub longest_ms: f64,
    /// Steps that remesh.
    pub remeshing: usize,
    /// Steps that took longer than was asked for.
    pub over: usize,
    /// Steps made.
    pub steps: usize,
}

impl Scenario {
    /// Makes steps from the start on, until the end or until `patience` is spent, and counts those that take longer than `limit_ms`.
    /// `told` hears the share done of whichever ends first.
    ///
    /// # Errors
    /// Those of the model and of a step.
    pub fn trial(&self, limit_ms: f64, patience: Duration, told: impl FnMut(f64)) -> Result<Trial, Error> {
        let mut model = self.model(|_, _| {})?;
        let mut clock = Clock {
            start: Instant::now(),
            patience,
            of: self.timing.steps as f64,
            all: Vec::new(),
            remeshing: Vec::new(),
            told,
        };
        match run(self, model.as_mut(), Asked::default(), &mut clock) {
            Ok(_) | Err(End::Late) => Ok(clock.trial(limit_ms)),
            Err(End::Failed(error)) => Err(error.into()),
        }
    }
}

/// Takes the times of steps.
struct Clock<F> {
    start: Instant,
    patience: Duration,
    of: f64,
    all: Vec<f64>,
    remeshing: Vec<f64>,
    told: F,
}

/// Why a trial ends before the scenario does.
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
    /// Steps from one time that it is told to the next.
    const TOLD: u64 = 256;

    fn trial(mut self, limit_ms: f64) -> Trial {
        let over = self.all.iter().filter(|ms| **ms > limit_ms).count();
        self.all.sort_by(f64::total_cmp);
        self.remeshing.sort_by(f64::total_cmp);
        let counted = if self.remeshing.is_empty() {
            &self.all
        } else {
            &self.remeshing
        };
        Trial {
            ms: percentile(counted, 0.5).unwrap_or(0.0),
            longest_ms: self.all.last().copied().unwrap_or(0.0),
            remeshing: self.remeshing.len(),
            over,
            steps: self.all.len(),
        }
    }
}

impl<F: FnMut(f64)> Observer for Clock<F> {
    type Error = End;

    fn step(&mut self, step: &Step<'_>) -> Result<(), End> {
        self.all.push(step.ms);
        if step.outcome.remeshes > 0 {
            self.remeshing.push(step.ms);
        }
        let spent = self.start.elapsed();
        if spent >= self.patience {
            return Err(End::Late);
        }
        if step.number.is_multiple_of(Self::TOLD) {
            let patience = spent.as_secs_f64() / self.patience.as_secs_f64();
            (self.told)(patience.max(step.number as f64 / self.of));
        }
        Ok(())
    }

    fn frame(&mut self, _: &Moment<'_>) -> Result<(), End> {
        Ok(())
    }

    fn mesh(&mut self, _: &Deformed<'_>) -> Result<(), End> {
        Ok(())
    }
}
