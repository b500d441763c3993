//! Progress and outcome of the steps.

use nalgebra::{Isometry3, Point3};

use crate::mechanics::insertion::{Event, EventKind, Outcome};

#[derive(Debug, Default)]
pub(super) struct Log {
    pub steps: u64,
    pub time_s: f64,
    /// Pose of the base given by the hand at the end of the last step.
    pub base: Option<Isometry3<f64>>,
    pub seeds: Vec<Point3<f64>>,
    pub outcome: Outcome,
}

impl Log {
    pub fn note(&mut self, kind: EventKind, at_mm: Point3<f64>, region: Option<i32>) {
        self.outcome.events.push(Event {
            kind,
            time_s: self.time_s,
            at_mm,
            region,
        });
    }
}
