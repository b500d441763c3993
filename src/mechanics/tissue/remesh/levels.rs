//! Levels I to IV: full or partial updates of the dense inverse (Goksel et al. 2011, section V-B).
//!
//! With P the degrees of freedom around the moved node, dK the change of the stiffness there, Y = K^-1[:, P] and G =
//! Y[P, :], the matrix inversion lemma gives `K'^-1 = K^-1 - Y C Y^T` with `C = (I + dK G)^-1 dK`. dK comes from the
//! true geometry, G and Y from the current inverse. C is computed in f64 regardless of the precision of the inverse.
//!
//! | level | entries updated | resulting K^c |
//! |---|---|---|
//! | I | all | that of the current mesh, up to accumulated rounding |
//! | II | rows and columns in P | correct, if Y was, where a contact was moved or is a neighbour; old elsewhere |
//! | III | rows and columns of the node | correct, if Y was, where the node itself is a contact; old elsewhere |
//! | IV | none | that of the last current state: the node counts as if at its old place |
//!
//! After level I, an inverse updated at level II or III is correct in the updated rows: exactly after one change, and
//! up to the influence of the entries not updated after more. It may lose definiteness, so K^c is checked by a Cholesky
//! factorisation after each such change, and the inverse is rebuilt where that fails. A rebuild applies all moves since
//! the base as one change, at level I.
//!
//! Rounding accumulates at level I, slowly in f64 and fast in f32, and faster near incompressibility. The residual of
//! sampled columns against the true stiffness is monitored, and the inverse rebuilt before it exceeds a limit. Samples
//! become more frequent near the limit and for ill-conditioned changes.

mod error_monitor;
mod inverse;
mod store;

pub use store::{Host, Store, Which};

use std::sync::Arc;

use faer::{Mat, MatMut, MatRef};

use super::adapted::{AdaptedMesh, Change};
use super::make::Entry;
use super::{
    Level, Precision, Rebuilt, RemeshError, RemeshReport, Remesher, RemesherOptions, SampleSchedule, check_step,
};
use crate::tissue::compliance::{check_distinct, check_dofs, check_shape};
use crate::tissue::dofs::NO_DOF;
use crate::tissue::symmetric::Symmetric;
use error_monitor::suits;
use inverse::Inverse;

/// Remesher of the levels I to IV with a dense inverse in CPU memory. It runs on the current pool; the result
/// does not depend on the number of threads.
pub type Levels<T> = DenseInverseRemesher<Host<T>>;

/// Remesher of the levels I to IV with a dense inverse in a [`Store`].
#[derive(Debug)]
pub struct DenseInverseRemesher<S> {
    inverse: Inverse<S>,
    level: Level,
    options: RemesherOptions,
    contacts: Vec<usize>,
    condensed: Mat<f64>,
    step: u64,
    /// Whether changes since the last rebuild left entries as they were.
    stale: bool,
    rebuilds: u64,
    sample_schedule: SampleSchedule,
}

impl<T: Entry> Levels<T> {
    /// Creates a remesher at `level`, I to IV, from the current state of `mesh`. `base` is the inverse of its base,
    /// which is not modified.
    ///
    /// # Errors
    /// [`RemeshError`] where the inverse does not match the mesh, the level is none of these, the precision does not
    /// suffice for the materials, or the mesh is too far from its base.
    pub fn new(
        mesh: &AdaptedMesh,
        base: Arc<Symmetric<T>>,
        level: Level,
        options: RemesherOptions,
    ) -> Result<Levels<T>, RemeshError> {
        DenseInverseRemesher::start(mesh, Host::new(base), level, options)
    }

    /// Current inverse.
    #[cfg(test)]
    pub fn inverse(&self) -> &Symmetric<T> {
        &self.inverse.store.current
    }
}

impl<S: Store> DenseInverseRemesher<S> {
    /// Creates a remesher at `level`, I to IV, from the current state of `mesh`. `store` must contain the unmodified
    /// inverse of its base.
    ///
    /// # Errors
    /// [`RemeshError`] as of [`Levels::new`].
    pub fn start(mesh: &AdaptedMesh, store: S, level: Level, options: RemesherOptions) -> Result<Self, RemeshError> {
        if level == Level::Exact {
            return Err(RemeshError::Level {
                asked: level,
                offered: Level::I,
            });
        }
        check_shape("rows of the inverse", store.size(), mesh.dofs().free())?;
        suits(mesh, level, store.precision(), &options)?;
        let mut levels = DenseInverseRemesher {
            inverse: Inverse::new(store),
            level,
            options,
            contacts: Vec::new(),
            condensed: Mat::new(),
            step: mesh.step(),
            stale: false,
            rebuilds: 0,
            sample_schedule: SampleSchedule::new(),
        };
        if !mesh.away().is_empty() {
            levels.refresh(mesh)?;
            levels.rebuilds = 0;
        }
        Ok(levels)
    }

    /// Store of the inverse.
    pub fn store(&mut self) -> &mut S {
        &mut self.inverse.store
    }

    /// Number of rebuilds of the inverse from the base.
    #[cfg(test)]
    pub fn rebuilds(&self) -> u64 {
        self.rebuilds
    }

    fn read_condensed(&mut self) -> Result<(), RemeshError> {
        self.condensed = self.inverse.store.entries(&self.contacts, &self.contacts)?;
        Ok(())
    }
}

/// Rows and columns that a level updates; `None` for all.
fn rows_of(level: Level, mesh: &AdaptedMesh, change: &Change) -> Option<Vec<usize>> {
    match level {
        Level::II => Some(change.support.iter().map(|dof| *dof as usize).collect()),
        Level::III => {
            let free_dofs = mesh.dofs().of(change.node).into_iter().filter(|dof| *dof != NO_DOF);
            Some(free_dofs.map(|dof| dof as usize).collect())
        }
        Level::I | Level::IV | Level::Exact => None,
    }
}

impl<S: Store> Remesher for DenseInverseRemesher<S> {
    fn level(&self) -> Level {
        self.level
    }

    fn set_level(&mut self, mesh: &AdaptedMesh, level: Level) -> Result<Option<RemeshReport>, RemeshError> {
        if level == Level::Exact {
            return Err(RemeshError::Level {
                asked: level,
                offered: self.level,
            });
        }
        suits(mesh, level, self.precision(), &self.options)?;
        let before = std::mem::replace(&mut self.level, level);
        if level >= before || !self.stale {
            return Ok(None);
        }
        match self.refresh(mesh) {
            Ok(report) => Ok(Some(RemeshReport {
                rebuilt: Some(Rebuilt::Switched),
                ..report
            })),
            Err(error) => {
                self.level = before;
                Err(error)
            }
        }
    }

    fn precision(&self) -> Precision {
        self.inverse.store.precision()
    }

    fn remesh(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<RemeshReport, RemeshError> {
        check_step(self.step, mesh, change)?;
        let rank = change.support.len();
        let (condition, bytes_moved) = match self.level {
            // The inverse stays as it is: nothing is factored that could be singular.
            Level::IV => (1.0, 0),
            level => {
                let limit = self.options.reciprocal_limit;
                let rows = rows_of(level, mesh, change);
                let done = self.inverse.update(change, rows.as_deref(), limit, &self.contacts)?;
                let (condition, condensed) = done.map_err(|reciprocal_condition| RemeshError::Singular {
                    node: change.node,
                    reciprocal_condition,
                    limit,
                })?;
                self.condensed = condensed;
                let touched = match rows {
                    None => self.inverse.store.bytes(),
                    Some(rows) => self.inverse.columns_bytes(rows.len()),
                };
                // What is updated is read and written, columns of the inverse are read besides.
                (condition, 2 * touched + self.inverse.columns_bytes(rank))
            }
        };
        self.step += 1;
        // The other levels leave entries of the inverse as they were, which only a rebuild can mend.
        self.stale |= self.level != Level::I;
        let mut report = RemeshReport {
            level: self.level,
            rank,
            support_size: 0,
            reciprocal_condition: condition,
            residual: None,
            rebuilt: None,
            rebuild_failed: false,
            bytes_moved,
        };
        if let Some(reason) = self.due(mesh, change, &mut report)? {
            match self.refresh(mesh) {
                Ok(rebuilt) => {
                    report.rebuilt = Some(reason);
                    report.bytes_moved += rebuilt.bytes_moved;
                    // A rebuild is one large update from the base, which may itself lose too much: measured
                    // again.
                    if matches!(reason, Rebuilt::Residual(_)) {
                        report.rebuild_failed = self.is_lost(mesh, change, &mut report).unwrap_or(true);
                    }
                }
                Err(_) => report.rebuild_failed = true,
            }
        }
        Ok(report)
    }

    fn refresh(&mut self, mesh: &AdaptedMesh) -> Result<RemeshReport, RemeshError> {
        let condition = self.rebuild(mesh)?;
        self.step = mesh.step();
        self.stale = false;
        self.rebuilds += 1;
        self.read_condensed()?;
        Ok(self.rebuilt(mesh, condition, Rebuilt::Requested))
    }

    fn residual(&mut self, mesh: &AdaptedMesh, dofs: &[usize]) -> Result<f64, RemeshError> {
        check_dofs(dofs, self.inverse.store.size())?;
        self.inverse.residual(mesh, dofs)
    }

    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), RemeshError> {
        check_dofs(dofs, self.inverse.store.size())?;
        check_distinct(dofs)?;
        self.contacts = dofs.to_vec();
        self.read_condensed()
    }

    fn contacts(&self) -> &[usize] {
        &self.contacts
    }

    fn condensed(&self) -> MatRef<'_, f64> {
        self.condensed.as_ref()
    }

    fn compliance(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        check_dofs(rows, self.inverse.store.size())?;
        check_dofs(columns, self.inverse.store.size())?;
        self.inverse.store.entries(rows, columns)
    }

    fn displacement(&mut self, forces: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        self.inverse.displacement(&self.contacts, forces, out)
    }

    fn displacement_refined(
        &mut self,
        mesh: &AdaptedMesh,
        forces: &[f64],
        out: &mut [f64],
    ) -> Result<f64, RemeshError> {
        self.displacement(forces, out)?;
        self.inverse.refine(mesh, &self.contacts, forces, out)
    }

    fn equivalent_forces(&mut self, forces: &[f64], out: &mut Vec<(usize, f64)>) -> Result<(), RemeshError> {
        check_shape("forces", forces.len(), self.contacts.len())?;
        out.clear();
        out.extend(self.contacts.iter().copied().zip(forces.iter().copied()));
        Ok(())
    }

    fn force_compliance_into(
        &mut self,
        rows: &[usize],
        columns: &[usize],
        mut out: MatMut<'_, f64>,
    ) -> Result<(), RemeshError> {
        out.copy_from(&self.compliance(rows, columns)?);
        Ok(())
    }

    fn uses_base_compliance(&self) -> bool {
        false
    }

    fn prefetch(&mut self, dofs: &[usize]) -> Result<(), RemeshError> {
        check_dofs(dofs, self.inverse.store.size()).map_err(RemeshError::from)
    }

    fn memory(&self) -> usize {
        self.inverse.store.memory()
    }
}

impl<S: Store> DenseInverseRemesher<S> {
    /// Rebuilds the inverse; returns the reciprocal condition of I + dK G.
    fn rebuild(&mut self, mesh: &AdaptedMesh) -> Result<f64, RemeshError> {
        let limit = self.options.reciprocal_limit;
        let condition = self.inverse.rebuild(mesh, limit)?;
        condition.map_err(|reciprocal_condition| RemeshError::FarFromBase {
            reciprocal_condition,
            limit,
        })
    }

    /// Returns the report of a rebuild.
    fn rebuilt(&self, mesh: &AdaptedMesh, condition: f64, reason: Rebuilt) -> RemeshReport {
        let rank = mesh.support().count();
        RemeshReport {
            level: self.level,
            rank,
            support_size: 0,
            reciprocal_condition: condition,
            residual: None,
            rebuilt: Some(reason),
            rebuild_failed: false,
            bytes_moved: 3 * self.inverse.store.bytes() + self.inverse.columns_bytes(rank),
        }
    }
}

#[cfg(test)]
mod tests;
