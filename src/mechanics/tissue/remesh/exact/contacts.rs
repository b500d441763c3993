//! Compliance at the contacts.

use crate::tissue::error::LinearError;
use faer::prelude::ReborrowMut;
use faer::{Accum, Mat, MatRef};

use super::support::{CHANGE_ROOM, CONTACTS_ROOM, HELD_ROOM, Support};
use super::update::{Work, product};
use crate::tissue::compliance::{Compliance, check_distinct, check_dofs};
use crate::tissue::remesh::growable::Growable;

#[derive(Debug)]
pub(super) struct Contacts {
    dofs: Vec<usize>,
    /// K0^-1[c, c], symmetric.
    bare: Growable,
    /// K^-1[c, c], symmetric.
    pub condensed: Growable,
    /// Buffer for the next value of either matrix.
    spare: Growable,
    /// Buffer for columns of B.
    columns: Growable,
}

impl Contacts {
    pub(super) fn none() -> Contacts {
        Contacts {
            dofs: Vec::new(),
            bare: Growable::with_room(CONTACTS_ROOM, CONTACTS_ROOM),
            condensed: Growable::with_room(CONTACTS_ROOM, CONTACTS_ROOM),
            spare: Growable::with_room(CONTACTS_ROOM, CONTACTS_ROOM),
            columns: Growable::with_room(HELD_ROOM, CHANGE_ROOM),
        }
    }

    pub(super) fn dofs(&self) -> &[usize] {
        &self.dofs
    }

    /// K0^-1[c, c].
    pub(super) fn bare(&self) -> MatRef<'_, f64> {
        self.bare.get()
    }

    /// Resets the compliance at the contacts to that of the base.
    pub(crate) fn forget_correction(&mut self) {
        self.condensed.get_mut().copy_from(self.bare.get());
    }

    /// Reads K0^-1[c, c] anew: that of a source that solves for columns is symmetric to rounding only, so that what was
    /// read as contacts came depends on their order.
    pub(super) fn read_again(&mut self, source: &mut dyn Compliance) -> Result<(), LinearError> {
        let entries = source.entries(&self.dofs, &self.dofs)?;
        let mut bare = self.bare.get_mut();
        for j in 0..self.dofs.len() {
            for i in 0..=j {
                bare[(i, j)] = entries[(i, j)];
                bare[(j, i)] = entries[(i, j)];
            }
        }
        Ok(())
    }

    /// Sets the contacts; rows of B and entries of both matrices are kept for contacts that remain.
    pub(super) fn set(
        &mut self,
        dofs: &[usize],
        source: &mut dyn Compliance,
        support: &mut Support,
        work: &mut Work,
    ) -> Result<(), LinearError> {
        check_dofs(dofs, source.size())?;
        check_distinct(dofs)?;
        let before: Vec<Option<usize>> = dofs
            .iter()
            .map(|dof| self.dofs.iter().position(|old| old == dof))
            .collect();
        let new: Vec<usize> = (0..dofs.len()).filter(|index| before[*index].is_none()).collect();
        let new_dofs: Vec<usize> = new.iter().map(|index| dofs[*index]).collect();
        let len = support.len();
        // Entries of remaining contacts are kept, as reading the source is what costs.
        let with_new = source.entries(dofs, &new_dofs)?;
        let coupling = source.entries(support.dofs(), &new_dofs)?;

        // Contacts in this prefix keep their places, as most do from step to step: of B, their columns are not moved.
        let prefix = before
            .iter()
            .enumerate()
            .take_while(|(index, old)| **old == Some(*index))
            .count();
        rearrange(&mut self.bare, &mut self.spare, &before, prefix);
        rearrange(&mut self.condensed, &mut self.spare, &before, prefix);
        let mut columns = self.columns.shape(len, dofs.len() - prefix);
        let mut coupling_column = 0;
        for (mut column, old) in columns.rb_mut().col_iter_mut().zip(&before[prefix..]) {
            if let Some(old) = *old {
                column.copy_from(support.b.get().col(old));
            } else {
                column.copy_from(coupling.col(coupling_column));
                coupling_column += 1;
            }
        }
        let mut b = support.b.shape(len, dofs.len());
        b.rb_mut().subcols_mut(prefix, dofs.len() - prefix).copy_from(columns);
        // By the matrix inversion lemma K^-1[c, c] is K0^-1[c, c] - B^T C B; all but the new columns of it are known.
        let mut cb = Mat::zeros(len, new.len());
        product(cb.as_mut(), Accum::Replace, support.c.get(), coupling.as_ref(), 1.0);
        // Part of the last update may not be in C yet.
        work.add_left(coupling.as_ref(), cb.as_mut(), 1.0);
        let mut correction = Mat::zeros(dofs.len(), new.len());
        product(
            correction.as_mut(),
            Accum::Replace,
            support.b.get().transpose(),
            cb.as_ref(),
            1.0,
        );
        let (mut bare, mut condensed) = (self.bare.get_mut(), self.condensed.get_mut());
        for (new_column, &j) in new.iter().enumerate() {
            // Each pair of new contacts is read once, so that both matrices stay symmetric.
            for i in (0..dofs.len()).filter(|i| before[*i].is_some() || *i <= j) {
                bare[(i, j)] = with_new[(i, new_column)];
                bare[(j, i)] = with_new[(i, new_column)];
                condensed[(i, j)] = with_new[(i, new_column)] - correction[(i, new_column)];
                condensed[(j, i)] = condensed[(i, j)];
            }
        }
        self.dofs.clear();
        self.dofs.extend_from_slice(dofs);
        Ok(())
    }
}

/// Moves the entries of remaining contacts to their new places; those of new contacts are not set.
fn rearrange(matrix: &mut Growable, next: &mut Growable, before: &[Option<usize>], prefix: usize) {
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
