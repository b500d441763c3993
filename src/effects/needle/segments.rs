//! The straight pieces of needle and seeds that a frame shows.

use nalgebra::Point3;

use super::present;
use crate::synth::FrameState;
use crate::synth::tables::Tables;
use crate::tracking::needle::MAX_NODES;

/// Start and end of a straight piece in the probe frame (mm), each with a number behind it: its radius and the thickness of
/// the plane that sees it, mm.
pub type Segment<T> = [[T; 4]; 2];

/// Most segments that a frame shows, of needle and seeds together: 192 seeds and more in one plane.
pub const MAX_SEGMENTS: usize = 256;

/// What a frame shows of needle and seeds, for the CPU and for upload: the segments that meet the scan plane. Of a needle of
/// more than 64 those towards the tip, then those of the seeds in their order, up to [`MAX_SEGMENTS`]. What is not finite,
/// or has no thickness, is not shown.
pub fn segments(tables: &Tables, state: &FrameState) -> impl Iterator<Item = Segment<f64>> {
    crossing(tables, state).take(MAX_SEGMENTS)
}

/// How many segments of a frame meet its scan plane, or belong to its needle, and are too many to be shown.
pub fn left_out(tables: &Tables, state: &FrameState) -> usize {
    if !present(tables) {
        return 0;
    }
    let hidden = state.needle.as_ref().map_or(0, |needle| first_shown(&needle.nodes));
    hidden + crossing(tables, state).count().saturating_sub(MAX_SEGMENTS)
}

/// Of a needle of too many nodes, the first that is shown.
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
    let needle = state.needle.iter();
    let needle = needle.map(|needle| (&needle.nodes[first_shown(&needle.nodes)..], needle.diameter_mm));
    let seeds = state.seeds.iter().map(|seed| (&seed.nodes[..], seed.diameter_mm));
    let pairs = needle
        .chain(seeds)
        .flat_map(|(nodes, diameter_mm)| nodes.windows(2).map(move |pair| (pair, diameter_mm)));
    let world_to_probe = state.probe_to_world.try_inverse();
    pairs.filter_map(move |(pair, diameter_mm)| {
        let world_to_probe = world_to_probe?;
        let ends = [pair[0], pair[1]].map(|node| world_to_probe.transform_point(&node));
        segment(ends, diameter_mm, thickness_mm.unwrap_or(diameter_mm))
    })
}

/// A segment, if it is one and meets the plane. Radius and thickness are rounded once, for all backends.
fn segment([start, end]: [Point3<f64>; 2], diameter_mm: f64, thickness_mm: f64) -> Option<Segment<f64>> {
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
