//! Mechanics against closed forms and independent solutions.

mod beam;
mod insertion;
mod nonlinear;
mod remesh_gpu;
mod viscoelastic;
