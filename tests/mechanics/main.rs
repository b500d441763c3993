//! Mechanics against closed forms and independent solutions.

mod beam;
mod insertion;
mod nonlinear;
mod remesh;
mod statics;
mod viscoelastic;
