//! Condensed compliance K^c: the rows and columns of K^-1 at the contact nodes, each in its node's frame, so that u^c =
//! K^c f^c (Goksel et al.'s section II).

use faer::{Mat, MatRef};

use super::compliance::{Compliance, ComplianceError};
use super::dofs::{Dofs, NONE};
use super::frames::Frame;

/// Contact node with the axes of its forces and displacements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Index of the node.
    pub node: u32,
    /// Axes of the forces and displacements.
    pub frame: Frame,
}

/// Compliance K^c of the contacts, mm/N: three rows and columns per contact, in the order of the contacts; exactly
/// symmetric. Entries along an axis fixed at its node are zero.
#[derive(Clone, Debug)]
pub struct Condensed {
    contacts: Vec<Contact>,
    dofs: Vec<[u32; 3]>,
    /// K^c in world axes.
    world: Mat<f64>,
    /// K^c in the frames of the nodes.
    matrix: Mat<f64>,
}

/// Error in adding contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CondensedError {
    /// The mesh does not have the node.
    #[error("contact node {node}, but the mesh has {nodes} nodes: valid are 0 to {nodes} - 1")]
    OutOfRange {
        /// Index of the node.
        node: u32,
        /// Number of nodes in the mesh.
        nodes: usize,
    },
    /// The node is fixed along every axis.
    #[error("node {node} is fixed along every axis and cannot be a contact: nothing there yields to a force")]
    Fixed {
        /// Index of the node.
        node: u32,
    },
    /// The node is already a contact.
    #[error("node {node} is a contact already; a node can be one once")]
    Repeated {
        /// Index of the node.
        node: u32,
    },
    /// K^-1 belongs to another system.
    #[error("the compliance has {found} degrees of freedom, the mesh {expected} free ones")]
    Size {
        /// Degrees of freedom of the compliance.
        found: usize,
        /// Free degrees of freedom of the mesh.
        expected: usize,
    },
    /// Entries of K^-1 cannot be read.
    #[error(transparent)]
    Compliance(#[from] ComplianceError),
}

impl Default for Condensed {
    fn default() -> Self {
        Self::new()
    }
}

impl Condensed {
    /// Creates an empty set of contacts.
    pub fn new() -> Self {
        Self {
            contacts: Vec::new(),
            dofs: Vec::new(),
            world: Mat::new(),
            matrix: Mat::new(),
        }
    }

    /// Appends contacts; only the new rows and columns of K^-1 are read.
    ///
    /// # Errors
    /// [`CondensedError`]; nothing is added then.
    pub fn add(
        &mut self,
        compliance: &mut dyn Compliance,
        dofs: &Dofs,
        contacts: &[Contact],
    ) -> Result<(), CondensedError> {
        let [found, expected] = [compliance.size(), dofs.free()];
        if found != expected {
            return Err(CondensedError::Size { found, expected });
        }
        let mut all = self.dofs.clone();
        for (at, &Contact { node, .. }) in contacts.iter().enumerate() {
            let nodes = dofs.nodes();
            if node as usize >= nodes {
                return Err(CondensedError::OutOfRange { node, nodes });
            }
            if self.index_of(node).is_some() || contacts[..at].iter().any(|other| other.node == node) {
                return Err(CondensedError::Repeated { node });
            }
            if dofs.of(node) == [NONE; 3] {
                return Err(CondensedError::Fixed { node });
            }
            all.push(dofs.of(node));
        }
        let first = self.contacts.len();
        let block = read(compliance, &all, first)?;
        self.dofs = all;
        self.contacts.extend_from_slice(contacts);
        let size = 3 * self.contacts.len();
        for matrix in [&mut self.world, &mut self.matrix] {
            matrix.resize_with(size, size, |_, _| 0.0);
        }
        self.take(first, &block);
        Ok(())
    }

    /// Contacts in the order of their rows.
    pub fn contacts(&self) -> &[Contact] {
        &self.contacts
    }

    /// Index of a node among the contacts.
    pub fn index_of(&self, node: u32) -> Option<usize> {
        self.contacts.iter().position(|contact| contact.node == node)
    }

    /// Number of contact degrees of freedom, three per contact.
    pub fn size(&self) -> usize {
        3 * self.contacts.len()
    }

    /// K^c in the frames of the nodes, mm/N.
    pub fn matrix(&self) -> MatRef<'_, f64> {
        self.matrix.as_ref()
    }

    /// Stores a block from [`read`] and its transpose, and rotates both into the frames.
    fn take(&mut self, first: usize, block: &Mat<f64>) {
        for j in 3 * first..self.size() {
            for i in (0..3 * first).chain(j..self.size()) {
                let value = block[(i, j - 3 * first)];
                self.world[(i, j)] = value;
                self.world[(j, i)] = value;
            }
        }
        for a in first..self.contacts.len() {
            for b in 0..=a {
                self.rotate(a, b);
            }
        }
    }

    /// Computes block (a, b) in frames, R_a^T W R_b, and its transpose; b is at most a.
    fn rotate(&mut self, a: usize, b: usize) {
        let [left, right] = [a, b].map(|at| self.contacts[at].frame);
        let row = |i: usize| right.to_frame(std::array::from_fn(|j| self.world[(3 * a + i, 3 * b + j)]));
        let half: [[f64; 3]; 3] = std::array::from_fn(row);
        for j in 0..3 {
            let column = left.to_frame(half.map(|row| row[j]));
            for i in if a == b { j } else { 0 }..3 {
                self.matrix[(3 * a + i, 3 * b + j)] = column[i];
                self.matrix[(3 * b + j, 3 * a + i)] = column[i];
            }
        }
    }
}

/// Reads the world-axis columns of the contacts from `first` on, at the rows of all contacts; zero along fixed axes.
fn read(compliance: &mut dyn Compliance, dofs: &[[u32; 3]], first: usize) -> Result<Mat<f64>, ComplianceError> {
    let free = |contacts: &[[u32; 3]]| -> (Vec<usize>, Vec<usize>) {
        let all = contacts.as_flattened().iter().enumerate();
        all.filter(|&(_, &dof)| dof != NONE)
            .map(|(at, &dof)| (at, dof as usize))
            .unzip()
    };
    let (row_places, rows) = free(dofs);
    let (column_places, columns) = free(&dofs[first..]);
    let entries = compliance.entries(&rows, &columns)?;
    let mut block = Mat::zeros(3 * dofs.len(), 3 * (dofs.len() - first));
    for (j, &column) in column_places.iter().enumerate() {
        for (i, &row) in row_places.iter().enumerate() {
            block[(row, column)] = entries[(i, j)];
        }
    }
    Ok(block)
}

#[cfg(test)]
mod tests;
