//! Degrees of freedom: three displacements per node, each free or prescribed.

/// In place of the number of a degree of freedom: it is prescribed.
pub const NO_DOF: u32 = u32::MAX;

/// Numbering of the free displacements in the reduced system, ascending by node, then axis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dofs {
    numbers: Vec<[u32; 3]>,
    free: Vec<(u32, u8)>,
}

impl Dofs {
    /// Numbers the degrees of freedom of `nodes` nodes, those in `fixed` (node from 0, axis 0 to 2) prescribed.
    /// Duplicates have no effect.
    ///
    /// # Panics
    /// If a node or an axis is out of range, or three times `nodes` does not fit 32 bits.
    pub fn new(nodes: usize, fixed: impl IntoIterator<Item = (u32, u8)>) -> Dofs {
        assert!(
            nodes < (u32::MAX / 3) as usize,
            "{nodes} nodes outnumber 32-bit degrees of freedom"
        );
        let mut numbers = vec![[0; 3]; nodes];
        for (node, axis) in fixed {
            numbers[node as usize][axis as usize] = NO_DOF;
        }
        let mut free = Vec::with_capacity(3 * nodes);
        for (node, dofs) in numbers.iter_mut().enumerate() {
            for (axis, dof) in dofs.iter_mut().enumerate() {
                if *dof != NO_DOF {
                    *dof = free.len() as u32;
                    free.push((node as u32, axis as u8));
                }
            }
        }
        Dofs { numbers, free }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.numbers.len()
    }

    /// Number of free degrees of freedom: the size of the reduced system.
    pub fn free(&self) -> usize {
        self.free.len()
    }

    /// Numbers of a node's degrees of freedom along x, y and z, [`NO_DOF`] where prescribed.
    ///
    /// # Panics
    /// If the node is out of range.
    pub fn of(&self, node: u32) -> [u32; 3] {
        self.numbers[node as usize]
    }

    /// Node and axis of a free degree of freedom.
    ///
    /// # Panics
    /// If the number is out of range.
    pub(crate) fn node_of(&self, dof: u32) -> (u32, u8) {
        self.free[dof as usize]
    }

    /// Prescribed degrees of freedom as (node, axis), ascending.
    pub fn prescribed(&self) -> impl Iterator<Item = (u32, u8)> + '_ {
        self.numbers.iter().enumerate().flat_map(|(node, dofs)| {
            (0..3u8)
                .filter(|&axis| dofs[axis as usize] == NO_DOF)
                .map(move |axis| (node as u32, axis))
        })
    }

    /// Returns the free entries of a vector over all nodes.
    ///
    /// # Panics
    /// If there is not one entry per node.
    pub fn gather(&self, nodal: &[[f64; 3]]) -> Vec<f64> {
        assert_eq!(nodal.len(), self.nodes(), "one entry a node");
        let entry = |&(node, axis): &(u32, u8)| nodal[node as usize][axis as usize];
        self.free.iter().map(entry).collect()
    }

    /// Writes the free entries into a vector over all nodes; the prescribed ones are unchanged.
    ///
    /// # Panics
    /// If there is not one entry per node, or not one value per free degree of freedom.
    pub fn scatter(&self, free: &[f64], nodal: &mut [[f64; 3]]) {
        assert_eq!(nodal.len(), self.nodes(), "one entry a node");
        assert_eq!(free.len(), self.free(), "one value a free degree of freedom");
        for (value, &(node, axis)) in free.iter().zip(&self.free) {
            nodal[node as usize][axis as usize] = *value;
        }
    }
}

#[cfg(test)]
mod tests;
