//! Error bounds of the slice: the label of every sample. A twin may read another label only where the sample provably
//! lies within rounding of a label boundary.

use std::collections::BTreeSet;

use crate::effects::slice::{Beyond, Boundary, WITHIN, spline};
use crate::synth::tables::Tables;

use crate::parity::rounding::ULP;
use crate::parity::{Slack, Step};

/// Rounding error of one term of an index, in ULP: matrix stored (1/2), product (1), three sums (3).
const TERM: f64 = 4.5;

/// Rounding error of a share of the votes under trilinear interpolation, in ULP: eight weights of two products each
/// from fractions that lose one difference each, and up to seven sums, of weights that sum to 1.
const SHARE: f64 = 2.0 + 3.0 + 7.0;

/// Rounding error of a share of the votes under B-splines, in ULP: weights of up to eight operations each from a
/// fraction that loses a difference, two products, and sums of four by four by four terms, of weights that sum to 1.
const SMOOTH_SHARE: f64 = 3.0 * (8.0 + 1.0) + 2.0 + 12.0 + 16.0;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let echo = |label: u8| f64::from(step.tables.label_rows[usize::from(label)].echo);
    for index in 0..step.after.label.len() {
        let (exact, twin) = (step.after.label[index], step.twin.label[index]);
        if exact != twin && !slack.torn[index] {
            let possible = possible_labels(step.tables, step.after.position[index], slack.position[index]);
            let (line, sample) = step.place(index);
            slack.labels_apart += 1;
            if !(possible.contains(&exact) && possible.contains(&twin)) {
                slack.fault(format!(
                    "line {line}, sample {sample}: label {twin} instead of {exact}; within rounding there are only {possible:?}"
                ));
            }
        }
        slack.amplitude[index] = (echo(exact) - echo(twin)).abs();
    }
}

/// Returns the labels possible within rounding at a reference position (with its flag; relative to the local origin)
/// known to `off` mm.
pub(crate) fn possible_labels(tables: &Tables, position: [f64; 4], off: [f64; 3]) -> BTreeSet<u8> {
    labels_by(tables, position, off, tables.settings.effects.slice.boundary)
}

/// The same by a rule near boundaries.
pub(crate) fn labels_by(tables: &Tables, [x, y, z, flag]: [f64; 4], off: [f64; 3], boundary: Boundary) -> BTreeSet<u8> {
    if flag == 1.0 {
        return BTreeSet::from([0]);
    }
    let matrix = tables.volume.world_to_index();
    let size = tables.volume.size().map(|n| n as f64);
    let p = [x, y, z];
    let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
    for row in 0..3 {
        let terms = |q: [f64; 3]| (0..3).map(|c| (matrix[(row, c)] * q[c]).abs()).sum::<f64>();
        let index = (0..3).map(|c| matrix[(row, c)] * p[c]).sum::<f64>() + matrix[(row, 3)];
        let rounding = TERM * ULP * (terms(p) + matrix[(row, 3)].abs()) + ULP * (index.abs() + 0.5);
        let off = terms(off) + rounding;
        (low[row], high[row]) = (index - off, index + off);
    }
    let mut labels = BTreeSet::new();
    // Possible positions may lie on both sides of a face: labels beyond it are then added to those within.
    if (0..3).any(|axis| low[axis] + 0.5 <= 0.0 || high[axis] + 0.5 >= size[axis]) {
        if tables.settings.effects.slice.beyond == Beyond::Void {
            labels.insert(0);
        } else {
            let mut faces = BTreeSet::new();
            let clamped = |ends: [f64; 3]| std::array::from_fn(|axis| ends[axis].clamp(-0.5, size[axis] - 1.5));
            nearest(tables, clamped(low), clamped(high), &mut faces);
            if faces.contains(&0) {
                labels.insert(0);
            }
            for axis in 0..3 {
                [low[axis], high[axis]] = folded([low[axis], high[axis]], size[axis]);
                if low[axis] + 0.5 <= 0.0 || high[axis] + 0.5 >= size[axis] {
                    labels.insert(0);
                }
            }
        }
    }
    match boundary {
        Boundary::Nearest => nearest(tables, low, high, &mut labels),
        boundary => vote(tables, low, high, boundary, &mut labels),
    }
    labels
}

/// Mirrors a range of indices along an axis of `size` voxels at both ends; indices on an end stay within.
fn folded([low, high]: [f64; 2], size: f64) -> [f64; 2] {
    // Negation and differences of numbers up to twice the size lose 2 ULP of it.
    let off = 2.0 * ULP * (2.0 * size + low.abs().max(high.abs()));
    let ends = [-0.5, size - 0.5];
    let mirror = |position: f64| match position {
        position if position < ends[0] => 2.0 * ends[0] - position,
        position if position >= ends[1] => 2.0 * ends[1] - position,
        position => position,
    };
    let [a, b] = [mirror(low), mirror(high)];
    let on_end = |end: f64| low < end && high >= end;
    let reached = [a, b].into_iter().chain(ends.into_iter().filter(|end| on_end(*end)));
    let (lowest, highest) = reached.fold((f64::INFINITY, f64::NEG_INFINITY), |(lowest, highest), position| {
        (lowest.min(position), highest.max(position))
    });
    let (lowest, highest) = (lowest - off, highest + off);
    // Indices mirrored at the upper end keep a distance from it.
    let lowest = if high >= ends[1] {
        lowest.min(ends[1] - 1.01 * WITHIN)
    } else {
        lowest
    };
    if lowest < ends[0] - 1.0 || highest > ends[1] + 1.0 {
        return [lowest, highest];
    }
    [lowest, highest].map(|position| position.clamp(ends[0] + 1e-9, ends[1] - 1e-9))
}

/// Collects the labels of the voxels whose cells the box of indices touches.
fn nearest(tables: &Tables, low: [f64; 3], high: [f64; 3], labels: &mut BTreeSet<u8>) {
    let size = tables.volume.size();
    let range = |axis: usize| {
        let [first, last] = [low[axis], high[axis]].map(|x| (x + 0.5).floor() as i64);
        first.max(0)..=last.min(size[axis] as i64 - 1)
    };
    for k in range(2) {
        for j in range(1) {
            for i in range(0) {
                labels.insert(tables.volume.voxels()[tables.volume.offset([i, j, k].map(|n| n as usize))]);
            }
        }
    }
}

/// Collects the labels whose share of the votes may be the largest somewhere in the box of indices. Shares, trilinear
/// or of B-splines, are continuous across cells and change by at most 1 per voxel along each axis.
fn vote(tables: &Tables, low: [f64; 3], high: [f64; 3], boundary: Boundary, labels: &mut BTreeSet<u8>) {
    let index: [f64; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
    let off: f64 = (0..3).map(|axis| 0.5 * (high[axis] - low[axis])).sum();
    let size = tables.volume.size();
    if (0..3).any(|axis| high[axis] + 0.5 < 0.0 || low[axis] + 0.5 >= size[axis] as f64) {
        return;
    }
    let (beyond, share_off) = match boundary {
        Boundary::Smooth => (1, SMOOTH_SHARE),
        _ => (0, SHARE),
    };
    let weight = |position: f64, voxel: i64| match boundary {
        Boundary::Smooth => {
            let tap = voxel + 1 - position.floor() as i64;
            usize::try_from(tap)
                .ok()
                .and_then(|tap| spline(position - position.floor()).get(tap).copied())
                .map_or(0.0, |six| six / 6.0)
        }
        _ => (1.0 - (position - voxel as f64).abs()).max(0.0),
    };
    let label = |voxel: [i64; 3]| {
        let voxel = std::array::from_fn(|axis| voxel[axis].clamp(0, size[axis] as i64 - 1) as usize);
        tables.volume.voxels()[tables.volume.offset(voxel)]
    };
    let voxels = |first: [i64; 3], last: [i64; 3]| {
        let plane = move |k: i64| (first[1]..=last[1]).flat_map(move |j| (first[0]..=last[0]).map(move |i| [i, j, k]));
        (first[2]..=last[2]).flat_map(plane)
    };
    // Cells touched by the box.
    let [first, last] = [low, high].map(|ends| ends.map(|position| position.floor() as i64));
    let mut shares = vec![0.0; tables.volume.labels().len()];
    for voxel in voxels(first.map(|n| n - beyond), last.map(|n| n + 1 + beyond)) {
        shares[usize::from(label(voxel))] += (0..3).map(|axis| weight(index[axis], voxel[axis])).product::<f64>();
    }
    for cell in voxels(first, last) {
        let of_cell: Vec<u8> = voxels(cell, cell.map(|n| n + 1)).map(label).collect();
        let largest_share = of_cell
            .iter()
            .map(|label| shares[usize::from(*label)])
            .fold(0.0, f64::max);
        labels.extend(
            of_cell
                .into_iter()
                .filter(|&label| shares[usize::from(label)] >= largest_share - 2.0 * (off + share_off * ULP)),
        );
    }
}
