//! Mechanics in f64: deformable tissue, needles, insertions, remeshing.

pub mod block;
pub mod insertion;
mod ldl;
pub mod needle;
#[cfg(feature = "gpu")]
pub mod remesh_gpu;
pub mod tissue;
