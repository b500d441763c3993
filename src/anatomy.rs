//! Labelled volumes, their files and formats, phantoms, segmentations, and acoustic properties of tissue.

pub mod acoustics;
pub mod phantom;
pub mod segmentation;
pub mod volume;
