//! Precomputation for an expected mesh change.
//!
//! The degrees of freedom P around a change are known before its size. With P in S, where its rows and columns of C are
//! zero, G[S, P] can be read and C G[S, P] computed column by column: half the work of an update.

use faer::Accum;
use faer::prelude::ReborrowMut;

use super::Exact;
use super::support::CHANGE_ROOM;
use super::update::product;

/// Columns of C G[S, P] computed at once.
const COLUMNS_AT_ONCE: usize = 8;

/// Expected change, and the work done for it.
#[derive(Debug)]
pub(super) struct Speculation {
    /// Degrees of freedom P of the change; empty if none is expected.
    support: Vec<u32>,
    /// Size of S without P, once P is in S.
    before: Option<usize>,
    /// Number of columns of C G[S, P] computed.
    columns: usize,
}

impl Speculation {
    pub(super) fn new() -> Speculation {
        Speculation {
            support: Vec::with_capacity(CHANGE_ROOM),
            before: None,
            columns: 0,
        }
    }

    /// Discards the computed columns, as C has changed.
    pub(crate) fn begin_columns(&mut self) {
        self.columns = 0;
    }

    /// Cancels the expected change.
    pub(super) fn forget(&mut self) {
        self.support.clear();
        (self.before, self.columns) = (None, 0);
    }

    pub(super) fn bytes(&self) -> usize {
        self.support.capacity() * size_of::<u32>()
    }
}

impl Exact {
    /// Sets the degrees of freedom of the expected change.
    pub(super) fn await_change(&mut self, support: &[u32]) {
        if self.options.deferred && self.speculation.support != support {
            self.discard_speculation();
            self.speculation.support.extend_from_slice(support);
        }
    }

    /// Ends the expectation when a change arrives. Returns the size of S without it, and the number of columns of C
    /// G[S, P] already computed.
    pub(super) fn meet(&mut self, support: &[u32]) -> (usize, usize) {
        if self.speculation.support != support {
            self.discard_speculation();
        }
        let expected = (
            self.speculation.before.unwrap_or(self.support.len()),
            self.speculation.columns,
        );
        self.speculation.forget();
        expected
    }

    /// Removes from S what was only expected.
    fn discard_speculation(&mut self) {
        if let Some(before) = self.speculation.before {
            self.support.truncate(before);
        }
        self.speculation.forget();
    }

    /// Performs one task for the expected change; no update of C may be pending.
    pub(super) fn speculate(&mut self) {
        let Exact {
            speculation,
            support,
            work,
            source,
            contacts,
            ..
        } = self;
        let rank = speculation.support.len();
        if speculation.columns == rank {
            return;
        }
        if speculation.before.is_none() {
            let before = support.len();
            // A failure is reported when the change arrives.
            match support.extend(&mut **source, &speculation.support, contacts.dofs()) {
                Ok(()) => speculation.before = Some(before),
                Err(_) => speculation.forget(),
            }
            return;
        }
        let len = support.len();
        let first_column = speculation.columns;
        let count = COLUMNS_AT_ONCE.min(rank - first_column);
        let mut g_sp = work.g_sp.shape(len, rank).subcols_mut(first_column, count);
        for (column, dof) in speculation.support[first_column..first_column + count]
            .iter()
            .enumerate()
        {
            g_sp.rb_mut()
                .col_mut(column)
                .copy_from(support.g.get().col(support.place(*dof)));
        }
        let x = work.v.shape(len, rank).subcols_mut(first_column, count);
        product(x, Accum::Replace, support.c.get(), g_sp.as_ref(), 1.0);
        speculation.columns += count;
    }
}
