//! Studies and what they need of every crate below: the doors of crates, hard cases, static problems, tables of
//! parameters.

mod doors;
mod parameters;
mod pops;
mod stability;
mod statics;
