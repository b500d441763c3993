//! Needle insertion by finite elements: forces, states, paths, and what must hold of them.

mod anatomy;
mod bending;
mod contact;
mod edges;
mod held;
mod levels;
mod living;
mod probe;
mod support;
