//! A dense inverse beside the base that it started from.

use std::sync::Arc;

use faer::{Mat, MatRef};
use rayon::prelude::*;

use crate::mechanics::tissue::compliance::{Compliance, ComplianceError, check_shape};
use crate::mechanics::tissue::remesh::adapted::{AdaptedMesh, Change};
use crate::mechanics::tissue::remesh::defect::{backward_error, defect, largest};
use crate::mechanics::tissue::remesh::difference::Difference;
use crate::mechanics::tissue::remesh::grown::symmetrise;
use crate::mechanics::tissue::remesh::lu::{Lu, capacitance};
use crate::mechanics::tissue::symmetric::{PANEL_ROWS, Scalar, Symmetric};

pub(super) struct Inverse<T> {
    base: Arc<Symmetric<T>>,
    pub current: Symmetric<T>,
    difference: Difference,
    lu: Lu,
    column: Vec<f64>,
}

impl<T> std::fmt::Debug for Inverse<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Inverse({} rows)", self.column.len())
    }
}

impl<T: Scalar> Inverse<T> {
    pub fn new(base: Arc<Symmetric<T>>) -> Self {
        Inverse {
            current: (*base).clone(),
            difference: Difference::default(),
            lu: Lu::default(),
            column: vec![0.0; base.size()],
            base,
        }
    }

    /// Y C Y^T is taken off all entries, or those of some rows and columns. The reciprocal condition of I + dK G; as an inner
    /// error, where it is below `limit`, and then nothing has changed.
    pub fn update(
        &mut self,
        change: &Change,
        rows: Option<&[usize]>,
        limit: f64,
    ) -> Result<Result<f64, f64>, ComplianceError> {
        let columns: Vec<usize> = change.support.iter().map(|dof| *dof as usize).collect();
        let y = read_columns(&self.current, &columns)?;
        let g = Mat::from_fn(columns.len(), columns.len(), |i, j| y[(columns[i], j)].wide());
        let mut c = Mat::zeros(columns.len(), columns.len());
        let condition = capacitance(&mut self.lu, change.stiffness.as_ref(), g.as_ref(), c.as_mut());
        if condition < limit {
            return Ok(Err(condition));
        }
        let c = rounded(c.as_ref());
        match rows {
            None => self.current.rank_update(y.as_ref(), c.as_ref())?,
            Some(rows) => self.current.update_rows(rows, y.as_ref(), c.as_ref())?,
        }
        Ok(Ok(condition))
    }

    /// The inverse of the current mesh from that of the base, all moves taken as one change. Results as for
    /// [`update`](Self::update).
    pub fn rebuild(&mut self, mesh: &AdaptedMesh, limit: f64) -> Result<Result<f64, f64>, ComplianceError> {
        mesh.difference_into(&mut self.difference);
        let columns: Vec<usize> = mesh.support().map(|dof| dof as usize).collect();
        let place = |dof: u32| columns.partition_point(|column| *column < dof as usize);
        let mut change = Mat::zeros(columns.len(), columns.len());
        for (row, column, value) in self.difference.entries() {
            change[(place(row), place(column))] = value;
        }
        let y = read_columns(&self.base, &columns)?;
        let mut g = Mat::from_fn(columns.len(), columns.len(), |i, j| y[(columns[i], j)].wide());
        symmetrise(g.as_mut());
        let mut c = Mat::zeros(columns.len(), columns.len());
        let condition = capacitance(&mut self.lu, change.as_ref(), g.as_ref(), c.as_mut());
        if condition < limit {
            return Ok(Err(condition));
        }
        self.copy_base();
        self.current.rank_update(y.as_ref(), rounded(c.as_ref()).as_ref())?;
        Ok(Ok(condition))
    }

    fn copy_base(&mut self) {
        let panels: Vec<_> = self.base.row_panels().map(|panel| panel.columns).collect();
        self.current
            .row_panels_mut()
            .for_each(|panel| panel.columns.copy_from_slice(panels[panel.first_row / PANEL_ROWS]));
    }

    /// The largest |K X e - e| over unit forces on these degrees of freedom.
    pub fn residual(&mut self, mesh: &AdaptedMesh, dofs: &[usize]) -> f64 {
        mesh.difference_into(&mut self.difference);
        let mut unit = vec![0.0; self.current.size()];
        let mut worst = 0.0f64;
        for &dof in dofs {
            if self.current.copy_column(dof, &mut self.column, T::wide).is_err() {
                return f64::NAN;
            }
            unit[dof] = 1.0;
            let rest = largest(&defect(mesh, &self.difference, &self.column, &unit));
            worst = if rest.is_nan() { rest } else { worst.max(rest) };
            if worst.is_nan() {
                break;
            }
            unit[dof] = 0.0;
        }
        worst
    }

    /// Displacements under forces on some degrees of freedom.
    pub fn displacement(&mut self, contacts: &[usize], forces: &[f64], out: &mut [f64]) -> Result<(), ComplianceError> {
        check_shape("forces", forces.len(), contacts.len())?;
        check_shape("displacements", out.len(), self.current.size())?;
        out.fill(0.0);
        for (&dof, &force) in contacts.iter().zip(forces) {
            self.current.copy_column(dof, &mut self.column, T::wide)?;
            out.iter_mut()
                .zip(&self.column)
                .for_each(|(u, column)| *u += force * column);
        }
        Ok(())
    }

    /// One step of iterative refinement of displacements under forces on some degrees of freedom; the backward error left.
    pub fn refine(
        &mut self,
        mesh: &AdaptedMesh,
        contacts: &[usize],
        forces: &[f64],
        out: &mut [f64],
    ) -> Result<f64, ComplianceError> {
        let mut all = vec![0.0; out.len()];
        for (&dof, force) in contacts.iter().zip(forces) {
            all[dof] = *force;
        }
        mesh.difference_into(&mut self.difference);
        let rest = defect(mesh, &self.difference, out, &all);
        self.current.multiply_into(&rest, &mut self.column)?;
        out.iter_mut()
            .zip(&self.column)
            .for_each(|(u, correction)| *u += correction);
        Ok(backward_error(mesh, &self.difference, out, &all))
    }

    pub fn bytes(&self) -> usize {
        self.base.bytes() + self.current.bytes()
    }

    /// Bytes of this many columns.
    pub fn columns_bytes(&self, columns: usize) -> usize {
        columns * self.current.size() * size_of::<T>()
    }
}

/// Columns of a symmetric matrix.
fn read_columns<T: Scalar>(matrix: &Symmetric<T>, columns: &[usize]) -> Result<Mat<T>, ComplianceError> {
    let mut y = Mat::<T>::zeros(matrix.size(), columns.len());
    let read = y
        .par_col_iter_mut()
        .zip(columns)
        .map(|(out, &column)| match out.try_as_col_major_mut() {
            Some(out) => matrix.column_into(column, out.as_slice_mut()),
            None => Ok(()),
        });
    read.collect::<Result<(), _>>()?;
    Ok(y)
}

/// A matrix rounded to the precision of the inverse.
fn rounded<T: Scalar>(matrix: MatRef<'_, f64>) -> Mat<T> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| T::of(matrix[(i, j)]))
}
