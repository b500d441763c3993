//! Scratch memory shared by solves on several threads.

use std::fmt;
use std::sync::{Mutex, PoisonError};

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};

/// Buffers that are not in use.
#[derive(Default)]
pub struct Scratch(Mutex<Vec<MemBuffer>>);

impl Scratch {
    /// Runs `work` on a stack of size `need`; `None` if that memory cannot be allocated.
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
        // A panic elsewhere leaves the list intact.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn fits(buffer: &MemBuffer, need: StackReq) -> bool {
    buffer.len() >= need.unaligned_bytes_required()
}

/// A clone starts without buffers.
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
