//! Error monitoring of the updated C and K^c, with recomputation where needed.

use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, MatMut, MatRef};

use super::Exact;
use super::update::product;
use crate::tissue::remesh::adapted::AdaptedMesh;
use crate::tissue::remesh::{Rebuilt, RemeshReport, SampleSchedule};
use insonify_base::random::{hash3, seed_words};

/// Amplified rounding of a change above which a sample is taken at once: a tenth of the accuracy promised for K^c.
const AMPLIFIED: f64 = 1e-11;

impl Exact {
    /// Samples the errors if due, or defers that.
    pub(super) fn maintain(&mut self, mesh: &AdaptedMesh, report: &mut RemeshReport) {
        let every = self.options.check_every;
        // A change and its reversal multiply rounding by the square of their condition.
        let amplified = f64::EPSILON / (report.reciprocal_condition * report.reciprocal_condition);
        let is_doubtful = every > 0 && amplified > AMPLIFIED;
        let is_due = self.sample_schedule.is_due(every);
        // Deferred to a less busy step, which never came.
        let is_overdue = self.is_due;
        if is_doubtful || is_overdue || is_due && !self.options.deferred {
            self.sample(mesh, report);
        } else {
            self.is_due = is_due;
        }
    }

    /// Samples the errors, and recomputes C and K^c where they are too large. If that fails, the updated C stays.
    pub(super) fn sample(&mut self, mesh: &AdaptedMesh, report: &mut RemeshReport) {
        self.is_due = false;
        self.complete();
        mesh.difference_into(&mut self.difference);
        let [residual, backward] = self.correction_error();
        report.residual = Some(residual);
        // NaN fails both comparisons.
        let tolerance = self.options.exact_tolerance;
        if backward <= tolerance && self.contacts_error() <= tolerance {
            self.sample_schedule.relax(self.options.check_every);
            return;
        }
        self.sample_schedule = SampleSchedule::new();
        match self.recompute() {
            Ok(condition) => {
                self.rebuilds += 1;
                report.rebuilt = Some(Rebuilt::Residual(residual));
                report.reciprocal_condition = report.reciprocal_condition.min(condition);
            }
            Err(_) => report.rebuild_failed = true,
        }
    }

    /// Returns the largest entry of K K^-1 e - e for random forces e of 1 or -1 N on all of S, with K^-1 as corrected
    /// by C and `self.difference` that of the mesh; and the same relative to the magnitude of its terms. If the base
    /// inverse is exact, it is `dK x - y` on S and zero elsewhere, where y = C G e and x = G e - G y. Costs O(|S|^2).
    fn correction_error(&mut self) -> [f64; 2] {
        let Exact {
            support,
            work,
            difference,
            ..
        } = self;
        let (g, c) = (support.g.get(), support.c.get());
        let mut columns = work.columns.shape(support.len(), 4);
        let (mut e, products) = columns.rb_mut().split_at_col_mut(1);
        let (mut ge, products) = products.split_at_col_mut(1);
        let (mut y, mut gy) = products.split_at_col_mut(1);
        // One vector of random signs: it costs products with vectors, where the norm of the whole defect would cost one
        // of matrices.
        fill_with_signs(e.rb_mut(), self.step);
        product(ge.rb_mut(), Accum::Replace, g, e.rb(), 1.0);
        product(y.rb_mut(), Accum::Replace, c, ge.rb(), 1.0);
        product(gy.rb_mut(), Accum::Replace, g, y.rb(), 1.0);
        let mut defect = e;
        defect.copy_from(y.rb());
        for (row, column, value) in difference.entries() {
            let place = support.place(column);
            defect[(support.place(row), 0)] -= value * (ge[(place, 0)] - gy[(place, 0)]);
        }
        let residual = largest(defect.rb());
        // Relative to the terms, whose rounding is unavoidable, not to their sum.
        let size = difference.norm_inf() * (largest(ge.rb()) + largest(gy.rb())) + largest(y.rb());
        [residual, relative(residual, size)]
    }

    /// Returns the relative error of K^c e against K0^-1[c, c] e - B^T C B e for random signs e. Costs O(|S|^2).
    fn contacts_error(&mut self) -> f64 {
        let Exact {
            support,
            contacts,
            work,
            ..
        } = self;
        let (b, c) = (support.b.get(), support.c.get());
        let mut columns = work.columns.shape(support.len(), 2);
        let (mut be, mut y) = columns.rb_mut().split_at_col_mut(1);
        let mut columns_of_contacts = work.w.shape(contacts.dofs().len(), 3);
        let (mut e, products) = columns_of_contacts.rb_mut().split_at_col_mut(1);
        let (mut bare, mut now) = products.split_at_col_mut(1);
        fill_with_signs(e.rb_mut(), self.step);
        product(be.rb_mut(), Accum::Replace, b, e.rb(), 1.0);
        product(y.rb_mut(), Accum::Replace, c, be.rb(), 1.0);
        product(bare.rb_mut(), Accum::Replace, contacts.bare(), e.rb(), 1.0);
        product(now.rb_mut(), Accum::Replace, contacts.condensed.get(), e.rb(), 1.0);
        let size = largest(bare.rb()) + largest(now.rb());
        product(bare.rb_mut(), Accum::Add, b.transpose(), y.rb(), -1.0);
        now -= bare;
        relative(largest(now.rb()), size)
    }
}

/// Fills a column with random values 1 and -1.
fn fill_with_signs(column: MatMut<'_, f64>, step: u64) {
    for (i, sign) in column.col_mut(0).iter_mut().enumerate() {
        let bit = hash3([step as i32, i as i32, 0], seed_words(0))[0] & 1;
        *sign = if bit == 0 { 1.0 } else { -1.0 };
    }
}

fn relative(error: f64, size: f64) -> f64 {
    if error == 0.0 { 0.0 } else { error / size }
}

/// Returns the largest magnitude in a column; NaN if an entry is NaN.
fn largest(column: MatRef<'_, f64>) -> f64 {
    let magnitudes = column.col(0).iter().map(|value| value.abs());
    magnitudes.fold(0.0, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}
