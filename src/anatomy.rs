//! Labelled volumes, their files and formats, phantoms, segmentations, and what tissue sounds like.

pub mod acoustics;
pub mod phantom;
pub mod segmentation;
pub mod volume;
