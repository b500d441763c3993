//! Whole states from one thread to another.

use std::sync::{Arc, Weak};

use crate::mechanics::insertion::{Model, Snapshot};

/// The end that writes.
pub(super) struct Publisher {
    buffers: triple_buffer::Input<Snapshot>,
    reader: Weak<()>,
}

/// The end that reads.
pub(super) struct Latest {
    buffers: triple_buffer::Output<Snapshot>,
    _alive: Arc<()>,
}

/// Two ends of one hand-over.
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
    /// Hands the state of a model over, in place of the one before; waits for nobody. Nothing is done, and the model
    /// not asked, once the reader is gone.
    pub(super) fn publish(&mut self, model: &mut dyn Model) {
        if self.reader.strong_count() > 0 {
            model.snapshot(self.buffers.input_buffer_mut());
            self.buffers.publish();
        }
    }
}

impl Latest {
    /// Takes the latest state; whether it is another than before.
    pub(super) fn take(&mut self) -> bool {
        self.buffers.update()
    }

    /// The state taken last.
    pub(super) fn state(&self) -> &Snapshot {
        self.buffers.output_buffer()
    }
}
