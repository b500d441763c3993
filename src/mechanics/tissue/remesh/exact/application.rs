//! Corrected compliance beyond the contacts: other entries, and displacements of the entire mesh.

use crate::tissue::error::LinearError;
use faer::prelude::{Reborrow, ReborrowMut};
use faer::{Accum, Mat, MatMut, MatRef};

use super::Exact;
use super::update::product;
use crate::tissue::compliance::check_shape;
use crate::tissue::remesh::adapted::AdaptedMesh;
use crate::tissue::remesh::defect::{backward_error, defect};

impl Exact {
    /// Computes the forces on the base mesh (N, one per free degree of freedom) that displace it as `forces` on the
    /// contacts displace the current one: those on the contacts, and corrections for moved nodes on S. Multiplied by
    /// K0^-1, for instance on another thread, they give the displacements of the entire mesh.
    ///
    /// # Errors
    /// [`LinearError::Shape`] where a slice has the wrong length.
    pub(crate) fn base_forces(&mut self, forces: &[f64], out: &mut [f64]) -> Result<(), LinearError> {
        check_shape("forces on the base", out.len(), self.source.size())?;
        out.fill(0.0);
        let mut carried = Vec::new();
        self.carried(forces, &mut carried)?;
        carried.iter().for_each(|(dof, force)| out[*dof] += force);
        Ok(())
    }

    /// Computes [`base_forces`](Self::base_forces) as a list: the contacts, then S.
    pub(super) fn carried(&mut self, forces: &[f64], out: &mut Vec<(usize, f64)>) -> Result<(), LinearError> {
        check_shape("forces", forces.len(), self.contacts.dofs().len())?;
        let Exact {
            support,
            contacts,
            work,
            ..
        } = self;
        let forces = MatRef::from_column_major_slice(forces, forces.len(), 1);
        let mut columns = std::mem::take(&mut work.columns);
        let (mut across, mut corrected) = columns.shape(support.len(), 2).split_at_col_mut(1);
        product(across.rb_mut(), Accum::Replace, support.b.get(), forces, 1.0);
        product(corrected.rb_mut(), Accum::Replace, support.c.get(), across.rb(), -1.0);
        work.add_left(across.rb(), corrected.rb_mut(), -1.0);
        out.clear();
        out.extend(contacts.dofs().iter().copied().zip(forces.col(0).iter().copied()));
        out.extend(
            support
                .dofs()
                .iter()
                .copied()
                .zip(corrected.rb().col(0).iter().copied()),
        );
        work.columns = columns;
        Ok(())
    }

    /// Computes out -= E_S C x.
    fn subtract_correction(&self, x: MatRef<'_, f64>, out: &mut [f64]) {
        let mut corrected = Mat::zeros(self.support.len(), 1);
        product(corrected.as_mut(), Accum::Replace, self.support.c.get(), x, 1.0);
        for (&dof, force) in self.support.dofs().iter().zip(corrected.col(0).iter()) {
            out[dof] -= force;
        }
    }

    /// Computes a block of the compliance of the current mesh.
    pub(super) fn block(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, LinearError> {
        self.complete();
        let mut block = self.source.entries(rows, columns)?;
        // S before the rows: a source that solves for columns has those of S cached.
        let left = self.source.entries(rows, self.support.dofs())?;
        let right = self.source.entries(columns, self.support.dofs())?;
        let mut corrected = Mat::zeros(self.support.len(), columns.len());
        product(
            corrected.as_mut(),
            Accum::Replace,
            self.support.c.get(),
            right.transpose(),
            1.0,
        );
        product(block.as_mut(), Accum::Add, left.as_ref(), corrected.as_ref(), -1.0);
        Ok(block)
    }

    pub(super) fn full_displacement(&mut self, forces: &[f64], out: &mut [f64]) -> Result<(), LinearError> {
        check_shape("displacements", out.len(), self.source.size())?;
        let mut base = vec![0.0; out.len()];
        self.base_forces(forces, &mut base)?;
        self.source.multiply_into(&base, out)
    }

    pub(super) fn full_displacement_refined(
        &mut self,
        mesh: &AdaptedMesh,
        forces: &[f64],
        out: &mut [f64],
    ) -> Result<f64, LinearError> {
        self.full_displacement(forces, out)?;
        let mut full_forces = vec![0.0; out.len()];
        for (&dof, force) in self.contacts.dofs().iter().zip(forces) {
            full_forces[dof] = *force;
        }
        mesh.difference_into(&mut self.difference);
        let mut residual = defect(mesh, &self.difference, out, &full_forces);
        let mut correction = vec![0.0; out.len()];
        self.apply(&mut residual, &mut correction)?;
        out.iter_mut()
            .zip(&correction)
            .for_each(|(u, correction)| *u += correction);
        Ok(backward_error(mesh, &self.difference, out, &full_forces))
    }

    /// Computes out = K^-1 x for any forces x, which are overwritten.
    fn apply(&mut self, x: &mut [f64], out: &mut [f64]) -> Result<(), LinearError> {
        self.complete();
        self.source.multiply_into(x, out)?;
        let across: Vec<f64> = self.support.dofs().iter().map(|dof| out[*dof]).collect();
        self.subtract_correction(MatRef::from_column_major_slice(&across, across.len(), 1), x);
        self.source.multiply_into(x, out)
    }

    /// Returns the largest residual of the columns `dofs` of the compliance of the current mesh.
    pub(super) fn true_residual(&mut self, mesh: &AdaptedMesh, dofs: &[usize]) -> Result<f64, LinearError> {
        self.complete();
        mesh.difference_into(&mut self.difference);
        let size = self.source.size();
        let (mut unit, mut base, mut column) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
        let mut worst = 0.0f64;
        for &dof in dofs {
            unit[dof] = 1.0;
            base.copy_from_slice(&unit);
            let mut across = vec![0.0; self.support.len()];
            let rows = MatMut::from_column_major_slice_mut(&mut across, self.support.len(), 1);
            self.source.entries_into(self.support.dofs(), &[dof], rows)?;
            self.subtract_correction(MatRef::from_column_major_slice(&across, across.len(), 1), &mut base);
            self.source.multiply_into(&base, &mut column)?;
            let residual = defect(mesh, &self.difference, &column, &unit);
            worst = residual
                .iter()
                .fold(worst, |a, r| if r.is_nan() { f64::INFINITY } else { a.max(r.abs()) });
            unit[dof] = 0.0;
        }
        Ok(worst)
    }
}
