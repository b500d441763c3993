//! Exposed liver with its inferior vena cava across the image, after the in-vivo experiment of Kobayashi et al. 2010
//! (section 4.2.1): the needle enters beside the probe through the capsule and reaches the vein.
//!
//! Kobayashi et al. 2010 state no lengths; a cava of 22 x 13 mm, its centre 28 mm below the capsule, is that of a pig
//! or a slim adult. The capsule is the plane y = 0; the region above it, where the rim of a curved probe does not reach
//! the liver, is background, as of saline.

use nalgebra::Matrix4;

use super::geometry::{Bounds, Point};
use super::paint::Painting;
use super::{Facts, UsualProbe, pose_at};
use crate::volume::{LabelVolume, VolumeError};

pub(super) mod labels {
    //! Label values of the liver with a vein.
    crate::phantom::label_table! {
        LIVER = 1 "liver",
        VESSEL = 2 "vessel",
    }
}
use labels as l;

/// Corners of the volume, mm.
const BOX_MM: [[f64; 3]; 2] = [[-60.0, -10.0, -24.0], [50.0, 64.0, 24.0]];
/// Centre of the vein in its cross-section (x, y), and its half axes, mm.
const VEIN_MM: [[f64; 2]; 2] = [[-4.0, 28.0], [11.0, 6.5]];
/// Position of the array's centre, just above the capsule, mm.
const ARRAY_MM: [f64; 2] = [-10.0, -0.5];

/// Imaged on the capsule, the vein across the image.
pub(super) const PHANTOM: Facts = Facts {
    voxel_mm: 0.5,
    make,
    pose,
    probe: UsualProbe {
        kind: "curvilinear",
        numbers: &[("radius_mm", 20.0), ("angle_deg", 75.0)],
        depth_mm: 62.0,
    },
};

fn make(resolution_mm: f64, _seed: u64) -> Result<LabelVolume, VolumeError> {
    let [middle, half] = VEIN_MM;
    let base = move |p: &Point| {
        let across = ((p.x - middle[0]) / half[0]).hypot((p.y - middle[1]) / half[1]);
        match p.y {
            y if y < 0.0 => 0,
            _ if across < 1.0 => l::VESSEL,
            _ => l::LIVER,
        }
    };
    let [min, max] = BOX_MM.map(Point::from);
    Painting::new(base, None).volume(&Bounds { min, max }, resolution_mm, l::TABLE, "liver-vein")
}

fn pose() -> Matrix4<f64> {
    let [x, y] = ARRAY_MM;
    pose_at(Point::new(x, y, 0.0), Point::y(), Point::x())
}
