//! Columns of K^-1 on demand: solved from the sparse factor on first use and cached.
//!
//! Start-up then costs a factorisation instead of a dense inverse, and memory one column per degree of freedom ever
//! touched. Columns prefetched along a needle's predicted path are solved together, which is several times faster than
//! one by one.

use crate::tissue::error::LinearError;
use std::collections::HashSet;
use std::sync::Arc;

use faer::{Mat, MatMut};

use super::compliance::{Compliance, check_dofs, check_shape};
use super::factor::Factor;

/// Most right-hand sides solved together; more gain little and need their memory twice over.
const BLOCK: usize = 60;

/// Least-recently-used cache of columns of K^-1, solved from its factor.
///
/// The last bits of a column may depend on how many were solved together with it, hence on earlier requests; the same
/// sequence of requests gives the same bits.
#[derive(Clone, Debug)]
pub struct Columns {
    factor: Arc<Factor>,
    capacity: usize,
    /// Cached columns by degree of freedom.
    columns: Vec<Option<Column>>,
    kept: usize,
    /// Use counter.
    clock: u64,
    solved: usize,
}

#[derive(Clone, Debug)]
struct Column {
    values: Vec<f64>,
    last_used: u64,
}

impl Columns {
    /// Creates an empty cache of at most `capacity` (at least 1) columns of 8 bytes per degree of freedom.
    pub fn new(factor: Arc<Factor>, capacity: usize) -> Self {
        Self {
            columns: vec![None; factor.size()],
            factor,
            capacity: capacity.max(1),
            kept: 0,
            clock: 0,
            solved: 0,
        }
    }

    /// Replaces the factor, possibly by one of another size, and drops all columns.
    pub fn replace(&mut self, factor: Arc<Factor>) {
        self.columns = vec![None; factor.size()];
        self.kept = 0;
        self.factor = factor;
    }

    /// Factor that columns are solved from.
    pub fn factor(&self) -> &Arc<Factor> {
        &self.factor
    }

    /// Number of columns currently cached.
    pub fn len(&self) -> usize {
        self.kept
    }

    /// Whether no column is cached.
    pub fn is_empty(&self) -> bool {
        self.kept == 0
    }

    /// Largest number of columns cached.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Whether column `dof` is cached.
    pub fn holds(&self, dof: usize) -> bool {
        matches!(self.columns.get(dof), Some(Some(_)))
    }

    /// Number of columns solved so far, including those dropped since.
    pub fn solved(&self) -> usize {
        self.solved
    }

    /// Returns column `dof` (mm/N), solving for it if it is not cached.
    ///
    /// # Errors
    /// [`LinearError`] when `dof` is out of range or the column is not finite.
    pub fn column(&mut self, dof: usize) -> Result<&[f64], LinearError> {
        check_dofs(&[dof], self.factor.size())?;
        self.fetch(&[dof])?;
        match &self.columns[dof] {
            Some(column) => Ok(&column.values),
            None => unreachable!("a column just fetched"),
        }
    }

    /// Ensures that these distinct columns, at most the capacity, are cached.
    fn fetch(&mut self, dofs: &[usize]) -> Result<(), LinearError> {
        self.clock += 1;
        let mut missing = Vec::new();
        for &dof in dofs {
            match &mut self.columns[dof] {
                Some(column) => column.last_used = self.clock,
                None => missing.push(dof),
            }
        }
        self.make_room(missing.len());
        let size = self.factor.size();
        // By blocks: a factor is read from memory once for all right-hand sides of a solve.
        for block in missing.chunks(BLOCK) {
            let mut solutions = Mat::<f64>::zeros(size, block.len());
            for (k, &dof) in block.iter().enumerate() {
                solutions[(dof, k)] = 1.0;
            }
            self.factor.solve_many_in_place(solutions.as_mut());
            self.solved += block.len();
            for (&dof, column) in block.iter().zip(solutions.col_iter()) {
                let values: Vec<f64> = column.iter().copied().collect();
                if !values.iter().all(|value| value.is_finite()) {
                    return Err(LinearError::Column { dof });
                }
                let last_used = self.clock;
                self.columns[dof] = Some(Column { values, last_used });
                self.kept += 1;
            }
        }
        Ok(())
    }

    /// Drops the least recently used columns until `coming` more fit; among those used together, the highest first.
    fn make_room(&mut self, coming: usize) {
        let excess = (self.kept + coming).saturating_sub(self.capacity);
        if excess == 0 {
            return;
        }
        let kept = self.columns.iter().enumerate();
        let mut oldest: Vec<_> = kept
            .filter_map(|(dof, column)| Some((column.as_ref()?.last_used, dof)))
            .collect();
        oldest.sort_unstable_by_key(|&(used, dof)| (used, std::cmp::Reverse(dof)));
        for (_, dof) in oldest.into_iter().take(excess) {
            self.columns[dof] = None;
            self.kept -= 1;
        }
    }

    /// Number of these columns that are not cached.
    fn missing(&self, dofs: &[usize]) -> usize {
        dofs.iter().filter(|dof| !self.holds(**dof)).count()
    }
}

/// Returns each index once, in order of first occurrence.
fn distinct(dofs: &[usize]) -> Vec<usize> {
    let mut seen = HashSet::new();
    dofs.iter().copied().filter(|&dof| seen.insert(dof)).collect()
}

impl Compliance for Columns {
    fn size(&self) -> usize {
        self.factor.size()
    }

    fn column_into(&mut self, dof: usize, out: &mut [f64]) -> Result<(), LinearError> {
        check_shape("rows of the column", out.len(), self.size())?;
        out.copy_from_slice(self.column(dof)?);
        Ok(())
    }

    /// Solves for rows or columns, whichever has fewer missing (K^-1 is symmetric). On a tie, uses the smaller list, as
    /// each vector lies elsewhere in memory.
    fn entries_into(&mut self, rows: &[usize], columns: &[usize], mut out: MatMut<'_, f64>) -> Result<(), LinearError> {
        check_dofs(rows, self.size())?;
        check_dofs(columns, self.size())?;
        check_shape("rows of the block", out.nrows(), rows.len())?;
        check_shape("columns of the block", out.ncols(), columns.len())?;
        let by_rows = (self.missing(rows), rows.len()) < (self.missing(columns), columns.len());
        let (sides, others) = if by_rows { (rows, columns) } else { (columns, rows) };
        for batch in distinct(sides).chunks(self.capacity) {
            self.fetch(batch)?;
            for (j, side) in sides.iter().enumerate() {
                let Some(column) = &self.columns[*side] else {
                    continue;
                };
                for (i, &row) in others.iter().enumerate() {
                    let entry = if by_rows { (j, i) } else { (i, j) };
                    out[entry] = column.values[row];
                }
            }
        }
        Ok(())
    }

    /// Solves the missing columns together. Beyond the capacity, only the first are prefetched.
    fn prefetch(&mut self, dofs: &[usize]) -> Result<(), LinearError> {
        check_dofs(dofs, self.size())?;
        let mut wanted = distinct(dofs);
        wanted.truncate(self.capacity);
        self.fetch(&wanted)
    }

    /// Performs one solve, regardless of the cache.
    fn multiply_into(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), LinearError> {
        check_shape("forces", x.len(), self.size())?;
        check_shape("displacements", out.len(), self.size())?;
        out.copy_from_slice(x);
        self.factor.solve_in_place(out);
        Ok(())
    }

    /// Size of the cached columns and the factor.
    fn bytes(&self) -> usize {
        (self.kept * self.factor.size() + self.factor.entries()) * size_of::<f64>()
    }
}

#[cfg(test)]
mod tests;
