//! Schedule of error samples.

/// Counter of updates between samples: one after a start or a bad sample, twice as many after each good one.
#[derive(Clone, Copy, Debug)]
pub(super) struct SampleSchedule {
    /// Updates since the last sample.
    updates: u64,
    interval: u64,
}

impl SampleSchedule {
    /// Creates a schedule that samples the next update.
    pub fn new() -> SampleSchedule {
        SampleSchedule {
            updates: 0,
            interval: 1,
        }
    }

    /// Counts an update; returns whether to sample it. With `every` 0 none is sampled.
    pub fn is_due(&mut self, every: u64) -> bool {
        self.updates += 1;
        every > 0 && self.updates >= self.interval
    }

    /// Records a good sample: the next may wait twice as long, but at most `every` updates.
    pub fn relax(&mut self, every: u64) {
        *self = SampleSchedule {
            updates: 0,
            interval: (2 * self.interval).min(every),
        };
    }
}
