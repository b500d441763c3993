//! Why a needle in tissue has no shape.

use crate::mechanics::needle::InvalidNeedleModel;

/// Solved when what is out of balance at any element's ends is less than this share of the largest moment.
pub const TOLERANCE: f64 = 1e-10;

/// Why there is no solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BeamError {
    /// A number is out of its range.
    #[error(transparent)]
    Invalid(#[from] InvalidNeedleModel),
    /// Nothing gives the needle a direction.
    #[error(
        "the base turns freely and no tissue holds the needle: found no stiff layer around it; \
         expected one, or a prescribed slope of the base"
    )]
    Unheld,
    /// Tissue is crushed between the needle and where it ends.
    #[error(
        "tissue is compressed to nothing {depth_mm} mm below the entry, at {share_percent} % of the base's motion: found a \
         deflection of {deflection_mm} mm; expected less than the tissue's initial length, {initial_length_mm} mm"
    )]
    Crushed {
        /// Where, mm from the entry.
        depth_mm: f64,
        /// Deflection there, mm.
        deflection_mm: f64,
        /// t0 there, mm.
        initial_length_mm: f64,
        /// How much of the base's motion was possible, percent.
        share_percent: f64,
    },
    /// Newton's method found no balance.
    #[error(
        "no balance was found beyond {share_percent} % of the base's motion: found a residual of {residual:.1e} after \
         {iterations} iterations; expected less than {TOLERANCE:.0e}"
    )]
    NotConverged {
        /// Share of the base's motion up to which there was one, percent.
        share_percent: f64,
        /// Largest moment out of balance over the largest moment.
        residual: f64,
        /// Newton steps in all.
        iterations: usize,
    },
}
