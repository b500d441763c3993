//! Displacements of the nodes around the tip, without those of the rest of the mesh.

use faer::MatMut;

use crate::mechanics::tissue::dofs::NONE;
use crate::mechanics::tissue::remesh::{Adaptation, RemeshError};

/// What the block of the carrier was read for: it holds as long as none of this changes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    element: u32,
    mesh_step: u64,
    contacts: u64,
}

/// Nodes around an element, with their displacements.
#[derive(Debug, Default)]
pub(super) struct Nearby {
    key: Option<Key>,
    /// Ascending.
    nodes: Vec<u32>,
    rows: Vec<usize>,
    columns: Vec<usize>,
    /// Entries of the carrier, rows by columns.
    block: Vec<f64>,
    values: Vec<f64>,
    displacements: Vec<[f64; 3]>,
}

impl Nearby {
    /// Makes sure that all nodes of the elements that touch `element` are there, displaced by the carried forces. `contacts`
    /// changes whenever the contacts do.
    pub fn gather(
        &mut self,
        adaptation: &mut Adaptation,
        carried: &[(usize, f64)],
        element: u32,
        contacts: u64,
    ) -> Result<(), RemeshError> {
        let (mesh, remesher) = adaptation.parts();
        let key = Key {
            element,
            mesh_step: mesh.step(),
            contacts,
        };
        if self.key != Some(key) {
            self.key = None;
            self.nodes.clear();
            let corners = mesh.elements()[element as usize];
            self.nodes
                .extend(corners.iter().flat_map(|corner| mesh.neighbours(*corner)));
            self.nodes.sort_unstable();
            self.nodes.dedup();
            self.rows.clear();
            let dofs = self.nodes.iter().flat_map(|node| mesh.dofs().of(*node));
            self.rows
                .extend(dofs.filter(|dof| *dof != NONE).map(|dof| dof as usize));
            self.columns.clear();
            self.columns.extend(carried.iter().map(|(dof, _)| *dof));
            let (rows, columns) = (self.rows.len(), self.columns.len());
            self.block.resize(rows * columns, 0.0);
            let block = MatMut::from_column_major_slice_mut(&mut self.block, rows, columns);
            remesher.carrier_into(&self.rows, &self.columns, block)?;
            self.key = Some(key);
        }
        self.displace(adaptation, carried);
        Ok(())
    }

    fn displace(&mut self, adaptation: &Adaptation, carried: &[(usize, f64)]) {
        self.values.clear();
        self.values.resize(self.rows.len(), 0.0);
        for (column, (_, force)) in self.block.chunks_exact(self.rows.len().max(1)).zip(carried) {
            self.values
                .iter_mut()
                .zip(column)
                .for_each(|(u, entry)| *u += entry * force);
        }
        self.displacements.clear();
        let mut values = self.values.iter();
        for node in &self.nodes {
            let dofs = adaptation.mesh().dofs().of(*node);
            let displacement = dofs.map(|dof| {
                if dof == NONE {
                    0.0
                } else {
                    values.next().copied().unwrap_or_default()
                }
            });
            self.displacements.push(displacement);
        }
    }

    /// The displacement of a node, mm; none where it is not around.
    pub fn of(&self, node: u32) -> Option<[f64; 3]> {
        let at = self.nodes.binary_search(&node).ok()?;
        self.displacements.get(at).copied()
    }
}
