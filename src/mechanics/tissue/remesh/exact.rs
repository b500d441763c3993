//! Exact condensed remeshing: exact compliance at the contacts from an unmodified base inverse.
//!
//! Let S be the degrees of freedom around all nodes away from their base, dK the change of the stiffness on S since the
//! base, computed from scratch, and G = K0^-1[S, S]. The matrix inversion lemma gives
//!
//! ```text
//! K^-1[a, b] = K0^-1[a, b] - K0^-1[a, S] C K0^-1[S, b],    C = (I + dK G)^-1 dK     (symmetric)
//! ```
//!
//! for any rows a and columns b. A move changes only C, which can be updated: a change d on the degrees of freedom P
//! gives
//!
//! ```text
//! C' = C + V D V^T,    V = E_P - C G[S, P],    D = (I + d H)^-1 d,    H = K^-1[P, P] = G[P, P] - G[P, S] C G[S, P]
//! ```
//!
//! at a cost of O(|S|^2 |P|) in matrix products, and the compliance at the contacts c follows from `K^c' = K^c - W D
//! W^T`, W = K^-1[c, P]. Rows where dK returns to zero leave S; when none is left, C is empty and K^c is read from the
//! base, bit for bit. `docs/remeshing.md` has the proof, the effects of rounding, and the predecessors: the capacitance
//! matrices of James and Pai, and the augmented systems of Yeung, Crouch and Pothen.

mod application;
mod contacts;
mod error_monitor;
mod recompute;
mod speculation;
mod support;
mod update;

use crate::tissue::error::LinearError;
use std::fmt;

use faer::{Mat, MatMut, MatRef};

use super::adapted::{AdaptedMesh, Change};
use super::difference::Difference;
use super::{
    Level, Precision, Rebuilt, RemeshError, RemeshReport, Remesher, RemesherOptions, SampleSchedule, check_step,
};
use crate::tissue::compliance::{Compliance, check_dofs};
use contacts::Contacts;
use speculation::Speculation;
use support::Support;
use update::Work;

/// Remesher of the exact condensed level. It runs on one thread, and allocates nothing while S does not outgrow its
/// largest size so far.
pub struct Exact {
    source: Box<dyn Compliance + Send>,
    precision: Precision,
    options: RemesherOptions,
    support: Support,
    contacts: Contacts,
    difference: Difference,
    work: Work,
    step: u64,
    sample_schedule: SampleSchedule,
    /// Whether a due sample of the errors was deferred.
    is_due: bool,
    speculation: Speculation,
    rebuilds: u64,
}

impl fmt::Debug for Exact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Exact(step {}, |S| = {}, {} contacts)",
            self.step,
            self.support.len(),
            self.contacts.dofs().len()
        )
    }
}

impl Exact {
    /// Creates a remesher from the current state of `mesh`. `source` is the compliance of its base, with entries of
    /// `precision`.
    ///
    /// # Errors
    /// [`RemeshError`] where the source does not match the mesh or fails, or the mesh is too far from its base.
    pub fn new(
        mesh: &AdaptedMesh,
        source: Box<dyn Compliance + Send>,
        precision: Precision,
        options: RemesherOptions,
    ) -> Result<Exact, RemeshError> {
        let size = mesh.dofs().free();
        fits(&*source, size)?;
        let mut exact = Exact {
            source,
            precision,
            options,
            support: Support::new(size),
            contacts: Contacts::none(),
            difference: Difference::default(),
            work: Work::new(size),
            step: mesh.step(),
            sample_schedule: SampleSchedule::new(),
            is_due: false,
            speculation: Speculation::new(),
            rebuilds: 0,
        };
        exact.refresh(mesh)?;
        exact.rebuilds = 0;
        Ok(exact)
    }

    /// Degrees of freedom S, in the order of [`correction`](Self::correction).
    #[cfg(test)]
    pub fn support_dofs(&self) -> &[usize] {
        self.support.dofs()
    }

    /// Correction C of the base compliance, N/mm.
    #[cfg(test)]
    pub fn correction(&mut self) -> MatRef<'_, f64> {
        self.complete();
        self.support.c.get()
    }

    /// Number of times C was recomputed instead of updated.
    #[cfg(test)]
    pub fn rebuilds(&self) -> u64 {
        self.rebuilds
    }

    fn report(&self, rank: usize, reciprocal_condition: f64, rebuilt: Option<Rebuilt>) -> RemeshReport {
        let support = self.support.len();
        let contacts = self.contacts.dofs().len();
        // An update reads G[S, P] and reads and writes C; a recomputation reads G and dK, writes the factors and C.
        let entries = match rebuilt {
            None => rank * support + 3 * support * support + 2 * contacts * support,
            Some(_) => 5 * support * support + contacts * support,
        };
        RemeshReport {
            level: Level::Exact,
            rank,
            support_size: support,
            reciprocal_condition,
            residual: None,
            rebuilt,
            rebuild_failed: false,
            bytes_moved: entries * size_of::<f64>(),
        }
    }
}

/// Checks that a source has one row per free degree of freedom.
fn fits(source: &dyn Compliance, size: usize) -> Result<(), LinearError> {
    let rows = source.size();
    if rows == size {
        return Ok(());
    }
    Err(LinearError::Shape {
        what: "rows of the compliance",
        found: rows,
        expected: size,
    })
}

impl Remesher for Exact {
    fn level(&self) -> Level {
        Level::Exact
    }

    fn set_level(&mut self, _: &AdaptedMesh, level: Level) -> Result<Option<RemeshReport>, RemeshError> {
        match level {
            Level::Exact => Ok(None),
            asked => Err(RemeshError::Level {
                asked,
                offered: Level::Exact,
            }),
        }
    }

    fn precision(&self) -> Precision {
        self.precision
    }

    fn remesh(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<RemeshReport, RemeshError> {
        check_step(self.step, mesh, change)?;
        self.complete();
        let (before, done) = self.meet(&change.support);
        self.support
            .extend(&mut *self.source, &change.support, self.contacts.dofs())?;
        let condition = match self.update(change, done) {
            Ok(condition) => condition,
            Err(reciprocal_condition) => {
                self.support.truncate(before);
                return Err(RemeshError::Singular {
                    node: change.node,
                    reciprocal_condition,
                    limit: self.options.reciprocal_limit,
                });
            }
        };
        self.step += 1;
        // Rows that are back at their base leave C, which must be complete for that: S stays as small as what the
        // needle has moved.
        if self.support.releases(mesh, &change.support) {
            self.complete();
            self.support.release(mesh, &change.support);
        }
        let mut report = self.report(change.support.len(), condition, None);
        if self.support.is_empty() {
            self.contacts.forget_correction();
            (self.sample_schedule, self.is_due, self.work.left) = (SampleSchedule::new(), false, false);
        } else {
            self.maintain(mesh, &mut report);
        }
        Ok(report)
    }

    fn run_deferred(&mut self, mesh: &AdaptedMesh) -> Option<RemeshReport> {
        if self.work.left {
            self.complete();
            return None;
        }
        let mut report = self.report(0, 1.0, None);
        if self.is_due {
            self.sample(mesh, &mut report);
        } else {
            self.speculate();
        }
        Some(report).filter(|report| report.rebuilt.is_some())
    }

    fn expect(&mut self, support: &[u32]) {
        self.await_change(support);
    }

    fn refresh(&mut self, mesh: &AdaptedMesh) -> Result<RemeshReport, RemeshError> {
        self.complete();
        self.contacts.read_again(&mut *self.source)?;
        let dofs: Vec<u32> = mesh.support().collect();
        let mut support = Support::new(mesh.dofs().free());
        support.extend(&mut *self.source, &dofs, self.contacts.dofs())?;
        let before = std::mem::replace(&mut self.support, support);
        self.speculation.forget();
        mesh.difference_into(&mut self.difference);
        match self.recompute() {
            Ok(condition) => {
                self.rebuilds += 1;
                self.step = mesh.step();
                Ok(self.report(dofs.len(), condition, Some(Rebuilt::Requested)))
            }
            Err(reciprocal_condition) => {
                self.support = before;
                Err(RemeshError::FarFromBase {
                    reciprocal_condition,
                    limit: self.options.reciprocal_limit,
                })
            }
        }
    }

    fn residual(&mut self, mesh: &AdaptedMesh, dofs: &[usize]) -> Result<f64, RemeshError> {
        check_dofs(dofs, self.source.size())?;
        self.true_residual(mesh, dofs).map_err(RemeshError::from)
    }

    fn set_contacts(&mut self, dofs: &[usize]) -> Result<(), RemeshError> {
        self.contacts
            .set(dofs, &mut *self.source, &mut self.support, &mut self.work)
            .map_err(RemeshError::from)
    }

    fn contacts(&self) -> &[usize] {
        self.contacts.dofs()
    }

    fn condensed(&self) -> MatRef<'_, f64> {
        self.contacts.condensed.get()
    }

    fn compliance(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        self.block(rows, columns).map_err(RemeshError::from)
    }

    fn displacement(&mut self, forces: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        self.full_displacement(forces, out).map_err(RemeshError::from)
    }

    fn displacement_refined(
        &mut self,
        mesh: &AdaptedMesh,
        forces: &[f64],
        out: &mut [f64],
    ) -> Result<f64, RemeshError> {
        self.full_displacement_refined(mesh, forces, out)
            .map_err(RemeshError::from)
    }

    fn equivalent_forces(&mut self, forces: &[f64], out: &mut Vec<(usize, f64)>) -> Result<(), RemeshError> {
        self.carried(forces, out).map_err(RemeshError::from)
    }

    fn force_compliance_into(
        &mut self,
        rows: &[usize],
        columns: &[usize],
        out: MatMut<'_, f64>,
    ) -> Result<(), RemeshError> {
        self.source.entries_into(rows, columns, out).map_err(RemeshError::from)
    }

    fn uses_base_compliance(&self) -> bool {
        true
    }

    fn prefetch(&mut self, dofs: &[usize]) -> Result<(), RemeshError> {
        self.source.prefetch(dofs).map_err(RemeshError::from)
    }

    fn memory(&self) -> usize {
        self.source.bytes() + self.support.bytes() + self.work.bytes() + self.speculation.bytes()
    }
}

#[cfg(test)]
mod tests;
