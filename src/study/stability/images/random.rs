//! Case of random scenes on every backend.

use super::super::record::{Record, Unexpected};
use super::drawn::scene;
use super::setup::{Tally, gpus};
use crate::study::parity::check;

/// Compares all backends on randomly drawn scenes.
pub fn scenes(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let count = record.effort().pick(10, 100);
    let mut tally = Tally::default();
    for index in 0..count {
        let case = scene(record.seed(), index);
        let verdicts = check(&case, &gpus)?;
        tally.add(&case, verdicts);
        record.done((index + 1) as f64 / count as f64);
    }
    record.report("scenes", count as f64);
    tally.note(record)
}
