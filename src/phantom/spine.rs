//! The lumbar spine from L2 to L5 with the back behind it. The origin lies in front of the canal, midway between L3 and L4.

mod vertebra;

use nalgebra::Matrix4;

use super::dent::Dent;
use super::geometry::{Bounds, Point, path, step};
use super::paint::{Over, Painting};
use super::pose_at;
use crate::random::noise::Noise;
use crate::volume::{LabelVolume, VolumeError};

pub(super) mod labels {
    //! Label values of the spine phantom.
    crate::phantom::label_table! {
        SKIN = 1 "skin",
        FAT = 2 "fat",
        FASCIA = 3 "fascia",
        MUSCLE = 4 "muscle",
        BONE = 5 "bone",
        CARTILAGE = 6 "cartilage",
        DISC = 7 "disc",
        LIGAMENT = 8 "ligament",
        EPIDURAL_FAT = 9 "epidural_fat",
        CSF = 10 "csf",
        NERVE = 11 "nerve",
        VESSEL = 12 "vessel",
        VESSEL_WALL = 13 "vessel_wall",
        PERITONEAL_FAT = 14 "peritoneal_fat",
    }
}
use labels as l;

/// Radius of the probe of the default pose, mm.
const PROBE_RADIUS_MM: f64 = 60.0;
/// Indentation of the skin by that probe, mm.
const PRESSED_MM: f64 = 7.0;
/// Distance between the centres of neighbouring vertebrae, mm.
const LEVEL_MM: f64 = 36.0;

/// Anterior offset of the spine by the lordosis at a height, mm.
fn lordosis(z: f64) -> f64 {
    7.0 - 0.0021 * (z + 4.0).powi(2)
}

/// Depth below the undented skin of the back, mm: a furrow over the spinous processes between the muscles.
fn skin_depth(p: &Point) -> f64 {
    let furrow = 4.5 * (-(p.x / 15.0).powi(2)).exp();
    let back = 58.0 - 0.0020 * p.x * p.x - furrow - 0.75 * lordosis(p.z);
    let slope = (1.0 + (0.004 * p.x).powi(2)).sqrt();
    (back - p.y) / slope
}

/// Skin, fat, fascia, the columns of the back muscles, and the tissue in front of them.
fn surroundings(p: &Point, fat: &Noise, septa: &Noise) -> u8 {
    let depth = skin_depth(p);
    if depth <= 0.0 {
        return 0;
    }
    if depth < 2.2 {
        return l::SKIN;
    }
    let layer = 8.0 + 4.0 * step(0.0, -85.0, p.z) + 1.5 * fat.at(p);
    if depth < 2.2 + layer {
        return l::FAT;
    }
    if depth < 2.2 + layer + 1.6 {
        return l::FASCIA;
    }
    let x = p.x.abs();
    let y = p.y + lordosis(p.z);
    let inside = |cx: f64, cy: f64, rx: f64, ry: f64| ((x - cx) / rx).powi(2) + ((y - cy) / ry).powi(2);
    if x < 14.0 && y > -12.0 && y < 13.0 - 0.3 * x {
        return l::EPIDURAL_FAT;
    }
    let column = inside(36.0, 24.0, 38.0, 32.0);
    if column < 1.0 || (x < 20.0 && y > 4.0) {
        // Fat planes: multifidus from longissimus, longissimus from iliocostalis.
        let bend = 2.5 * septa.at(p);
        let plane =
            (x - 21.0 - 0.25 * (y - 20.0) - bend).abs() < 0.6 || (x - 46.0 + 0.2 * (y - 20.0) - bend).abs() < 0.6;
        return if column > 0.95 && x > 20.0 {
            l::FASCIA
        } else if plane {
            l::FAT
        } else {
            l::MUSCLE
        };
    }
    if inside(58.0, -10.0, 17.0, 8.0) < 1.0 || inside(43.0, -30.0, 19.0, 20.0) < 1.0 {
        return l::MUSCLE;
    }
    l::PERITONEAL_FAT
}

pub(super) fn make(resolution_mm: f64, seed: u64) -> Result<LabelVolume, VolumeError> {
    let (fat, septa) = (Noise::new(seed, 200, 35.0), Noise::new(seed, 201, 25.0));
    let dent = Dent::new(&pose(), PROBE_RADIUS_MM, 1.6 * PRESSED_MM, skin_depth);
    let mut painting = Painting::new(move |p: &Point| surroundings(p, &fat, &septa), Some(dent));
    great_vessels(&mut painting);
    for level in -1..=4 {
        let z = LEVEL_MM * (1.5 - f64::from(level));
        vertebra::add(&mut painting, z, seed, level);
    }
    vertebra::canal(&mut painting, seed);
    let world = Bounds {
        min: Point::new(-80.0, -65.0, -85.0),
        max: Point::new(80.0, 65.0, 85.0),
    };
    painting.volume(&world, resolution_mm, l::TABLE)
}

pub(super) fn pose() -> Matrix4<f64> {
    let axial = -Point::y();
    let mut skin = Point::new(-13.0, 70.0, 0.0);
    while skin_depth(&skin) < 0.0 {
        skin += axial * 0.05;
    }
    pose_at(skin + axial * PRESSED_MM, axial, -Point::z())
}

/// Aorta and inferior vena cava in front of the bodies.
fn great_vessels<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>) {
    let at = |x: f64, radius: f64| {
        path(
            &[
                ([x, -56.0 - lordosis(-90.0), -95.0], radius),
                ([x, -56.0 - lordosis(0.0), 0.0], radius),
                ([x, -56.0 - lordosis(90.0), 95.0], radius),
            ],
            6,
        )
    };
    for (course, wall) in [(at(12.0, 8.5), 1.5), (at(-14.0, 10.0), 0.8)] {
        painting.add_all(
            &course,
            wall,
            l::VESSEL_WALL,
            Over::only(&[l::PERITONEAL_FAT, l::MUSCLE]),
        );
        painting.add_all(
            &course,
            0.0,
            l::VESSEL,
            Over::only(&[l::VESSEL_WALL, l::PERITONEAL_FAT]),
        );
    }
}
