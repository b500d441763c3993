//! Whether the inverse is still good enough.

use faer::Side;
use faer::linalg::solvers::Llt;

use super::{Following, Store};
use crate::mechanics::tissue::remesh::adapted::{AdaptedMesh, Change};
use crate::mechanics::tissue::remesh::{Level, Options, Precision, Rebuilt, RemeshError, RemeshReport};
use crate::random::{hash3, seed_words};

impl<S: Store> Following<S> {
    fn residual_limit(&self) -> f64 {
        match self.inverse.store.precision() {
            Precision::Single => self.options.residual_single,
            Precision::Double => self.options.residual_double,
        }
    }

    /// Whether K^c can be a compliance: symmetric it is, and positive definite it must be.
    fn is_definite(&self) -> bool {
        self.contacts.is_empty() || Llt::new(self.condensed.as_ref(), Side::Lower).is_ok()
    }

    /// Looks at what a change has left behind, and says why the inverse must be rebuilt if it must.
    pub(super) fn due(
        &mut self,
        mesh: &AdaptedMesh,
        change: &Change,
        report: &mut RemeshReport,
    ) -> Result<Option<Rebuilt>, RemeshError> {
        let Options { check_every, .. } = self.options;
        if self.level == Level::I && check_every > 0 && self.step.is_multiple_of(check_every) {
            let size = self.inverse.store.size();
            let any = hash3([self.step as i32, 0, 0], seed_words(0))[0] as usize % size;
            // One column where the inverse has just changed most, and one anywhere.
            let own = change.support.first().map_or(any, |dof| *dof as usize);
            let residual = self.inverse.residual(mesh, &[own, any])?;
            report.residual = Some(residual);
            if residual.is_nan() || residual > self.residual_limit() {
                return Ok(Some(Rebuilt::Residual(residual)));
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
    options: &Options,
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
