//! Rules of the house: who may name whom, what declarations and shaders say of each other, and what a plan holds.

mod echoes;
mod fusion;
mod names;
mod parameter_blocks;
mod plans;
mod shaders;
