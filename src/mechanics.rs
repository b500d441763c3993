//! Mechanics in f64: tetrahedral meshes, point location, and deformable tissue.

pub mod insertion;
mod ldl;
pub mod lists;
pub mod mesh;
pub mod needle;
#[cfg(feature = "gpu")]
pub mod remesh_gpu;
pub mod tissue;
