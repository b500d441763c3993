//! The library through its public and internal interfaces. Binaries of their own have the command (`cli`), mechanics, and what
//! counts allocations or ends a process (`allocations`, `formats`, `fuzz`): every binary more links the whole library once more.

mod boundaries;
mod parity;
mod physics;
mod scenes;
mod stability;
mod support;
