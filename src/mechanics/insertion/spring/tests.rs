//! Invariants of the mass-spring model, by topic.

mod bending;
mod insertion;
mod meeting;
mod network;
mod rule;
mod stable;
