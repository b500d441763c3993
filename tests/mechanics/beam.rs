//! The needle as a beam in tissue, against closed forms, another method and published figures.

mod case;
mod energy;
mod hard;
mod inverse;
mod large;
mod published;
mod winkler;
