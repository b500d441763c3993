//! Errors of the beam solver.

use crate::mechanics::needle::InvalidNeedleModel;

/// Convergence tolerance: largest residual moment at any element's ends, as a share of the largest moment.
pub const TOLERANCE: f64 = 1e-10;

/// Reason why there is no solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BeamError {
    /// A number out of range.
    #[error(transparent)]
    Invalid(#[from] InvalidNeedleModel),
    /// The direction of the needle is undetermined: its base turns freely, without tissue around it.
    #[error(
        "the base turns freely and no tissue holds the needle: found no stiff layer around it; \
         expected one, or a prescribed slope of the base"
    )]
    Unheld,
    /// Tissue beside the needle is compressed to nothing.
    #[error(
        "tissue is compressed to nothing {depth_mm} mm below the entry, at {share_percent} % of the base's motion: found a \
         deflection of {deflection_mm} mm; expected less than the tissue's initial length, {initial_length_mm} mm"
    )]
    Crushed {
        /// Depth of the crushed tissue, mm from the entry.
        depth_mm: f64,
        /// Deflection at that depth, mm.
        deflection_mm: f64,
        /// Initial length t0 of the tissue at that depth, mm.
        initial_length_mm: f64,
        /// Share of the base's motion that was reached, percent.
        share_percent: f64,
    },
    /// Newton's method did not converge.
    #[error(
        "no balance was found beyond {share_percent} % of the base's motion: found a residual of {residual:.1e} after \
         {iterations} iterations; expected less than {TOLERANCE:.0e}"
    )]
    NotConverged {
        /// Share of the base's motion up to which it converged, percent.
        share_percent: f64,
        /// Largest residual moment over the largest moment.
        residual: f64,
        /// Total number of Newton steps.
        iterations: usize,
    },
}
