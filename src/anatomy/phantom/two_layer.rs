//! Two-layer phantom of Dehghan et al. 2008 ("Phantom design"): a harder inclusion, a cylinder with a hemisphere at
//! each end, joined to the base by another cylinder, in a softer block of PVC with a hole that represents the rectum.
//!
//! Dehghan et al. 2008 give the shape, but no lengths; those here make the inclusion as large as a prostate and the
//! block deep enough for Dehghan et al.'s imaging depth of 75 mm. Rheometry gave 30 to 36 kPa for the inclusion
//! ("Discussion"). The needle enters at the lower (inferior) face along +z; the base is the anterior face.

use nalgebra::Matrix4;

use super::geometry::{Bounds, Point, Tube};
use super::paint::{Over, Painting};
use super::{Facts, UsualProbe, pose_at};
use crate::volume::{LabelVolume, VolumeError};

pub(super) mod labels {
    //! Label values of the two-layer phantom.
    crate::phantom::label_table! {
        SURROUNDING = 1 "phantom_top",
        INCLUSION = 2 "phantom_inclusion",
    }
}
use labels as l;

/// Half size of the block, mm.
const HALF_MM: [f64; 3] = [45.0, 40.0, 45.0];
/// Radius of the inclusion and half length of its cylinder, mm.
const INCLUSION_MM: [f64; 2] = [15.0, 10.0];
/// Radius of the cylinder that joins the inclusion to the base, mm.
const STEM_MM: f64 = 6.0;
/// Radius of the hole and its distance behind the inclusion's axis, mm.
const HOLE_MM: [f64; 2] = [9.0, 26.0];

/// Imaged on the face opposite to that where the needle enters (Dehghan et al. 2008, "Experimental setup").
pub(super) const PHANTOM: Facts = Facts {
    voxel_mm: 0.5,
    make,
    pose,
    probe: UsualProbe {
        kind: "linear",
        numbers: &[("width_mm", 38.0)],
        depth_mm: 75.0,
    },
};

fn make(resolution_mm: f64, _seed: u64) -> Result<LabelVolume, VolumeError> {
    let [radius, half_length] = INCLUSION_MM;
    let [hole_radius, hole_y] = HOLE_MM;
    let base = move |p: &Point| {
        let hole = p.x.hypot(p.y - hole_y) < hole_radius;
        if hole { 0 } else { l::SURROUNDING }
    };
    let mut painting = Painting::new(base, None);
    let inclusion = Tube {
        ends: [Point::new(0.0, 0.0, -half_length), Point::new(0.0, 0.0, half_length)],
        radii: [radius; 2],
    };
    let stem = Tube {
        ends: [Point::zeros(), Point::new(0.0, -2.0 * HALF_MM[1], 0.0)],
        radii: [STEM_MM; 2],
    };
    painting.add_all(&[inclusion, stem], 0.0, l::INCLUSION, Over::BODY);
    let half = Point::from(HALF_MM);
    painting.volume(&Bounds { min: -half, max: half }, resolution_mm, l::TABLE, "two-layer")
}

fn pose() -> Matrix4<f64> {
    pose_at(Point::new(0.0, 0.0, HALF_MM[2]), -Point::z(), Point::x())
}
