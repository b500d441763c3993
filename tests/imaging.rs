//! Frames through the door of `insonify-imaging`: scenes, plans, and the physics of every effect.

mod boundaries;
mod physics;
mod scenes;
mod support;
