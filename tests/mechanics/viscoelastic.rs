//! Fading memory against closed forms: integrals and derivatives of powers, creep and relaxation of bodies, steps of
//! any length, and a knee that is crossed at every step.

mod crossing;
mod laws;
mod mittag_leffler;
mod orders;
mod steps;
