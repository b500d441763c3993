//! Mechanics against closed forms and independent solutions.

mod beam;
mod insertion;
mod nonlinear;
mod statics;
mod viscoelastic;
