//! Static solutions against closed forms, manufactured solutions and a dense solution assembled another way.

mod bending;
mod case;
mod energy;
mod manufactured;
mod patch;
mod random;
mod reference;
mod stretched;
mod symmetry;
