//! Static solutions against closed forms and a dense solution assembled another way.

mod bending;
mod case;
mod energy;
mod patch;
mod random;
mod reference;
mod stretched;
mod symmetry;
