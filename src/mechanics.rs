//! Mechanics in f64: tetrahedral meshes, point location, and tissue that deforms.

pub mod insertion;
mod ldl;
pub mod mesh;
pub mod needle;
pub mod tissue;
