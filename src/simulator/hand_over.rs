//! Lock-free hand-over of complete states between threads.

use std::sync::{Arc, Weak};

use crate::mechanics::insertion::{Model, Snapshot};

/// Writing end.
pub(super) struct Publisher {
    buffers: triple_buffer::Input<Snapshot>,
    reader: Weak<()>,
}

/// Reading end.
pub(super) struct Latest {
    buffers: triple_buffer::Output<Snapshot>,
    _alive: Arc<()>,
}

/// Returns the two ends of a hand-over.
pub(super) fn hand_over() -> (Publisher, Latest) {
    let (input, output) = triple_buffer::triple_buffer(&Snapshot::default());
    let alive = Arc::new(());
    let publisher = Publisher {
        buffers: input,
        reader: Arc::downgrade(&alive),
    };
    let latest = Latest {
        buffers: output,
        _alive: alive,
    };
    (publisher, latest)
}

impl Publisher {
    /// Publishes the state of a model in place of the previous one, without waiting. Does nothing, not even request the
    /// state, once the reader is gone.
    pub(super) fn publish(&mut self, model: &mut dyn Model) {
        if self.reader.strong_count() > 0 {
            model.snapshot(self.buffers.input_buffer_mut());
            self.buffers.publish();
        }
    }
}

impl Latest {
    /// Takes the latest state; returns whether it is new.
    pub(super) fn take(&mut self) -> bool {
        self.buffers.update()
    }

    /// Returns the state taken last.
    pub(super) fn state(&self) -> &Snapshot {
        self.buffers.output_buffer()
    }
}
