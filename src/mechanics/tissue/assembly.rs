//! The stiffness matrix of a mesh: sparse, symmetric, its lower triangle in compressed columns over the free degrees of
//! freedom.
//!
//! Assembly takes two steps. The first finds, once for a mesh, where each pair of nodes that share an element meets in the
//! matrix, and which of these places each element adds to; the second computes the elements and adds them up, and can be
//! repeated with other reference positions.

mod pattern;

use std::sync::Arc;

use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};

use super::dofs::Dofs;
use super::element::{DegenerateElement, NodeBlock, Shape};
use super::factor::Symmetric;
use super::material::Material;
use crate::mechanics::mesh::TetMesh;
pub(super) use pattern::corners_by_node;
use pattern::{PAIRS, Pattern};

/// What a stiffness matrix keeps however its nodes move.
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
    /// One block for each pair of nodes that share an element, prescribed ones too.
    blocks: Vec<NodeBlock>,
    /// Entries of the lower triangle over the free degrees of freedom, column by column.
    values: Vec<f64>,
    norm_inf: f64,
}

/// Why a stiffness matrix cannot be assembled.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AssemblyError {
    /// A list does not match the mesh.
    #[error("{found} {what}; expected {expected}, as the mesh has")]
    Count {
        /// What there are too many or too few of.
        what: &'static str,
        /// How many were given.
        found: usize,
        /// How many the mesh has.
        expected: usize,
    },
    /// A tetrahedron has no usable volume.
    #[error("tetrahedron {element} (nodes {corners:?}): {cause}{}", more(.others))]
    Element {
        /// Index of the first such element, from 0.
        element: usize,
        /// Its nodes.
        corners: [u32; 4],
        /// What is wrong with it.
        cause: DegenerateElement,
        /// The next elements that are no better, ten at most.
        others: Vec<usize>,
    },
    /// The matrix has more entries than 32-bit indices can name.
    #[error("the stiffness matrix has more than {limit} entries")]
    TooLarge {
        /// The most that indices can name.
        limit: usize,
    },
}

fn more(elements: &[usize]) -> String {
    match elements {
        [] => String::new(),
        others => format!("; unusable as well: {others:?}"),
    }
}

impl Stiffness {
    /// Assembles the stiffness of a mesh in its reference state, `materials` one an element.
    ///
    /// # Errors
    /// [`AssemblyError`] where a list does not match the mesh or an element is flat or inverted.
    pub fn assemble(mesh: &TetMesh, materials: &[Material], dofs: &Dofs) -> Result<Stiffness, AssemblyError> {
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

    /// The stiffness of the same mesh, materials and degrees of freedom with the reference nodes elsewhere (mm). It has the
    /// same pattern, so a [`Factor`](super::factor::Factor) of the one can be refactored to the other.
    ///
    /// # Errors
    /// [`AssemblyError`] where there is not one position a node, or an element is flat or inverted.
    pub fn at_nodes(&self, nodes: &[[f64; 3]]) -> Result<Stiffness, AssemblyError> {
        expect("node positions", nodes.len(), self.dofs().nodes())?;
        Stiffness::fill(Arc::clone(&self.structure), nodes)
    }

    fn fill(structure: Arc<Structure>, nodes: &[[f64; 3]]) -> Result<Stiffness, AssemblyError> {
        let blocks = structure.blocks(nodes)?;
        let Structure { dofs, pattern, .. } = &*structure;
        let mut values = Vec::with_capacity(pattern.entries());
        let mut sums = vec![0.0; dofs.free()];
        pattern.for_each_entry(dofs, |row, column, at, (i, j)| {
            let value = blocks[at][i][j];
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

    /// The degrees of freedom.
    pub fn dofs(&self) -> &Dofs {
        &self.structure.dofs
    }

    /// Node indices of the elements.
    pub fn elements(&self) -> &[[u32; 4]] {
        &self.structure.elements
    }

    /// The materials, one an element.
    pub fn materials(&self) -> &[Material] {
        &self.structure.materials
    }

    /// The largest sum of magnitudes in a row, N/mm.
    pub fn norm_inf(&self) -> f64 {
        self.norm_inf
    }

    /// The lower triangle, rows ascending in each column.
    pub fn lower(&self) -> SparseColMatRef<'_, u32, f64> {
        SparseColMatRef::new(self.pattern(), &self.values)
    }

    /// Where the lower triangle has entries.
    pub(super) fn pattern(&self) -> SymbolicSparseColMatRef<'_, u32> {
        self.structure.pattern.lower.as_ref()
    }

    /// `y = K x` over the free degrees of freedom (x in mm, y in N).
    ///
    /// # Panics
    /// If a slice does not have one entry for each.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) {
        self.product(x, y);
    }

    /// Forces on all nodes (N) that hold the displacements of all nodes (mm), prescribed ones among them.
    ///
    /// # Panics
    /// If there is not one displacement a node.
    pub fn nodal_forces(&self, displacement_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        assert_eq!(displacement_mm.len(), self.dofs().nodes(), "one displacement a node");
        let mut forces = vec![[0.0; 3]; displacement_mm.len()];
        for (column, row, at) in self.structure.pattern.blocks() {
            let block = &self.blocks[at];
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
    /// The blocks of all pairs of nodes with the nodes at these positions.
    fn blocks(&self, nodes: &[[f64; 3]]) -> Result<Vec<NodeBlock>, AssemblyError> {
        let mut blocks = vec![[[0.0; 3]; 3]; self.pattern.pairs()];
        let parts = self.elements.iter().zip(&self.materials).zip(self.pattern.places());
        for (element, ((corners, material), places)) in parts.enumerate() {
            let shape = match Shape::of(&corners.map(|node| nodes[node as usize])) {
                Ok(shape) => shape,
                Err(cause) => return Err(self.unusable(nodes, element, cause)),
            };
            let weights = shape.weights(material);
            for (&at, (a, b)) in places.iter().zip(PAIRS) {
                let (row, column) = if corners[a] > corners[b] { (a, b) } else { (b, a) };
                let block = shape.block(weights, row, column);
                for (sums, row) in blocks[at as usize].iter_mut().zip(&block) {
                    for (sum, value) in sums.iter_mut().zip(row) {
                        *sum += value;
                    }
                }
            }
        }
        Ok(blocks)
    }

    fn unusable(&self, nodes: &[[f64; 3]], element: usize, cause: DegenerateElement) -> AssemblyError {
        let rest = self.elements.iter().enumerate().skip(element + 1);
        let others = rest.filter(|(_, corners)| Shape::of(&corners.map(|node| nodes[node as usize])).is_err());
        AssemblyError::Element {
            element,
            corners: self.elements[element],
            cause,
            others: others.map(|(other, _)| other).take(10).collect(),
        }
    }
}

fn expect(what: &'static str, found: usize, expected: usize) -> Result<(), AssemblyError> {
    if found == expected {
        Ok(())
    } else {
        Err(AssemblyError::Count { what, found, expected })
    }
}

#[cfg(test)]
mod tests;
