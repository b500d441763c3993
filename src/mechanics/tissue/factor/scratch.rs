//! Scratch memory that solves on several threads share.

use std::fmt;
use std::sync::{Mutex, PoisonError};

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};

/// Buffers that nobody uses at the moment.
#[derive(Default)]
pub struct Scratch(Mutex<Vec<MemBuffer>>);

impl Scratch {
    /// Runs `work` on a stack that holds `need`; none if that memory cannot be had.
    pub fn with<T>(&self, need: StackReq, work: impl FnOnce(&mut MemStack) -> T) -> Option<T> {
        let mut buffer = match self.store().pop().filter(|buffer| fits(buffer, need)) {
            Some(buffer) => buffer,
            None => MemBuffer::try_new(need).ok()?,
        };
        let result = work(MemStack::new(&mut buffer));
        self.store().push(buffer);
        Some(result)
    }

    fn store(&self) -> std::sync::MutexGuard<'_, Vec<MemBuffer>> {
        // A panic elsewhere leaves the list whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn fits(buffer: &MemBuffer, need: StackReq) -> bool {
    buffer.len() >= need.unaligned_bytes_required()
}

/// A copy begins without buffers.
impl Clone for Scratch {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl fmt::Debug for Scratch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Scratch({} buffers)", self.store().len())
    }
}
