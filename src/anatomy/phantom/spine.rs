//! The lumbar spine from L2 to L5 with the back behind it. The origin lies in front of the canal, midway between L3 and
//! L4.

use labels as l;
use nalgebra::Matrix4;

use super::geometry::{Bounds, Point, path, step};
use super::paint::{Dent, Over, Painting};
use super::{Facts, UsualProbe, pose_at};
use crate::phantom::geometry::{Block, Ellipsoid, Solid, Tube, Uneven, frame, smooth_max};
use crate::volume::{LabelVolume, VolumeError};
use insonify_base::random::noise::{Noise, choice};

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

/// Imaged from behind, sagittal over the laminae, feet on the right. The skin bears the dent of this probe.
pub(super) const PHANTOM: Facts = Facts {
    voxel_mm: 0.8,
    make,
    pose,
    probe: UsualProbe {
        kind: "curvilinear",
        numbers: &[("radius_mm", PROBE_RADIUS_MM), ("angle_deg", 60.0)],
        depth_mm: 100.0,
    },
};

fn make(resolution_mm: f64, seed: u64) -> Result<LabelVolume, VolumeError> {
    let (fat, septa) = (Noise::new(seed, 200, 35.0), Noise::new(seed, 201, 25.0));
    let dent = Dent::new(&pose(), PROBE_RADIUS_MM, 1.6 * PRESSED_MM, skin_depth);
    let mut painting = Painting::new(move |p: &Point| surroundings(p, &fat, &septa), Some(dent));
    great_vessels(&mut painting);
    for level in -1..=4 {
        let z = LEVEL_MM * (1.5 - f64::from(level));
        vertebra(&mut painting, z, seed, level);
    }
    canal(&mut painting, seed);
    let world = Bounds {
        min: Point::new(-80.0, -65.0, -85.0),
        max: Point::new(80.0, 65.0, 85.0),
    };
    painting.volume(&world, resolution_mm, l::TABLE, &format!("spine {seed}"))
}

fn pose() -> Matrix4<f64> {
    let axial = -Point::y();
    let mut skin = Point::new(-13.0, 70.0, 0.0);
    while skin_depth(&skin) < 0.0 {
        skin += axial * 0.05;
    }
    pose_at(skin + axial * PRESSED_MM, axial, -Point::z())
}

/// Aorta and inferior vena cava in front of the bodies.
fn great_vessels<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>) {
    let course_at = |x: f64, radius: f64| {
        path(
            &[
                ([x, -56.0 - lordosis(-90.0), -95.0], radius),
                ([x, -56.0 - lordosis(0.0), 0.0], radius),
                ([x, -56.0 - lordosis(90.0), 95.0], radius),
            ],
            6,
        )
    };
    for (course, wall) in [(course_at(12.0, 8.5), 1.5), (course_at(-14.0, 10.0), 0.8)] {
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

// Lumbar vertebra with the disc and the joints below it, and the spinal canal.

/// Half height of a body, mm; the rest of a level is disc.
const BODY_HALF_MM: f64 = 13.5;
/// Half width and half depth of a body, mm.
const BODY_MM: [f64; 2] = [25.0, 17.5];
/// Anterior offset of the centre of a body from the canal's centre, mm.
const BODY_Y_MM: f64 = -27.0;
/// Radius of the canal and of the dural sac, mm.
const CANAL_MM: [f64; 2] = [10.5, 8.0];

/// Maps a vertebra's own coordinates (x left, y back, z up, mm from the canal's centre) to the world.
#[derive(Clone, Copy)]
struct Seat {
    origin: Point,
    up: Point,
    back: Point,
}

impl Seat {
    fn new(z: f64) -> Self {
        let up = Point::new(0.0, lordosis(z - 1.0) - lordosis(z + 1.0), 2.0).normalize();
        Self {
            origin: Point::new(0.0, -lordosis(z), z),
            up,
            back: up.cross(&Point::x()),
        }
    }

    fn at(&self, [x, y, z]: [f64; 3]) -> Point {
        self.origin + Point::x() * x + self.back * y + self.up * z
    }

    fn along(&self, [x, y, z]: [f64; 3]) -> Point {
        Point::x() * x + self.back * y + self.up * z
    }

    /// A point of the phantom in the frame of the seat.
    fn local(&self, p: &Point) -> Point {
        let offset = p - self.origin;
        Point::new(offset.x, offset.dot(&self.back), offset.dot(&self.up))
    }
}

/// Adds the vertebra at a height, the disc below it and the joints with the next.
fn vertebra<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, z: f64, seed: u64, level: i32) {
    let seat = Seat::new(z);
    let soft = Over::only(&[
        l::FAT,
        l::MUSCLE,
        l::FASCIA,
        l::PERITONEAL_FAT,
        l::EPIDURAL_FAT,
        l::LIGAMENT,
    ]);
    body_and_disc(painting, seat, soft);
    // Ligaments before the bones that they join, which paint over their ends.
    interspinous(painting, seat, z, soft);
    // Noise of its own for each level: equal vertebrae would show as a pattern along the spine.
    let rough = |shape: Block| Uneven {
        shape,
        noise: Noise::new(seed, (210 + level) as u32, 6.0),
        amplitude_mm: 0.6,
    };
    painting.add(
        rough(Block {
            centre: seat.at([0.0, 29.0, -7.0]),
            axes: [
                Point::x(),
                seat.along([0.0, 0.97, -0.24]),
                seat.along([0.0, 0.24, 0.97]),
            ],
            half: [3.0, 15.0, 9.5],
            round: 2.8,
        }),
        0.0,
        l::BONE,
        soft,
    );
    for side in [-1.0, 1.0] {
        let pedicle = Tube {
            ends: [seat.at([side * 14.5, -14.0, 5.0]), seat.at([side * 14.5, 6.0, 4.0])],
            radii: [5.6, 5.2],
        };
        let transverse = path(
            &[
                ([0.0, 0.0, 0.0], 6.0),
                ([side * 12.0, 2.0, 0.5], 4.6),
                ([side * 26.0, 6.0, 1.0], 4.2),
            ],
            3,
        )
        .into_iter()
        .map(|tube| Tube {
            ends: tube
                .ends
                .map(|end| seat.at([side * 14.0 + end.x, 2.0 + end.y, 3.0 + end.z])),
            radii: tube.radii,
        });
        let transverse: Vec<Tube> = transverse.collect();
        painting.add_all(&[pedicle], 0.0, l::BONE, soft);
        painting.add_all(&transverse, 0.0, l::BONE, soft);
        let slope = frame(seat.along([side * 0.80, -0.60, 0.0]), seat.along([0.0, -0.18, 1.0]));
        painting.add(
            rough(Block {
                centre: seat.at([side * 8.5, 12.0, -5.0]),
                axes: slope,
                half: [11.0, 10.5, 3.1],
                round: 2.5,
            }),
            0.0,
            l::BONE,
            soft,
        );
        articular_processes(painting, seat, side, soft);
    }
}

/// Articular processes of a side, and the joint with the next vertebra.
fn articular_processes<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seat: Seat, side: f64, soft: Over) {
    let upper = Ellipsoid {
        centre: seat.at([side * 18.5, 8.5, 15.0]),
        axes: [Point::x(), seat.back, seat.up],
        radii: [5.5, 6.5, 11.0],
    };
    let lower = Ellipsoid {
        centre: seat.at([side * 12.5, 13.5, -17.0]),
        radii: [5.5, 5.5, 11.0],
        ..upper
    };
    painting.add(upper, 0.0, l::BONE, soft);
    painting.add(lower, 0.0, l::BONE, soft);
    // The joint lies between the lower process of this vertebra and the upper one of the next.
    let joint = Block {
        centre: seat.at([side * 15.6, 11.5, -19.5]),
        axes: frame(seat.along([side * 0.80, -0.60, 0.0]), seat.up),
        half: [1.0, 8.5, 7.5],
        round: 0.8,
    };
    painting.add(joint, 0.0, l::CARTILAGE, Over::only(&[l::BONE]));
}

fn body_and_disc<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seat: Seat, soft: Over) {
    let bounds = Bounds {
        min: seat.origin,
        max: seat.origin,
    }
    .grown(50.0);
    let section = move |p: &Point, waist: f64| {
        let q = seat.local(p);
        let level = (q.x / BODY_MM[0]).hypot((q.y - BODY_Y_MM) / BODY_MM[1]);
        ((level - waist) * BODY_MM[1], q.z)
    };
    let disc = move |p: &Point| {
        let (side, height) = section(p, 1.03);
        // Wide enough for the anterior gap opened by lordosis; the next body is painted over it.
        side.max((height + BODY_HALF_MM + 7.5).abs() - 7.8)
    };
    let body = move |p: &Point| {
        let height = seat.local(p).z;
        let (side, _) = section(p, 0.92 + 0.10 * (height / BODY_HALF_MM).powi(2));
        smooth_max(side, height.abs() - BODY_HALF_MM, 3.0)
    };
    painting.add(Solid { bounds, distance: disc }, 0.0, l::DISC, soft);
    painting.add(
        Solid { bounds, distance: body },
        0.0,
        l::BONE,
        Over::only(&[
            l::FAT,
            l::MUSCLE,
            l::FASCIA,
            l::PERITONEAL_FAT,
            l::EPIDURAL_FAT,
            l::DISC,
        ]),
    );
}

/// Ligaments between this spinous process and the next, and the yellow ligament between the laminae.
fn interspinous<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seat: Seat, z: f64, soft: Over) {
    let below = Seat::new(z - LEVEL_MM);
    let upright = [Point::x(), seat.back, seat.up];
    let between = |offset: [f64; 3]| (seat.at(offset) + below.at(offset)) / 2.0;
    painting.add(
        Block {
            centre: between([0.0, 28.0, -8.0]),
            axes: upright,
            half: [1.8, 13.0, 10.0],
            round: 0.8,
        },
        0.0,
        l::LIGAMENT,
        soft,
    );
    for side in [-1.0, 1.0] {
        painting.add(
            Block {
                centre: between([side * 5.2, 10.8, -3.0]),
                axes: frame(seat.along([side * 0.80, -0.60, 0.0]), seat.up),
                half: [7.5, 12.0, 2.0],
                round: 1.0,
            },
            0.0,
            l::LIGAMENT,
            soft,
        );
    }
}

/// Adds epidural fat, the dural sac and its nerve roots.
fn canal<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, seed: u64) {
    let along = |x: f64, y: f64, radius: f64| {
        let knots: Vec<([f64; 3], f64)> = (-5..=5)
            .map(|i| {
                let z = 20.0 * f64::from(i);
                ([x, y - lordosis(z), z], radius)
            })
            .collect();
        path(&knots, 2)
    };
    let [canal, sac] = CANAL_MM;
    painting.add_all(&along(0.0, 0.0, canal), 0.0, l::EPIDURAL_FAT, Over::BODY);
    painting.add_all(&along(0.0, -0.8, sac), 0.0, l::CSF, Over::only(&[l::EPIDURAL_FAT]));
    for root in 0..9 {
        let angle = 0.7 * f64::from(root);
        let out = 2.0 + 3.5 * choice(seed, 220, [root, 0]);
        let strand = along(out * angle.cos(), 1.0 + 0.7 * out * angle.sin(), 0.75);
        painting.add_all(&strand, 0.0, l::NERVE, Over::only(&[l::CSF]));
    }
}
