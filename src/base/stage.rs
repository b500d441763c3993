//! Work under way in this process, for whoever shows progress: long work says what it does and how far it is.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Work under way, until it is dropped.
#[derive(Debug)]
pub struct Stage(u64);

/// State of some work.
#[derive(Clone, Debug)]
pub struct State {
    number: u64,
    /// Name of the work.
    pub name: String,
    /// When it began.
    pub begun: Instant,
    /// Its progress.
    pub extent: Extent,
}

/// Progress of some work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extent {
    /// Unknown.
    Unknown,
    /// Fraction done, 0 to 1.
    Share(f64),
    /// Frames done, of how many.
    Frames(u64, u64),
}

/// All work under way, the innermost last.
static STATES: Mutex<Vec<State>> = Mutex::new(Vec::new());

fn states() -> MutexGuard<'static, Vec<State>> {
    STATES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// State of the innermost work under way.
pub fn current() -> Option<State> {
    states().last().cloned()
}

/// Begins work.
pub fn enter(name: impl Into<String>, extent: Extent) -> Stage {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    states().push(State {
        number,
        name: name.into(),
        begun: Instant::now(),
        extent,
    });
    Stage(number)
}

/// Does work whose extent is not known.
pub fn during<T>(name: &str, work: impl FnOnce() -> T) -> T {
    let _stage = enter(name, Extent::Unknown);
    work()
}

impl Stage {
    fn change(&self, change: impl FnOnce(&mut State)) {
        if let Some(state) = states().iter_mut().find(|state| state.number == self.0) {
            change(state);
        }
    }

    /// Sets the fraction done, 0 to 1.
    pub fn share(&self, share: f64) {
        self.change(|state| state.extent = Extent::Share(share));
    }

    /// Counts a frame as done.
    pub fn frame(&self) {
        self.change(|state| {
            if let Extent::Frames(done, _) = &mut state.extent {
                *done += 1;
            }
        });
    }

    /// Sets what is done.
    pub fn rename(&self, name: &str) {
        self.change(|state| name.clone_into(&mut state.name));
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        states().retain(|state| state.number != self.0);
    }
}
