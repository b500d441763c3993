//! Moves of single nodes that keep the elements around them sound.

use super::assign::Limits;
use super::draft::Draft;
use super::{sharpest_cosine, six_volumes};

/// Shares of a move that are tried, until one leaves all elements sound.
const PARTS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// Moves a node towards a position as far as the elements around it allow: none may invert, and none may become sharper
/// than the limit unless it was that sharp before.
pub(super) fn shift(draft: &mut Draft, node: u32, to: [f64; 3], limits: &Limits) {
    let from = draft.nodes[node as usize];
    let sharpness = |draft: &Draft, element: u32| sharpest_cosine(&draft.corners(element));
    let before: Vec<f64> = draft
        .star(node)
        .iter()
        .map(|&element| sharpness(draft, element))
        .collect();
    for part in PARTS {
        draft.nodes[node as usize] = [0, 1, 2].map(|axis| from[axis] + part * (to[axis] - from[axis]));
        let sound = draft.star(node).iter().zip(&before).all(|(&element, before)| {
            let limit = limits.largest_cosine(draft.classes[element as usize]).max(*before);
            six_volumes(&draft.corners(element)) > 0.0 && sharpness(draft, element) <= limit
        });
        if sound {
            return;
        }
    }
    draft.nodes[node as usize] = from;
}

/// Moves the nodes within tissue to the mean of their neighbours where that makes the sharpest element around them less
/// sharp: room for the nodes of interfaces.
pub(super) fn relax(draft: &mut Draft) {
    for node in 0..draft.nodes.len() as u32 {
        let star = draft.star(node);
        let class = draft.classes[star[0] as usize];
        if star.iter().any(|element| draft.classes[*element as usize] != class) {
            continue;
        }
        let from = draft.nodes[node as usize];
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for other in star.iter().flat_map(|element| draft.elements[*element as usize]) {
            if other != node {
                let position = draft.nodes[other as usize];
                sum = [0, 1, 2].map(|axis| sum[axis] + position[axis]);
                count += 1.0;
            }
        }
        let fixed = draft.fixed[node as usize];
        let before = sharpest(draft, node);
        draft.nodes[node as usize] = [0, 1, 2].map(|axis| if fixed[axis] { from[axis] } else { sum[axis] / count });
        if sharpest(draft, node) >= before {
            draft.nodes[node as usize] = from;
        }
    }
}

/// Returns the cosine of the smallest dihedral angle around a node; 1 if an element is inverted.
fn sharpest(draft: &Draft, node: u32) -> f64 {
    let cosine = |&element: &u32| {
        let corners = draft.corners(element);
        if six_volumes(&corners) > 0.0 {
            sharpest_cosine(&corners)
        } else {
            1.0
        }
    };
    draft.star(node).iter().map(cosine).fold(-1.0, f64::max)
}
