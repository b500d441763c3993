//! What lies on a needle's way.

use nalgebra::{Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use crate::mechanics::insertion::pushing::{Layer, crossings};
use crate::mechanics::insertion::{Anatomy, Interaction};
use crate::mechanics::tissue::nonlinear::Solid;

/// A gap between elements on the way that is none, mm: rounding.
const GAP_MM: f64 = 1e-3;

/// A layer thinner than this is taken for one with that above it: the line grazes the corner of a region.
const THINNEST_MM: f64 = 0.5;

/// Distance before the entry up to which regions outside the mesh are looked for, mm: a mesh cuts corners of the body.
const OUTSIDE_MM: f64 = 5.0;

/// Distance at which regions are looked at, mm.
const SAMPLE_MM: f64 = 0.25;

/// Halvings of it to where a region begins, 1e-8 mm.
const HALVINGS: usize = 25;

/// A line, where it enters the body, and the regions along it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Way {
    /// Where it enters; of one that does not, where the tip was.
    pub entry: Point3<f64>,
    pub direction: Unit<Vector3<f64>>,
    /// Where each region begins, mm beyond the entry; none of a line that does not enter.
    pub regions: Vec<(f64, i32)>,
}

impl Way {
    /// That of a needle whose tip is at `tip`: into the first part of the body before it, or the one that it is in.
    pub fn find(body: &Solid, anatomy: &dyn Anatomy, tip: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Way {
        let mut all = crossings(body, &(*tip).into(), &(**direction).into());
        all.sort_by(|a, b| a.from_mm.total_cmp(&b.from_mm).then(a.element.cmp(&b.element)));
        let (mut start, mut end) = (0, f64::NEG_INFINITY);
        let mut last = all.len();
        for (at, crossing) in all.iter().enumerate() {
            if crossing.from_mm > end + GAP_MM {
                // A stretch of the body ends here.
                if end > 0.0 {
                    last = at;
                    break;
                }
                start = at;
            }
            end = end.max(crossing.to_mm);
        }
        let stretch = if end > 0.0 { &all[start..last] } else { &[] };
        let entry_mm = stretch.first().map_or(0.0, |crossing| crossing.from_mm);
        let entry = tip + entry_mm * direction.into_inner();
        let length_mm = if stretch.is_empty() { 0.0 } else { end - entry_mm };
        Way {
            regions: layered(anatomy, &entry, direction, length_mm),
            entry,
            direction: *direction,
        }
    }

    pub fn region(&self, layer: usize) -> Option<i32> {
        self.regions.get(layer).map(|(_, region)| *region)
    }

    /// How far a point is beside the line, mm.
    pub fn beside_mm(&self, point: &Point3<f64>) -> f64 {
        (point - self.entry).cross(&self.direction).norm()
    }

    /// How far a point is beyond the entry, mm.
    pub fn travel_mm(&self, point: &Point3<f64>) -> f64 {
        (point - self.entry).dot(&self.direction)
    }

    /// The layers, by what their regions do to the needle.
    pub fn layers(&self, of: impl Fn(i32) -> Interaction) -> Vec<Layer> {
        let layer = |&(from_mm, region): &(f64, i32)| {
            let of = of(region);
            let breaks = of.puncture_n > of.cutting_n;
            Layer {
                from_mm,
                membrane_n: if breaks { of.puncture_n } else { 0.0 },
                cutting_n: of.cutting_n,
                friction_n_per_mm: of.friction_n_per_mm,
                static_ratio: of.static_ratio,
            }
        };
        self.regions.iter().map(layer).collect()
    }
}

/// Where each region begins, mm from the entry, along a line of some length through the body. What is in no region counts as what is
/// before it, or at the beginning behind it. Regions of the body that the mesh leaves out before the entry are met there, one after the
/// other.
fn layered(
    anatomy: &dyn Anatomy,
    entry: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
    length_mm: f64,
) -> Vec<(f64, i32)> {
    let at = |mm: f64| anatomy.region(&(entry + direction.scale(mm)));
    let mut layers: Vec<(f64, i32)> = Vec::new();
    let outside = (1..=(OUTSIDE_MM / SAMPLE_MM) as usize).map(|sample| sample as f64 * SAMPLE_MM);
    let outside_mm = outside.take_while(|mm| at(-mm).is_some()).last().unwrap_or(0.0);
    let samples = ((outside_mm + length_mm) / SAMPLE_MM).ceil() as usize;
    let spacing = (outside_mm + length_mm) / samples as f64;
    for sample in 0..samples {
        let mm = (sample as f64 + 0.5) * spacing - outside_mm;
        let Some(region) = at(mm) else { continue };
        match layers.last() {
            None => layers.push((-outside_mm, region)),
            Some((_, above)) if *above == region => {}
            Some(_) => {
                let [mut before, mut behind] = [mm - spacing, mm];
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (before + behind);
                    *(if at(middle) == Some(region) {
                        &mut behind
                    } else {
                        &mut before
                    }) = middle;
                }
                layers.push((behind, region));
            }
        }
    }
    let mut kept: Vec<(f64, i32)> = Vec::new();
    for (at, layer) in layers.iter().enumerate() {
        let to = layers.get(at + 1).map_or(length_mm, |(from, _)| *from);
        let thin = to - layer.0 < THINNEST_MM;
        if kept.last().is_none_or(|(_, above)| *above != layer.1 && !thin) {
            kept.push(*layer);
        }
    }
    let mut least = 0.0;
    for (from, _) in &mut kept {
        *from = from.max(least);
        least = *from + THINNEST_MM;
    }
    kept
}

/// Where bone is first met on the line of a needle from `tip` to `length_mm` farther, mm from the tip.
pub fn obstacle(
    anatomy: &dyn Anatomy,
    tip: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
    length_mm: f64,
) -> Option<f64> {
    let samples = (length_mm / SAMPLE_MM).ceil().max(0.0) as usize;
    let places = (0..=samples).map(|sample| (sample as f64 * SAMPLE_MM).min(length_mm));
    let is_bone = |mm: f64| {
        let region = anatomy.region(&(tip + direction.scale(mm)));
        region.is_some_and(|region| anatomy.interaction(region).bone.is_some())
    };
    places.into_iter().find(|mm| is_bone(*mm))
}

/// Whether the shaft of a needle, `length_mm` behind its tip, is in the body, or the tip touches it.
pub fn in_body(body: &Solid, tip: &Point3<f64>, direction: &Unit<Vector3<f64>>, length_mm: f64) -> bool {
    let met = crossings(body, &(*tip).into(), &(**direction).into());
    // A surface at the tip is not yet entered.
    met.iter()
        .any(|crossing| crossing.from_mm < -GAP_MM && crossing.to_mm > -length_mm)
}
