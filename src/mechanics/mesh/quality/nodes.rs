//! Isolated and coincident nodes.

use std::collections::HashMap;

use crate::mechanics::mesh::TetMesh;

/// Distance below which nodes coincide, as a share of the diagonal of their box: far above the rounding of coordinates, even
/// of those printed with ten digits, and far below any usable element.
const COINCIDENT: f64 = 1e-9;

/// Returns the nodes without an element.
pub(super) fn isolated(mesh: &TetMesh) -> Vec<u32> {
    let mut used = vec![false; mesh.nodes().len()];
    for node in mesh.elements().as_flattened() {
        used[*node as usize] = true;
    }
    (0..)
        .zip(used)
        .filter(|(_, used)| !used)
        .map(|(node, _)| node)
        .collect()
}

/// Returns coincident nodes, each preceded by the earlier one. Nodes that are not finite are skipped.
pub(super) fn coincident(nodes: &[[f64; 3]]) -> Vec<[u32; 2]> {
    let finite = |node: &[f64; 3]| node.iter().all(|x| x.is_finite());
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for node in nodes.iter().filter(|node| finite(node)) {
        for axis in 0..3 {
            bounds[0][axis] = bounds[0][axis].min(node[axis]);
            bounds[1][axis] = bounds[1][axis].max(node[axis]);
        }
    }
    let diagonal = distance(bounds[0], bounds[1]);
    if !(diagonal > 0.0 && diagonal.is_finite()) {
        // All in one point, or so far apart that their distances overflow.
        let all: Vec<u32> = (0..)
            .zip(nodes)
            .filter(|(_, node)| finite(node))
            .map(|(n, _)| n)
            .collect();
        return match (diagonal == 0.0, all.split_first()) {
            (true, Some((first, rest))) => rest.iter().map(|node| [*first, *node]).collect(),
            _ => Vec::new(),
        };
    }
    let reach = COINCIDENT * diagonal;
    // In cells twice the reach wide, the neighbours of a point lie in its cell or in the adjacent ones on the nearer sides.
    let side = 2.0 * reach;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut found = Vec::new();
    for (index, node) in (0..).zip(nodes).filter(|(_, node)| finite(node)) {
        let place: [f64; 3] = std::array::from_fn(|axis| (node[axis] - bounds[0][axis]) / side);
        let cell = place.map(|x| x.floor() as i64);
        let nearer: [i64; 3] = std::array::from_fn(|axis| if place[axis].fract() < 0.5 { -1 } else { 1 });
        let earlier = (0..8)
            .filter_map(|corner| {
                let near = std::array::from_fn(|axis| cell[axis] + (corner >> axis & 1) * nearer[axis]);
                cells.get(&near)
            })
            .flatten()
            .filter(|other| distance(nodes[**other as usize], *node) <= reach)
            .min();
        match earlier {
            Some(earlier) => found.push([*earlier, index]),
            None => cells.entry(cell).or_default().push(index),
        }
    }
    found
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}
