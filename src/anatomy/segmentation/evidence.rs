//! Plausibility of the names of labels: volume, height, course, side and order of organs.

use nalgebra::Vector3;

use crate::acoustics::{Side, side, without_side};
use crate::volume::{Label, LabelVolume};
use insonify_base::document::plain;

/// An organ by its name without a side; numbered ones (vertebrae, ribs) by what they have in common.
struct Organ {
    name: &'static str,
    /// Smallest and largest plausible volume, ml. No smallest one for what is scanned at any length.
    ml: [f64; 2],
    /// Volume in an adult, ml; 0 where volumes vary too much to be evidence.
    adult_ml: f64,
    /// Largest plausible extent from head to feet, mm.
    tallest_mm: f64,
}

/// An organ by the mass of a newborn's and of an adult man's, g (ICRP Publication 89, 2002, table 2.8; one of a pair; hollow organs with
/// their contents). Plausible are a third of the first to six times the second: empty organs and large spleens are within them. Tissue
/// weighs about 1 g/ml.
const fn solid(name: &'static str, newborn: f64, adult_ml: f64, tallest_mm: f64) -> Organ {
    Organ {
        name,
        ml: [newborn / 3.0, 6.0 * adult_ml],
        adult_ml,
        tallest_mm,
    }
}

/// An organ with a largest plausible volume only: at least twice that of the segmentations of adults tried.
const fn any(name: &'static str, most_ml: f64, tallest_mm: f64) -> Organ {
    Organ {
        name,
        ml: [0.0, most_ml],
        adult_ml: 0.0,
        tallest_mm,
    }
}

const ORGANS: &[Organ] = &[
    solid("spleen", 9.5, 150.0, 300.0),
    solid("kidney", 12.5, 155.0, 190.0),
    solid("gallbladder", 3.3, 68.0, 160.0),
    solid("liver", 130.0, 1800.0, 400.0),
    solid("stomach", 47.0, 400.0, 400.0),
    solid("pancreas", 6.0, 140.0, 180.0),
    solid("adrenal_gland", 3.0, 7.0, 90.0),
    solid("esophagus", 2.0, 40.0, 400.0),
    solid("thyroid_gland", 1.3, 20.0, 150.0),
    solid("heart", 46.0, 840.0, 250.0),
    solid("brain", 380.0, 1450.0, 250.0),
    // The blood in all large arteries or all large veins of a man (6 and 18 % of 5.3 l, table 2.14).
    any("aorta", 318.0, 700.0),
    any("inferior_vena_cava", 954.0, 500.0),
    any("portal_vein_and_splenic_vein", 250.0, 250.0),
    any("iliac_artery", 150.0, 400.0),
    any("iliac_vena", 200.0, 400.0),
    any("kidney_cyst", 1500.0, 180.0),
    any("duodenum", 350.0, 180.0),
    any("urinary_bladder", 1500.0, 220.0),
    any("prostate", 300.0, 120.0),
    any("trachea", 150.0, 250.0),
    any("lung", 5000.0, 450.0),
    any("sacrum", 600.0, 250.0),
    any("vertebra", 200.0, 110.0),
    any("rib", 80.0, 300.0),
    any("spinal_cord", 200.0, 700.0),
    any("scapula", 400.0, 280.0),
    any("clavicula", 150.0, 150.0),
    any("sternum", 300.0, 300.0),
    any("liver_vessels", 500.0, 300.0),
    any("lung_vessels", 800.0, 400.0),
];

/// Organs that run from head to feet as a tube.
const TUBES: [&str; 3] = ["aorta", "inferior_vena_cava", "spinal_cord"];

/// Ratio of length to thickness of a tube: below the first it is none, from the second it is evident.
const SLENDER: [f64; 2] = [2.5, 4.0];

/// Extent of a label.
pub(super) struct Extent {
    pub ml: f64,
    /// Whether the edge of the scan cuts the label, so that it may be small.
    cut: bool,
    /// Centre (LPS), mm; NaN for a label without voxels.
    middle_mm: Vector3<f64>,
    /// Lowest and highest voxel, mm above the scan's lowest.
    height_mm: [f64; 2],
    /// First and last voxel along each index axis.
    pub voxels: [[usize; 2]; 3],
}

/// Extents of the labels of a volume.
pub(super) struct Extents {
    pub labels: Vec<Extent>,
    /// Height of the scan, mm.
    scan_mm: f64,
}

impl Extents {
    pub(super) fn of(volume: &LabelVolume) -> Self {
        let count = volume.labels().len();
        let [nx, ny, _] = volume.size();
        let to_world = volume.index_to_world();
        let axis = |axis: usize| to_world.fixed_view::<3, 1>(0, axis).into_owned();
        let up = [0, 1, 2].map(|index| axis(index).z);
        let height = |index: [usize; 3]| -> f64 { (0..3).map(|axis| up[axis] * index[axis] as f64).sum() };
        let mut sums = vec![Vector3::zeros(); count];
        let mut counts = vec![0.0; count];
        let mut heights = vec![[f64::INFINITY, f64::NEG_INFINITY]; count];
        let mut voxels = vec![[[usize::MAX, 0]; 3]; count];
        for (row, line) in volume.voxels().chunks(nx).enumerate() {
            let mut start = 0;
            for run in line.chunk_by(|a, b| a == b) {
                let (label, end) = (usize::from(run[0]), start + run.len() - 1);
                let length = run.len() as f64;
                sums[label] += Vector3::new(0.5 * (start + end) as f64, (row % ny) as f64, (row / ny) as f64) * length;
                counts[label] += length;
                for x in [start, end] {
                    let index = [x, row % ny, row / ny];
                    let z = height(index);
                    heights[label] = [heights[label][0].min(z), heights[label][1].max(z)];
                    for (range, voxel) in voxels[label].iter_mut().zip(index) {
                        *range = [range[0].min(voxel), range[1].max(voxel)];
                    }
                }
                start = end + 1;
            }
        }
        let last = volume.size().map(|n| n - 1);
        let ends = (0..3).map(|axis| up[axis] * last[axis] as f64);
        let (low, high) = ends.fold((0.0, 0.0), |(low, high), end| (low + end.min(0.0), high + end.max(0.0)));
        let areas = cut_mm2(volume);
        let labels = (0..count).map(|label| {
            let mm3 = volume.labels()[label].voxels as f64 * volume.voxel_mm3();
            let middle = (sums[label] / counts[label]).push(1.0);
            Extent {
                ml: mm3 / 1000.0,
                // A tube that leaves the scan is cut across less than a face of the cube of its volume, other truncated
                // organs across more.
                cut: areas[label] >= mm3.powf(2.0 / 3.0),
                middle_mm: (to_world * middle).xyz(),
                height_mm: heights[label].map(|z| z - low),
                voxels: voxels[label],
            }
        });
        Self {
            labels: labels.collect(),
            scan_mm: high - low,
        }
    }

    fn tall_mm(&self, label: usize) -> f64 {
        let [low, high] = self.labels[label].height_mm;
        high - low
    }

    /// Length of a label from head to feet by its mean thickness.
    fn slenderness(&self, label: usize) -> f64 {
        let (tall, mm3) = (self.tall_mm(label), 1000.0 * self.labels[label].ml);
        tall / (mm3 / tall).sqrt()
    }

    /// Whether a label leaves the scan towards head or feet.
    fn leaves(&self, label: usize) -> bool {
        let [low, high] = self.labels[label].height_mm;
        low <= 0.0 || high >= self.scan_mm
    }
}

/// Area of contact of each label with the edge of the scan, mm^2.
fn cut_mm2(volume: &LabelVolume) -> Vec<f64> {
    let (size, to_world) = (volume.size(), volume.index_to_world());
    let step = |axis: usize| to_world.fixed_view::<3, 1>(0, axis).into_owned();
    let mut areas = vec![0.0; volume.labels().len()];
    for axis in 0..3 {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let face = step(u).cross(&step(v)).norm();
        for end in [0, size[axis] - 1] {
            for pixel in 0..size[u] * size[v] {
                let mut index = [0; 3];
                (index[axis], index[u], index[v]) = (end, pixel % size[u], pixel / size[u]);
                areas[usize::from(volume.voxels()[volume.offset(index)])] += face;
            }
        }
    }
    areas
}

/// A direction of the body along which organs have an order.
struct Order {
    /// World axis, and whether positions ascend along it.
    axis: usize,
    ascends: bool,
    /// What the first of two organs does if they are exchanged, and what the file is then.
    is_exchanged: &'static str,
    file_is: &'static str,
    /// Rank of an organ in the order.
    rank: fn(&str, Option<Side>) -> Option<f64>,
    /// Least difference of two ranks that counts, and by how much the two may seem exchanged, mm; both are less for two of a kind.
    least: f64,
    margin_mm: f64,
}

const ORDERS: [Order; 3] = [
    Order {
        axis: 0,
        ascends: true,
        is_exchanged: "lies left of",
        file_is: "mirrored",
        rank: across,
        least: 1.0,
        margin_mm: 10.0,
    },
    Order {
        axis: 1,
        ascends: true,
        is_exchanged: "lies behind",
        file_is: "back to front",
        rank: front_to_back,
        least: 2.0,
        margin_mm: 10.0,
    },
    Order {
        axis: 2,
        ascends: false,
        is_exchanged: "lies below",
        file_is: "upside down",
        rank: head_to_feet,
        least: 5.0,
        margin_mm: 20.0,
    },
];

/// From the patient's right to the left, with the spine in the middle and the large vessels close to it.
fn across(organ: &str, side: Option<Side>) -> Option<f64> {
    // The halves of the heart lie one before the other.
    match (side, organ) {
        (_, "heart_chamber") => None,
        (Some(Side::Right), _) | (None, "liver" | "gallbladder") => Some(-1.0),
        (None, "inferior_vena_cava") => Some(-0.5),
        (None, "vertebra" | "vertebrae" | "spine" | "spinal_cord" | "sacrum") => Some(0.0),
        (None, "aorta") => Some(0.5),
        (Some(Side::Left), _) | (None, "spleen" | "stomach") => Some(1.0),
        _ => None,
    }
}

fn front_to_back(organ: &str, _: Option<Side>) -> Option<f64> {
    match organ {
        "liver" | "stomach" | "gallbladder" | "heart" => Some(-1.0),
        "kidney" | "vertebra" | "vertebrae" | "spinal_cord" | "autochthon" | "sacrum" => Some(1.0),
        _ => None,
    }
}

/// By vertebrae: the number of one, counted from the head, or of those beside an organ.
fn head_to_feet(organ: &str, _: Option<Side>) -> Option<f64> {
    Some(match organ {
        "brain" => 0.0,
        "lung" => 13.0,
        "heart" => 14.0,
        "liver" | "spleen" | "stomach" => 18.0,
        "kidney" | "gallbladder" | "pancreas" => 20.0,
        "sacrum" => 26.0,
        "urinary_bladder" | "rectum" => 27.0,
        "prostate" => 28.0,
        "femur" | "head_of_femur" => 29.0,
        _ => return None,
    })
}

/// Number of a vertebra from the head.
fn vertebra(plain_name: &str) -> Option<f64> {
    let name = plain_name.strip_prefix("vertebra")?.trim_start_matches('e');
    let name = name.trim_start_matches('_').replacen("th", "t", 1);
    let number: u8 = name.get(1..)?.parse().ok()?;
    let above = match (name.as_bytes()[0], number) {
        (b'c', 1..=7) => 0,
        (b't', 1..=13) => 7,
        (b'l', 1..=6) => 19,
        (b's', 1) => 24,
        _ => return None,
    };
    Some(f64::from(above + number))
}

/// A label by what its name says.
struct Named {
    label: usize,
    name: String,
    organ: String,
    side: Option<Side>,
    vertebra: Option<f64>,
}

impl Named {
    fn new((label, name): &(usize, String)) -> Self {
        let plain_name = plain(name);
        let organ = without_side(&plain_name);
        let vertebra = vertebra(&plain_name);
        let organ = match organ.split_once('_') {
            _ if vertebra.is_some() => "vertebra",
            Some(("rib", _)) => "rib",
            Some(("lung", rest)) if rest.ends_with("lobe") => "lung",
            Some(("heart", _)) => "heart_chamber",
            _ => &organ,
        };
        Self {
            label: *label,
            name: name.clone(),
            organ: organ.to_owned(),
            side: side(&plain_name),
            vertebra,
        }
    }

    fn known(&self) -> Option<&'static Organ> {
        ORGANS.iter().find(|organ| organ.name == self.organ)
    }
}

/// Least number of organs that show a factor on all lengths, and the largest logarithm of a volume between the extremes of such organs.
const SCALED_ORGANS: usize = 3;
const SCALED_SPREAD: f64 = 3.0;

/// Factor by which lengths are too large, if most organs have implausible volumes and all are off by about the same factor; otherwise 1.
fn scale<'a>(named: impl Iterator<Item = &'a Named>, extents: &Extents) -> f64 {
    let (mut logarithms, mut odd) = (Vec::new(), 0);
    for named in named {
        let Some(organ) = named.known().filter(|organ| organ.adult_ml > 0.0) else {
            continue;
        };
        let Extent { ml, cut, .. } = extents.labels[named.label];
        if !cut {
            odd += usize::from(!(organ.ml[0]..=organ.ml[1]).contains(&ml));
            logarithms.push((ml / organ.adult_ml).ln());
        }
    }
    let extreme = |fold: fn(f64, f64) -> f64| logarithms.iter().copied().reduce(fold).unwrap_or(0.0);
    let spread = extreme(f64::max) - extreme(f64::min);
    let is_scaled = logarithms.len() >= SCALED_ORGANS && 2 * odd > logarithms.len() && spread < SCALED_SPREAD;
    if is_scaled {
        (logarithms.iter().sum::<f64>() / logarithms.len() as f64 / 3.0).exp()
    } else {
        1.0
    }
}

fn scale_text(scale: f64) -> String {
    if scale < 1.0 {
        format!(
            "all organs are too small alike, by a factor of about 1/{:.0} in length",
            1.0 / scale
        )
    } else {
        format!("all organs are too large alike, by a factor of about {scale:.0} in length")
    }
}

/// Plausibility of the names of labels.
#[derive(Default)]
pub(super) struct Fit {
    /// Labels with evidence for their organ.
    pub sound: Vec<usize>,
    /// Labels that are implausible for their name, each with a description.
    pub odd: Vec<(usize, String)>,
    /// Description of the orders in which most organs are exchanged.
    pub turned: Option<String>,
    /// Description of the factor by which all organs are too small or too large.
    pub scaled: Option<String>,
    /// Sum of the evidence; about the logarithm of a likelihood.
    pub score: f64,
}

impl Fit {
    /// Weighs names of labels.
    pub(super) fn of(labels: &[Label], extents: &Extents, names: &[(usize, String)]) -> Self {
        let mut fit = Self::default();
        let named: Vec<Named> = names.iter().map(Named::new).collect();
        let shown = |named: &Named| format!("label {} ({})", labels[named.label].value, named.name);
        let present = named.iter().filter(|named| extents.labels[named.label].ml > 0.0);
        let scale = scale(present.clone(), extents);
        if scale != 1.0 {
            fit.score += SCALED;
            fit.scaled = Some(scale_text(scale));
        }
        for named in present.clone() {
            fit.weigh(named, extents, scale, &shown(named));
        }
        let mut turned = Vec::new();
        for order in &ORDERS {
            let (mut kept, mut broken) = (0, Vec::new());
            for first in present.clone() {
                for second in present.clone() {
                    match order.holds(first, second, extents, scale) {
                        Some(true) => kept += 1,
                        Some(false) => {
                            let text = format!("{} {} {}", shown(first), order.is_exchanged, shown(second));
                            // A pair is the plainest example: first in the list.
                            let position = if first.organ == second.organ { 0 } else { broken.len() };
                            broken.insert(position, (first.label, text));
                        }
                        None => {}
                    }
                }
            }
            // One pair may as well have wrong names.
            if broken.len() > kept.max(1) {
                fit.score += EXCHANGED * (1.0 + kept as f64);
                let more = match broken.len() {
                    1 => String::new(),
                    n => format!(" and {} more", n - 1),
                };
                turned.push((order.file_is, format!("{}{more}", broken[0].1)));
            } else {
                fit.score += EXCHANGED * broken.len() as f64;
                fit.odd.extend(broken);
            }
        }
        if !turned.is_empty() {
            let (is, pairs): (Vec<_>, Vec<_>) = turned.into_iter().unzip();
            fit.turned = Some(format!("the file is {}: {}", is.join(" and "), pairs.join(", ")));
        }
        let column: Vec<usize> = present
            .filter(|named| named.vertebra.is_some())
            .map(|named| named.label)
            .collect();
        if column.len() >= 3 && !fit.odd.iter().any(|(label, _)| column.contains(label)) {
            fit.score += 1.0;
            fit.sound.extend(column);
        }
        fit
    }

    /// Weighs volume, height and course of a label.
    fn weigh(&mut self, named: &Named, extents: &Extents, scale: f64, shown: &str) {
        let Some(organ) = named.known() else {
            return;
        };
        let Extent { ml, cut, .. } = extents.labels[named.label];
        let ml = ml / scale.powi(3);
        let [low, high] = organ.ml;
        // What is not in the scan as a whole may be small.
        let excused = cut && ml < organ.adult_ml;
        let tall_mm = extents.tall_mm(named.label) / scale;
        if ml > high || (ml < low && !excused) {
            let text = format!("{shown} has {ml:.2} ml, expected {low:.1} to {high:.0} ml");
            self.odd.push((named.label, text));
            self.score += IMPLAUSIBLE;
        } else if tall_mm > organ.tallest_mm {
            let most = organ.tallest_mm;
            let text = format!("{shown} is {tall_mm:.0} mm from head to feet, expected at most {most:.0} mm");
            self.odd.push((named.label, text));
            self.score += IMPLAUSIBLE;
        } else if TUBES.contains(&organ.name) {
            let slenderness = extents.slenderness(named.label);
            if slenderness >= SLENDER[1] {
                self.sound.push(named.label);
                self.score += 0.5;
            } else if slenderness < SLENDER[0] && ml > 10.0 && !extents.leaves(named.label) {
                let text = format!("{shown} is no tube: {ml:.2} ml at {tall_mm:.0} mm from head to feet");
                self.odd.push((named.label, text));
                self.score += IMPLAUSIBLE;
            }
        } else if organ.adult_ml > 0.0 && !excused {
            self.sound.push(named.label);
            self.score += 1.0 - (ml / organ.adult_ml).ln().powi(2);
        }
    }
}

/// Scores of an implausible label, of two exchanged ones and of a factor on all lengths.
const IMPLAUSIBLE: f64 = -4.0;
const EXCHANGED: f64 = -4.0;
const SCALED: f64 = -4.0;

impl Order {
    /// Whether two organs lie in this order; `None` if there is none, or they lie too close.
    fn holds(&self, first: &Named, second: &Named, extents: &Extents, scale: f64) -> Option<bool> {
        let (least, margin_mm, ranks) = match (first.vertebra, second.vertebra) {
            (Some(a), Some(b)) if self.axis == 2 => (1.0, 10.0, [a, b]),
            _ => {
                let rank = |named: &Named| match named.vertebra {
                    Some(number) if self.axis == 2 => Some(number),
                    _ => (self.rank)(&named.organ, named.side),
                };
                let of_a_pair = self.axis == 0 && first.organ == second.organ;
                let margin_mm = if of_a_pair { 0.0 } else { self.margin_mm };
                (self.least, margin_mm, [rank(first)?, rank(second)?])
            }
        };
        if ranks[1] - ranks[0] < least {
            return None;
        }
        let along = |named: &Named| extents.labels[named.label].middle_mm[self.axis];
        let apart = (along(second) - along(first)) * if self.ascends { 1.0 } else { -1.0 };
        if apart > 0.0 {
            Some(true)
        } else {
            (apart < -margin_mm * scale).then_some(false)
        }
    }
}
