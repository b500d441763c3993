//! Mechanics against closed forms and independent solutions.

mod insertion;
mod remesh;
mod statics;
mod viscoelastic;
