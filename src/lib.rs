//! `insonify` synthesises B-mode ultrasound frames from labelled volumes, on the GPU through wgpu and on a CPU
//! reference that checks every pass.
//!
//! # Map
//!
//! | module | what it holds |
//! |---|---|
//! | [`document`] | TOML files that a user writes, and errors that point into them |
//! | [`scene`] | what a user writes, validated: every effect is optional |
//! | [`volume`] | labelled volumes, solid textures and their file formats |
//! | [`phantom`] | labelled volumes made from code |
//! | [`tissue`] | the tissue table and the bank of solid textures |
//! | [`segmentation`] | label files and folders of masks, their labels named |
//! | [`tracking`] | probe geometry, poses, trajectories, tracked sequences |
//! | [`effects`] | the ordered registry of effects: parameters, CPU reference, pass declaration |
//! | [`plan`] | scene to passes and resources, each with its reason |
//! | [`quality`] | levels picked from what they cost on this machine |
//! | [`synth`] | runs a plan on the CPU or the GPU |
//! | [`gpu`] | adapters, devices, pipelines, read-back; knows nothing of ultrasound |
//! | [`mechanics`] | tetrahedral meshes, point location, tissue that deforms |
//! | [`material_case`] | tests of a material as a user writes them |
//! | [`simulator`] | steps at the rate of the hand, images of them on another thread |
//! | [`remesh_gpu`] | remeshing with the dense inverse on a GPU |
//! | [`scenario`] | needle insertions as a user writes them, and their run |
//! | [`statics`] | static problems as a user writes them |
//! | [`beam_case`] | needles bent at their base as a user writes them |
//! | [`study`] | benchmarks, hard cases, and what made a pixel |
//! | [`text`] | text from files made fit for a terminal |
//! | [`output`] | PNG, image sequences, sidecars |
//!
//! # Axes and units
//!
//! Lengths are millimetres, angles radians in code and degrees in files, moduli kilopascals. The world is LPS as in DICOM
//! and ITK. The probe frame has its origin at the centre of the transducer array, x lateral towards the marked side,
//! y axial into the body, z = x cross y. Images have columns along x and rows along y (PLUS orientation MF).

pub mod beam_case;
pub mod document;
pub mod effects;
pub mod error;
pub mod gpu;
pub mod material_case;
pub mod mechanics;
pub mod memory;
pub mod output;
pub mod phantom;
pub mod plan;
pub mod quality;
pub mod random;
mod read;
pub mod real;
pub mod remesh_gpu;
pub mod scenario;
pub mod scene;
pub mod segmentation;
mod simd;
pub mod simulator;
pub mod statics;
pub mod study;
pub mod synth;
pub mod text;
pub mod tissue;
pub mod tracking;
pub mod volume;
