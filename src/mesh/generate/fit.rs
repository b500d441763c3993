//! Fit of interface nodes to the interfaces of the voxels.
//!
//! Through a point near the node on each face between unlike elements, a line along the face's normal is searched for
//! the position that separates the two tissues best. The node moves to the least-squares intersection of all these
//! planes, pulled towards the mean of its neighbours where they leave it free (the quadratic error function of T. Ju,
//! F. Losasso, S. Schaefer and J. Warren, "Dual contouring of Hermite data", ACM Transactions on Graphics 21, 2002).

use nalgebra::{Matrix3, Vector3};

use super::assign::Limits;
use super::draft::Draft;
use super::smooth::shift;
use super::tissue::{OUTSIDE, Tissue};
use crate::vector::{cross, dot, minus, norm};

/// Number of points on either side of the face on a search line.
const STEPS: usize = 16;
/// Half the length of a search line, in square roots of the area of the face: about a third of an edge. Longer lines
/// find other interfaces.
const REACH: f64 = 0.45;
/// Weight of the mean of the neighbours relative to that of the planes.
const TETHER: f64 = 0.02;
/// Least component of a search direction along the faces of the lattice for a node on them to move.
const FREE: f64 = 0.1;

/// Moves the nodes of interfaces once, in order.
pub(super) fn fit(draft: &mut Draft, tissue: &Tissue, limits: &Limits) {
    for node in 0..draft.nodes.len() as u32 {
        if let Some(position) = wanted(draft, tissue, node) {
            shift(draft, node, position, limits);
        }
    }
}

/// Returns the target position of a node, or `None` if it lies on no interface.
fn wanted(draft: &Draft, tissue: &Tissue, node: u32) -> Option<[f64; 3]> {
    let from = Vector3::from(draft.nodes[node as usize]);
    let fixed = draft.fixed[node as usize];
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let (mut total, mut middle) = (0.0, Vector3::zeros());
    for &element in draft.star(node) {
        let class = draft.classes[element as usize];
        for opposite in 0..4 {
            let other = draft.across(element, opposite);
            // Each face once: from the element of the higher class, which is not outside.
            if draft.elements[element as usize][opposite] == node || other >= class {
                continue;
            }
            let corners = draft.face(element, opposite).map(|n| draft.nodes[n as usize]);
            let face = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0]));
            let within = draft.nodes[draft.elements[element as usize][opposite] as usize];
            let outwards = if dot(face, minus(within, corners[0])) > 0.0 {
                -1.0
            } else {
                1.0
            };
            let area = 0.5 * norm(face);
            let sum = corners
                .iter()
                .fold(Vector3::zeros(), |sum, corner| sum + Vector3::from(*corner));
            total += area;
            middle += area * 0.5 * (sum - from);
            let free = |axis: usize| {
                if fixed[axis] {
                    0.0
                } else {
                    outwards * face[axis] / (2.0 * area)
                }
            };
            let mut normal = Vector3::from_fn(|axis, _| free(axis));
            if normal.norm() < FREE {
                continue;
            }
            normal.normalize_mut();
            let point = 0.5 * from + sum / 6.0;
            let reach = REACH * area.sqrt();
            if let Some(distance) = parting(tissue, &point, &normal, reach, [class, other]) {
                matrix += area * normal * normal.transpose();
                right += area * distance * normal;
            }
        }
    }
    if total == 0.0 {
        return None;
    }
    matrix += Matrix3::identity() * (TETHER * total);
    right += (middle / total - from) * (TETHER * total);
    let step = matrix.cholesky()?.solve(&right);
    Some([0, 1, 2].map(|axis| {
        if fixed[axis] {
            from[axis]
        } else {
            from[axis] + step[axis]
        }
    }))
}

/// Finds the position along a line through a point (mm from the point) where the first class gives way to the second:
/// that with the fewest points of either on the wrong side, of ties the nearest. Towards the outside all tissues are
/// equivalent. Returns `None` where the line does not meet both.
fn parting(
    tissue: &Tissue,
    point: &Vector3<f64>,
    normal: &Vector3<f64>,
    reach: f64,
    [first, second]: [u8; 2],
) -> Option<f64> {
    let step = reach / STEPS as f64;
    let mut wrong = 0i32;
    let mut seen = [false; 2];
    let mut best = (0i32, -reach);
    for sample in 0..2 * STEPS {
        let height = (sample as f64 + 0.5) * step - reach;
        let class = tissue.class_at((point + height * normal).into());
        if class == second {
            wrong += 1;
            seen[1] = true;
        } else if class == first || second == OUTSIDE {
            wrong -= 1;
            seen[0] = true;
        }
        let offset = height + 0.5 * step;
        if wrong < best.0 || wrong == best.0 && offset.abs() < best.1.abs() {
            best = (wrong, offset);
        }
    }
    (seen == [true; 2]).then_some(best.1)
}
