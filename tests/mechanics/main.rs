//! Mechanics against closed forms and independent solutions.

mod remesh;
mod statics;
