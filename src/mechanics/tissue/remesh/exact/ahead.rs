//! Work for a change that is expected, done before it comes.
//!
//! Around which degrees of freedom P a change will be is known before how large it is. With P in S, where its rows and columns of C are
//! zero, G[S, P] can be read and C G[S, P] multiplied, column by column: half of what an update takes.

use faer::Accum;
use faer::prelude::ReborrowMut;

use super::Exact;
use super::held::CHANGE_ROOM;
use super::update::product;

/// Columns of C G[S, P] that are done at once.
const COLUMNS_AT_ONCE: usize = 8;

/// The change that is expected, and what is done for it.
#[derive(Debug)]
pub(super) struct Ahead {
    /// P; none is expected if there is nothing in it.
    support: Vec<u32>,
    /// The size of S without it, once P is in S.
    before: Option<usize>,
    /// Columns of C G[S, P] that are done.
    columns: usize,
}

impl Ahead {
    pub fn new() -> Ahead {
        Ahead {
            support: Vec::with_capacity(CHANGE_ROOM),
            before: None,
            columns: 0,
        }
    }

    /// C is another.
    pub fn begin_columns(&mut self) {
        self.columns = 0;
    }

    /// Nothing is expected any more.
    pub fn forget(&mut self) {
        self.support.clear();
        (self.before, self.columns) = (None, 0);
    }

    pub fn bytes(&self) -> usize {
        self.support.capacity() * size_of::<u32>()
    }
}

impl Exact {
    /// Expects the next change around these degrees of freedom.
    pub(super) fn await_change(&mut self, support: &[u32]) {
        if self.options.tended && self.ahead.support != support {
            self.give_up_ahead();
            self.ahead.support.extend_from_slice(support);
        }
    }

    /// A change has come. The size of S without it, and how many columns of C G[S, P] are done.
    pub(super) fn meet(&mut self, support: &[u32]) -> (usize, usize) {
        if self.ahead.support != support {
            self.give_up_ahead();
        }
        let met = (self.ahead.before.unwrap_or(self.held.len()), self.ahead.columns);
        self.ahead.forget();
        met
    }

    /// Takes out of S what was only expected.
    fn give_up_ahead(&mut self) {
        if let Some(before) = self.ahead.before {
            self.held.truncate(before);
        }
        self.ahead.forget();
    }

    /// Does one thing for the expected change; nothing may be left to do in C.
    pub(super) fn work_ahead(&mut self) {
        let Exact {
            ahead,
            held,
            work,
            source,
            contacts,
            ..
        } = self;
        let rank = ahead.support.len();
        if ahead.columns == rank {
            return;
        }
        if ahead.before.is_none() {
            let before = held.len();
            // What cannot be had now is told when the change comes.
            match held.extend(&mut **source, &ahead.support, contacts.dofs()) {
                Ok(()) => ahead.before = Some(before),
                Err(_) => ahead.forget(),
            }
            return;
        }
        let len = held.len();
        let first = ahead.columns;
        let count = COLUMNS_AT_ONCE.min(rank - first);
        let mut g_sp = work.g_sp.shape(len, rank).subcols_mut(first, count);
        for (column, dof) in ahead.support[first..first + count].iter().enumerate() {
            g_sp.rb_mut()
                .col_mut(column)
                .copy_from(held.g.get().col(held.place(*dof)));
        }
        let x = work.v.shape(len, rank).subcols_mut(first, count);
        product(x, Accum::Replace, held.c.get(), g_sp.as_ref(), 1.0);
        ahead.columns += count;
    }
}
