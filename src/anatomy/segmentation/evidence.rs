//! Plausibility of the names of labels: volume, height, course, side and order of organs.

mod order;
mod organs;

use super::extent::{Extent, Extents};
use crate::acoustics::{Side, side, without_side};
use crate::volume::Label;
use insonify_base::document::plain;
use order::ORDERS;
use organs::{ORGANS, Organ};

/// Organs that run from head to feet as a tube.
const TUBES: [&str; 3] = ["aorta", "inferior_vena_cava", "spinal_cord"];

/// Ratio of length to thickness of a tube: below the first it is none, from the second it is evident.
const SLENDER: [f64; 2] = [2.5, 4.0];

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

/// Least number of organs that show a factor on all lengths, and the largest logarithm of a volume between the extremes
/// of such organs.
const SCALED_ORGANS: usize = 3;
const SCALED_SPREAD: f64 = 3.0;

/// Factor by which lengths are too large, if most organs have implausible volumes and all are off by about the same
/// factor; otherwise 1.
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
    /// Weighs names of labels. `slant` is the tangent of the angle by which the body may be turned about its long axis.
    pub(super) fn of(labels: &[Label], extents: &Extents, names: &[(usize, String)], slant: f64) -> Self {
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
                    match order.holds(first, second, extents, scale, slant) {
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
