//! What users write, from text to a frame: the scenes that come with the crate, every kind of scene file, and every
//! kind of mistake in one.

mod broken;
mod doubts;
mod effects;
mod errors;
mod examples;
mod format;
mod motion;
mod support;
mod volumes;
