//! Outline of a sector, fitted to the rim of a mask: two arcs and two lines about an apex, or a rectangle.

use std::cmp::Reverse;
use std::f64::consts::FRAC_PI_2;

use nalgebra::{SMatrix, SVector};
use serde::Serialize;

/// Distance from the picture's edge within which the mask's rim is ignored, pixels: the sector may continue beyond the
/// picture.
const RIM_PX: usize = 4;
/// Bin width for the votes of rim points on radii and angles, pixels.
const BIN_PX: f64 = 3.0;
/// Maximum number of rim points used for voting and fitting; more are thinned evenly.
const MAX_POINTS: usize = 600;
/// Number of trial apices across the mask and above its top.
const TRIAL_APICES: [usize; 2] = [33, 48];
/// Largest height of a trial apex above the top of the mask, heights of the mask.
const MAX_APEX_HEIGHTS: f64 = 6.0;
/// Distances within which rim points count as on the outline in successive refinements, pixels: from the resolution of
/// the votes down to that of the mask.
const NEAR_PX: [f64; 8] = [12.0, 8.0, 6.0, 4.0, 3.0, 2.0, 1.5, 1.5];
/// Least cosine of the angle between the inward direction at a rim point and that of an edge.
const MIN_COSINE: f64 = 0.75;
/// Least share of an edge's visible length on which rim points must lie for the edge to count as seen.
const MIN_SEEN_SHARE: f64 = 0.2;
/// Least angle between the vertical and the sides of a fan, radians: the narrowest fields of view are 20 degrees.
const MIN_HALF_ANGLE: f64 = 0.17;
/// Largest share of the mask that may lie beyond an edge.
const MAX_BEYOND_SHARE: f64 = 0.05;
/// Least share of a rectangle that its mask must fill, and the stricter share if its left or right side is neither seen
/// nor cropped by the picture.
const MIN_FILLED_SHARES: [f64; 2] = [0.5, 0.9];

/// Shape of a sector in pixels: pixel centres have integer coordinates, rows run downwards, the array is at the top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Shape {
    /// Parallel scanlines.
    Rectangle {
        /// First and last column.
        columns: [f64; 2],
        /// First and last row.
        rows: [f64; 2],
    },
    /// Scanlines that diverge from one point.
    Fan {
        /// Apex: column and row.
        apex: [f64; 2],
        /// Radii of the array and of the far edge.
        radii: [f64; 2],
        /// Angle between the vertical and the last scanline on either side, radians, at most half a right angle short
        /// of a half turn.
        half: f64,
    },
}

/// Sector and the visibility of its edges.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Outline {
    /// Shape of the sector.
    #[serde(flatten)]
    pub shape: Shape,
    /// Whether the array, the far edge and the sides were found as edges of the mask; the others are placed at its
    /// extent.
    pub seen: [bool; 3],
}

impl Outline {
    /// Fits the outline that most of the mask's rim lies on; `None` if neither a fan nor a rectangle fits.
    pub fn of(mask: &[bool], width: usize) -> Option<Self> {
        let size = [width, mask.len() / width];
        let inside: Vec<[f64; 2]> = (0..mask.len())
            .filter(|&pixel| mask[pixel])
            .map(|pixel| [(pixel % width) as f64, (pixel / width) as f64])
            .collect();
        let rim: Vec<RimPoint> = (0..mask.len()).filter_map(|pixel| on_rim(mask, pixel, size)).collect();
        let [fan, rectangle] = [fan(&rim, &inside, size), rectangle(&rim, &inside, size)];
        match (fan, rectangle) {
            // A fan has more free parameters: it must be better by a tenth.
            (Some(fan), Some(rectangle)) => Some(if fan.1 > 1.1 * rectangle.1 { fan.0 } else { rectangle.0 }),
            (fan, rectangle) => fan.or(rectangle).map(|fit| fit.0),
        }
    }
}

/// Rim point of a mask: column, row, and the inward direction.
type RimPoint = [f64; 4];

/// Returns the rim point at a mask pixel that has a neighbour outside the mask and lies away from the picture's edge.
fn on_rim(mask: &[bool], pixel: usize, [width, height]: [usize; 2]) -> Option<RimPoint> {
    let (x, y) = (pixel % width, pixel / width);
    let inside = mask[pixel]
        && (RIM_PX..width.saturating_sub(RIM_PX)).contains(&x)
        && (RIM_PX..height.saturating_sub(RIM_PX)).contains(&y)
        && [pixel - 1, pixel + 1, pixel - width, pixel + width]
            .iter()
            .any(|&next| !mask[next]);
    if !inside {
        return None;
    }
    let (mut across, mut down) = (0.0, 0.0);
    let reach = RIM_PX as i32;
    for (dx, dy) in (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy))) {
        if mask[(y as i32 + dy) as usize * width + (x as i32 + dx) as usize] {
            (across, down) = (across + f64::from(dx), down + f64::from(dy));
        }
    }
    let length = f64::hypot(across, down);
    (length > 0.0).then(|| [x as f64, y as f64, across / length, down / length])
}

/// Returns the value that the given share of the values does not exceed.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

/// Returns the length of an edge, given as points 1 pixel apart, that lies in the picture away from its border.
fn visible(edge: impl Iterator<Item = [f64; 2]>, size: [usize; 2]) -> f64 {
    let is_inside = |p: &[f64; 2]| (0..2).all(|i| p[i] >= RIM_PX as f64 && p[i] < size[i] as f64 - RIM_PX as f64);
    edge.filter(is_inside).count() as f64
}

/// Returns whether the number of agreeing rim pixels suffices for an edge of the given visible length.
fn is_seen(agreeing: f64, visible: f64) -> bool {
    agreeing >= MIN_SEEN_SHARE * visible && visible > 10.0
}

/// Fits the rectangle whose sides most of the rim lies on; returns it with the number of agreeing points.
fn rectangle(rim: &[RimPoint], inside: &[[f64; 2]], size: [usize; 2]) -> Option<(Outline, f64)> {
    let (mut edges, mut is_side_seen, mut agreement) = ([[0.0; 2]; 2], [[false; 2]; 2], 0.0);
    for axis in 0..2 {
        let extent = [0.002, 0.998].map(|share| quantile(inside.iter().map(|p| p[axis]).collect(), share));
        for side in 0..2 {
            // The column or row in this half of the mask that most of the rim lies on, with its neighbours.
            let inwards = |p: &&RimPoint| [1.0, -1.0][side] * p[2 + axis] > MIN_COSINE;
            let is_near = |p: &RimPoint, line: usize| (p[axis] - line as f64).abs() < 1.5;
            let count = |line: usize| rim.iter().filter(inwards).filter(|p| is_near(p, line)).count();
            let middle = (0.5 * (extent[0] + extent[1])) as usize;
            let half = if side == 0 { 0..middle } else { middle..size[axis] };
            let best = half.max_by_key(|&line| count(line))?;
            let across = extent_of(inside, 1 - axis);
            is_side_seen[axis][side] = is_seen(count(best) as f64, across);
            let outwards = [-0.5, 0.5][side];
            edges[axis][side] = if is_side_seen[axis][side] {
                best as f64
            } else {
                extent[side]
            } + outwards;
            agreement += if is_side_seen[axis][side] {
                count(best) as f64
            } else {
                0.0
            };
        }
    }
    let [columns, rows] = edges;
    let area = (columns[1] - columns[0]) * (rows[1] - rows[0]);
    let outline = Outline {
        shape: Shape::Rectangle { columns, rows },
        seen: [
            is_side_seen[1][0],
            is_side_seen[1][1],
            is_side_seen[0][0] && is_side_seen[0][1],
        ],
    };
    // As far out as rim points are ignored.
    let reaches = |is_there: &dyn Fn(f64) -> bool| inside.iter().any(|p| is_there(p[0]));
    let cut = [
        reaches(&|x| x < RIM_PX as f64),
        reaches(&|x| x >= size[0].saturating_sub(RIM_PX) as f64),
    ];
    let sides = (0..2).all(|side| is_side_seen[0][side] || cut[side]);
    (inside.len() as f64 >= MIN_FILLED_SHARES[usize::from(!sides)] * area).then_some((outline, agreement))
}

fn extent_of(points: &[[f64; 2]], axis: usize) -> f64 {
    let fold = |extreme: fn(f64, f64) -> f64, start: f64| points.iter().map(|p| p[axis]).fold(start, extreme);
    fold(f64::max, 0.0) - fold(f64::min, f64::MAX)
}

/// Column and row of the apex, radii of the array and of the far edge, angle of the sides.
type FanParameters = [f64; 5];

/// Returns radius and signed angle from the vertical about an apex.
fn polar(apex: [f64; 2], x: f64, y: f64) -> [f64; 2] {
    [(x - apex[0]).hypot(y - apex[1]), (x - apex[0]).atan2(y - apex[1])]
}

/// Returns the edge that a rim point may lie on, judged by its inward direction: 0 for the array, 1 for the far edge, 2
/// for a side.
fn edge_of(angle: f64, p: RimPoint) -> Option<usize> {
    let (sine, cosine) = angle.sin_cos();
    let (along, across) = (p[2] * sine + p[3] * cosine, p[2] * cosine - p[3] * sine);
    let fits = [along, -along, -across * angle.signum()];
    fits.iter().position(|fit| *fit > MIN_COSINE)
}

/// Returns the signed distance of a point outwards from an edge.
fn distance(fan: FanParameters, edge: usize, p: RimPoint) -> f64 {
    let [x, y, near, far, half] = fan;
    let [radius, angle] = polar([x, y], p[0], p[1]);
    [near - radius, radius - far, radius * (angle.abs() - half)][edge]
}

/// Returns the nearest edge to a point and its signed distance, if that is less than `max_distance` and the point lies
/// alongside the edge.
fn nearest(fan: FanParameters, p: RimPoint, max_distance: f64) -> Option<(usize, f64)> {
    let [radius, angle] = polar([fan[0], fan[1]], p[0], p[1]);
    let edge = edge_of(angle, p)?;
    let is_beside = match edge {
        2 => !(fan[2] - max_distance..fan[3] + max_distance).contains(&radius),
        _ => distance(fan, 2, p) > max_distance,
    };
    let offset = distance(fan, edge, p);
    (!is_beside && offset.abs() < max_distance).then_some((edge, offset))
}

/// Fits the fan whose edges most of the rim lies on; returns it with the number of agreeing points.
fn fan(rim: &[RimPoint], inside: &[[f64; 2]], size: [usize; 2]) -> Option<(Outline, f64)> {
    let voters: Vec<RimPoint> = rim
        .iter()
        .copied()
        .step_by(rim.len().div_ceil(MAX_POINTS).max(1))
        .collect();
    let mut parameters = guessed(&voters)?;
    for max_distance in NEAR_PX {
        for _ in 0..3 {
            parameters = refined(parameters, &voters, max_distance);
        }
    }
    let widest = NEAR_PX[NEAR_PX.len() - 1];
    let mut on_edge = [0.0; 3];
    for (edge, _) in rim.iter().filter_map(|&p| nearest(parameters, p, widest)) {
        on_edge[edge] += 1.0;
    }
    let [x, y, near, far, half] = parameters;
    let point = |radius: f64, angle: f64| [x + radius * angle.sin(), y + radius * angle.cos()];
    let arc = |radius: f64| (0..(2.0 * half * radius) as usize).map(move |n| point(radius, n as f64 / radius - half));
    let side = |sign: f64| (near as usize..far as usize).map(move |radius| point(radius as f64, sign * half));
    let lengths = [
        visible(arc(near), size),
        visible(arc(far), size),
        visible(side(-1.0).chain(side(1.0)), size),
    ];
    // Dark areas within a sector have edges too, but with echoes beyond them.
    let outside = |edge: usize| {
        let beyond = |p: &&[f64; 2]| distance(parameters, edge, [p[0], p[1], 0.0, 0.0]) > NEAR_PX[3];
        inside.iter().filter(beyond).count() as f64 <= MAX_BEYOND_SHARE * inside.len() as f64
    };
    let are_seen: [bool; 3] = std::array::from_fn(|edge| is_seen(on_edge[edge], lengths[edge]) && outside(edge));
    if are_seen.iter().filter(|is_edge_seen| **is_edge_seen).count() < 2 {
        return None;
    }
    let around: Vec<[f64; 2]> = inside.iter().map(|p| polar([x, y], p[0], p[1])).collect();
    let extreme =
        |coordinate: &dyn Fn(&[f64; 2]) -> f64, share| quantile(around.iter().map(coordinate).collect(), share);
    let radii = [
        if are_seen[0] { near } else { extreme(&|p| p[0], 0.0005) } - 0.5,
        if are_seen[1] { far } else { extreme(&|p| p[0], 0.9995) } + 0.5,
    ];
    let half = if are_seen[2] {
        half
    } else {
        extreme(&|p| p[1].abs(), 0.998)
    } + 1.0 / (radii[0] + radii[1]);
    let radii = [radii[0].max(0.0), radii[1]];
    let outline = Outline {
        shape: Shape::Fan {
            apex: [x, y],
            radii,
            half,
        },
        seen: are_seen,
    };
    let valid = radii[1] > radii[0] && half > 0.0 && half < 1.9 * FRAC_PI_2;
    valid.then_some((
        outline,
        (0..3).filter(|&edge| are_seen[edge]).map(|edge| on_edge[edge]).sum(),
    ))
}

/// Finds the fan whose radii and angle get the most votes over a lattice of apices (P. V. C. Hough, US patent
/// 3,069,654, 1962).
fn guessed(voters: &[RimPoint]) -> Option<FanParameters> {
    let bound = |axis: usize, extreme: fn(f64, f64) -> f64| voters.iter().map(|p| p[axis]).reduce(extreme);
    let [left, top] = [bound(0, f64::min)?, bound(1, f64::min)?];
    let [width, height] = [bound(0, f64::max)? - left, bound(1, f64::max)? - top];
    if width.min(height) < 10.0 * BIN_PX {
        return None;
    }
    let mut best = (0, None);
    for column in 0..TRIAL_APICES[0] {
        let x = left + width * (0.25 + 0.5 * column as f64 / (TRIAL_APICES[0] - 1) as f64);
        for row in 0..TRIAL_APICES[1] {
            let y = top - (MAX_APEX_HEIGHTS * height + 1.0).powf(row as f64 / (TRIAL_APICES[1] - 1) as f64) + 1.0;
            let around: Vec<[f64; 2]> = voters.iter().map(|p| polar([x, y], p[0], p[1])).collect();
            let farthest = around.iter().map(|p| p[0]).fold(0.0, f64::max);
            let turn = BIN_PX / (0.6 * farthest);
            let mut votes =
                [(); 3].map(|()| vec![0usize; (farthest / BIN_PX).max(2.0 * FRAC_PI_2 / turn) as usize + 2]);
            for (&[radius, angle], &p) in around.iter().zip(voters) {
                if let Some(edge) = edge_of(angle, p) {
                    let bin = if edge == 2 { angle.abs() / turn } else { radius / BIN_PX };
                    votes[edge][bin as usize] += 1;
                }
            }
            // Two neighbouring bins, the first of several equal pairs.
            let peak = |votes: &[usize], first_bin: usize| {
                let pairs = (first_bin + 1..votes.len()).map(|bin| (votes[bin - 1] + votes[bin], bin));
                pairs
                    .max_by_key(|&(count, bin)| (count, Reverse(bin)))
                    .unwrap_or_default()
            };
            let [near, far] = [0, 1].map(|edge| peak(&votes[edge], 0));
            let sides = peak(&votes[2], (MIN_HALF_ANGLE / turn) as usize);
            let count = near.0 + far.0 + sides.0;
            if count > best.0 {
                let radii = [near.1, far.1].map(|bin| bin as f64 * BIN_PX);
                let half = (sides.1 as f64 * turn).min(1.8 * FRAC_PI_2);
                // A missing array or far edge is placed at the end of the mask.
                let far = if radii[1] > radii[0] { radii[1] } else { farthest };
                best = (count, Some([x, y, radii[0], far, half]));
            }
        }
    }
    best.1
}

/// Takes one least-squares step over the points near an edge, with J. W. Tukey's biweight.
fn refined(fan: FanParameters, points: &[RimPoint], max_distance: f64) -> FanParameters {
    // Scaled to one pixel at the far edge.
    let scale = [1.0, 1.0, 1.0, 1.0, 1.0 / fan[3].max(1.0)];
    let mut normal = SMatrix::<f64, 5, 5>::identity() * 1e-3;
    let mut right_side = SVector::<f64, 5>::zeros();
    for &p in points {
        let Some((edge, d)) = nearest(fan, p, max_distance) else {
            continue;
        };
        let weight = (1.0 - (d / max_distance).powi(2)).powi(2);
        let slopes = SVector::<f64, 5>::from_fn(|i, _| {
            let distance_after = |sign: f64| {
                let mut fan = fan;
                fan[i] += sign * 0.01 * scale[i];
                distance(fan, edge, p)
            };
            (distance_after(1.0) - distance_after(-1.0)) / 0.02
        });
        normal += weight * slopes * slopes.transpose();
        right_side -= weight * d * slopes;
    }
    let step = normal
        .cholesky()
        .map(|factor| factor.solve(&right_side))
        .unwrap_or_default();
    // The step is limited to what the points near an edge can determine.
    let bounded = step * (max_distance / step.norm().max(max_distance));
    let moved_fan: FanParameters = std::array::from_fn(|i| fan[i] + bounded[i] * scale[i]);
    if moved_fan[2] > 0.0 && moved_fan[3] > moved_fan[2] && moved_fan[4] > 0.0 {
        moved_fan
    } else {
        fan
    }
}
