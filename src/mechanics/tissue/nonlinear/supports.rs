//! Which displacements of a body are free, and which prescribed.

pub use crate::mechanics::tissue::dofs::NONE;

/// `D` degrees of freedom a node, numbered node by node; the free ones also among themselves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Supports<const D: usize> {
    /// Number among the free ones, by degree of freedom; [`NONE`] where prescribed.
    of: Vec<u32>,
    free: Vec<u32>,
    prescribed: Vec<u32>,
}

impl<const D: usize> Supports<D> {
    /// Those of `nodes` nodes with the degrees of freedom `prescribed` (node, axis); naming one twice changes nothing.
    ///
    /// # Panics
    /// If a node or an axis is out of range, or there are more than 32 bits can number.
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

    /// All degrees of freedom, free or not.
    pub fn all(&self) -> usize {
        self.of.len()
    }

    /// The free degrees of freedom, ascending.
    pub fn free(&self) -> &[u32] {
        &self.free
    }

    /// The prescribed degrees of freedom, ascending.
    pub fn prescribed(&self) -> &[u32] {
        &self.prescribed
    }

    /// Number of a degree of freedom among the free ones, [`NONE`] where it is prescribed.
    ///
    /// # Panics
    /// If it is out of range.
    pub fn number(&self, dof: usize) -> u32 {
        self.of[dof]
    }

    /// Copies the free entries of a vector over all.
    pub(super) fn gather(&self, all: &[f64], free: &mut [f64]) {
        for (value, dof) in free.iter_mut().zip(&self.free) {
            *value = all[*dof as usize];
        }
    }
}
