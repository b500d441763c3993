//! Abdomen of a slim adult in supine position, right side and middle, from the dome of the liver to below the navel.

mod digestive;
mod hepatic;
mod kidney;
mod wall;

use nalgebra::Matrix4;

use super::dent::Dent;
use super::geometry::{Bounds, Point, Uneven};
use super::paint::{Over, Painting};
use super::pose_at;
use crate::random::noise::Noise;
use crate::volume::{LabelVolume, VolumeError};

pub(super) mod labels {
    //! Label values of the abdomen.
    crate::phantom::label_table! {
        SKIN = 1 "skin",
        FAT = 2 "fat",
        FASCIA = 3 "fascia",
        MUSCLE = 4 "muscle",
        BONE = 5 "bone",
        CARTILAGE = 6 "cartilage",
        DIAPHRAGM = 7 "diaphragm",
        LUNG = 8 "lung",
        HEART = 9 "heart",
        PERITONEAL_FAT = 10 "peritoneal_fat",
        LIVER = 11 "liver",
        LESION = 12 "lesion",
        VESSEL = 13 "vessel",
        VESSEL_WALL = 14 "vessel_wall",
        BILE = 15 "bile",
        GALLBLADDER_WALL = 16 "gallbladder_wall",
        KIDNEY_CORTEX = 17 "kidney_cortex",
        KIDNEY_MEDULLA = 18 "kidney_medulla",
        RENAL_SINUS = 19 "renal_sinus",
        BOWEL_WALL = 20 "bowel_wall",
        BOWEL_CONTENT = 21 "bowel_content",
        GAS = 22 "gas",
        STOMACH_WALL = 23 "stomach_wall",
        PANCREAS = 24 "pancreas",
        DISC = 25 "disc",
        CSF = 26 "csf",
        EPIDURAL_FAT = 27 "epidural_fat",
        LIGAMENT = 28 "ligament",
    }
}
use labels as l;

/// Radius of the probe of the default pose, mm.
const PROBE_RADIUS_MM: f64 = 60.0;
/// Indentation of the skin by that probe, mm.
const PRESSED_MM: f64 = 11.0;

pub(super) fn make(resolution_mm: f64, seed: u64) -> Result<LabelVolume, VolumeError> {
    let wall = wall::Wall::new(seed);
    let dent = Dent::new(&pose(), PROBE_RADIUS_MM, 1.6 * PRESSED_MM, wall::skin_depth);
    let mut painting = Painting::new(move |p: &Point| wall.label(p), Some(dent));
    digestive::add(&mut painting, seed);
    hepatic::add(&mut painting, seed);
    kidney::add(&mut painting, seed);
    let world = Bounds {
        min: Point::new(-160.0, -106.0, -130.0),
        max: Point::new(80.0, 94.0, 98.0),
    };
    painting.volume(&world, resolution_mm, l::TABLE)
}

/// Right subcostal oblique view, as used for the gallbladder: liver in front of it, great vessels and the spine to the
/// patient's left, the right kidney below; the marked side points to the patient's left and head.
pub(super) fn pose() -> Matrix4<f64> {
    let axial = Point::new(0.148, 0.962, 0.229).normalize();
    let mut skin = Point::new(-75.0, -122.0, -57.0);
    while wall::skin_depth(&skin) < 0.0 {
        skin += axial * 0.05;
    }
    pose_at(skin + axial * PRESSED_MM, axial, Point::new(0.661, -0.268, 0.701))
}
