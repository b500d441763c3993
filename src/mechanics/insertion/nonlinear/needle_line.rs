//! Line of a straight needle through the body, with the regions along it.

use nalgebra::{Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use crate::insertion::pushing::{PathLayer, crossings};
use crate::insertion::{Anatomy, Interaction};
use crate::tissue::nonlinear::{NonlinearBody, Solid};

use super::Frame;

/// Gap between elements on the line that counts as rounding, mm.
const GAP_MM: f64 = 1e-3;

/// Thickness below which a layer is merged with that above it, mm: the line grazes the corner of a region.
const THINNEST_MM: f64 = 0.5;

/// Distance before the entry up to which regions outside the mesh are searched, mm: a mesh cuts corners of the body.
const OUTSIDE_MM: f64 = 5.0;

/// Distance between samples of the regions, mm.
const SAMPLE_MM: f64 = 0.25;

/// Bisections of [`SAMPLE_MM`] to locate the start of a region, to 1e-8 mm.
const HALVINGS: usize = 25;

/// A line with its entry into the body and the regions along it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct NeedleLine {
    /// Point of entry, or the position of the tip if the line does not enter.
    pub entry: Point3<f64>,
    pub direction: Unit<Vector3<f64>>,
    /// Start (mm beyond the entry) and number of each region; empty for a line that does not enter.
    pub regions: Vec<(f64, i32)>,
}

impl NeedleLine {
    /// Finds the line of a needle whose tip is at `tip`: into the first part of the body in front of it, or the one
    /// that contains it.
    pub(super) fn find<const D: usize, const N: usize>(
        body: &NonlinearBody<D, N>,
        frame: &Frame<D>,
        anatomy: &dyn Anatomy,
        tip: &Point3<f64>,
        direction: &Unit<Vector3<f64>>,
    ) -> NeedleLine {
        let mut crossings = crossings(body, &frame.point(tip), &frame.vector(direction));
        crossings.sort_by(|a, b| a.from_mm.total_cmp(&b.from_mm).then(a.element.cmp(&b.element)));
        let (mut start, mut end) = (0, f64::NEG_INFINITY);
        let mut end_index = crossings.len();
        for (index, crossing) in crossings.iter().enumerate() {
            if crossing.from_mm > end + GAP_MM {
                // A stretch of the body ends here.
                if end > 0.0 {
                    end_index = index;
                    break;
                }
                start = index;
            }
            end = end.max(crossing.to_mm);
        }
        let stretch = if end > 0.0 { &crossings[start..end_index] } else { &[] };
        let entry_mm = stretch.first().map_or(0.0, |crossing| crossing.from_mm);
        let entry = tip + entry_mm * direction.into_inner();
        let length_mm = if stretch.is_empty() { 0.0 } else { end - entry_mm };
        NeedleLine {
            regions: layered(anatomy, &entry, direction, length_mm),
            entry,
            direction: *direction,
        }
    }

    pub(super) fn region(&self, layer: usize) -> Option<i32> {
        self.regions.get(layer).map(|(_, region)| *region)
    }

    /// Returns the distance of a point from the line, mm.
    pub(crate) fn beside_mm(&self, point: &Point3<f64>) -> f64 {
        (point - self.entry).cross(&self.direction).norm()
    }

    /// Returns the position of a point along the line, mm beyond the entry.
    pub(super) fn travel_mm(&self, point: &Point3<f64>) -> f64 {
        (point - self.entry).dot(&self.direction)
    }

    /// Returns the layers, by the interactions of their regions with the needle.
    pub(super) fn layers(&self, interaction_of: impl Fn(i32) -> Interaction) -> Vec<PathLayer> {
        let layer = |&(from_mm, region): &(f64, i32)| {
            let interaction = interaction_of(region);
            let breaks = interaction.puncture_n > interaction.cutting_n;
            PathLayer {
                from_mm,
                membrane_n: if breaks { interaction.puncture_n } else { 0.0 },
                cutting_n: interaction.cutting_n,
                friction_n_per_mm: interaction.friction_n_per_mm,
                static_ratio: interaction.static_ratio,
                peak: interaction.peak,
            }
        };
        self.regions.iter().map(layer).collect()
    }
}

/// Returns the start of each region, mm from the entry, along a line of the given length through the body. Points
/// outside all regions belong to the region before them, or, at the beginning, to that after them. Regions of the body
/// in front of the entry that the mesh omits are met at the entry, one after the other.
fn layered(
    anatomy: &dyn Anatomy,
    entry: &Point3<f64>,
    direction: &Unit<Vector3<f64>>,
    length_mm: f64,
) -> Vec<(f64, i32)> {
    let region_at = |mm: f64| anatomy.region(&(entry + direction.scale(mm)));
    let mut layers: Vec<(f64, i32)> = Vec::new();
    let outside = (1..=(OUTSIDE_MM / SAMPLE_MM) as usize).map(|sample| sample as f64 * SAMPLE_MM);
    let outside_mm = outside.take_while(|mm| region_at(-mm).is_some()).last().unwrap_or(0.0);
    let samples = ((outside_mm + length_mm) / SAMPLE_MM).ceil() as usize;
    let spacing = (outside_mm + length_mm) / samples as f64;
    for sample in 0..samples {
        // In the middle of each interval: at the very entry, rounding would decide whether the body has
        // begun.
        let mm = (sample as f64 + 0.5) * spacing - outside_mm;
        let Some(region) = region_at(mm) else { continue };
        match layers.last() {
            None => layers.push((-outside_mm, region)),
            Some((_, above)) if *above == region => {}
            Some(_) => {
                let [mut before, mut behind] = [mm - spacing, mm];
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (before + behind);
                    *(if region_at(middle) == Some(region) {
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
    for (index, layer) in layers.iter().enumerate() {
        let to = layers.get(index + 1).map_or(length_mm, |(from, _)| *from);
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

/// Returns the distance from `tip` to the first bone on the line of a needle up to `length_mm`, mm.
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

/// Returns whether the shaft of a needle, `length_mm` behind its tip, is in the body, or the tip touches it.
pub fn in_body(body: &Solid, tip: &Point3<f64>, direction: &Unit<Vector3<f64>>, length_mm: f64) -> bool {
    let crossed = crossings(body, &(*tip).into(), &(**direction).into());
    // A surface at the tip is not yet entered.
    crossed
        .iter()
        .any(|crossing| crossing.from_mm < -GAP_MM && crossing.to_mm > -length_mm)
}
