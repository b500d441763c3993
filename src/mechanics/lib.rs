//! Mechanics in f64: tetrahedral meshes, point location, and deformable tissue.

pub mod block;
pub mod insertion;
mod ldl;
pub mod needle;
#[cfg(feature = "gpu")]
pub mod remesh_gpu;
pub mod tissue;
