//! What must hold of the model, by what it holds of.

mod insertion;
mod network;
mod rule;
mod stable;
