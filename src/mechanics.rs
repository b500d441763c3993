//! Mechanics in f64: tetrahedral meshes and point location.

pub mod mesh;
