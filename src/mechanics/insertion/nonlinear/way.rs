//! What lies on a needle's way.

use nalgebra::{Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use crate::mechanics::insertion::Interaction;
use crate::mechanics::insertion::pushing::{Crossing, Layer, crossings};
use crate::mechanics::tissue::nonlinear::Solid;

/// A gap between elements on the way that is none, mm: rounding.
const GAP_MM: f64 = 1e-3;

/// A layer thinner than this is taken for one with that above it: the line grazes the corner of an element.
const THINNEST_MM: f64 = 0.5;

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
    pub fn find(body: &Solid, regions: &[i32], tip: &Point3<f64>, direction: &Unit<Vector3<f64>>) -> Way {
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
        Way {
            entry: tip + entry_mm * direction.into_inner(),
            direction: *direction,
            regions: layered(stretch, regions, entry_mm),
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

/// Where each region begins, mm from the entry, along crossings in their order: which one a place lies in is decided by the crossing
/// that reaches farthest in.
fn layered(stretch: &[Crossing], regions: &[i32], entry_mm: f64) -> Vec<(f64, i32)> {
    let mut layers: Vec<(f64, i32)> = Vec::new();
    let mut end = f64::NEG_INFINITY;
    for crossing in stretch {
        let [from, to] = [crossing.from_mm, crossing.to_mm].map(|mm| mm - entry_mm);
        if to - from.max(end) < GAP_MM {
            continue;
        }
        let region = regions[crossing.element as usize];
        let begins = if layers.is_empty() { 0.0 } else { from };
        end = to;
        if layers.last().is_none_or(|(_, above)| *above != region) {
            layers.push((begins, region));
        }
    }
    let mut kept: Vec<(f64, i32)> = Vec::new();
    for (at, layer) in layers.iter().enumerate() {
        let to = layers.get(at + 1).map_or(end, |(from, _)| *from);
        let thin = to - layer.0 < THINNEST_MM;
        if kept.last().is_none_or(|(_, above)| *above != layer.1 && !thin) {
            kept.push(*layer);
        }
    }
    kept
}

/// The first region with bone on the way of a needle from `tip` to `length_mm` farther, and where it is met, mm from the tip.
pub fn obstacle(
    body: &Solid,
    regions: &[i32],
    tip: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
    length_mm: f64,
    is_bone: impl Fn(i32) -> bool,
) -> Option<(i32, f64)> {
    let met = crossings(body, &(*tip).into(), &(**direction).into()).into_iter();
    let met = met.map(|crossing| (regions[crossing.element as usize], crossing));
    met.filter(|(region, crossing)| is_bone(*region) && crossing.to_mm > 0.0 && crossing.from_mm < length_mm)
        .map(|(region, crossing)| (region, crossing.from_mm.max(0.0)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Whether the shaft of a needle, `length_mm` behind its tip, is in the body, or the tip touches it.
pub fn in_body(body: &Solid, tip: &Point3<f64>, direction: &Unit<Vector3<f64>>, length_mm: f64) -> bool {
    let met = crossings(body, &(*tip).into(), &(**direction).into());
    // A surface at the tip is not yet entered.
    met.iter()
        .any(|crossing| crossing.from_mm < -GAP_MM && crossing.to_mm > -length_mm)
}
