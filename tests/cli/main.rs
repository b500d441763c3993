//! The `insonify` command from outside: what others script against.

mod adapters;
mod bad_input;
mod beam;
mod beam_measure;
mod calibrate;
mod far;
mod frames;
mod golden;
#[path = "../support/gpu.rs"]
#[allow(dead_code, reason = "each test binary uses its own part of what is shared")]
mod gpu;
mod hostile_text;
mod insert;
mod insert_far;
mod insert_ready;
mod manipulator;
mod matching;
mod material;
mod mesh_make;
mod meshes;
mod outputs;
mod path;
mod quality;
mod realism;
mod reports;
mod rf;
mod seeds;
mod segmentations;
mod solve;
mod stability;
mod support;
mod tissue;
mod tradeoff;
mod training;
