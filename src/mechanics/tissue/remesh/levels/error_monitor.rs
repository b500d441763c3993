//! Error monitoring of the dense inverse.

use faer::Side;
use faer::linalg::solvers::Llt;

use super::{DenseInverseRemesher, Store};
use crate::tissue::remesh::adapted::{AdaptedMesh, Change};
use crate::tissue::remesh::{Level, Precision, Rebuilt, RemeshError, RemeshReport, RemesherOptions, SampleSchedule};
use insonify_base::random::{hash3, seed_words};

/// Sampled residual at which the inverse is rebuilt, relative to the limit: only a few columns are sampled, and others
/// are worse.
const REBUILD_AT: f64 = 0.1;

/// Sampled residual below which the next sample may wait, relative to the limit: a few updates add less than the rest.
const CALM: f64 = 1e-2;

impl<S: Store> DenseInverseRemesher<S> {
    fn residual_limit(&self) -> f64 {
        match self.inverse.store.precision() {
            Precision::Single => self.options.residual_single,
            Precision::Double => self.options.residual_double,
        }
    }

    /// Whether K^c can be a compliance, that is, positive definite; it is always symmetric.
    fn is_definite(&self) -> bool {
        self.contacts.is_empty() || Llt::new(self.condensed.as_ref(), Side::Lower).is_ok()
    }

    /// Whether to sample the residual after a change of this reciprocal condition.
    fn is_sample_due(&mut self, reciprocal_condition: f64) -> bool {
        let every = self.options.check_every;
        let is_due = self.sample_schedule.is_due(every);
        // A change and the change back multiply rounding by the square of their condition.
        let rounding = match self.inverse.store.precision() {
            Precision::Single => f64::from(f32::EPSILON),
            Precision::Double => f64::EPSILON,
        };
        let is_doubtful = rounding > self.residual_limit() * reciprocal_condition * reciprocal_condition;
        is_due || (every > 0 && is_doubtful)
    }

    /// Samples the residual of three columns: one where the inverse has just changed most, that of the most compliant
    /// contact, and a random one.
    fn sample(&mut self, mesh: &AdaptedMesh, change: &Change) -> Result<f64, RemeshError> {
        let any = hash3([self.step as i32, 0, 0], seed_words(0))[0] as usize % self.inverse.store.size();
        let moved = change.support.first().map_or(any, |dof| *dof as usize);
        let softer = |a: &usize, b: &usize| self.condensed[(*a, *a)].total_cmp(&self.condensed[(*b, *b)]);
        let contact = (0..self.contacts.len()).max_by(softer);
        let contact = contact.map_or(any, |index| self.contacts[index]);
        self.inverse.residual(mesh, &[moved, contact, any])
    }

    /// Whether the residual exceeds the limit even after a rebuild, as when one update loses that much.
    pub(super) fn is_lost(
        &mut self,
        mesh: &AdaptedMesh,
        change: &Change,
        report: &mut RemeshReport,
    ) -> Result<bool, RemeshError> {
        let residual = self.sample(mesh, change)?;
        report.residual = Some(residual);
        Ok(residual.is_nan() || residual > REBUILD_AT * self.residual_limit())
    }

    /// Checks the inverse after a change; returns the reason for a rebuild, if one is needed.
    pub(super) fn due(
        &mut self,
        mesh: &AdaptedMesh,
        change: &Change,
        report: &mut RemeshReport,
    ) -> Result<Option<Rebuilt>, RemeshError> {
        if self.level == Level::I && self.is_sample_due(report.reciprocal_condition) {
            let residual = self.sample(mesh, change)?;
            report.residual = Some(residual);
            let limit = self.residual_limit();
            let calmer = std::mem::replace(&mut self.sample_schedule, SampleSchedule::new());
            if residual.is_nan() || residual > REBUILD_AT * limit {
                return Ok(Some(Rebuilt::Residual(residual)));
            }
            if residual < CALM * limit {
                self.sample_schedule = calmer;
                self.sample_schedule.relax(self.options.check_every);
            }
        }
        let partial = matches!(self.level, Level::II | Level::III);
        Ok((partial && !self.is_definite()).then_some(Rebuilt::Indefinite))
    }
}

/// Refuses f32 where rounding makes it useless.
pub(super) fn suits(
    mesh: &AdaptedMesh,
    level: Level,
    precision: Precision,
    options: &RemesherOptions,
) -> Result<(), RemeshError> {
    let poisson = mesh.stiffness().materials().iter().map(|material| material.poisson());
    let highest = poisson.fold(-1.0, f64::max);
    let limit = options.single_poisson_limit;
    if precision == Precision::Double || level == Level::IV || highest <= limit {
        return Ok(());
    }
    Err(RemeshError::Unsuited {
        level,
        precision,
        reason: format!(
            "a region has a Poisson's ratio of {highest}, and beyond {limit} the rounding of f32 outgrows the answer within \
             tens of remeshes; use f64, or the exact level"
        ),
    })
}
