//! Mechanics in f64: tetrahedral meshes, point location, and deformable tissue.

pub mod insertion;
mod ldl;
pub mod mesh;
pub mod needle;
pub mod remesh_gpu;
pub mod tissue;
