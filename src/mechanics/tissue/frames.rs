//! Contact frames: three orthonormal axes of a node, so that needle contacts read (axial, lateral, lateral) and probe
//! contacts (axial, radial, tangential).

use nalgebra::Vector3;

/// Orthonormal, right-handed axes of a node, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    axes: [[f64; 3]; 3],
}

/// Why three vectors are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum InvalidFrame {
    /// A component is not finite.
    #[error("axis {axis} of a frame is {found:?}; expected finite components")]
    NotFinite {
        /// Index of the axis, 0 to 2.
        axis: usize,
        /// Components given.
        found: [f64; 3],
    },
    /// A direction has zero length.
    #[error("the direction {found:?} has no length")]
    NoDirection {
        /// Vector given.
        found: [f64; 3],
    },
}

impl Frame {
    /// World axes.
    pub const WORLD: Frame = Frame {
        axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };

    /// Creates a frame whose first axis is along `direction` (any length). The second axis is at right angles to the
    /// world axis that is farthest from the direction.
    ///
    /// # Errors
    /// [`InvalidFrame`] when the direction has zero length or is not finite.
    pub fn along(direction: [f64; 3]) -> Result<Self, InvalidFrame> {
        if !direction.iter().all(|x| x.is_finite()) {
            let found = direction;
            return Err(InvalidFrame::NotFinite { axis: 0, found });
        }
        // Scaled first, so that no square overflows or underflows.
        let vector = Vector3::from(direction);
        let first = (vector / vector.amax()).normalize();
        if !first.iter().all(|x| x.is_finite()) {
            return Err(InvalidFrame::NoDirection { found: direction });
        }
        let farthest = first.iamin();
        let mut world = Vector3::zeros();
        world[farthest] = 1.0;
        let second = world.cross(&first).normalize();
        Ok(Self::of([first, second, first.cross(&second)]))
    }

    fn of(axes: [Vector3<f64>; 3]) -> Self {
        Self {
            axes: axes.map(Into::into),
        }
    }

    /// Axes in world coordinates.
    #[cfg(test)]
    pub fn axes(&self) -> &[[f64; 3]; 3] {
        &self.axes
    }

    /// Converts a world vector to this frame: R^T v.
    pub fn to_frame(&self, vector: [f64; 3]) -> [f64; 3] {
        self.axes
            .map(|axis| axis[0] * vector[0] + axis[1] * vector[1] + axis[2] * vector[2])
    }

    /// Converts a vector of this frame to the world: R v.
    #[cfg(test)]
    pub fn to_world(&self, vector: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = &self.axes;
        std::array::from_fn(|i| a[i] * vector[0] + b[i] * vector[1] + c[i] * vector[2])
    }
}

#[cfg(test)]
mod tests;
