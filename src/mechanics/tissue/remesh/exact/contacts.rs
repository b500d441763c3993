//! The compliance at the contacts.

use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Mat, MatRef};

use super::held::Held;
use super::update::product;
use crate::mechanics::tissue::compliance::{Compliance, ComplianceError, check_distinct, check_dofs};
use crate::mechanics::tissue::remesh::grown::Grown;

#[derive(Debug)]
pub(super) struct Contacts {
    dofs: Vec<usize>,
    /// K0^-1[c, c], symmetric.
    bare: Mat<f64>,
    /// K^-1[c, c], symmetric.
    pub condensed: Mat<f64>,
    /// Memory for the next B.
    coupling: Grown,
}

impl Contacts {
    pub fn none() -> Contacts {
        Contacts {
            dofs: Vec::new(),
            bare: Mat::new(),
            condensed: Mat::new(),
            coupling: Grown::default(),
        }
    }

    pub fn dofs(&self) -> &[usize] {
        &self.dofs
    }

    /// K0^-1[c, c].
    pub fn bare(&self) -> MatRef<'_, f64> {
        self.bare.as_ref()
    }

    /// The compliance at the contacts is that of the base.
    pub fn forget_correction(&mut self) {
        self.condensed.copy_from(&self.bare);
    }

    /// Names the contacts anew: rows of B and entries of both matrices are kept where their degrees of freedom stay.
    pub fn set(&mut self, dofs: &[usize], source: &mut dyn Compliance, held: &mut Held) -> Result<(), ComplianceError> {
        check_dofs(dofs, source.size())?;
        check_distinct(dofs)?;
        let before: Vec<Option<usize>> = dofs
            .iter()
            .map(|dof| self.dofs.iter().position(|old| old == dof))
            .collect();
        let new: Vec<usize> = (0..dofs.len()).filter(|at| before[*at].is_none()).collect();
        let new_dofs: Vec<usize> = new.iter().map(|at| dofs[*at]).collect();
        let own = source.entries(dofs, &new_dofs)?;
        let coupling = source.entries(held.dofs(), &new_dofs)?;

        let kept = |matrix: &Mat<f64>| {
            Mat::from_fn(dofs.len(), dofs.len(), |i, j| match (before[i], before[j]) {
                (Some(i), Some(j)) => matrix[(i, j)],
                _ => 0.0,
            })
        };
        let (mut bare, mut condensed) = (kept(&self.bare), kept(&self.condensed));
        let mut columns = self.coupling.shape(held.len(), dofs.len());
        for (at, old) in before.iter().enumerate() {
            if let Some(old) = *old {
                columns.rb_mut().col_mut(at).copy_from(held.b.get().col(old));
            }
        }
        for (from, &at) in new.iter().enumerate() {
            columns.rb_mut().col_mut(at).copy_from(coupling.col(from));
        }
        // B^T C B at the new columns.
        let mut cb = Mat::zeros(held.len(), new.len());
        product(cb.as_mut(), Accum::Replace, held.c.get(), coupling.as_ref(), 1.0);
        let mut correction = Mat::zeros(dofs.len(), new.len());
        product(
            correction.as_mut(),
            Accum::Replace,
            columns.rb().transpose(),
            cb.as_ref(),
            1.0,
        );
        for (from, &j) in new.iter().enumerate() {
            // Pairs of new contacts once, so that both matrices stay symmetric.
            for i in (0..dofs.len()).filter(|i| before[*i].is_some() || *i <= j) {
                bare[(i, j)] = own[(i, from)];
                bare[(j, i)] = own[(i, from)];
                condensed[(i, j)] = own[(i, from)] - correction[(i, from)];
                condensed[(j, i)] = condensed[(i, j)];
            }
        }
        std::mem::swap(&mut held.b, &mut self.coupling);
        self.dofs = dofs.to_vec();
        self.bare = bare;
        self.condensed = condensed;
        Ok(())
    }
}
