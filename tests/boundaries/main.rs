//! Rules of the house: who may name whom, what declarations and shaders say of each other, and what a plan holds.

#[path = "../support/mod.rs"]
mod support;

mod names;
mod parameters;
mod plans;
mod remesh;
mod shaders;
