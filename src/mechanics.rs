//! Mechanics in f64, without wgpu: tetrahedral meshes and point location.
