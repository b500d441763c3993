//! Elements and neighbours of each node of a mesh.

use crate::mechanics::tissue::assembly::corners_by_node;

/// Elements and neighbours of every node. They depend only on the elements, so moves do not change them.
#[derive(Clone, Debug)]
pub(super) struct Around {
    /// Start of each node's corners; a corner is four times its element plus its place there.
    corner_firsts: Vec<u32>,
    corners: Vec<u32>,
    /// Start of each node's neighbours.
    neighbour_firsts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Around {
    pub fn new(elements: &[[u32; 4]], nodes: usize) -> Around {
        let (corner_firsts, corners) = corners_by_node(elements, nodes);
        let mut neighbour_firsts = vec![0];
        let mut neighbours = Vec::with_capacity(16 * nodes);
        let mut own: Vec<u32> = Vec::new();
        for node in 0..nodes {
            let around = &corners[corner_firsts[node] as usize..corner_firsts[node + 1] as usize];
            own.clear();
            own.extend(around.iter().flat_map(|corner| elements[*corner as usize / 4]));
            own.sort_unstable();
            own.dedup();
            neighbours.extend_from_slice(&own);
            neighbour_firsts.push(neighbours.len() as u32);
        }
        Around {
            corner_firsts,
            corners,
            neighbour_firsts,
            neighbours,
        }
    }

    /// Nodes of the elements of `node`, including itself, ascending.
    pub fn neighbours(&self, node: u32) -> &[u32] {
        let node = node as usize;
        &self.neighbours[self.neighbour_firsts[node] as usize..self.neighbour_firsts[node + 1] as usize]
    }

    /// Elements of a node, with its place in each.
    pub fn elements(&self, node: u32) -> impl Iterator<Item = (u32, usize)> + '_ {
        let node = node as usize;
        let corners = &self.corners[self.corner_firsts[node] as usize..self.corner_firsts[node + 1] as usize];
        corners.iter().map(|corner| (corner / 4, *corner as usize % 4))
    }
}
