//! Free and prescribed displacements of a body.

pub use crate::mechanics::tissue::dofs::NONE;

/// Numbering of `D` degrees of freedom per node, node by node, and of the free ones among them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Supports<const D: usize> {
    /// Number of each degree of freedom among the free ones; [`NONE`] where prescribed.
    of: Vec<u32>,
    free: Vec<u32>,
    prescribed: Vec<u32>,
}

impl<const D: usize> Supports<D> {
    /// Numbers the degrees of freedom of `nodes` nodes, those in `prescribed` (node, axis) prescribed. Duplicates have
    /// no effect.
    ///
    /// # Panics
    /// If a node or an axis is out of range, or 32 bits cannot number all degrees of freedom.
    pub fn new(nodes: usize, prescribed: impl IntoIterator<Item = (u32, u8)>) -> Self {
        assert!(
            nodes < (u32::MAX / 4) as usize,
            "{nodes} nodes outnumber 32-bit degrees of freedom"
        );
        let mut of = vec![0; D * nodes];
        for (node, axis) in prescribed {
            assert!((axis as usize) < D, "axis {axis} in {D} dimensions");
            of[D * node as usize + axis as usize] = NONE;
        }
        let (mut free, mut held) = (Vec::with_capacity(of.len()), Vec::new());
        for (dof, number) in (0..).zip(&mut of) {
            if *number == NONE {
                held.push(dof);
            } else {
                *number = free.len() as u32;
                free.push(dof);
            }
        }
        Supports {
            of,
            free,
            prescribed: held,
        }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.of.len() / D
    }

    /// Number of all degrees of freedom, free or not.
    pub fn all(&self) -> usize {
        self.of.len()
    }

    /// Free degrees of freedom, ascending.
    pub fn free(&self) -> &[u32] {
        &self.free
    }

    /// Prescribed degrees of freedom, ascending.
    pub fn prescribed(&self) -> &[u32] {
        &self.prescribed
    }

    /// Number of a degree of freedom among the free ones, [`NONE`] where it is prescribed.
    ///
    /// # Panics
    /// If `dof` is out of range.
    pub fn number(&self, dof: usize) -> u32 {
        self.of[dof]
    }

    /// Copies the free entries of a vector over all degrees of freedom.
    pub(super) fn gather(&self, all: &[f64], free: &mut [f64]) {
        for (value, dof) in free.iter_mut().zip(&self.free) {
            *value = all[*dof as usize];
        }
    }
}
