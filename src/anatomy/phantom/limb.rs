//! Vessels and nerves of limbs and neck in cross-section, under a linear probe on the skin. The seed picks one of five
//! regions (side of the neck, below the collarbone, elbow, groin, back of the knee) and draws all of it: layers,
//! bellies of muscle, bone, lymph node, and the bundle of artery, veins and nerves.
//!
//! The origin is on the skin, z runs along the limb, y into it. All lengths and shares are by eye, after frames of
//! these regions. Veins are flattened towards the skin by a degree that is drawn: it stands for the pressure of the
//! probe, no mechanics are computed.

use nalgebra::Matrix4;

use super::geometry::{Bounds, Ellipsoid, Point, Shape, Solid, Uneven};
use super::paint::{Over, Painting};
use super::{Facts, UsualProbe, pose_at};
use crate::volume::{LabelVolume, VolumeError};
use insonify_base::random::noise::{Noise, choice};

pub(super) mod labels {
    //! Label values of the limb.
    crate::phantom::label_table! {
        SKIN = 1 "skin",
        FAT = 2 "fat",
        FASCIA = 3 "fascia",
        MUSCLE = 4 "muscle_limb",
        OBLIQUE = 5 "muscle",
        BETWEEN = 6 "intermuscular_fat",
        BONE = 7 "bone",
        ARTERY = 8 "artery",
        ARTERY_WALL = 9 "vessel_wall",
        VEIN = 10 "vein",
        EPINEURIUM = 11 "epineurium",
        FASCICLE = 12 "fascicle",
        LYMPH_NODE = 13 "lymph_node",
    }
}
use labels as l;

/// Half width, depth and half length of the volume, mm.
const SIZE_MM: [f64; 3] = [32.0, 60.0, 10.0];
/// Height of the volume over the skin, mm.
const ABOVE_MM: f64 = 2.0;
/// Number of bellies of muscle.
const BELLIES: i32 = 9;

/// Ranges of a region, mm unless stated.
struct Region {
    /// Thickness of the fat under the skin.
    fat: [f64; 2],
    /// Way from the fat to the artery's centre, beside its radius.
    roof: [f64; 2],
    /// Radius of the artery.
    artery: [f64; 2],
    /// Number of veins, and radius of each before it is flattened.
    veins: [f64; 2],
    vein: [f64; 2],
    /// Number of nerves, and half width of each.
    nerves: [f64; 2],
    nerve: [f64; 2],
    /// Height of a nerve over its width.
    flat: [f64; 2],
    /// Way between a nerve and its neighbours.
    gap: [f64; 2],
    /// Share of nerves that are one fascicle.
    roots: f64,
    /// Way from the artery down to the bone's surface, and radius of the bone.
    bone: [f64; 2],
    shaft: [f64; 2],
}

const REGIONS: [Region; 5] = [
    // Side of the neck: carotid, jugular vein, roots of the brachial plexus between the scalene muscles.
    Region {
        fat: [1.5, 6.0],
        roof: [2.0, 13.0],
        artery: [2.2, 4.2],
        veins: [1.0, 2.4],
        vein: [2.0, 6.5],
        nerves: [2.0, 5.5],
        nerve: [1.2, 3.6],
        flat: [0.7, 1.0],
        gap: [0.1, 7.0],
        roots: 0.5,
        bone: [3.0, 25.0],
        shaft: [5.0, 9.0],
    },
    // Below the collarbone to the axilla: axillary vessels under the pectoral muscles, cords around the artery.
    Region {
        fat: [2.0, 10.0],
        roof: [3.0, 14.0],
        artery: [2.0, 4.2],
        veins: [1.0, 3.0],
        vein: [2.0, 5.0],
        nerves: [2.0, 4.6],
        nerve: [1.8, 4.8],
        flat: [0.5, 1.0],
        gap: [0.2, 2.0],
        roots: 0.2,
        bone: [3.0, 25.0],
        shaft: [6.0, 12.0],
    },
    // Elbow and upper arm: brachial artery with two veins, median, ulnar and radial nerves, humerus.
    Region {
        fat: [1.5, 7.0],
        roof: [0.5, 8.0],
        artery: [1.2, 2.8],
        veins: [0.0, 3.6],
        vein: [0.7, 2.6],
        nerves: [1.0, 3.4],
        nerve: [1.8, 4.5],
        flat: [0.4, 0.9],
        gap: [0.2, 8.0],
        roots: 0.1,
        bone: [2.0, 15.0],
        shaft: [8.0, 13.0],
    },
    // Groin: femoral artery, vein beside it, nerve on the other side.
    Region {
        fat: [2.0, 13.0],
        roof: [1.0, 8.0],
        artery: [2.8, 5.2],
        veins: [1.0, 2.8],
        vein: [3.0, 7.0],
        nerves: [1.0, 2.4],
        nerve: [3.0, 7.0],
        flat: [0.25, 0.7],
        gap: [0.2, 3.0],
        roots: 0.0,
        bone: [3.0, 20.0],
        shaft: [14.0, 22.0],
    },
    // Back of the knee and thigh: tibial and peroneal or sciatic nerve, popliteal vessels deeper.
    Region {
        fat: [3.0, 11.0],
        roof: [6.0, 15.0],
        artery: [2.2, 4.4],
        veins: [0.6, 2.6],
        vein: [2.0, 6.0],
        nerves: [1.0, 2.6],
        nerve: [3.0, 7.0],
        flat: [0.45, 0.85],
        gap: [0.2, 8.0],
        roots: 0.0,
        bone: [2.0, 22.0],
        shaft: [12.0, 20.0],
    },
];

/// Numbers that depend on seed, stream and item.
#[derive(Clone, Copy)]
struct Draws {
    seed: u64,
    stream: u32,
}

impl Draws {
    /// A number from 0 to 1, evenly.
    fn share(self, item: i32, which: i32) -> f64 {
        choice(self.seed, self.stream, [item, which])
    }

    /// A number in a range, mostly near its lower end.
    fn low(self, [low, high]: [f64; 2], item: i32, which: i32) -> f64 {
        low + (high - low) * self.share(item, which).powi(2)
    }

    /// A number in a range, evenly.
    fn within(self, [low, high]: [f64; 2], item: i32, which: i32) -> f64 {
        low + (high - low) * self.share(item, which)
    }
}

/// A vessel, nerve or fascicle: an elliptical cylinder along the limb.
#[derive(Clone, Copy)]
struct Strand {
    /// Centre of the section at z = 0 (x, y), mm.
    centre: [f64; 2],
    /// Change of the centre along z.
    drift: [f64; 2],
    /// Half width and half height of the section, mm.
    half: [f64; 2],
    /// Turn of the section about z, radians.
    turn: f64,
}

impl Strand {
    /// Place in the section in units of the half axes.
    fn local(&self, p: &Point) -> [f64; 2] {
        let [x, y] = [0, 1].map(|axis| p[axis] - self.centre[axis] - self.drift[axis] * p.z);
        let (sin, cos) = self.turn.sin_cos();
        [(cos * x + sin * y) / self.half[0], (cos * y - sin * x) / self.half[1]]
    }

    /// A point of the section at z = 0, of units of the half axes.
    fn at(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let [x, y] = [u * self.half[0], v * self.half[1]];
        let (sin, cos) = self.turn.sin_cos();
        [self.centre[0] + cos * x - sin * y, self.centre[1] + sin * x + cos * y]
    }

    /// Whether the other is at least `gap_mm` away.
    fn clears(&self, other: &Self, gap_mm: f64) -> bool {
        (0..24).all(|i| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 24.0).sin_cos();
            let [x, y] = self.at([cos, sin]);
            other.distance(&Point::new(x, y, 0.0)) > gap_mm
        }) && self.distance(&Point::new(other.centre[0], other.centre[1], 0.0)) > 0.0
    }
}

impl Shape for Strand {
    fn bounds(&self) -> Bounds {
        let reach = self.half[0].max(self.half[1]);
        let way = self.drift.map(|drift| reach + drift.abs() * SIZE_MM[2]);
        let [x, y] = self.centre;
        Bounds {
            min: Point::new(x - way[0], y - way[1], -SIZE_MM[2]),
            max: Point::new(x + way[0], y + way[1], SIZE_MM[2]),
        }
    }

    fn distance(&self, p: &Point) -> f64 {
        let [u, v] = self.local(p);
        let level = u.hypot(v);
        if level < 1e-9 {
            return -self.half[0].min(self.half[1]);
        }
        (level - 1.0) * level / (u / self.half[0]).hypot(v / self.half[1])
    }
}

/// Declaration of the phantom, which the probe images across.
pub(super) const PHANTOM: Facts = Facts {
    voxel_mm: 0.3,
    make,
    pose,
    probe: UsualProbe {
        kind: "linear",
        numbers: &[("width_mm", 38.0)],
        depth_mm: 40.0,
    },
};

fn pose() -> Matrix4<f64> {
    pose_at(Point::zeros(), Point::y(), Point::x())
}

fn make(resolution_mm: f64, seed: u64) -> Result<LabelVolume, VolumeError> {
    let draws = Draws { seed, stream: 300 };
    let region = &REGIONS[(draws.share(0, 0) * REGIONS.len() as f64) as usize];
    let layers = Layers::new(draws, region);
    let fascia_mm = layers.skin_mm + layers.fat_mm;
    let mut painting = Painting::new(move |p: &Point| layers.label(p), None);
    let bundle = Bundle::new(draws, region, fascia_mm);
    lymph_node(&mut painting, draws, &bundle, fascia_mm);
    bundle.paint(&mut painting, draws, region);
    let [x, y, z] = SIZE_MM;
    let world = Bounds {
        min: Point::new(-x, -ABOVE_MM, -z),
        max: Point::new(x, y, z),
    };
    painting.volume(&world, resolution_mm, l::TABLE, &format!("limb {seed}"))
}

/// Skin, fat, deep fascia, and bellies of muscle with fasciae and fat between them.
struct Layers {
    skin_mm: f64,
    fat_mm: f64,
    fascia_mm: f64,
    /// Half thickness of the fat between bellies, and how it varies.
    between_mm: [f64; 2],
    /// Level of the unevenness below which there is no fascia between bellies.
    broken: f64,
    bellies: Vec<Belly>,
    /// Unevenness: of layers, of bellies in two directions, of what is between them.
    noise: [Noise; 4],
}

/// A belly of muscle: what is nearest to its centre (x, y), which drifts along z.
struct Belly {
    centre: [f64; 2],
    drift: f64,
    label: u8,
}

impl Layers {
    fn new(draws: Draws, region: &Region) -> Self {
        let [half, depth, _] = SIZE_MM;
        let bellies = (0..BELLIES)
            .map(|i| Belly {
                centre: [draws.within([-half, half], i, 10), draws.within([4.0, depth], i, 11)],
                drift: draws.within([-0.2, 0.2], i, 12),
                label: if draws.share(i, 13) < 0.7 {
                    l::MUSCLE
                } else {
                    l::OBLIQUE
                },
            })
            .collect();
        Self {
            skin_mm: draws.within([1.0, 2.0], 0, 1),
            fat_mm: draws.within(region.fat, 0, 2),
            fascia_mm: draws.within([0.4, 0.9], 0, 3),
            between_mm: [draws.low([-0.6, 6.0], 0, 4), draws.within([0.4, 1.6], 0, 5)],
            broken: draws.within([-0.6, 0.6], 0, 6),
            bellies,
            noise: [(301, 18.0), (302, 13.0), (303, 13.0), (304, 7.0)]
                .map(|(stream, scale)| Noise::new(draws.seed, stream, scale)),
        }
    }

    fn label(&self, p: &Point) -> u8 {
        let depth = p.y - 0.001 * p.x * p.x;
        if depth <= 0.0 {
            return 0;
        }
        if depth < self.skin_mm {
            return l::SKIN;
        }
        let below = depth - self.skin_mm - self.fat_mm * (1.0 + 0.3 * self.noise[0].at(p));
        if below < 0.0 {
            return l::FAT;
        }
        if below < self.fascia_mm {
            return l::FASCIA;
        }
        let (x, y) = (p.x + 4.0 * self.noise[1].at(p), p.y + 3.0 * self.noise[2].at(p));
        // Bellies are wider than deep.
        let mut nearest = [(f64::INFINITY, l::MUSCLE); 2];
        for belly in &self.bellies {
            let away = ((x - belly.centre[0] - belly.drift * p.z) / 1.7).hypot(y - belly.centre[1]);
            if away < nearest[0].0 {
                nearest = [(away, belly.label), nearest[0]];
            } else if away < nearest[1].0 {
                nearest[1].0 = away;
            }
        }
        let border = (nearest[1].0 - nearest[0].0) / 2.0;
        let uneven = self.noise[3].at(p);
        let fat = self.between_mm[0] + self.between_mm[1] * uneven;
        if border < fat {
            l::BETWEEN
        } else if border < fat.max(0.0) + self.fascia_mm / 2.0 && uneven > self.broken {
            l::FASCIA
        } else {
            nearest[0].1
        }
    }
}

/// Tissue that bone, vessels and nerves take the place of.
fn soft() -> Over {
    Over::only(&[l::FAT, l::FASCIA, l::MUSCLE, l::OBLIQUE, l::BETWEEN, l::LYMPH_NODE])
}

/// An oval node with a hilum of fat, beside the bundle.
fn lymph_node<B: Fn(&Point) -> u8 + Sync>(painting: &mut Painting<B>, draws: Draws, bundle: &Bundle, fascia_mm: f64) {
    let radii = [[2.0, 6.0], [1.2, 3.0], [3.0, 7.0]];
    let radii = std::array::from_fn(|axis| draws.within(radii[axis], 0, 30 + axis as i32));
    let side = if draws.share(0, 33) < 0.5 { -1.0 } else { 1.0 };
    let x = bundle.artery.centre[0] + side * draws.within([8.0, 22.0], 0, 34);
    let centre = [
        x,
        fascia_mm + draws.within([-1.0, 9.0], 0, 35),
        draws.within([-8.0, 8.0], 0, 36),
    ];
    let node = |scale: f64| Ellipsoid::upright(centre, radii.map(|radius| scale * radius));
    painting.add(node(1.0), 0.0, l::LYMPH_NODE, soft());
    painting.add(node(0.45), 0.0, l::BETWEEN, Over::only(&[l::LYMPH_NODE]));
}

/// Bone, artery, veins and nerves, clear of each other.
struct Bundle {
    bone: Strand,
    artery: Strand,
    veins: Vec<Strand>,
    nerves: Vec<Strand>,
}

impl Bundle {
    fn new(draws: Draws, region: &Region, fascia_mm: f64) -> Self {
        let radius = draws.within(region.artery, 0, 40);
        let artery = Strand {
            centre: [
                draws.within([-12.0, 12.0], 0, 41),
                fascia_mm + draws.within(region.roof, 0, 42) + radius,
            ],
            drift: [draws.within([-0.2, 0.2], 0, 43), draws.within([-0.15, 0.15], 0, 44)],
            half: [radius, radius * draws.within([0.85, 1.0], 0, 45)],
            turn: 0.0,
        };
        let shaft = draws.within(region.shaft, 0, 20);
        let bone = Strand {
            centre: [
                draws.within([-22.0, 22.0], 0, 21),
                artery.centre[1] + radius + draws.within(region.bone, 0, 22) + shaft,
            ],
            drift: [draws.within([-0.2, 0.2], 0, 23), artery.drift[1]],
            half: [shaft * draws.within([1.0, 1.5], 0, 24), shaft],
            turn: draws.within([-0.5, 0.5], 0, 25),
        };
        let mut bundle = Self {
            bone,
            artery,
            veins: Vec::new(),
            nerves: Vec::new(),
        };
        for i in 0..draws.within(region.veins, 0, 46).round() as i32 {
            // Pressed flat by the probe: the perimeter stays, the height is 0.25 to 0.95 of the width.
            let (radius, flat) = (draws.within(region.vein, i, 50), draws.within([0.25, 0.95], i, 51));
            let half = 2.0 * radius / (1.0 + flat);
            let gap = draws.within([-1.0, 1.5], i, 52);
            let vein = bundle.placed(draws, 400 + i, [half, half * flat], gap, fascia_mm);
            bundle.veins.extend(vein);
        }
        for i in 0..draws.within(region.nerves, 0, 47).round() as i32 {
            let (half, flat) = (draws.within(region.nerve, i, 60), draws.within(region.flat, i, 61));
            let gap = draws.low(region.gap, i, 62);
            let nerve = bundle.placed(draws, 500 + i, [half, half * flat], gap, fascia_mm);
            bundle.nerves.extend(nerve);
        }
        bundle
    }

    /// Vessels and nerves.
    fn strands(&self) -> impl Iterator<Item = &Strand> {
        std::iter::once(&self.artery).chain(&self.veins).chain(&self.nerves)
    }

    /// A strand in a random direction from the artery, where it first is clear of the others and below the fascia; none
    /// where there is no room.
    fn placed(&self, draws: Draws, item: i32, half: [f64; 2], gap_mm: f64, fascia_mm: f64) -> Option<Strand> {
        let mut strand = Strand {
            half,
            turn: draws.within([-0.4, 0.4], item, 0),
            drift: [0, 1].map(|axis| self.artery.drift[axis] + draws.within([-0.1, 0.1], item, 1 + axis as i32)),
            centre: self.artery.centre,
        };
        for attempt in 0..20 {
            let (sin, cos) = draws.within([-0.7, 3.84], item, 10 + attempt).sin_cos();
            for step in 0..60 {
                let away = 0.5 * f64::from(step);
                strand.centre = [self.artery.centre[0] + away * cos, self.artery.centre[1] + away * sin];
                let low_enough = strand.centre[1] - half[1] > fascia_mm - 1.0;
                let others = self.strands().chain([&self.bone]);
                if low_enough && others.into_iter().all(|other| strand.clears(other, gap_mm)) {
                    return Some(strand);
                }
            }
        }
        None
    }

    fn paint<B: Fn(&Point) -> u8 + Sync>(&self, painting: &mut Painting<B>, draws: Draws, region: &Region) {
        let uneven = |shape: Strand, amplitude_mm: f64, stream: u32| Uneven {
            shape,
            noise: Noise::new(draws.seed, stream, shape.half[0].max(2.0)),
            amplitude_mm,
        };
        painting.add(uneven(self.bone, 0.8, 305), 0.0, l::BONE, soft());
        for (i, &strand) in self.strands().enumerate() {
            let sheath = draws.low([0.0, 2.5], i as i32, 70);
            let around = Over::only(&[l::FASCIA, l::MUSCLE, l::OBLIQUE]);
            painting.add(uneven(strand, 1.2, 310), sheath, l::BETWEEN, around);
        }
        let wall = draws.within([0.0, 0.8], 0, 71);
        for (i, &vein) in (320..).zip(&self.veins) {
            painting.add(uneven(vein, 0.12 * vein.half[0], i), 0.0, l::VEIN, soft());
        }
        painting.add(uneven(self.artery, 0.15, 311), wall, l::ARTERY_WALL, soft());
        painting.add(
            uneven(self.artery, 0.15, 311),
            0.0,
            l::ARTERY,
            Over::only(&[l::ARTERY_WALL]),
        );
        for (i, &nerve) in (0..).zip(&self.nerves) {
            let stream = 330 + i as u32;
            let amplitude_mm = 0.15 * nerve.half[0];
            painting.add(uneven(nerve, amplitude_mm, stream), 0.0, l::EPINEURIUM, soft());
            let within = Over::only(&[l::EPINEURIUM]);
            if draws.share(i, 72) < region.roots {
                let rim = draws.within([0.3, 0.6], i, 73);
                painting.add(uneven(nerve, amplitude_mm, stream), -rim, l::FASCICLE, within);
            } else {
                painting.add(fascicles(nerve, draws, i), 0.0, l::FASCICLE, within);
            }
        }
    }
}

/// Fascicles of a nerve, as many as the square of its width asks for, apart from each other and from its rim.
fn fascicles(nerve: Strand, draws: Draws, item: i32) -> Solid<impl Fn(&Point) -> f64 + Send + Sync> {
    let size = draws.within([0.35, 0.75], item, 74);
    let mut all: Vec<Strand> = Vec::new();
    for attempt in 0..120 {
        let (level, angle) = (
            draws.share(item, 100 + 3 * attempt).sqrt(),
            draws.share(item, 101 + 3 * attempt),
        );
        let (sin, cos) = (std::f64::consts::TAU * angle).sin_cos();
        let radius = size * draws.within([0.6, 1.3], item, 102 + 3 * attempt);
        let fascicle = Strand {
            centre: nerve.at([level * cos, level * sin]),
            half: [radius; 2],
            ..nerve
        };
        let [x, y] = fascicle.centre;
        if nerve.distance(&Point::new(x, y, 0.0)) < -radius - 0.3
            && all.iter().all(|other| fascicle.clears(other, 0.35))
        {
            all.push(fascicle);
        }
    }
    Solid {
        bounds: nerve.bounds(),
        distance: move |p: &Point| {
            all.iter()
                .map(|fascicle| fascicle.distance(p))
                .fold(f64::INFINITY, f64::min)
        },
    }
}
