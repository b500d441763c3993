//! Tissue that stiffens with strain against closed forms, and its schemes against each other.

mod case;
mod creep;
mod hand;
mod knee;
mod laws;
mod patch;
mod schemes;
