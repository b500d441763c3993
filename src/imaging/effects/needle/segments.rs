//! Straight segments of needle and seeds in a frame.

use nalgebra::Point3;

use super::present;
use crate::synth::tables::Tables;
use crate::synth::{FrameState, NeedleView};
use insonify_base::matrix::inverse_rigid;
use insonify_tracking::needle::MAX_NODES;

/// Start and end of a straight segment in the probe frame (mm), followed by its radius and by the thickness of the
/// plane for it, mm. Then the distances of its start and end from the tip (mm), the number of its shaft (0 for the
/// needle), and the factor on its echo before a point spread.
pub type Segment<T> = [[T; 4]; 3];

/// Maximum number of segments of needle and seeds in a frame: at least 192 seeds in one plane.
pub(crate) const MAX_SEGMENTS: usize = 256;

/// Segments of needle and seeds that meet the scan plane, for the CPU and for upload. For a needle of more than 64
/// segments those towards the tip, then those of the seeds in their order, up to `MAX_SEGMENTS`. Segments that are
/// not finite or have no thickness are skipped.
pub fn segments(tables: &Tables, state: &FrameState) -> impl Iterator<Item = Segment<f64>> {
    crossing(tables, state).take(MAX_SEGMENTS)
}

/// Number of segments of a frame that meet its scan plane, or belong to its needle, but exceed the maximum.
pub fn left_out(tables: &Tables, state: &FrameState) -> usize {
    if !present(tables) {
        return 0;
    }
    let hidden = state.needle.as_ref().map_or(0, |needle| first_shown(&needle.nodes));
    hidden + crossing(tables, state).count().saturating_sub(MAX_SEGMENTS)
}

/// Distance between points of a shaft at which the distance from the sector is computed, mm.
const STEP_MM: f64 = 1.0;
/// Maximum number of steps along a segment.
const MAX_STEPS: f64 = 1e3;

/// View of the needle in a frame; `None` if it has none.
pub(crate) fn view(tables: &Tables, state: &FrameState) -> Option<NeedleView> {
    let needle = state.needle.as_ref()?;
    let Some(echo) = &tables.settings.effects.needle else {
        return Some(NeedleView::Excluded);
    };
    let world_to_probe = inverse_rigid(&state.probe_to_world);
    let thickness_mm = echo.thickness_mm.unwrap_or(needle.diameter_mm);
    let mut distance_mm = f64::INFINITY;
    for pair in needle.nodes[first_shown(&needle.nodes)..].windows(2) {
        let [start, end] = [pair[0], pair[1]].map(|node| world_to_probe.transform_point(&node));
        // Of a segment that meets the plane, the part that does.
        let is_met = segment([start, end], needle.diameter_mm, thickness_mm).is_some();
        let reach = (needle.diameter_mm + thickness_mm) / 2.0;
        let across = |z: f64| (z - start.z) / (end.z - start.z);
        let [from, to] = if is_met && start.z != end.z {
            let [a, b] = [across(-reach), across(reach)];
            [a.min(b).max(0.0), a.max(b).min(1.0)]
        } else {
            [0.0, 1.0]
        };
        let steps = ((end - start).norm() * (to - from) / STEP_MM)
            .ceil()
            .clamp(1.0, MAX_STEPS);
        for step in 0..=steps as usize {
            let point = start + (end - start) * (from + (to - from) * step as f64 / steps);
            let aside = tables.grid.distance_mm(point.x, point.y);
            if is_met && aside == 0.0 {
                return Some(NeedleView::Inside);
            }
            distance_mm = distance_mm.min(aside.hypot(point.z));
        }
    }
    Some(NeedleView::Outside { distance_mm })
}

/// Index of the first node shown of a needle with too many nodes.
fn first_shown(nodes: &[Point3<f64>]) -> usize {
    nodes.len().saturating_sub(MAX_NODES)
}

/// All segments that meet the scan plane: the needle's, then those of the seeds.
fn crossing(tables: &Tables, state: &FrameState) -> impl Iterator<Item = Segment<f64>> {
    let thickness_mm = tables
        .settings
        .effects
        .needle
        .as_ref()
        .and_then(|needle| needle.thickness_mm);
    let shafts = state
        .needle
        .iter()
        .map(|needle| (0, needle))
        .chain((1..).zip(&state.seeds));
    let pieces = shafts.flat_map(|(number, shaft)| {
        let nodes = &shaft.nodes[first_shown(&shaft.nodes)..];
        let length = |pair: &[Point3<f64>]| (pair[1] - pair[0]).norm();
        let mut from_tip: f64 = nodes.windows(2).map(length).sum();
        nodes.windows(2).map(move |pair| {
            let start = from_tip;
            from_tip -= length(pair);
            (pair, shaft.diameter_mm, [start, from_tip.max(0.0), f64::from(number)])
        })
    });
    let world_to_probe = state.probe_to_world.try_inverse();
    let speckle = tables.effects.speckle.as_ref();
    pieces.filter_map(move |(pair, diameter_mm, [start, end, number])| {
        let world_to_probe = world_to_probe?;
        let ends = [pair[0], pair[1]].map(|node| world_to_probe.transform_point(&node));
        let [start_of, end_of] = segment(ends, diameter_mm, thickness_mm.unwrap_or(diameter_mm))?;
        let factor = speckle.map_or(1.0, |speckle| {
            1.0 / speckle.thick_gain(diameter_mm / 2.0, tables.sample_mm())
        });
        // If another segment is not finite, the distance from the tip is unknown.
        let rounded = [start, end, number, factor].map(|x| if x.is_finite() { f64::from(x as f32) } else { 0.0 });
        Some([start_of, end_of, rounded])
    })
}

/// Both ends of a segment, if it is valid and meets the plane. Radius and thickness are rounded once, for all
/// backends.
fn segment([start, end]: [Point3<f64>; 2], diameter_mm: f64, thickness_mm: f64) -> Option<[[f64; 4]; 2]> {
    let [radius, thickness] = [diameter_mm / 2.0, thickness_mm].map(|length| f64::from(length as f32));
    let is_finite = start
        .iter()
        .chain(end.iter())
        .chain([&radius, &thickness])
        .all(|x| x.is_finite());
    let reach = radius + thickness / 2.0;
    let meets = start.z.min(end.z) <= reach && start.z.max(end.z) >= -reach;
    let shown = is_finite && radius > 0.0 && meets;
    shown.then_some([[start.x, start.y, start.z, radius], [end.x, end.y, end.z, thickness]])
}

#[cfg(test)]
mod tests;
