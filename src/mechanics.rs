//! Mechanics in f64: tetrahedral meshes, point location, and tissue that deforms.

pub mod mesh;
pub mod tissue;
