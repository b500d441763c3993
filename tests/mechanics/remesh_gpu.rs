//! Remeshing on a GPU: its passes as declared, and parity with the CPU.

mod declarations;
mod insertion;
mod remesh;
mod remesh_support;
