//! Sparse stiffness matrix of a mesh: its lower triangle in compressed columns over the free degrees of freedom.
//!
//! Assembly has two steps. The symbolic step, once per mesh, finds the places of all pairs of nodes that share an
//! element, and the places that each element contributes to. The numeric step computes and sums the elements, and can
//! be repeated with other reference positions.

mod pattern;

use crate::tissue::error::LinearError;
use std::sync::Arc;

use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};

use super::dofs::Dofs;
use super::element::{DegenerateElement, NodeBlock, Shape};
use super::factor::Symmetric;
use super::material::Material;
use insonify_mesh::TetMesh;
use pattern::{PAIRS, Pattern};

/// Parts of a stiffness matrix that do not depend on node positions.
#[derive(Debug)]
struct Structure {
    elements: Vec<[u32; 4]>,
    materials: Vec<Material>,
    dofs: Dofs,
    pattern: Pattern,
}

/// The stiffness matrix K of a mesh with some displacements prescribed, N/mm.
#[derive(Clone, Debug)]
pub struct Stiffness {
    structure: Arc<Structure>,
    /// One block per pair of nodes that share an element, including prescribed nodes.
    blocks: Vec<NodeBlock>,
    /// Entries of the lower triangle over the free degrees of freedom, column by column.
    values: Vec<f64>,
    norm_inf: f64,
}

impl Stiffness {
    /// Assembles the stiffness of a mesh in its reference state, with one material per element.
    ///
    /// # Errors
    /// [`LinearError`] where a list does not match the mesh or an element is flat or inverted.
    pub fn assemble(mesh: &TetMesh, materials: &[Material], dofs: &Dofs) -> Result<Stiffness, LinearError> {
        expect("materials", materials.len(), mesh.elements().len())?;
        expect("nodes with degrees of freedom", dofs.nodes(), mesh.nodes().len())?;
        let structure = Structure {
            elements: mesh.elements().to_vec(),
            materials: materials.to_vec(),
            dofs: dofs.clone(),
            pattern: Pattern::new(mesh.elements(), dofs)?,
        };
        Stiffness::fill(Arc::new(structure), mesh.nodes())
    }

    /// Returns the stiffness of the same mesh, materials and degrees of freedom at other reference positions (mm). The
    /// pattern is unchanged, so a [`Factor`](super::factor::Factor) of one can be refactored to the other.
    ///
    /// # Errors
    /// [`LinearError`] where there is not one position per node, or an element is flat or inverted.
    pub fn at_nodes(&self, nodes: &[[f64; 3]]) -> Result<Stiffness, LinearError> {
        expect("node positions", nodes.len(), self.dofs().nodes())?;
        Stiffness::fill(Arc::clone(&self.structure), nodes)
    }

    fn fill(structure: Arc<Structure>, nodes: &[[f64; 3]]) -> Result<Stiffness, LinearError> {
        let blocks = structure.blocks(nodes)?;
        let Structure { dofs, pattern, .. } = &*structure;
        let mut values = Vec::with_capacity(pattern.entries());
        let mut sums = vec![0.0; dofs.free()];
        pattern.for_each_entry(dofs, |row, column, index, (i, j)| {
            let value = blocks[index][i][j];
            values.push(value);
            sums[row as usize] += value.abs();
            if row != column {
                sums[column as usize] += value.abs();
            }
        });
        let norm_inf = sums.into_iter().fold(0.0, f64::max);
        Ok(Stiffness {
            structure,
            blocks,
            values,
            norm_inf,
        })
    }

    /// Degrees of freedom of the mesh.
    pub fn dofs(&self) -> &Dofs {
        &self.structure.dofs
    }

    /// Node indices of the elements.
    pub fn elements(&self) -> &[[u32; 4]] {
        &self.structure.elements
    }

    /// Materials, one per element.
    pub fn materials(&self) -> &[Material] {
        &self.structure.materials
    }

    /// Infinity norm (largest absolute row sum), N/mm.
    pub fn norm_inf(&self) -> f64 {
        self.norm_inf
    }

    /// Lower triangle, rows ascending in each column.
    pub fn lower(&self) -> SparseColMatRef<'_, u32, f64> {
        SparseColMatRef::new(self.pattern(), &self.values)
    }

    /// Sparsity pattern of the lower triangle.
    pub(super) fn pattern(&self) -> SymbolicSparseColMatRef<'_, u32> {
        self.structure.pattern.lower.as_ref()
    }

    /// Computes `y = K x` over the free degrees of freedom (x in mm, y in N).
    ///
    /// # Panics
    /// If a slice does not have one entry per free degree of freedom.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) {
        self.product(x, y);
    }

    /// Returns the forces on all nodes (N) that balance given displacements of all nodes (mm), including prescribed
    /// ones.
    ///
    /// # Panics
    /// If there is not one displacement per node.
    pub fn nodal_forces(&self, displacement_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        assert_eq!(displacement_mm.len(), self.dofs().nodes(), "one displacement a node");
        let mut forces = vec![[0.0; 3]; displacement_mm.len()];
        for (column, row, index) in self.structure.pattern.blocks() {
            let block = &self.blocks[index];
            let (u, v) = (displacement_mm[column], displacement_mm[row]);
            for i in 0..3 {
                forces[row][i] += block[i][0] * u[0] + block[i][1] * u[1] + block[i][2] * u[2];
            }
            if row != column {
                for i in 0..3 {
                    forces[column][i] += block[0][i] * v[0] + block[1][i] * v[1] + block[2][i] * v[2];
                }
            }
        }
        forces
    }
}

impl Structure {
    /// Computes the blocks of all node pairs at these node positions (mm).
    fn blocks(&self, nodes: &[[f64; 3]]) -> Result<Vec<NodeBlock>, LinearError> {
        let mut blocks = vec![[[0.0; 3]; 3]; self.pattern.pairs()];
        let parts = self.elements.iter().zip(&self.materials).zip(self.pattern.places());
        for (element, ((corners, material), places)) in parts.enumerate() {
            let shape = match Shape::of(&corners.map(|node| nodes[node as usize])) {
                Ok(shape) => shape,
                Err(cause) => return Err(self.unusable(nodes, element, cause)),
            };
            let weights = shape.weights(material);
            for (&block_index, (a, b)) in places.iter().zip(PAIRS) {
                let (row, column) = if corners[a] > corners[b] { (a, b) } else { (b, a) };
                let block = shape.block(weights, row, column);
                for (sums, row) in blocks[block_index as usize].iter_mut().zip(&block) {
                    for (sum, value) in sums.iter_mut().zip(row) {
                        *sum += value;
                    }
                }
            }
        }
        Ok(blocks)
    }

    fn unusable(&self, nodes: &[[f64; 3]], element: usize, cause: DegenerateElement) -> LinearError {
        let following = self.elements.iter().enumerate().skip(element + 1);
        let others = following.filter(|(_, corners)| Shape::of(&corners.map(|node| nodes[node as usize])).is_err());
        LinearError::Element {
            element,
            corners: self.elements[element],
            cause,
            others: others.map(|(degenerate, _)| degenerate).take(10).collect(),
        }
    }
}

fn expect(what: &'static str, found: usize, expected: usize) -> Result<(), LinearError> {
    if found == expected {
        Ok(())
    } else {
        Err(LinearError::Count { what, found, expected })
    }
}

#[cfg(test)]
mod tests;
