//! Condensation: the rows and columns K^c of K^-1 at the contact nodes, each in its node's own frame, so that
//! u^c = K^c f^c (Goksel et al.'s section II).

use faer::{Mat, MatRef};

use super::compliance::{Compliance, ComplianceError};
use super::dofs::{Dofs, NONE};
use super::frames::Frame;

/// A node in contact, and the axes that its forces and displacements are given in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// The node.
    pub node: u32,
    /// Its axes.
    pub frame: Frame,
}

/// K^c in mm/N: three rows and columns a contact, in the order of the contacts, symmetric to the bit. Along an axis that is
/// fixed at the node it is zero.
#[derive(Clone, Debug)]
pub struct Condensed {
    contacts: Vec<Contact>,
    dofs: Vec<[u32; 3]>,
    /// In world axes, so that a node can be turned again and again without loss.
    world: Mat<f64>,
    /// In the frames of the nodes.
    matrix: Mat<f64>,
}

/// Why contacts cannot be added, removed or turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CondensedError {
    /// A node that the mesh does not have.
    #[error("contact node {node}, but the mesh has {nodes} nodes: valid are 0 to {nodes} - 1")]
    OutOfRange {
        /// As given.
        node: u32,
        /// Nodes of the mesh.
        nodes: usize,
    },
    /// A node that cannot move.
    #[error("node {node} is fixed along every axis and cannot be a contact: nothing there yields to a force")]
    Fixed {
        /// The node.
        node: u32,
    },
    /// A node that is in contact already.
    #[error("node {node} is a contact already; a node can be one once")]
    Repeated {
        /// The node.
        node: u32,
    },
    /// A node that is not in contact.
    #[error("node {node} is no contact")]
    Unknown {
        /// The node.
        node: u32,
    },
    /// K^-1 belongs to another system.
    #[error("the compliance has {found} degrees of freedom, the mesh {expected} free ones")]
    Size {
        /// Of the compliance.
        found: usize,
        /// Of the mesh.
        expected: usize,
    },
    /// Entries of K^-1 cannot be had.
    #[error(transparent)]
    Compliance(#[from] ComplianceError),
}

impl Default for Condensed {
    fn default() -> Self {
        Self::new()
    }
}

impl Condensed {
    /// No contact.
    pub fn new() -> Self {
        Self {
            contacts: Vec::new(),
            dofs: Vec::new(),
            world: Mat::new(),
            matrix: Mat::new(),
        }
    }

    /// Adds contacts after those that are there; only the new rows and columns of K^-1 are read.
    ///
    /// # Errors
    /// [`CondensedError`], naming the node; nothing is added then.
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

    /// Removes a contact; the others keep their order and their values.
    ///
    /// # Errors
    /// [`CondensedError::Unknown`] when the node is no contact.
    pub fn remove(&mut self, node: u32) -> Result<(), CondensedError> {
        let at = self.index_of(node).ok_or(CondensedError::Unknown { node })?;
        self.contacts.remove(at);
        self.dofs.remove(at);
        let size = 3 * self.contacts.len();
        let from = |i: usize| if i < 3 * at { i } else { i + 3 };
        for matrix in [&mut self.world, &mut self.matrix] {
            *matrix = Mat::from_fn(size, size, |i, j| matrix[(from(i), from(j))]);
        }
        Ok(())
    }

    /// Reads every entry again: K^-1 has changed.
    ///
    /// # Errors
    /// [`CondensedError`]; nothing is changed then.
    pub fn refresh(&mut self, compliance: &mut dyn Compliance) -> Result<(), CondensedError> {
        let block = read(compliance, &self.dofs, 0)?;
        self.take(0, &block);
        Ok(())
    }

    /// Turns the frame of a contact.
    ///
    /// # Errors
    /// [`CondensedError::Unknown`] when the node is no contact.
    pub fn turn(&mut self, node: u32, frame: Frame) -> Result<(), CondensedError> {
        let at = self.index_of(node).ok_or(CondensedError::Unknown { node })?;
        self.contacts[at].frame = frame;
        for other in 0..self.contacts.len() {
            self.rotate(at.max(other), at.min(other));
        }
        Ok(())
    }

    /// The contacts, in the order of their rows.
    pub fn contacts(&self) -> &[Contact] {
        &self.contacts
    }

    /// Where a node is among the contacts.
    pub fn index_of(&self, node: u32) -> Option<usize> {
        self.contacts.iter().position(|contact| contact.node == node)
    }

    /// Contact degrees of freedom: three a contact.
    pub fn size(&self) -> usize {
        3 * self.contacts.len()
    }

    /// K^c in the frames of the nodes, mm/N.
    pub fn matrix(&self) -> MatRef<'_, f64> {
        self.matrix.as_ref()
    }

    /// Forces in the frames of the nodes (N) as forces on the free degrees of freedom of the whole mesh. Along fixed axes
    /// they go into the support.
    ///
    /// # Panics
    /// If there are not three values a contact, or `out` is not as long as the mesh has free degrees of freedom.
    pub fn spread(&self, forces: &[f64], out: &mut [f64]) {
        assert_eq!(forces.len(), self.size(), "three forces a contact");
        out.fill(0.0);
        for ((contact, dofs), force) in self.contacts.iter().zip(&self.dofs).zip(forces.as_chunks().0) {
            for (&dof, value) in dofs.iter().zip(contact.frame.to_world(*force)) {
                if dof != NONE {
                    out[dof as usize] = value;
                }
            }
        }
    }

    /// Stores a block of [`read`] and its mirror image, and rotates it.
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

    /// Computes block (a, b) of the matrix in frames and its mirror image, R_a^T W R_b; b is at most a.
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

/// World columns of the contacts from `first` on, at the rows of all contacts; zero along fixed axes.
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
