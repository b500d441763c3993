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

/// A node that was asked for.
#[derive(Clone, Copy, Debug)]
struct Near {
    node: u32,
    /// Under the forces at hand, if it was asked for since they are, mm.
    displacement: Option<[f64; 3]>,
}

/// Nodes that the tip comes past, with their displacements.
#[derive(Debug, Default)]
pub(super) struct Nearby {
    key: Option<Key>,
    nodes: Vec<Near>,
    /// Degrees of freedom that the carried forces act on.
    columns: Vec<usize>,
    /// Entries of the carrier: three rows a node.
    rows: Vec<f64>,
}

impl Nearby {
    /// The carried forces are others.
    pub fn renew(&mut self) {
        self.nodes.iter_mut().for_each(|near| near.displacement = None);
    }

    /// The displacement of a node under the carried forces, mm. `contacts` changes whenever the contacts do.
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

    /// True while entries that were read still hold.
    fn holds(&self, adaptation: &Adaptation, carried: &[(usize, f64)], contacts: u64) -> bool {
        let mesh_step = adaptation.mesh().step();
        self.key == Some(Key { mesh_step, contacts }) && self.columns.iter().eq(carried.iter().map(|(dof, _)| dof))
    }

    /// Reads the rows of a node. Its place.
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
        // What does not move has zeros.
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
