//! Stiffness of the current mesh minus that of the base.

use super::adapted::AdaptedMesh;
use crate::tissue::dofs::{Dofs, NO_DOF};
use crate::tissue::element::{NodeBlock, Shape};

/// K(now) - K(base) over the nodes touched by moves, N/mm: one 3 x 3 block per pair of them that shares an element, and
/// exactly zero elsewhere. Always recomputed from both positions of the nodes, so no errors accumulate and a mesh back
/// at its base has an empty difference.
#[derive(Clone, Debug, Default)]
pub struct Difference {
    /// Touched nodes, ascending.
    nodes: Vec<u32>,
    /// Degrees of freedom of the touched nodes.
    dofs: Vec<[u32; 3]>,
    /// Start of each touched node's row of blocks, with a final end.
    starts: Vec<u32>,
    /// Index in `nodes` of the blocks' columns, ascending in each row.
    columns: Vec<u32>,
    blocks: Vec<NodeBlock>,
    /// Elements with a moved corner.
    elements: Vec<u32>,
    /// Index of each node in `nodes`.
    places: Vec<u32>,
}

impl Difference {
    /// Whether no node is touched.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Touched nodes, ascending.
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Blocks as (row node, column node, block), by row, then column.
    pub fn blocks(&self) -> impl Iterator<Item = (u32, u32, &NodeBlock)> + '_ {
        let rows = self.nodes.iter().zip(self.starts.windows(2));
        rows.flat_map(move |(&row, span)| {
            let span = span[0] as usize..span[1] as usize;
            let entries = self.columns[span.clone()].iter().zip(&self.blocks[span]);
            entries.map(move |(&column, block)| (row, self.nodes[column as usize], block))
        })
    }

    /// Entries over the free degrees of freedom as (row, column, N/mm), row by row.
    pub fn entries(&self) -> impl Iterator<Item = (u32, u32, f64)> + '_ {
        let rows = self.dofs.iter().zip(self.starts.windows(2));
        rows.flat_map(move |(rows, span)| {
            let span = span[0] as usize..span[1] as usize;
            (0..3).filter(|i| rows[*i] != NO_DOF).flat_map(move |i| {
                span.clone().flat_map(move |block| {
                    let columns = self.dofs[self.columns[block] as usize];
                    (0..3)
                        .filter(move |j| columns[*j] != NO_DOF)
                        .map(move |j| (rows[i], columns[j], self.blocks[block][i][j]))
                })
            })
        })
    }

    /// Computes `y += dK x` over the free degrees of freedom (x in mm, y in N).
    ///
    /// # Panics
    /// If a slice ends before the last touched degree of freedom.
    pub(crate) fn add_product(&self, x: &[f64], y: &mut [f64]) {
        for (row, column, value) in self.entries() {
            y[row as usize] += value * x[column as usize];
        }
    }

    /// Infinity norm (largest absolute row sum), N/mm.
    pub fn norm_inf(&self) -> f64 {
        let mut largest = 0.0f64;
        let (mut sum, mut current_row) = (0.0, NO_DOF);
        for (row, _, value) in self.entries() {
            if row != current_row {
                (sum, current_row) = (0.0, row);
            }
            sum += f64::abs(value);
            largest = largest.max(sum);
        }
        largest
    }

    pub(super) fn assemble(&mut self, mesh: &AdaptedMesh) {
        self.lay_out(mesh);
        for index in 0..self.elements.len() {
            let element = self.elements[index];
            let shapes = [mesh.base(), mesh.nodes()].map(|nodes| Shape::of(&mesh.positions(element, nodes)));
            let [Ok(base), Ok(now)] = shapes else {
                // Neither the base nor an accepted move has unusable elements.
                continue;
            };
            let material = &mesh.stiffness().materials()[element as usize];
            let (base_weights, now_weights) = (base.weights(material), now.weights(material));
            let corners = mesh.elements()[element as usize].map(|node| self.places[node as usize]);
            for (a, b) in (0..16).map(|pair| (pair / 4, pair % 4)) {
                let block = self.block_at(corners[a], corners[b]);
                let old = base.block(base_weights, a, b);
                let new = now.block(now_weights, a, b);
                for (i, j) in (0..9).map(|entry| (entry / 3, entry % 3)) {
                    block[i][j] += new[i][j] - old[i][j];
                }
            }
        }
    }

    /// Finds the touched nodes, the elements between them and the node pairs that share an element.
    fn lay_out(&mut self, mesh: &AdaptedMesh) {
        self.elements.clear();
        for &node in mesh.away() {
            self.elements
                .extend(mesh.elements_around(node).map(|(element, _)| element));
        }
        self.elements.sort_unstable();
        self.elements.dedup();
        self.nodes.clear();
        for &element in &self.elements {
            self.nodes.extend(mesh.elements()[element as usize]);
        }
        // In ascending order, so that the columns of a row are too: `block_at` searches them by halves.
        self.nodes.sort_unstable();
        self.nodes.dedup();
        self.places.resize(mesh.nodes().len(), NO_DOF);
        self.places.fill(NO_DOF);
        let dofs: &Dofs = mesh.dofs();
        self.dofs.clear();
        for (index, &node) in self.nodes.iter().enumerate() {
            self.places[node as usize] = index as u32;
            self.dofs.push(dofs.of(node));
        }
        self.starts.clear();
        self.starts.push(0);
        self.columns.clear();
        for &node in &self.nodes {
            let places = mesh
                .neighbours(node)
                .iter()
                .map(|neighbour| self.places[*neighbour as usize]);
            self.columns.extend(places.filter(|place| *place != NO_DOF));
            self.starts.push(self.columns.len() as u32);
        }
        self.blocks.clear();
        self.blocks.resize(self.columns.len(), [[0.0; 3]; 3]);
    }

    /// Returns the block of two touched nodes of one element.
    fn block_at(&mut self, row: u32, column: u32) -> &mut NodeBlock {
        let span = self.starts[row as usize] as usize..self.starts[row as usize + 1] as usize;
        let offset = self.columns[span.clone()].partition_point(|listed| *listed < column);
        &mut self.blocks[span.start + offset]
    }
}

#[cfg(test)]
mod tests;
