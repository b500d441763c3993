//! The frame of a contact node: three orthonormal axes, so that needle contacts read (axial, lateral, lateral) and probe
//! contacts (axial, radial, tangential).

use nalgebra::Vector3;

/// The largest deviation from orthonormal axes that counts as rounding of the caller's.
pub const AXES_TOLERANCE: f64 = 1e-6;

/// Orthonormal, right-handed axes of a node, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    axes: [[f64; 3]; 3],
}

/// Why three vectors are no frame.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum InvalidFrame {
    /// A component is not finite.
    #[error("axis {axis} of a frame is {found:?}; expected finite components")]
    NotFinite {
        /// The axis, 0 to 2.
        axis: usize,
        /// As given.
        found: [f64; 3],
    },
    /// The axes are not unit vectors at right angles.
    #[error(
        "axes {first} and {second} of a frame have the product {found}; expected {}, to {AXES_TOLERANCE}",
        if .first == .second { "1 (unit length)" } else { "0 (right angles)" }
    )]
    NotOrthonormal {
        /// One axis, 0 to 2.
        first: usize,
        /// The other, or the same.
        second: usize,
        /// Their inner product.
        found: f64,
    },
    /// The axes are a mirror image of a rotation.
    #[error("the axes of a frame are left-handed: axis 2 must be the cross product of axes 0 and 1")]
    LeftHanded,
    /// A direction has no length.
    #[error("the direction {found:?} has no length")]
    NoDirection {
        /// As given.
        found: [f64; 3],
    },
}

impl Frame {
    /// The axes of the world.
    pub const WORLD: Frame = Frame {
        axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };

    /// A frame of these axes, in world coordinates: the columns of the rotation R from the frame to the world. Deviations of
    /// up to [`AXES_TOLERANCE`] are removed (Gram and Schmidt, first axis first).
    ///
    /// # Errors
    /// [`InvalidFrame`], naming the axes.
    pub fn new(axes: [[f64; 3]; 3]) -> Result<Self, InvalidFrame> {
        let vectors = axes.map(Vector3::from);
        if let Some(axis) = (0..3).find(|&axis| !axes[axis].iter().all(|x| x.is_finite())) {
            let found = axes[axis];
            return Err(InvalidFrame::NotFinite { axis, found });
        }
        for first in 0..3 {
            for second in first..3 {
                let found = vectors[first].dot(&vectors[second]);
                let expected = if first == second { 1.0 } else { 0.0 };
                if (found - expected).abs() > AXES_TOLERANCE {
                    return Err(InvalidFrame::NotOrthonormal { first, second, found });
                }
            }
        }
        if vectors[0].cross(&vectors[1]).dot(&vectors[2]) < 0.0 {
            return Err(InvalidFrame::LeftHanded);
        }
        let first = vectors[0].normalize();
        let second = (vectors[1] - first * first.dot(&vectors[1])).normalize();
        Ok(Self::of([first, second, first.cross(&second)]))
    }

    /// A frame whose first axis is along `direction` (any length), the two lateral ones chosen by a fixed rule: the second
    /// is at right angles to the world axis that the direction is farthest from.
    ///
    /// # Errors
    /// [`InvalidFrame`] when the direction has no length or is not finite.
    pub fn along(direction: [f64; 3]) -> Result<Self, InvalidFrame> {
        if !direction.iter().all(|x| x.is_finite()) {
            let found = direction;
            return Err(InvalidFrame::NotFinite { axis: 0, found });
        }
        // Scaled first, so that no square overflows or vanishes.
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

    /// The axes, in world coordinates.
    pub fn axes(&self) -> &[[f64; 3]; 3] {
        &self.axes
    }

    /// A world vector in this frame: R^T v.
    pub fn to_frame(&self, vector: [f64; 3]) -> [f64; 3] {
        self.axes
            .map(|axis| axis[0] * vector[0] + axis[1] * vector[1] + axis[2] * vector[2])
    }

    /// A vector of this frame in the world: R v.
    pub fn to_world(&self, vector: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = &self.axes;
        std::array::from_fn(|i| a[i] * vector[0] + b[i] * vector[1] + c[i] * vector[2])
    }
}

#[cfg(test)]
mod tests;
