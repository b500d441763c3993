//! Foundations without ultrasound: files, text, memory, threads, numbers.

pub mod bending;
pub mod blame;
pub mod border;
pub mod cache;

pub mod csv;
pub mod dicom;
pub mod document;
pub mod foreign;
pub mod kinds;
pub mod machine;
pub mod matrix;
pub mod memory;
pub mod note;
pub mod number;
pub mod output;
pub mod parallel;
pub mod pareto;
pub mod random;
pub mod range;
pub mod read;
pub mod real;
pub mod simd;
pub mod stage;
pub mod statistics;
pub mod table;
pub mod text;

/// Version of this release, which all crates share: part of what is cached and written.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
