//! Body wall, spine and cavities: a label for every point of the abdomen before the organs are painted in.

use super::l;
use crate::phantom::geometry::{Ellipsoid, Point, Shape, curve, smooth_min, step};
use insonify_base::random::noise::Noise;

/// Thickness of the skin, mm.
const SKIN_MM: f64 = 2.0;
/// Thickness of the muscle wall, and of the ribs with the intercostal tissue, mm.
const MUSCLE_MM: f64 = 11.0;
/// Distance between neighbouring ribs along the body axis, mm.
const RIB_STEP_MM: f64 = 26.0;
/// Lower border of the rib cage: angle from the back (degrees) and height (mm). The 10th rib falls from the spine to
/// the flank, and the costal arch climbs from there to the sternum.
const COSTAL_MARGIN: [[f64; 2]; 10] = [
    [0.0, 52.0],
    [30.0, 40.0],
    [60.0, 6.0],
    [90.0, -38.0],
    [108.0, -49.0],
    [122.0, -40.0],
    [136.0, -17.0],
    [152.0, 16.0],
    [168.0, 46.0],
    [180.0, 58.0],
];
/// Distance between the centres of neighbouring vertebrae, and the height of the first one in the phantom, mm.
const VERTEBRA_MM: [f64; 2] = [35.0, -6.0];

/// Depth of a point below the undented skin, mm (positive inside): the outline is a superellipse with a waist.
pub(super) fn skin_depth(p: &Point) -> f64 {
    let waist = (-((p.z + 75.0) / 60.0).powi(2)).exp();
    let (a, b) = (150.0 - 9.0 * waist, 97.0 - 3.0 * waist);
    // Exponent 2.5: x^2.5 = x^2 sqrt(x).
    let (u, v) = ((p.x / a).abs(), (p.y / b).abs());
    let (u15, v15) = (u * u.sqrt(), v * v.sqrt());
    let sum = u15 * u + v15 * v;
    let level = sum.powf(0.4);
    let slope = level / sum.max(1e-12) * ((u15 / a).powi(2) + (v15 / b).powi(2)).sqrt();
    (1.0 - level) / slope.max(1e-6)
}

/// Maximum depth at which the abdominal or chest cavity begins, mm.
pub(super) const CAVITY_MM: f64 = 28.0;

/// Signed distance to the diaphragm, negative on the abdominal side, mm: two domes on a cylinder.
pub(super) fn diaphragm(p: &Point) -> f64 {
    const RIGHT: Ellipsoid = Ellipsoid::upright([-58.0, 2.0, 0.0], [66.0, 70.0, 90.0]);
    const LEFT: Ellipsoid = Ellipsoid::upright([60.0, 2.0, 0.0], [66.0, 70.0, 78.0]);
    let above = Point::new(p.x, p.y, p.z.max(0.0));
    smooth_min(RIGHT.distance(&above), LEFT.distance(&above), 30.0)
}

/// Body wall with its irregular layers.
pub(super) struct Wall {
    fat: Noise,
    edge: Noise,
}

impl Wall {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            fat: Noise::new(seed, 1, 45.0),
            edge: Noise::new(seed, 2, 18.0),
        }
    }

    /// Label of a point.
    pub(super) fn label(&self, p: &Point) -> u8 {
        let depth = skin_depth(p);
        if depth <= 0.0 {
            return 0;
        }
        if depth < SKIN_MM {
            return l::SKIN;
        }
        if depth > CAVITY_MM + 20.0 {
            return self.cavity(p, depth);
        }
        let from_back = p.x.abs().atan2(p.y).to_degrees();
        let fat = 12.0 + 2.5 * self.fat.at(p) + 4.0 * step(-20.0, -100.0, p.z) * step(175.0, 150.0, from_back)
            - 1.5 * step(0.0, 60.0, p.z);
        let below_skin = depth - SKIN_MM;
        if below_skin < fat {
            // The membranous layer (Scarpa's fascia) within the fat of the lower abdominal wall.
            let membrane = (below_skin - 0.6 * fat).abs() < 0.5 && p.z < -20.0 && p.y < 40.0;
            return if membrane { l::FASCIA } else { l::FAT };
        }
        let into = below_skin - fat;
        if into > MUSCLE_MM + 1.0 {
            return self.cavity(p, depth);
        }
        if !(0.9..MUSCLE_MM).contains(&into) {
            return l::FASCIA;
        }
        let above_margin = p.z - curve(&COSTAL_MARGIN, from_back);
        if let Some(rib) = rib(p, from_back, above_margin, into) {
            return rib;
        }
        if above_margin > 0.0 || from_back < 45.0 {
            let line = (into - 2.6).abs() < 0.45 && above_margin > 0.0;
            return if line { l::FASCIA } else { l::MUSCLE };
        }
        flat_muscles(p, into)
    }

    fn cavity(&self, p: &Point, depth: f64) -> u8 {
        if let Some(label) = spine(p).or_else(|| back_muscles(p)) {
            return label;
        }
        if p.z > 0.0 {
            let above = diaphragm(p);
            if above > 1.7 {
                // Fat, not lung, lies in front of the heart.
                let front = 44.0 * (-(p.x / 40.0).powi(2)).exp() * step(-10.0, -45.0, p.y);
                let recess = 24.0 + front + 3.0 * self.edge.at(p);
                let chest = p.z > recess;
                return if chest { l::LUNG } else { l::PERITONEAL_FAT };
            }
            if above > -1.7 && p.z > 6.0 {
                return l::DIAPHRAGM;
            }
        }
        // The muscular part of the diaphragm lines the wall below the lungs.
        let lining = depth < CAVITY_MM - 1.0 && p.z > -20.0 && p.y > -60.0;
        if lining { l::DIAPHRAGM } else { l::PERITONEAL_FAT }
    }
}

/// Bone or cartilage of the rib cage at a height above its lower border and a depth into the muscle wall.
fn rib(p: &Point, from_back: f64, above_margin: f64, into: f64) -> Option<u8> {
    if p.x.abs() < 17.0 && p.y < 0.0 && p.z > 62.0 {
        return ((into - 5.5) / 4.5).abs().lt(&1.0).then_some(l::BONE);
    }
    let nearest = (above_margin / RIB_STEP_MM).round();
    let (off_axis, forward_end) = if nearest >= 0.0 {
        (above_margin - nearest * RIB_STEP_MM, 180.0)
    } else if above_margin > -32.0 {
        (above_margin + 21.0, 78.0)
    } else {
        (above_margin + 42.0, 52.0)
    };
    if from_back > forward_end {
        return None;
    }
    // Ribs run obliquely: their height along the body axis is their width over the cosine of that slope.
    let tall = if from_back < 95.0 { 8.2 } else { 7.2 };
    let level = (off_axis / tall).powi(2) + ((into - 5.6) / 4.1).powi(2);
    if level > 1.0 {
        return None;
    }
    let bone_ends = 141.0 + 3.0 * nearest.max(0.0);
    Some(if from_back > bone_ends { l::CARTILAGE } else { l::BONE })
}

/// Rectus abdominis in its sheath beside the midline; elsewhere the three flat muscles with the fasciae between
/// them.
fn flat_muscles(p: &Point, into: f64) -> u8 {
    let from_midline = p.x.abs();
    if p.y < 0.0 && from_midline < 66.0 {
        let intersection = [22.0, -18.0, -62.0].iter().any(|z| (p.z - z).abs() < 1.3);
        let sheath = !(4.0..62.0).contains(&from_midline);
        return if sheath || intersection { l::FASCIA } else { l::MUSCLE };
    }
    let between = (into - 4.4).abs() < 0.55 || (into - 7.8).abs() < 0.55;
    if between { l::FASCIA } else { l::MUSCLE }
}

/// Vertebrae, discs, canal and the ligament behind the bodies.
fn spine(p: &Point) -> Option<u8> {
    let (x, y) = (p.x, p.y - 46.0);
    if x.abs() > 44.0 || y < -22.0 {
        return None;
    }
    let [step_mm, first] = VERTEBRA_MM;
    let along = (p.z - first) / step_mm;
    let from_middle = (along - along.round()) * step_mm;
    let in_disc = from_middle.abs() > 12.5;
    let waist = 1.0 - 0.09 * (1.0 - (from_middle / 12.5).powi(2)).max(0.0);
    if (x / 24.0).powi(2) + (y / 17.0).powi(2) < waist * waist {
        return Some(if in_disc { l::DISC } else { l::BONE });
    }
    let canal = (x * x + (y - 25.0).powi(2)).sqrt();
    if canal < 7.5 {
        return Some(l::CSF);
    }
    if canal < 9.5 {
        return Some(l::EPIDURAL_FAT);
    }
    if canal < 14.0 && y > 10.0 {
        return Some(if from_middle.abs() < 12.0 { l::BONE } else { l::LIGAMENT });
    }
    let transverse = x.abs() < 42.0 && (y - 20.0 - 0.1 * x.abs()).abs() < 3.5 && (from_middle - 2.0).abs() < 4.5;
    let spinous = x.abs() < 3.2 && y > 12.0 && (from_middle + 5.0).abs() < 9.0;
    (transverse || spinous).then_some(l::BONE)
}

/// Psoas, quadratus lumborum, erector spinae and the crura of the diaphragm.
fn back_muscles(p: &Point) -> Option<u8> {
    let x = p.x.abs();
    let inside = |cx: f64, cy: f64, rx: f64, ry: f64| ((x - cx) / rx).powi(2) + ((p.y - cy) / ry).powi(2) < 1.0;
    let psoas = 20.0 * step(30.0, -60.0, p.z);
    if psoas > 2.0 && inside(28.0 + 0.8 * psoas, 50.0, psoas, 0.95 * psoas) {
        return Some(l::MUSCLE);
    }
    if inside(60.0, 68.0, 18.0, 8.0) && p.z < 10.0 {
        return Some(l::MUSCLE);
    }
    if p.y > 60.0 && x < 74.0 {
        let sheath = x > 72.5 || p.y < 61.0;
        return Some(if sheath { l::FASCIA } else { l::MUSCLE });
    }
    (inside(12.0, 27.0, 6.0, 5.0) && p.z < 50.0).then_some(l::DIAPHRAGM)
}
