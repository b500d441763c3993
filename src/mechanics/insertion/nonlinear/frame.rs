//! Coordinates of a body in the world.

use nalgebra::{Point3, Vector3};

/// Origin and axes of a body's coordinates in the world; a body of two dimensions lies in their plane.
#[derive(Clone, Debug)]
pub(super) struct Frame<const D: usize> {
    pub origin: Point3<f64>,
    /// Unit vectors, square to each other.
    pub axes: [Vector3<f64>; D],
}

impl Frame<3> {
    /// The coordinates of the world.
    pub(super) fn world() -> Self {
        Frame {
            origin: Point3::origin(),
            axes: [Vector3::x(), Vector3::y(), Vector3::z()],
        }
    }
}

impl<const D: usize> Frame<D> {
    /// Coordinates of a point of the world, mm.
    pub(super) fn point(&self, world: &Point3<f64>) -> [f64; D] {
        self.vector(&(world - self.origin))
    }

    /// Components of a vector of the world.
    pub(super) fn vector(&self, world: &Vector3<f64>) -> [f64; D] {
        self.axes.map(|axis| axis.dot(world))
    }

    /// Vector of the world with these components.
    pub(super) fn in_world(&self, components: &[f64; D]) -> [f64; 3] {
        let parts = self
            .axes
            .iter()
            .zip(components)
            .map(|(axis, component)| axis * *component);
        parts.sum::<Vector3<f64>>().into()
    }

    /// Distance of a point of the world from the plane of the body, mm; 0 in three dimensions.
    pub(super) fn aside_mm(&self, world: &Point3<f64>) -> f64 {
        match D {
            2 => (world - self.origin).dot(&self.axes[0].cross(&self.axes[1])).abs(),
            _ => 0.0,
        }
    }
}
