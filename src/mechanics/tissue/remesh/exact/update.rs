//! Update of C and K^c for one change.

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef, Par};

use super::Exact;
use super::support::{CHANGE_ROOM, CONTACTS_ROOM, HELD_ROOM};
use crate::tissue::remesh::adapted::Change;
use crate::tissue::remesh::growable::{Growable, mirror, symmetrise};
use crate::tissue::remesh::lu::{Lu, capacitance};

/// Buffers of an update, named after their contents.
#[derive(Default)]
pub(super) struct Work {
    /// Places of P in S.
    pub places: Vec<usize>,
    /// G[S, P], also for an expected change.
    pub g_sp: Growable,
    /// H = K^-1[P, P].
    pub h: Growable,
    /// D = (I + d H)^-1 d.
    pub d: Growable,
    /// W^T = K^-1[P, c].
    pub w: Growable,
    /// D W^T.
    pub dw: Growable,
    /// -V; before that, C G[S, P], also for an expected change.
    pub v: Growable,
    /// -V D.
    pub vd: Growable,
    /// Whether V D V^T has yet to be added to C.
    pub left: bool,
    /// A few columns.
    pub columns: Growable,
    /// V^T times a few columns.
    pub across: Growable,
    /// D V^T times a few columns.
    pub turned: Growable,
    /// Next C during a recomputation.
    pub next: Growable,
    pub lu: Lu,
}

impl Work {
    pub(super) fn new(size: usize) -> Work {
        let room = size.min(HELD_ROOM);
        let tall = || Growable::with_room(room, CHANGE_ROOM);
        Work {
            g_sp: tall(),
            v: tall(),
            vd: tall(),
            w: Growable::with_room(CHANGE_ROOM, CONTACTS_ROOM),
            dw: Growable::with_room(CHANGE_ROOM, CONTACTS_ROOM),
            next: Growable::with_room(room, room),
            ..Work::default()
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let Work {
            g_sp,
            v,
            vd,
            columns,
            across,
            turned,
            h,
            d,
            w,
            dw,
            next,
            lu,
            places: _,
            left: _,
        } = self;
        let matrices = [g_sp, v, vd, columns, across, turned, h, d, w, dw, next];
        matrices.iter().map(|matrix| matrix.bytes()).sum::<usize>() + lu.bytes()
    }
}

impl Exact {
    /// Updates C and K^c, with the last product of C at once or [later](Self::complete). S must contain the support of
    /// the change; the first `done` columns of C G[S, P] are already computed. Returns the reciprocal condition of I +
    /// d H; as an error where it is too small, which leaves C and K^c unchanged.
    pub(super) fn update(&mut self, change: &Change, done: usize) -> Result<f64, f64> {
        let Exact { support, work, .. } = self;
        let (len, rank) = (support.len(), change.support.len());
        work.places.clear();
        work.places.extend(change.support.iter().map(|dof| support.place(*dof)));
        let mut g_sp = work.g_sp.shape(len, rank);
        for (column, &place) in work.places.iter().enumerate().skip(done) {
            g_sp.rb_mut().col_mut(column).copy_from(support.g.get().col(place));
        }
        let g_sp = g_sp.rb();
        // V and H of the module's equations; columns that a prediction of this move has computed are kept.
        let mut x = work.v.shape(len, rank);
        let to_do = x.rb_mut().subcols_mut(done, rank - done);
        product(
            to_do,
            Accum::Replace,
            support.c.get(),
            g_sp.subcols(done, rank - done),
            1.0,
        );
        let mut h = work.h.shape(rank, rank);
        pick_rows(h.rb_mut(), g_sp, &work.places);
        product(h.rb_mut(), Accum::Add, g_sp.transpose(), x.rb(), -1.0);
        symmetrise(h.rb_mut());
        let mut d = work.d.shape(rank, rank);
        // det K' = det K det(I + d H): this matrix is singular where the stiffness of the changed mesh is.
        let condition = capacitance(&mut work.lu, change.stiffness.as_ref(), h.rb(), d.rb_mut());
        if condition < self.options.reciprocal_limit {
            return Err(condition);
        }
        let d = d.rb();

        // K^c needs W only: it is current before C is, whose last product is the largest and can wait for idle time.
        let b = support.b.get();
        let mut w = work.w.shape(rank, b.ncols());
        pick_rows(w.rb_mut(), b, &work.places);
        product(w.rb_mut(), Accum::Add, x.rb().transpose(), b, -1.0);
        let mut dw = work.dw.shape(rank, b.ncols());
        product(dw.rb_mut(), Accum::Replace, d, w.rb(), 1.0);
        symmetric_product(self.contacts.condensed.get_mut(), w.rb().transpose(), dw.rb(), -1.0);

        // x becomes -V; the sign cancels in V D V^T.
        for (column, &place) in work.places.iter().enumerate() {
            x[(place, column)] -= 1.0;
        }
        work.left = true;
        if !self.options.deferred {
            self.complete();
        }
        Ok(condition)
    }

    /// Adds the pending part of the last update to C.
    pub(super) fn complete(&mut self) {
        if std::mem::take(&mut self.work.left) {
            let Work { v, d, vd, .. } = &mut self.work;
            let v = v.get();
            let mut vd = vd.shape(v.nrows(), v.ncols());
            product(vd.rb_mut(), Accum::Replace, v, d.get(), 1.0);
            symmetric_product(self.support.c.get_mut(), vd.rb(), v.transpose(), 1.0);
        }
    }
}

impl Work {
    /// Computes `out += alpha V D V^T y` where that is not yet in C.
    pub(crate) fn add_left(&mut self, y: MatRef<'_, f64>, out: MatMut<'_, f64>, alpha: f64) {
        if self.left {
            let Work {
                v, d, across, turned, ..
            } = self;
            let mut across = across.shape(v.get().ncols(), y.ncols());
            product(across.rb_mut(), Accum::Replace, v.get().transpose(), y, 1.0);
            let mut turned = turned.shape(across.nrows(), y.ncols());
            product(turned.rb_mut(), Accum::Replace, d.get(), across.rb(), 1.0);
            product(out, Accum::Add, v.get(), turned.rb(), alpha);
        }
    }
}

/// Copies rows of a matrix.
fn pick_rows(mut out: MatMut<'_, f64>, from: MatRef<'_, f64>, indices: &[usize]) {
    for (mut out, from) in out.rb_mut().col_iter_mut().zip(from.col_iter()) {
        for (row, &index) in indices.iter().enumerate() {
            out[row] = from[index];
        }
    }
}

/// Computes `out = alpha A B` or `out += alpha A B` on this thread.
pub(super) fn product(out: MatMut<'_, f64>, accumulate: Accum, a: MatRef<'_, f64>, b: MatRef<'_, f64>, alpha: f64) {
    matmul(out, accumulate, a, b, alpha, Par::Seq);
}

/// Computes `out += alpha A B` where both `out` and the product are symmetric, below the diagonal only, and mirrors it.
pub(super) fn symmetric_product(mut out: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>, alpha: f64) {
    triangular::matmul(
        out.rb_mut(),
        BlockStructure::TriangularLower,
        Accum::Add,
        a,
        BlockStructure::Rectangular,
        b,
        BlockStructure::Rectangular,
        alpha,
        Par::Seq,
    );
    mirror(out);
}
