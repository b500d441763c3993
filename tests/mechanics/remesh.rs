//! Remeshing at every level against the inverse of the stiffness assembled from the moved mesh.

mod accuracy;
mod drift;
mod insertion;
mod running;
mod sources;
mod support;
