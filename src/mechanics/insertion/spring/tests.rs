//! What must hold of the model, by what it holds of.

mod bending;
mod insertion;
mod meeting;
mod network;
mod rule;
mod stable;
