//! Computation of C and K^c from scratch.

use faer::Accum;
use faer::prelude::{Reborrow, ReborrowMut};

use super::Exact;
use super::update::{product, symmetric_product};
use crate::tissue::remesh::SampleSchedule;
use crate::tissue::remesh::growable::symmetrise;
use insonify_base::simd::{Kernel, vectorised};

impl Exact {
    /// Computes C and K^c by one LU factorisation from the base and `self.difference`, whose degrees of freedom all lie
    /// in S. Returns the reciprocal condition of I + dK G; as an error where it is too small, which leaves C and K^c
    /// unchanged.
    pub(super) fn recompute(&mut self) -> Result<f64, f64> {
        let Exact {
            support,
            work,
            difference,
            ..
        } = self;
        let len = support.len();
        let g = support.g.get();
        let mut matrix = work.lu.space(len);
        matrix.fill(0.0);
        let mut next = work.next.shape(len, len);
        next.fill(0.0);
        // Columns of I + G dK, the transpose of I + dK G.
        for (row, column, value) in difference.entries() {
            let (row, column) = (support.place(row), support.place(column));
            next[(row, column)] = value;
            let (Some(sums), Some(values)) = (
                matrix.rb_mut().col_mut(row).try_as_col_major_mut(),
                g.col(column).try_as_col_major(),
            ) else {
                continue;
            };
            vectorised(AddScaled {
                sums: sums.as_slice_mut(),
                values: values.as_slice(),
                factor: value,
            });
        }
        for i in 0..len {
            matrix[(i, i)] += 1.0;
        }
        let condition = work.lu.factor();
        if condition < self.options.reciprocal_limit {
            return Err(condition);
        }
        work.lu.solve_transpose(next.rb_mut());
        symmetrise(next.rb_mut());
        std::mem::swap(&mut support.c, &mut work.next);
        (self.sample_schedule, self.is_due, self.work.left) = (SampleSchedule::new(), false, false);
        self.speculation.begin_columns();

        self.contacts.forget_correction();
        let b = self.support.b.get();
        let mut cb = self.work.columns.shape(len, b.ncols());
        product(cb.rb_mut(), Accum::Replace, self.support.c.get(), b, 1.0);
        symmetric_product(self.contacts.condensed.get_mut(), b.transpose(), cb.rb(), -1.0);
        Ok(condition)
    }
}

/// Computes sums += factor values.
struct AddScaled<'a> {
    sums: &'a mut [f64],
    values: &'a [f64],
    factor: f64,
}

impl Kernel for AddScaled<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (sum, value) in self.sums.iter_mut().zip(self.values) {
            *sum += self.factor * value;
        }
    }
}
