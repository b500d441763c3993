//! Abdomen of a slim adult in supine position, right side and middle, from the dome of the liver to below the navel.

mod hepatic;
mod wall;

use std::sync::LazyLock;

use labels as l;
use nalgebra::Matrix4;

use super::geometry::{Bounds, Point, Uneven};
use super::paint::{Dent, Over, Painting};
use super::{Facts, UsualProbe, pose_at};
use crate::phantom::geometry::{Ellipsoid, Shape, Solid, Tube, frame, path, smooth_max, smooth_min};
use crate::volume::{LabelVolume, VolumeError};
use insonify_base::random::noise::{Noise, choice};

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

/// Radius of the probe of the default pose, mm.
const PROBE_RADIUS_MM: f64 = 60.0;
/// Indentation of the skin by that probe, mm.
const PRESSED_MM: f64 = 11.0;

/// Imaged from right subcostal and oblique to the sagittal plane, feet on the right of the image: liver with its
/// vessels, gallbladder and right kidney, a rib's shadow at the left edge. The skin bears the dent of this probe.
pub(super) const PHANTOM: Facts = Facts {
    voxel_mm: 1.0,
    make,
    pose,
    probe: UsualProbe {
        kind: "curvilinear",
        numbers: &[("radius_mm", PROBE_RADIUS_MM), ("angle_deg", 70.0)],
        depth_mm: 150.0,
    },
};

fn make(resolution_mm: f64, seed: u64) -> Result<LabelVolume, VolumeError> {
    let wall = wall::Wall::new(seed);
    let dent = Dent::new(&pose(), PROBE_RADIUS_MM, 1.6 * PRESSED_MM, wall::skin_depth);
    let mut painting = Painting::new(move |p: &Point| wall.label(p), Some(dent));
    digestive_tract(&mut painting, seed);
    hepatic::add(&mut painting, seed);
    kidney(&mut painting, seed);
    let world = Bounds {
        min: Point::new(-160.0, -106.0, -130.0),
        max: Point::new(80.0, 94.0, 98.0),
    };
    painting.volume(&world, resolution_mm, l::TABLE, &format!("abdomen {seed}"))
}

/// Right subcostal oblique view, as used for the gallbladder: liver in front of it, great vessels and the spine to the
/// patient's left, the right kidney below; the marked side points to the patient's left and head.
fn pose() -> Matrix4<f64> {
    let axial = Point::new(0.148, 0.962, 0.229).normalize();
    let mut skin = Point::new(-75.0, -122.0, -57.0);
    while wall::skin_depth(&skin) < 0.0 {
        skin += axial * 0.05;
    }
    pose_at(skin + axial * PRESSED_MM, axial, Point::new(0.661, -0.268, 0.701))
}

// Stomach, pancreas, bowel with its gas, and the heart above the diaphragm.

/// Thickness of the bowel wall, mm.
const BOWEL_WALL_MM: f64 = 2.2;
/// Thickness of the stomach wall, mm.
const STOMACH_WALL_MM: f64 = 4.0;

/// Adds the organs. Gas lies anteriorly, where it rises to in the supine position.
fn digestive_tract<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let free = Over::only(&[l::PERITONEAL_FAT]);
    let heart = Ellipsoid::upright([26.0, -24.0, 96.0], [52.0, 38.0, 38.0]);
    painting.add(heart, 0.0, l::HEART, Over::only(&[l::LUNG]));

    let pancreas = path(
        &[
            ([-24.0, -4.0, -44.0], 9.0),
            ([-20.0, -4.0, -28.0], 12.0),
            ([0.0, -10.0, -14.0], 8.5),
            ([30.0, -8.0, -2.0], 8.0),
            ([66.0, 12.0, 12.0], 7.5),
            ([90.0, 26.0, 20.0], 6.0),
        ],
        4,
    );
    for (i, piece) in pancreas.into_iter().enumerate() {
        // Neighbouring pieces take different noise: the surface breaks where they join, as between lobules.
        let lobulated = Uneven {
            shape: piece,
            noise: Noise::new(seed, 50 + (i as u32 & 1), 7.0),
            amplitude_mm: 1.2,
        };
        painting.add(lobulated, 0.0, l::PANCREAS, free);
    }

    let stomach = path(
        &[
            ([92.0, 0.0, 52.0], 30.0),
            ([72.0, -22.0, 20.0], 26.0),
            ([48.0, -42.0, -14.0], 18.0),
            ([14.0, -46.0, -26.0], 14.0),
            ([-14.0, -32.0, -24.0], 11.0),
            ([-32.0, -18.0, -22.0], 8.0),
        ],
        5,
    );
    // The wall is painted solid and then hollowed by the same shape, less its thickness: content cannot break
    // through it. Gas takes content only, so that the wall cuts the bubble off.
    painting.add_all(&stomach, 0.0, l::STOMACH_WALL, free);
    painting.add_all(
        &stomach,
        -STOMACH_WALL_MM,
        l::BOWEL_CONTENT,
        Over::only(&[l::STOMACH_WALL]),
    );
    let bubble = Ellipsoid::upright([72.0, -44.0, 24.0], [34.0, 14.0, 30.0]);
    painting.add(bubble, 0.0, l::GAS, Over::only(&[l::BOWEL_CONTENT]));

    let duodenum = path(
        &[
            ([-34.0, -16.0, -20.0], 9.0),
            ([-44.0, 0.0, -26.0], 10.0),
            ([-42.0, 8.0, -52.0], 10.5),
            ([-32.0, 6.0, -66.0], 10.5),
            ([0.0, 0.0, -66.0], 10.0),
            ([28.0, 0.0, -54.0], 10.0),
        ],
        5,
    );
    // A loop takes only fat that is left: duodenum and colon, which are fixed, come before the small bowel.
    loop_of_bowel(painting, &duodenum, 0.25, seed, 60);
    let colon = path(
        &[
            ([-104.0, 22.0, -135.0], 22.0),
            ([-104.0, 14.0, -104.0], 21.0),
            ([-98.0, -22.0, -92.0], 19.0),
            ([-70.0, -46.0, -104.0], 18.0),
            ([-30.0, -54.0, -92.0], 17.0),
            ([20.0, -54.0, -78.0], 17.0),
            ([62.0, -46.0, -62.0], 17.0),
            ([100.0, -30.0, -40.0], 17.0),
        ],
        6,
    );
    loop_of_bowel(painting, &colon, 0.62, seed, 70);
    for (i, course) in small_bowel(seed).iter().enumerate() {
        loop_of_bowel(painting, course, 0.35, seed, 80 + i as u32);
    }
}

/// Wall, content, and gas in a fraction of the segments.
fn loop_of_bowel<B: Fn(&Point) -> u8 + Sync>(
    painting: &mut Painting<B>,
    course: &[Tube],
    gas_share: f64,
    seed: u64,
    stream: u32,
) {
    painting.add_all(course, 0.0, l::BOWEL_WALL, Over::only(&[l::PERITONEAL_FAT]));
    let lumen = Over::only(&[l::BOWEL_WALL]);
    painting.add_all(course, -BOWEL_WALL_MM, l::BOWEL_CONTENT, lumen);
    for (i, piece) in course.iter().enumerate() {
        if choice(seed, stream, [i as i32, 0]) < gas_share {
            let [a, b] = piece.ends;
            let radius = 0.5 * (piece.radii[0] + piece.radii[1]);
            let reach = (0.5 * (b - a).norm() + 2.0).max(0.5 * radius);
            let middle = (a + b) / 2.0;
            let pocket = Ellipsoid::upright(
                [middle.x, middle.y - 0.42 * radius, middle.z],
                [reach, 0.45 * radius, reach],
            );
            painting.add(pocket, 0.0, l::GAS, Over::only(&[l::BOWEL_CONTENT]));
        }
    }
}

/// Hairpin loops of small bowel below the pancreas and behind the transverse colon.
fn small_bowel(seed: u64) -> Vec<Vec<Tube>> {
    [[-32.0, -70.0], [-6.0, -96.0], [-36.0, -116.0], [-10.0, -136.0]]
        .iter()
        .enumerate()
        .map(|(row, [y, z])| {
            let jitter = |i: i32, which: i32| 9.0 * (choice(seed, 90 + row as u32, [i, which]) - 0.5);
            let knots: Vec<([f64; 3], f64)> = (0..16)
                .map(|i| {
                    let limb = i / 2;
                    let up = (i % 2 == 0) == (limb % 2 == 0);
                    let x = -58.0 + 23.0 * f64::from(limb);
                    let along = if up { 15.0 } else { -15.0 };
                    ([x + jitter(i, 0), y + jitter(i, 1), z + along + jitter(i, 2)], 11.5)
                })
                .collect();
            path(&knots, 3)
        })
        .collect()
}

// The right kidney: cortex, medullary pyramids around the sinus, and the vessels at its hilum.

/// Centre of the kidney, mm.
const KIDNEY_CENTRE: [f64; 3] = [-60.0, 33.0, -40.0];
/// Half length, half width (towards the hilum) and half thickness, mm.
const HALF_MM: [f64; 3] = [54.0, 27.0, 22.0];
/// Half angle of a pyramid at the centre of the kidney, in its coordinates scaled to a sphere, radians.
const PYRAMID_RAD: f64 = 0.32;
/// Angles of the pyramids around the hilum's axis, degrees from the hilum, in each of two rows.
const PYRAMIDS_DEG: [f64; 7] = [52.0, 88.0, 128.0, 180.0, 232.0, 272.0, 308.0];

/// Outline without the hilum.
pub(super) static KIDNEY: LazyLock<Ellipsoid> = LazyLock::new(|| Ellipsoid {
    centre: Point::from(KIDNEY_CENTRE),
    axes: frame(Point::new(0.20, -0.12, 1.0), Point::new(0.85, -0.5, 0.0)),
    radii: HALF_MM,
});

fn sinus() -> Ellipsoid {
    let body = *KIDNEY;
    Ellipsoid {
        centre: body.centre + body.axes[1] * 9.0,
        radii: [23.0, 13.0, 6.5],
        ..body
    }
}

/// Signed distance of the pyramids: cones from the centre, between sinus and cortex.
fn pyramids(p: &Point) -> f64 {
    let body = *KIDNEY;
    let local = body.local(p);
    let level = local.norm();
    let nearest = PYRAMIDS_DEG
        .iter()
        .flat_map(|deg| {
            let (sin, cos) = deg.to_radians().sin_cos();
            [-0.42, 0.42].map(|row| Point::new(sin, cos, row))
        })
        .chain(
            [-0.6, 0.0, 0.6]
                .into_iter()
                .flat_map(|along| [-1.0, 1.0].map(|row| Point::new(along, -0.1, row))),
        )
        .map(|axis| {
            let axis = axis.normalize();
            (local.dot(&axis) / level.max(1e-9)).clamp(-1.0, 1.0).acos()
        })
        .fold(f64::INFINITY, f64::min);
    let scale = HALF_MM[2];
    let cone = (nearest - PYRAMID_RAD * (1.15 - 0.25 * level)) * level * scale;
    smooth_max(
        smooth_max(cone, (level - 0.79) * scale, 4.0),
        1.2 - sinus().distance(p),
        2.0,
    )
}

/// Adds the kidney with its renal vein.
fn kidney<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let body = *KIDNEY;
    let bounds = body.bounds();
    let hilum = body.centre + body.axes[1] * 30.0;
    let notch = Ellipsoid {
        centre: hilum,
        radii: [16.0, 10.0, 9.0],
        ..body
    };
    let kidney = Uneven {
        shape: Solid {
            bounds: Bounds { ..bounds },
            distance: move |p: &Point| smooth_max(body.distance(p), -notch.distance(p), 5.0),
        },
        noise: Noise::new(seed, 30, 22.0),
        amplitude_mm: 1.0,
    };
    let room = Over::only(&[
        l::PERITONEAL_FAT,
        l::MUSCLE,
        l::LIVER,
        l::BOWEL_WALL,
        l::BOWEL_CONTENT,
        l::GAS,
    ]);
    // The fat capsule first clears liver, muscle and bowel; the kidney takes only fat, and a rim remains.
    painting.add(Ellipsoid { ..body }, 4.0, l::PERITONEAL_FAT, room);
    painting.add(kidney, 0.0, l::KIDNEY_CORTEX, Over::only(&[l::PERITONEAL_FAT]));
    let cortex = Over::only(&[l::KIDNEY_CORTEX]);
    painting.add(
        Solid {
            bounds,
            distance: pyramids,
        },
        0.0,
        l::KIDNEY_MEDULLA,
        cortex,
    );
    // The sinus alone would be closed all round; it opens at the hilum, where vessels enter.
    let opening = Ellipsoid {
        centre: body.centre + body.axes[1] * 20.0,
        radii: [12.0, 12.0, 6.0],
        ..body
    };
    let core = sinus();
    painting.add(
        Uneven {
            shape: Solid {
                bounds,
                distance: move |p: &Point| smooth_min(core.distance(p), opening.distance(p), 4.0),
            },
            noise: Noise::new(seed, 31, 8.0),
            amplitude_mm: 1.8,
        },
        0.0,
        l::RENAL_SINUS,
        Over::only(&[l::KIDNEY_CORTEX, l::KIDNEY_MEDULLA]),
    );
    let vein = path(
        &[
            ([-21.0, 20.0, -32.0], 4.5),
            ([-34.0, 18.0, -36.0], 4.2),
            ([hilum.x, hilum.y, hilum.z], 3.6),
            ([hilum.x - 8.0, hilum.y + 5.0, hilum.z + 2.0], 2.4),
        ],
        4,
    );
    let course = Over::only(&[
        l::PERITONEAL_FAT,
        l::RENAL_SINUS,
        l::KIDNEY_CORTEX,
        l::VESSEL_WALL,
        l::BOWEL_WALL,
    ]);
    painting.add_all(&vein, 0.0, l::VESSEL, course);
}
