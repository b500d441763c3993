//! Plausibility of the names of labels: volume, height, course, side and order of organs.

mod order;
mod organs;
mod places;
mod pose;

use super::extent::{Extent, Extents};
use crate::acoustics::{Side, side, without_side};
use crate::volume::{Label, LabelVolume};
use insonify_base::document::plain;
use order::{ORDERS, Order};
use organs::{ORGANS, Organ};
use places::Place;
use pose::Pose;

/// Organs that run from head to feet as a tube.
const TUBES: [&str; 3] = ["aorta", "inferior_vena_cava", "spinal_cord"];

/// Ratio of length to thickness of a tube: below the first it is none, from the second it is evident.
const SLENDER: [f64; 2] = [2.5, 4.0];

/// Ratio from which an organ that is no tube is one.
const TUBULAR: f64 = 8.0;

/// Number of organs with a place from which one elsewhere is told from the others.
const PLACED: usize = 4;

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
    place: Option<Place>,
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
            place: Place::of(&plain_name),
        }
    }

    fn known(&self) -> Option<&'static Organ> {
        ORGANS.iter().find(|organ| organ.name == self.organ)
    }
}

/// Least number of organs that show a factor on all lengths, with names by value and with names that the file states,
/// and the largest logarithm of the ratio of volumes between the extremes of such organs.
const SCALED_ORGANS: usize = 3;
const SCALED_NAMED: usize = 2;
const SCALED_SPREAD: f64 = 3.0;

/// Factor by which lengths are too large, if most organs have implausible volumes and all are off by about the same
/// factor; otherwise 1.
fn scale<'a>(named: impl Iterator<Item = &'a Named>, extents: &Extents, least: usize) -> f64 {
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
    let is_scaled = logarithms.len() >= least && 2 * odd > logarithms.len() && spread < SCALED_SPREAD;
    if is_scaled {
        (logarithms.iter().sum::<f64>() / logarithms.len() as f64 / 3.0).exp()
    } else {
        1.0
    }
}

fn scale_text(scale: f64) -> String {
    if scale < 1.0 {
        let unit = if (0.07..0.14).contains(&scale) {
            ", as if in centimetres"
        } else {
            ""
        };
        format!(
            "all organs are too small alike, by a factor of about 1/{:.0} in length{unit}",
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
    /// Labels that do not lie where their organ does, each with a description.
    pub elsewhere: Vec<(usize, String)>,
    /// Whether the labels do not lie as the organs of their names do.
    pub is_scattered: bool,
    /// Description of the orders in which most organs are exchanged.
    pub turned: Option<String>,
    /// Description of the factor by which all organs are too small or too large.
    pub scaled: Option<String>,
    /// Sum of the evidence; about the logarithm of a likelihood.
    pub score: f64,
}

/// The frame in which organs are to be in order.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Frame {
    /// The body's own, so that no orientation of the file decides on names.
    Body,
    /// The file's, except for a tilt of the body, which may also be turned about its long axis by an angle of this
    /// tangent.
    File { slant: f64 },
}

impl Fit {
    /// Weighs names of labels.
    pub(super) fn of(volume: &LabelVolume, extents: &Extents, names: &[(usize, String)], frame: Frame) -> Self {
        let mut fit = Self::default();
        let named: Vec<Named> = names.iter().map(Named::new).collect();
        let shown = |named: &Named| shown(volume.labels(), named);
        let present: Vec<&Named> = named
            .iter()
            .filter(|named| extents.labels[named.label].ml > 0.0)
            .collect();
        let least = if frame == Frame::Body {
            SCALED_ORGANS
        } else {
            SCALED_NAMED
        };
        let scale = scale(present.iter().copied(), extents, least);
        if scale != 1.0 {
            fit.score += SCALED;
            fit.scaled = Some(scale_text(scale));
        }
        let pose = Pose::of(present.iter().copied(), extents, scale);
        let upright = pose.upright().map(|turn| Extents::turned(volume, &turn));
        let upright = upright.as_ref().unwrap_or(extents);
        for named in &present {
            fit.weigh(named, upright, &pose, scale, &shown(named));
        }
        // Organs that a turn of the whole body puts out of order are told as such.
        let is_turned = frame != Frame::Body && !pose.is_upright();
        let (ordered, slant) = match frame {
            Frame::File { slant } if is_turned => (extents, slant),
            Frame::File { slant } => (upright, slant),
            Frame::Body => (upright, 0.0),
        };
        let odd = fit.odd.len();
        fit.order(&present, ordered, volume.labels(), scale, slant);
        if is_turned {
            fit.odd.truncate(odd);
            if let Some(axes) = pose.exchanged() {
                let told = format!("the axes {axes} seem to be exchanged (transpose the array before it is saved)");
                fit.turned = Some(told);
            }
            fit.turned.get_or_insert_with(|| {
                if pose.is_mirrored() {
                    "the file is mirrored".to_owned()
                } else {
                    format!("the body is turned by {:.0} degrees in the file", pose.angle_deg())
                }
            });
        }
        fit.locate(&pose, &present, &shown);
        let is_odd = |label: &usize| fit.odd.iter().chain(&fit.elsewhere).any(|(odd, _)| odd == label);
        let column: Vec<usize> = present
            .iter()
            .filter(|named| named.vertebra.is_some())
            .map(|named| named.label)
            .collect();
        if column.len() >= 3 && !column.iter().any(is_odd) {
            fit.score += 1.0;
            fit.sound.extend(column);
        }
        fit.sound.sort_unstable();
        fit.sound.dedup();
        let odd: Vec<usize> = fit.odd.iter().chain(&fit.elsewhere).map(|(label, _)| *label).collect();
        fit.sound.retain(|label| !odd.contains(label));
        fit
    }

    /// Weighs the places of labels.
    fn locate(&mut self, pose: &Pose, named: &[&Named], shown: &dyn Fn(&Named) -> String) {
        if pose.count < 2 {
            return;
        }
        self.score += pose.score;
        self.is_scattered = pose.count >= 3 && pose.score <= 0.0;
        if self.is_scattered || pose.count < 3 {
            return;
        }
        self.sound.extend(&pose.sound);
        if pose.count >= PLACED {
            let text = |&(label, distance_mm): &(usize, f64)| {
                let named = named.iter().find(|named| named.label == label)?;
                let text = format!(
                    "{} lies {distance_mm:.0} mm from where it would among the others",
                    shown(named)
                );
                Some((label, text))
            };
            self.elsewhere = pose.elsewhere.iter().filter_map(text).collect();
        }
    }

    /// Weighs the order of organs.
    fn order(&mut self, present: &[&Named], extents: &Extents, labels: &[Label], scale: f64, slant: f64) {
        let mut turned = Vec::new();
        for order in &ORDERS {
            let (kept, broken) = pairs(order, present, extents, labels, scale, slant);
            // One pair may as well have wrong names.
            if broken.len() > kept.max(1) {
                self.score += EXCHANGED * (1.0 + kept as f64);
                let more = match broken.len() {
                    1 => String::new(),
                    n => format!(" and {} more", n - 1),
                };
                turned.push((order.file_is, format!("{}{more}", broken[0].1)));
            } else {
                self.score += EXCHANGED * broken.len() as f64;
                self.odd.extend(broken);
            }
        }
        if !turned.is_empty() {
            let (is, pairs): (Vec<_>, Vec<_>) = turned.into_iter().unzip();
            self.turned = Some(format!("the file is {}: {}", is.join(" and "), pairs.join(", ")));
        }
    }

    /// Weighs volume, height and course of a label.
    fn weigh(&mut self, named: &Named, extents: &Extents, pose: &Pose, scale: f64, shown: &str) {
        let Some(organ) = named.known() else {
            return;
        };
        let Extent { ml, cut, .. } = extents.labels[named.label];
        let ml = ml / scale.powi(3);
        let [low, high] = organ.ml;
        // What is not in the scan as a whole may be small.
        let excused = cut && ml < organ.adult_ml;
        let tall_mm = extents.tall_mm(named.label) / scale;
        let slenderness = extents.slenderness(named.label);
        let mut odd = |text: String| {
            self.odd.push((named.label, text));
            self.score += IMPLAUSIBLE;
        };
        if ml > high || (ml < low && !excused) {
            odd(format!("{shown} has {ml:.2} ml, expected {low:.1} to {high:.0} ml"));
        } else if tall_mm > organ.tallest_mm {
            let most = organ.tallest_mm;
            odd(format!(
                "{shown} is {tall_mm:.0} mm from head to feet, expected at most {most:.0} mm"
            ));
        } else if TUBES.contains(&organ.name) {
            if slenderness >= SLENDER[1] {
                self.sound.push(named.label);
                self.score += 0.5;
            } else if slenderness < SLENDER[0] && ml > 10.0 && !extents.leaves(named.label) {
                odd(format!(
                    "{shown} is no tube: {ml:.2} ml at {tall_mm:.0} mm from head to feet"
                ));
            }
        } else if organ.adult_ml > 0.0 && organ.name != "esophagus" && slenderness > TUBULAR {
            odd(format!(
                "{shown} is a tube: {ml:.2} ml at {tall_mm:.0} mm from head to feet"
            ));
        } else if organ.adult_ml > 0.0 && !excused {
            let evidence = 1.0 - (ml / (organ.adult_ml * pose.size().powi(3))).ln().powi(2);
            self.score += evidence;
            if evidence > 0.0 {
                self.sound.push(named.label);
            }
        }
    }
}

fn shown(labels: &[Label], named: &Named) -> String {
    format!("label {} ({})", labels[named.label].value, named.name)
}

/// Number of pairs of organs that are in order, and the others: the first of each with a description.
fn pairs(
    order: &Order,
    present: &[&Named],
    extents: &Extents,
    labels: &[Label],
    scale: f64,
    slant: f64,
) -> (usize, Vec<(usize, String)>) {
    let (mut kept, mut broken) = (0, Vec::new());
    for first in present {
        for second in present {
            match order.holds(first, second, extents, scale, slant) {
                Some(true) => kept += 1,
                Some(false) => {
                    let text = format!(
                        "{} {} {}",
                        shown(labels, first),
                        order.is_exchanged,
                        shown(labels, second)
                    );
                    // A pair is the plainest example: first in the list.
                    let position = if first.organ == second.organ { 0 } else { broken.len() };
                    broken.insert(position, (first.label, text));
                }
                None => {}
            }
        }
    }
    (kept, broken)
}

/// Scores of an implausible label, of two exchanged ones and of a factor on all lengths.
const IMPLAUSIBLE: f64 = -4.0;
const EXCHANGED: f64 = -4.0;
const SCALED: f64 = -4.0;
