//! Operations on a dense inverse, independent of its store.

use faer::Mat;

use super::store::{Store, Which};
use crate::tissue::compliance::check_shape;
use crate::tissue::remesh::RemeshError;
use crate::tissue::remesh::adapted::{AdaptedMesh, Change};
use crate::tissue::remesh::defect::{backward_error, defect, largest};
use crate::tissue::remesh::difference::Difference;
use crate::tissue::remesh::growable::symmetrise;
use crate::tissue::remesh::lu::{Lu, capacitance};

pub(super) struct Inverse<S> {
    pub store: S,
    difference: Difference,
    lu: Lu,
    column: Vec<f64>,
}

impl<S> std::fmt::Debug for Inverse<S> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Inverse({} rows)", self.column.len())
    }
}

impl<S: Store> Inverse<S> {
    pub(super) fn new(store: S) -> Self {
        Inverse {
            difference: Difference::default(),
            lu: Lu::default(),
            column: vec![0.0; store.size()],
            store,
        }
    }

    /// Subtracts Y C Y^T from all entries, or from those of some rows and columns. Returns the reciprocal condition of
    /// I + dK G, and the entries at the rows and columns `block`; the condition as an inner error where it is below
    /// `limit`, and then nothing changes.
    pub(super) fn update(
        &mut self,
        change: &Change,
        rows: Option<&[usize]>,
        limit: f64,
        block: &[usize],
    ) -> Result<Result<(f64, Mat<f64>), f64>, RemeshError> {
        let columns: Vec<usize> = change.support.iter().map(|dof| *dof as usize).collect();
        let stiffness = change.stiffness.as_ref();
        if let Some(done) = self.store.apply(&columns, stiffness, limit, rows, block)? {
            return Ok(Ok(done));
        }
        let g = self.store.take(Which::Current, &columns)?;
        let mut c = Mat::zeros(columns.len(), columns.len());
        let condition = capacitance(&mut self.lu, stiffness, g.as_ref(), c.as_mut());
        if condition < limit {
            return Ok(Err(condition));
        }
        let block = self.store.update(c.as_ref(), rows, block)?;
        Ok(Ok((condition, block)))
    }

    /// Rebuilds the inverse of the current mesh from that of the base, with all moves as one change. Results are as for
    /// [`update`](Self::update).
    pub(super) fn rebuild(&mut self, mesh: &AdaptedMesh, limit: f64) -> Result<Result<f64, f64>, RemeshError> {
        mesh.difference_into(&mut self.difference);
        let columns: Vec<usize> = mesh.support().map(|dof| dof as usize).collect();
        let index_of = |dof: u32| columns.partition_point(|column| *column < dof as usize);
        let mut change = Mat::zeros(columns.len(), columns.len());
        for (row, column, value) in self.difference.entries() {
            change[(index_of(row), index_of(column))] = value;
        }
        let mut g = self.store.take(Which::Base, &columns)?;
        symmetrise(g.as_mut());
        let mut c = Mat::zeros(columns.len(), columns.len());
        let condition = capacitance(&mut self.lu, change.as_ref(), g.as_ref(), c.as_mut());
        if condition < limit {
            return Ok(Err(condition));
        }
        self.store.restart(c.as_ref())?;
        Ok(Ok(condition))
    }

    /// Returns the largest |K X e - e| over unit forces e on these degrees of freedom.
    pub(super) fn residual(&mut self, mesh: &AdaptedMesh, dofs: &[usize]) -> Result<f64, RemeshError> {
        mesh.difference_into(&mut self.difference);
        let every: Vec<usize> = (0..self.store.size()).collect();
        let columns = self.store.entries(&every, dofs)?;
        let mut unit = vec![0.0; self.store.size()];
        let mut worst = 0.0f64;
        for (&dof, column) in dofs.iter().zip(columns.col_iter()) {
            self.column
                .iter_mut()
                .zip(column.iter())
                .for_each(|(to, from)| *to = *from);
            unit[dof] = 1.0;
            let residual = largest(&defect(mesh, &self.difference, &self.column, &unit));
            worst = if residual.is_nan() {
                residual
            } else {
                worst.max(residual)
            };
            if worst.is_nan() {
                break;
            }
            unit[dof] = 0.0;
        }
        Ok(worst)
    }

    /// Computes displacements under forces on some degrees of freedom.
    pub(super) fn displacement(
        &mut self,
        contacts: &[usize],
        forces: &[f64],
        out: &mut [f64],
    ) -> Result<(), RemeshError> {
        check_shape("forces", forces.len(), contacts.len())?;
        check_shape("displacements", out.len(), self.store.size())?;
        self.store.combine(contacts, forces, out)
    }

    /// Performs one step of iterative refinement of displacements under forces on some degrees of freedom; returns the
    /// remaining backward error.
    pub(super) fn refine(
        &mut self,
        mesh: &AdaptedMesh,
        contacts: &[usize],
        forces: &[f64],
        out: &mut [f64],
    ) -> Result<f64, RemeshError> {
        let mut full_forces = vec![0.0; out.len()];
        for (&dof, force) in contacts.iter().zip(forces) {
            full_forces[dof] = *force;
        }
        mesh.difference_into(&mut self.difference);
        let residual = defect(mesh, &self.difference, out, &full_forces);
        self.store.multiply(&residual, &mut self.column)?;
        out.iter_mut()
            .zip(&self.column)
            .for_each(|(u, correction)| *u += correction);
        Ok(backward_error(mesh, &self.difference, out, &full_forces))
    }

    /// Size of this many columns, bytes.
    pub(crate) fn columns_bytes(&self, columns: usize) -> usize {
        let entry = match self.store.precision() {
            super::Precision::Single => size_of::<f32>(),
            super::Precision::Double => size_of::<f64>(),
        };
        columns * self.store.size() * entry
    }
}
