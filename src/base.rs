//! Foundations without ultrasound: files, text, memory, numbers, reports.

pub mod cache;
pub mod cause;
pub mod csv;
pub mod document;
#[cfg(feature = "internals")]
pub mod lossy;
pub mod matrix;
pub mod memory;
pub mod output;
pub mod random;
pub mod range;
pub mod read;
pub mod real;
pub mod report;
#[cfg(feature = "cli")]
pub mod search;
pub mod simd;
pub mod text;
