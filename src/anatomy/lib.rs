//! Labelled volumes, their files and formats, phantoms, segmentations, registration, and acoustic properties of tissue.

pub mod acoustics;
pub mod phantom;
pub mod registration;
pub mod segmentation;
pub mod volume;
