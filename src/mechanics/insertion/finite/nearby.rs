//! Displacements of the nodes around the tip, without those of the rest of the mesh.

use faer::MatMut;

use crate::mechanics::tissue::dofs::NONE;
use crate::mechanics::tissue::remesh::{Adaptation, RemeshError};

/// State for which entries of the carrier were read.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    mesh_step: u64,
    contacts: u64,
}

/// A node whose carrier rows were read.
#[derive(Clone, Copy, Debug)]
struct Near {
    node: u32,
    /// Displacement under the current forces, once computed for them, mm.
    displacement: Option<[f64; 3]>,
}

/// Cache of displacements of the nodes that the tip passes.
#[derive(Debug, Default)]
pub(super) struct Nearby {
    key: Option<Key>,
    nodes: Vec<Near>,
    /// Degrees of freedom on which the carried forces act.
    columns: Vec<usize>,
    /// Entries of the carrier, three rows per node.
    rows: Vec<f64>,
}

impl Nearby {
    /// Discards the displacements, after the carried forces have changed.
    pub fn renew(&mut self) {
        self.nodes.iter_mut().for_each(|near| near.displacement = None);
    }

    /// Returns the displacement of a node under the carried forces, mm. `contacts` is a counter that changes whenever the
    /// contacts do.
    pub fn displacement(
        &mut self,
        adaptation: &mut Adaptation,
        carried: &[(usize, f64)],
        contacts: u64,
        node: u32,
    ) -> Result<[f64; 3], RemeshError> {
        let at = match self.nodes.iter().position(|near| near.node == node) {
            Some(at) if self.holds(adaptation, carried, contacts) => at,
            _ => self.read(adaptation, carried, contacts, node)?,
        };
        if let Some(displacement) = self.nodes[at].displacement {
            return Ok(displacement);
        }
        let columns = self.columns.len();
        let displacement = [0, 1, 2].map(|axis| {
            let row = &self.rows[(3 * at + axis) * columns..][..columns];
            row.iter().zip(carried).map(|(entry, (_, force))| entry * force).sum()
        });
        self.nodes[at].displacement = Some(displacement);
        Ok(displacement)
    }

    /// Returns whether the entries that were read are still valid.
    fn holds(&self, adaptation: &Adaptation, carried: &[(usize, f64)], contacts: u64) -> bool {
        let mesh_step = adaptation.mesh().step();
        self.key == Some(Key { mesh_step, contacts }) && self.columns.iter().eq(carried.iter().map(|(dof, _)| dof))
    }

    /// Reads the rows of a node and returns its index.
    fn read(
        &mut self,
        adaptation: &mut Adaptation,
        carried: &[(usize, f64)],
        contacts: u64,
        node: u32,
    ) -> Result<usize, RemeshError> {
        if !self.holds(adaptation, carried, contacts) {
            self.nodes.clear();
            self.rows.clear();
            self.columns.clear();
            self.columns.extend(carried.iter().map(|(dof, _)| *dof));
            let mesh_step = adaptation.mesh().step();
            self.key = Some(Key { mesh_step, contacts });
        }
        let (at, columns) = (self.nodes.len(), self.columns.len());
        self.rows.truncate(3 * at * columns);
        self.rows.resize(3 * (at + 1) * columns, 0.0);
        let rows = self.rows[3 * at * columns..].chunks_exact_mut(columns.max(1));
        let dofs = adaptation.mesh().dofs().of(node);
        // Fixed degrees of freedom keep zeros.
        for (row, dof) in rows.zip(dofs).filter(|(_, dof)| *dof != NONE) {
            adaptation.ask(|_, remesher| {
                let out = MatMut::from_row_major_slice_mut(row, 1, columns);
                remesher.carrier_into(&[dof as usize], &self.columns, out)
            })?;
        }
        self.nodes.push(Near {
            node,
            displacement: None,
        });
        Ok(at)
    }
}
