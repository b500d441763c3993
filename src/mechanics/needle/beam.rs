//! Euler-Bernoulli beam on a hyperelastic foundation: a needle in tissue whose base is moved sideways (Wang et al.
//! 2023, sections II-A and III).
//!
//! The needle lies along x: its base at `-control_distance_mm`, the point of entry at 0, its tip at the inserted depth.
//! Its deflection u (mm, across the needle) obeys
//!
//! ```text
//! E I u'''' = -F,    F = k(lambda) u {1 - gamma sin^2(atan u')},    k = dS/d lambda,    lambda = (t0 - |u|)/t0
//! ```
//!
//! with displacement and slope prescribed at the base, or displacement alone (the base then turns freely, without
//! moment), and neither moment nor force at the tip. F is zero outside the tissue, k the tangent modulus of the layer's
//! material in compression, t0 the initial length of the tissue, gamma the friction of the layer. The equation of Wang
//! et al. has F without a sign; here F points along u, so that it pushes the needle back.
//!
//! | file | contents |
//! |---|---|
//! | [`material`] | hyperelastic materials in compression: stress, tangent modulus and its rate |
//! | [`problem`] | needle, layers and elements, validated |
//! | `foundation` | reaction and its derivatives over an element |
//! | [`spec`] | tables of a case file |
//! | `sweep` | the linear equations of one Newton step, from tip to base and back |
//! | `newton` | Newton's method with a line search and load steps |
//! | [`shape`] | solution: deflection, reaction, centres of motion |
//! | [`inverse`] | base motion for a given tip or a given centre of motion |
//! | [`fit`] | materials from measured stretch and stress |

use insonify_base::blame::Blame;
use insonify_base::range::OutOfRange;

pub mod fit;
mod foundation;
pub mod inverse;
pub mod material;
mod newton;
pub mod problem;
pub mod shape;
pub mod spec;
mod sweep;

pub use material::{Compression, Material, ModelName};
pub use newton::FoundationBeam;
pub use problem::{Base, BeamLayer, Problem, bending_stiffness_nmm2};
pub use shape::{LayerLoad, Shape};

/// Convergence tolerance: largest residual moment at any element's ends, as a share of the largest moment.
pub const TOLERANCE: f64 = 1e-10;

/// Reason why there is no solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BeamError {
    /// A number out of range.
    #[error(transparent)]
    Invalid(#[from] OutOfRange),
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
    /// The search for a motion of the base did not converge.
    #[error("no motion of the base was found: the closest misses the goal by {miss_mm:.3e} mm")]
    NoMotion {
        /// Largest distance from the goals, mm.
        miss_mm: f64,
    },
    /// A layer is compressed beyond its limit.
    #[error(
        "layer {layer} is compressed beyond its limit{}: found {ratio:.3} of its length {depth_mm:.2} mm below the entry; expected \
         at least {least}",
        if *always { " by every motion of the base that moves the tip so" } else { "" }
    )]
    Compressed {
        /// Number of the layer, from 1.
        layer: usize,
        /// Compression ratio.
        ratio: f64,
        /// Limit of the compression ratio.
        least: f64,
        /// Depth of that tissue, mm from the entry.
        depth_mm: f64,
        /// Whether no other motion of the base compresses the layers less.
        always: bool,
    },
    /// The needle crosses its undeflected line above that depth.
    #[error("no centre of motion at {wanted_mm} mm: the needle already crosses its undeflected line at {found_mm} mm")]
    Earlier {
        /// Depth of the goal, mm.
        wanted_mm: f64,
        /// Depth of the first crossing, mm.
        found_mm: f64,
    },
}

impl Blame for BeamError {}
