//! When a sample of the errors is due.

/// Counts updates between samples: one after a start or a sample that was off, twice as many after each that was good.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watch {
    /// Updates since the last sample.
    updates: u64,
    interval: u64,
}

impl Watch {
    /// The next update is sampled.
    pub fn new() -> Watch {
        Watch {
            updates: 0,
            interval: 1,
        }
    }

    /// Counts an update; whether it is to be sampled. Of `every` 0 none ever is.
    pub fn is_due(&mut self, every: u64) -> bool {
        self.updates += 1;
        every > 0 && self.updates >= self.interval
    }

    /// Notes a good sample: the next may wait twice as long, but no longer than `every` updates.
    pub fn relax(&mut self, every: u64) {
        *self = Watch {
            updates: 0,
            interval: (2 * self.interval).min(every),
        };
    }
}
