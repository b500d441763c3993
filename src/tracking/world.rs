//! World axes of stated coordinates.

use std::fmt;

use nalgebra::Matrix4;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// World axes in which a file states coordinates. All computations use LPS.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum World {
    /// x to the patient's left, y to the back, z to the head, as in DICOM and ITK.
    #[default]
    Lps,
    /// x to the patient's right, y to the front, z to the head, as in 3D Slicer.
    Ras,
}

impl World {
    /// Converts a point or direction from this world to LPS, or back: the same half turn about z.
    pub fn vector(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Lps => [x, y, z],
            Self::Ras => [-x, -y, z],
        }
    }

    /// Converts a transform to this world into one to LPS, or back.
    pub fn transform(self, mut matrix: Matrix4<f64>) -> Matrix4<f64> {
        if self == Self::Ras {
            matrix.fixed_rows_mut::<2>(0).neg_mut();
        }
        matrix
    }

    /// Returns the other world.
    pub fn other(self) -> Self {
        match self {
            Self::Lps => Self::Ras,
            Self::Ras => Self::Lps,
        }
    }
}

impl fmt::Display for World {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Lps => "LPS",
            Self::Ras => "RAS",
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;

    #[test]
    fn points_and_transforms_turn_together() {
        let place =
            Matrix4::new_rotation(Vector3::new(0.1, 0.2, 0.3)) * Matrix4::new_translation(&Vector3::new(1.0, 2.0, 3.0));
        let point = Point3::new(4.0, 5.0, 6.0);
        for world in [World::Lps, World::Ras] {
            let moved = place.transform_point(&point);
            assert_eq!(
                world.transform(place).transform_point(&point),
                Point3::from(world.vector(moved.into()))
            );
            assert_eq!(world.transform(world.transform(place)), place);
            assert_eq!(world.other().other(), world);
        }
        assert_eq!(World::Ras.vector([1.0, 2.0, 3.0]), [-1.0, -2.0, 3.0]);
    }
}
