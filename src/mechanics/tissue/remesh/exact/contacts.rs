//! The compliance at the contacts.

use faer::prelude::ReborrowMut;
use faer::{Accum, Mat, MatRef};

use super::held::{CHANGE_ROOM, CONTACTS_ROOM, HELD_ROOM, Held};
use super::update::{Work, product};
use crate::mechanics::tissue::compliance::{Compliance, ComplianceError, check_distinct, check_dofs};
use crate::mechanics::tissue::remesh::grown::Grown;

#[derive(Debug)]
pub(super) struct Contacts {
    dofs: Vec<usize>,
    /// K0^-1[c, c], symmetric.
    bare: Grown,
    /// K^-1[c, c], symmetric.
    pub condensed: Grown,
    /// Memory for the next of either.
    spare: Grown,
    /// Memory for columns of B.
    columns: Grown,
}

impl Contacts {
    pub fn none() -> Contacts {
        Contacts {
            dofs: Vec::new(),
            bare: Grown::with_room(CONTACTS_ROOM, CONTACTS_ROOM),
            condensed: Grown::with_room(CONTACTS_ROOM, CONTACTS_ROOM),
            spare: Grown::with_room(CONTACTS_ROOM, CONTACTS_ROOM),
            columns: Grown::with_room(HELD_ROOM, CHANGE_ROOM),
        }
    }

    pub fn dofs(&self) -> &[usize] {
        &self.dofs
    }

    /// K0^-1[c, c].
    pub fn bare(&self) -> MatRef<'_, f64> {
        self.bare.get()
    }

    /// The compliance at the contacts is that of the base.
    pub fn forget_correction(&mut self) {
        self.condensed.get_mut().copy_from(self.bare.get());
    }

    /// Names the contacts anew: rows of B and entries of both matrices are kept where their degrees of freedom stay.
    pub fn set(
        &mut self,
        dofs: &[usize],
        source: &mut dyn Compliance,
        held: &mut Held,
        work: &mut Work,
    ) -> Result<(), ComplianceError> {
        check_dofs(dofs, source.size())?;
        check_distinct(dofs)?;
        let before: Vec<Option<usize>> = dofs
            .iter()
            .map(|dof| self.dofs.iter().position(|old| old == dof))
            .collect();
        let new: Vec<usize> = (0..dofs.len()).filter(|at| before[*at].is_none()).collect();
        let new_dofs: Vec<usize> = new.iter().map(|at| dofs[*at]).collect();
        let len = held.len();
        let own = source.entries(dofs, &new_dofs)?;
        let coupling = source.entries(held.dofs(), &new_dofs)?;

        // Those before it stay where they are.
        let prefix = before
            .iter()
            .enumerate()
            .take_while(|(at, old)| **old == Some(*at))
            .count();
        rearrange(&mut self.bare, &mut self.spare, &before, prefix);
        rearrange(&mut self.condensed, &mut self.spare, &before, prefix);
        let mut columns = self.columns.shape(len, dofs.len() - prefix);
        let mut from = 0;
        for (mut column, old) in columns.rb_mut().col_iter_mut().zip(&before[prefix..]) {
            if let Some(old) = *old {
                column.copy_from(held.b.get().col(old));
            } else {
                column.copy_from(coupling.col(from));
                from += 1;
            }
        }
        let mut b = held.b.shape(len, dofs.len());
        b.rb_mut().subcols_mut(prefix, dofs.len() - prefix).copy_from(columns);
        // B^T C B at the new columns.
        let mut cb = Mat::zeros(len, new.len());
        product(cb.as_mut(), Accum::Replace, held.c.get(), coupling.as_ref(), 1.0);
        work.add_left(coupling.as_ref(), cb.as_mut(), 1.0);
        let mut correction = Mat::zeros(dofs.len(), new.len());
        product(
            correction.as_mut(),
            Accum::Replace,
            held.b.get().transpose(),
            cb.as_ref(),
            1.0,
        );
        let (mut bare, mut condensed) = (self.bare.get_mut(), self.condensed.get_mut());
        for (from, &j) in new.iter().enumerate() {
            // Pairs of new contacts once, so that both matrices stay symmetric.
            for i in (0..dofs.len()).filter(|i| before[*i].is_some() || *i <= j) {
                bare[(i, j)] = own[(i, from)];
                bare[(j, i)] = own[(i, from)];
                condensed[(i, j)] = own[(i, from)] - correction[(i, from)];
                condensed[(j, i)] = condensed[(i, j)];
            }
        }
        self.dofs.clear();
        self.dofs.extend_from_slice(dofs);
        Ok(())
    }
}

/// Brings the entries of contacts that stay to where they are now; those of new ones are left to be written.
fn rearrange(matrix: &mut Grown, next: &mut Grown, before: &[Option<usize>], prefix: usize) {
    let size = before.len();
    let (from, mut to) = (matrix.get(), next.shape(size, size));
    for (j, old) in before.iter().enumerate() {
        let Some(column) = *old else { continue };
        let (from, mut to) = (from.col(column), to.rb_mut().col_mut(j));
        to.rb_mut().subrows_mut(0, prefix).copy_from(from.subrows(0, prefix));
        for (i, old) in before.iter().enumerate().skip(prefix) {
            if let Some(row) = *old {
                to[i] = from[row];
            }
        }
    }
    std::mem::swap(matrix, next);
}
