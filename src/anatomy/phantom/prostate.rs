//! Male pelvis around the prostate, from the perineum to the bladder. The origin is the centre of the gland, the
//! rectum lies behind it with gel around the position of a transrectal probe.

use nalgebra::Matrix4;

use super::geometry::{Block, Bounds, Ellipsoid, Point, Shape, Solid, Tube, Uneven, path, smooth_max, step};
use super::paint::{Over, Painting};
use super::{Facts, UsualProbe, pose_at};
use crate::volume::{LabelVolume, VolumeError};
use insonify_base::random::noise::Noise;

pub(super) mod labels {
    //! Label values of the prostate phantom.
    crate::phantom::label_table! {
        SKIN = 1 "skin",
        FAT = 2 "fat",
        FASCIA = 3 "fascia",
        MUSCLE = 4 "muscle",
        BONE = 5 "bone",
        CARTILAGE = 6 "cartilage",
        PROSTATE_PERIPHERAL = 7 "prostate_peripheral",
        PROSTATE_CENTRAL = 8 "prostate_central",
        CAPSULE = 9 "capsule",
        URETHRA = 10 "urethra",
        SEMINAL_VESICLE = 11 "seminal_vesicle",
        BLADDER_WALL = 12 "bladder_wall",
        URINE = 13 "urine",
        RECTUM_WALL = 14 "rectum_wall",
        GEL = 15 "gel",
        VESSEL = 16 "vessel",
        NERVE = 17 "nerve",
        LESION = 18 "lesion",
        SOFT_TISSUE = 19 "soft_tissue",
    }
}
use labels as l;

/// Half width, half depth (front to back) and half length of the gland, mm: 34 ml.
const GLAND_MM: [f64; 3] = [24.0, 16.0, 21.0];
/// Thickness of the capsule, mm.
const CAPSULE_MM: f64 = 0.9;
/// Distance of the rectum's axis behind the centre of the gland, mm.
const RECTUM_Y_MM: f64 = 31.0;
/// Radius of the rectum's lumen and thickness of its wall, mm.
const RECTUM_MM: [f64; 2] = [11.2, 3.4];
/// Radius of the transrectal probe of the default pose, mm.
const PROBE_RADIUS_MM: f64 = 10.0;

/// Depth above the perineal skin, mm.
fn skin_depth(p: &Point) -> f64 {
    let cleft = 5.0 * (-(p.x / 9.0).powi(2)).exp() * step(10.0, 40.0, p.y);
    0.94 * (p.z + 53.0 - 0.0028 * p.x * p.x - cleft)
}

/// Signed distance of the gland: an ellipsoid that tapers to the apex and is flat posteriorly.
fn gland(p: &Point) -> f64 {
    let taper = 1.0 - 0.20 * step(2.0, -22.0, p.z);
    let round = Ellipsoid::upright([0.0; 3], [GLAND_MM[0] * taper, GLAND_MM[1] * taper, GLAND_MM[2]]).distance(p);
    let hollow = p.y - 13.4 - 0.004 * p.x * p.x;
    smooth_max(round, hollow, 7.0)
}

/// Perineal layers, the muscles of the pelvic floor and the fat between.
fn surroundings(p: &Point, fat: &Noise) -> u8 {
    let depth = skin_depth(p);
    if depth <= 0.0 {
        return 0;
    }
    if depth < 2.0 {
        return l::SKIN;
    }
    let x = p.x.abs();
    let under_skin = 7.0 + 2.0 * fat.at(p);
    let triangle = x < 8.0 + 0.5 * (p.y + 42.0) && p.y > -40.0 && p.y < 18.0;
    if depth > under_skin + 2.0 && p.z < -28.0 && triangle {
        let membrane = (p.z + 29.0).abs() < 1.0;
        return if membrane { l::FASCIA } else { l::MUSCLE };
    }
    // Levator ani: a funnel from the side walls down to the anal canal.
    let funnel = 16.0 + 22.0 * step(-34.0, 26.0, p.z);
    let ring = x.hypot(0.62 * (p.y - 12.0));
    if p.z > -36.0 && p.z < 34.0 && (ring - funnel).abs() < 2.0 && p.y > -26.0 {
        return l::MUSCLE;
    }
    let sphincter = p.x.hypot(p.y - RECTUM_Y_MM);
    if p.z < -24.0 && sphincter < 22.0 && depth > 3.5 {
        return l::MUSCLE;
    }
    l::FAT
}

/// Imaged across, in the middle of the gland.
pub(super) const PHANTOM: Facts = Facts {
    voxel_mm: 0.6,
    make,
    pose,
    probe: UsualProbe {
        kind: "trus-transverse",
        numbers: &[("radius_mm", PROBE_RADIUS_MM), ("angle_deg", 160.0)],
        depth_mm: 60.0,
    },
};

fn make(resolution_mm: f64, seed: u64) -> Result<LabelVolume, VolumeError> {
    let fat = Noise::new(seed, 100, 25.0);
    let mut painting = Painting::new(move |p: &Point| surroundings(p, &fat), None);
    side_walls(&mut painting, seed);
    bladder(&mut painting, seed);
    bundles(&mut painting);
    organ(&mut painting, seed);
    rectum(&mut painting, seed);
    let world = Bounds {
        min: Point::new(-55.0, -60.0, -60.0),
        max: Point::new(55.0, 50.0, 60.0),
    };
    painting.volume(&world, resolution_mm, l::TABLE, &format!("prostate {seed}"))
}

fn pose() -> Matrix4<f64> {
    pose_at(
        Point::new(0.0, RECTUM_Y_MM - PROBE_RADIUS_MM, 2.0),
        -Point::y(),
        Point::x(),
    )
}

/// Obturator muscles, pubic arch with its symphysis, and ischium.
fn side_walls<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let soft = Over::only(&[l::FAT, l::MUSCLE, l::FASCIA]);
    for side in [-1.0, 1.0] {
        let obturator = Uneven {
            shape: Ellipsoid::upright([side * 49.0, -2.0, 6.0], [11.0, 34.0, 40.0]),
            noise: Noise::new(seed, 101, 18.0),
            amplitude_mm: 1.5,
        };
        painting.add(obturator, 0.0, l::MUSCLE, soft);
        let ramus = path(
            &[
                ([side * 10.0, -42.0, 14.0], 11.0),
                ([side * 17.0, -40.0, -2.0], 8.0),
                ([side * 29.0, -30.0, -22.0], 6.5),
                ([side * 42.0, -14.0, -36.0], 7.0),
                ([side * 50.0, 6.0, -40.0], 10.0),
            ],
            6,
        );
        painting.add_all(&ramus, 0.0, l::BONE, soft);
        let upper = path(
            &[
                ([side * 10.0, -42.0, 14.0], 11.0),
                ([side * 32.0, -44.0, 28.0], 9.0),
                ([side * 60.0, -36.0, 44.0], 11.0),
            ],
            5,
        );
        painting.add_all(&upper, 0.0, l::BONE, soft);
        let ischium = Ellipsoid::upright([side * 62.0, 8.0, -8.0], [9.0, 24.0, 40.0]);
        painting.add(ischium, 0.0, l::BONE, soft);
    }
    // After both sides, whose bones meet in the midplane: the joint takes their place there.
    let symphysis = Block {
        centre: Point::new(0.0, -42.0, 12.0),
        axes: [Point::x(), Point::y(), Point::z()],
        half: [2.6, 14.0, 18.0],
        round: 1.0,
    };
    painting.add(symphysis, 0.0, l::CARTILAGE, Over::only(&[l::BONE]));
}

fn bladder<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let soft = Over::only(&[l::FAT, l::MUSCLE]);
    let wall = Uneven {
        shape: Ellipsoid::upright([0.0, -9.0, 43.0], [37.0, 26.0, 27.0]),
        noise: Noise::new(seed, 102, 20.0),
        amplitude_mm: 1.0,
    };
    // The noise of the wall: with another, the thickness of the wall would vary by up to 2 mm either way.
    let urine = Uneven {
        shape: Ellipsoid::upright([0.0, -9.0, 43.0], [33.5, 22.5, 23.5]),
        noise: Noise::new(seed, 102, 20.0),
        amplitude_mm: 1.0,
    };
    painting.add(wall, 0.0, l::BLADDER_WALL, soft);
    painting.add(urine, 0.0, l::URINE, Over::only(&[l::BLADDER_WALL]));
    for side in [-1.0, 1.0] {
        let vesicle = path(
            &[
                ([side * 4.0, 11.0, 19.0], 3.0),
                ([side * 11.0, 12.5, 24.0], 5.0),
                ([side * 20.0, 13.0, 27.0], 5.5),
                ([side * 29.0, 12.0, 33.0], 4.5),
            ],
            4,
        );
        for (i, piece) in vesicle.into_iter().enumerate() {
            let lobulated = Uneven {
                shape: piece,
                noise: Noise::new(seed, 103 + (i as u32 & 1), 4.0),
                amplitude_mm: 1.2,
            };
            painting.add(
                lobulated,
                0.0,
                l::SEMINAL_VESICLE,
                Over::only(&[l::FAT, l::MUSCLE, l::BLADDER_WALL]),
            );
        }
    }
}

/// Vessels and nerves around the gland.
fn bundles<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>) {
    // The anterior venous plexus and the bundles at five and seven o'clock.
    for (x, y, radius) in [
        (-7.0, -20.5, 2.6),
        (0.0, -22.0, 2.2),
        (6.5, -20.0, 2.9),
        (-18.5, 13.5, 1.5),
        (18.5, 13.5, 1.5),
    ] {
        let vessel = path(
            &[
                ([0.8 * x, y + 2.0, -24.0], radius),
                ([x, y, 0.0], radius),
                ([1.3 * x, y + 1.5, 24.0], radius),
            ],
            4,
        );
        painting.add_all(&vessel, 0.0, l::VESSEL, Over::only(&[l::FAT, l::MUSCLE]));
    }
    for side in [-1.0, 1.0] {
        let nerve = path(
            &[([side * 15.0, 15.0, -20.0], 1.1), ([side * 20.5, 15.0, 20.0], 1.1)],
            3,
        );
        painting.add_all(&nerve, 0.0, l::NERVE, Over::only(&[l::FAT, l::MUSCLE]));
    }
}

/// The gland with its zones, urethra and lesion.
fn organ<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let bounds = Bounds {
        min: Point::new(-GLAND_MM[0], -GLAND_MM[1], -GLAND_MM[2]),
        max: Point::from(GLAND_MM),
    }
    .grown(1.0);
    let shape = |amplitude_mm: f64| Uneven {
        shape: Solid {
            bounds,
            distance: gland,
        },
        noise: Noise::new(seed, 105, 14.0),
        amplitude_mm,
    };
    // Vessels and nerves are not among these: the bundles stay whole on the surface of the gland.
    let soft = Over::only(&[
        l::FAT,
        l::MUSCLE,
        l::FASCIA,
        l::BLADDER_WALL,
        l::SEMINAL_VESICLE,
        l::URINE,
        l::BONE,
    ]);
    // Both surfaces of the capsule have the same noise, so that its thickness does not vary.
    painting.add(shape(0.8), 0.0, l::CAPSULE, soft);
    painting.add(
        shape(0.8),
        -CAPSULE_MM,
        l::PROSTATE_PERIPHERAL,
        Over::only(&[l::CAPSULE]),
    );
    let peripheral = Over::only(&[l::PROSTATE_PERIPHERAL]);
    for side in [-1.0, 1.0] {
        let lobe = Uneven {
            shape: Ellipsoid::upright([side * 6.5, -4.0, 4.5], [11.5, 10.0, 14.5]),
            noise: Noise::new(seed, 106, 9.0),
            amplitude_mm: 0.9,
        };
        painting.add(lobe, 0.0, l::PROSTATE_CENTRAL, peripheral);
    }
    let lesion = Uneven {
        shape: Ellipsoid::upright([-13.5, 8.0, -3.0], [5.0, 3.6, 5.5]),
        noise: Noise::new(seed, 107, 4.0),
        amplitude_mm: 0.6,
    };
    painting.add(lesion, 0.0, l::LESION, peripheral);
    let urethra = path(
        &[
            ([0.0, -7.0, 26.0], 3.6),
            ([0.0, -4.0, 12.0], 2.6),
            ([0.0, -1.5, 0.0], 3.2),
            ([0.0, -3.0, -14.0], 2.8),
            ([0.0, -5.0, -26.0], 3.0),
            ([0.0, -16.0, -40.0], 3.6),
            ([0.0, -36.0, -42.0], 4.0),
        ],
        6,
    );
    painting.add_all(
        &urethra,
        0.0,
        l::URETHRA,
        Over::only(&[
            l::PROSTATE_CENTRAL,
            l::PROSTATE_PERIPHERAL,
            l::CAPSULE,
            l::BLADDER_WALL,
            l::MUSCLE,
            l::FASCIA,
            l::FAT,
        ]),
    );
}

/// Rectum and anal canal around the probe's position, with the fascia in front.
fn rectum<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let [lumen, wall] = RECTUM_MM;
    let tube = |low: f64| Tube {
        ends: [Point::new(0.0, RECTUM_Y_MM, low), Point::new(0.0, RECTUM_Y_MM, 80.0)],
        radii: [lumen; 2],
    };
    let body = Over::only(&[
        l::FAT,
        l::MUSCLE,
        l::FASCIA,
        l::CAPSULE,
        l::SEMINAL_VESICLE,
        l::SOFT_TISSUE,
    ]);
    let sheath = Uneven {
        shape: tube(-56.0),
        noise: Noise::new(seed, 108, 12.0),
        amplitude_mm: 0.5,
    };
    let mesorectum = tube(-18.0);
    painting.add(mesorectum, wall + 3.5, l::SOFT_TISSUE, Over::only(&[l::FAT]));
    painting.add(sheath, wall, l::RECTUM_WALL, body);
    painting.add(
        tube(-80.0),
        0.0,
        l::GEL,
        Over::only(&[l::RECTUM_WALL, l::SKIN, l::MUSCLE, l::FAT]),
    );
}
