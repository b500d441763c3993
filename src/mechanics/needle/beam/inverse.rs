//! The base motion that brings about what is wanted (Wang et al. 2023, section III-E).

use nalgebra::{DMatrix, DVector};

use super::error::BeamError;
use super::newton::FoundationBeam;
use super::problem::Base;
use super::shape::Shape;
use crate::mechanics::needle::InvalidNeedleModel;
use crate::mechanics::needle::shaft::check;

/// A needle within this of what is wanted is there, mm.
pub const TOLERANCE_MM: f64 = 1e-9;
/// Steps of the search.
const STEPS: usize = 60;
/// Halvings of a step.
const HALVINGS: usize = 12;
/// Change of the base by which derivatives are taken: mm, and mm at the needle's tip.
const NUDGE_MM: f64 = 1e-4;

/// What is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// The tip's deflection (mm), the base turning with its displacement about a remote centre of motion at a depth (mm from the
    /// entry, below the base).
    TipAbout {
        /// Of the tip.
        tip_mm: f64,
        /// Of the centre.
        rcm_mm: f64,
    },
    /// The tip's deflection (mm), the base turning freely.
    TipFree {
        /// Of the tip.
        tip_mm: f64,
    },
    /// The centre of motion at a depth (mm from the entry), for a displacement of the base (mm).
    Centre {
        /// Of the centre, 0 to the inserted depth.
        com_mm: f64,
        /// Of the base, not 0.
        displacement_mm: f64,
    },
    /// Both the tip's deflection (mm, not 0) and the depth of the centre of motion (mm, above the tip).
    TipAndCentre {
        /// Of the tip.
        tip_mm: f64,
        /// Of the centre.
        com_mm: f64,
    },
}

/// Why no base motion was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InverseError {
    /// The needle cannot be moved so.
    #[error(transparent)]
    Beam(#[from] BeamError),
    /// A number is out of its range.
    #[error(transparent)]
    Invalid(#[from] InvalidNeedleModel),
    /// The search ended without one.
    #[error("no motion of the base was found: the nearest leaves the needle {miss_mm:.3e} mm from what is wanted")]
    NotFound {
        /// Largest distance from what is wanted, mm.
        miss_mm: f64,
    },
    /// The needle crosses its old place before that depth.
    #[error("no centre of motion at {wanted_mm} mm: a needle that crosses there has crossed at {found_mm} mm before")]
    Earlier {
        /// Depth that is wanted, mm.
        wanted_mm: f64,
        /// Depth of the first crossing, mm.
        found_mm: f64,
    },
}

/// Finds the motion of the base, and the needle's shape then.
///
/// # Errors
/// [`InverseError`].
pub fn find(beam: &mut FoundationBeam, wanted: &Wanted) -> Result<(Base, Shape), InverseError> {
    let inserted = beam.problem().inserted_mm;
    let [distance, length] = [
        beam.problem().control_distance_mm,
        beam.problem().control_distance_mm + inserted,
    ];
    let within = |com: f64| {
        let expected = format!("0 to the inserted depth, {inserted} mm");
        check("com_mm", com, (0.0..=inserted).contains(&com), expected)
    };
    let not_zero = |key, x: f64| check(key, x, x != 0.0, "other than 0 mm");
    let prescribed = |displacement_mm: f64, slope: f64| Base {
        displacement_mm,
        slope: Some(slope),
    };
    match *wanted {
        Wanted::TipAbout { tip_mm, rcm_mm } => {
            let arm = distance + rcm_mm;
            check("rcm_mm", rcm_mm, arm > 0.0, "a depth beyond the base, mm")?;
            let goals = [(inserted, tip_mm)];
            seek(beam, &goals, &|c| prescribed(c[0], -c[0] / arm), &[NUDGE_MM])
        }
        Wanted::TipFree { tip_mm } => {
            let free = |c: &[f64]| Base {
                displacement_mm: c[0],
                slope: None,
            };
            seek(beam, &[(inserted, tip_mm)], &free, &[NUDGE_MM])
        }
        Wanted::Centre {
            com_mm,
            displacement_mm,
        } => {
            within(com_mm)?;
            not_zero("displacement_mm", displacement_mm)?;
            let turned = |c: &[f64]| prescribed(displacement_mm, c[0]);
            let found = seek(beam, &[(com_mm, 0.0)], &turned, &[NUDGE_MM / length.max(1.0)])?;
            first(found, com_mm)
        }
        Wanted::TipAndCentre { tip_mm, com_mm } => {
            within(com_mm)?;
            not_zero("tip_mm", tip_mm)?;
            check("com_mm", com_mm, com_mm < inserted, "above the tip")?;
            let nudges = [NUDGE_MM, NUDGE_MM / length.max(1.0)];
            let goals = [(inserted, tip_mm), (com_mm, 0.0)];
            first(seek(beam, &goals, &|c| prescribed(c[0], c[1]), &nudges)?, com_mm)
        }
    }
}

/// Refuses a needle that has crossed its old place before.
fn first(found: (Base, Shape), wanted_mm: f64) -> Result<(Base, Shape), InverseError> {
    match found.1.com_mm() {
        Some(found_mm) if found_mm < wanted_mm - 1e-3 => Err(InverseError::Earlier { wanted_mm, found_mm }),
        _ => Ok(found),
    }
}

/// Newton's method with derivatives by differences on what makes up the base motion, from rest: goals are places and deflections, mm.
fn seek(
    beam: &mut FoundationBeam,
    goals: &[(f64, f64)],
    base: &dyn Fn(&[f64]) -> Base,
    nudges: &[f64],
) -> Result<(Base, Shape), InverseError> {
    let count = nudges.len();
    let miss = |beam: &mut FoundationBeam, at: &DVector<f64>| -> Result<(DVector<f64>, Shape), BeamError> {
        let shape = beam.solve(&base(at.as_slice()))?;
        let off = goals.iter().map(|(place, deflection)| shape.at(*place)[0] - deflection);
        Ok((DVector::from_iterator(count, off), shape))
    };
    let mut at = DVector::zeros(count);
    let (mut off, mut shape) = miss(beam, &at)?;
    for _ in 0..STEPS {
        if off.amax() <= TOLERANCE_MM {
            return Ok((base(at.as_slice()), shape));
        }
        let mut slopes = DMatrix::zeros(count, count);
        for (j, nudge) in nudges.iter().enumerate() {
            let mut side = |sign: f64| {
                let mut beside = at.clone();
                beside[j] += sign * nudge;
                miss(beam, &beside).map(|(off, _)| off)
            };
            let column = (side(1.0)? - side(-1.0)?) / (2.0 * nudge);
            slopes.set_column(j, &column);
        }
        let Some(step) = slopes
            .lu()
            .solve(&off)
            .filter(|step| step.iter().all(|x| x.is_finite()))
        else {
            break;
        };
        let mut part = 1.0;
        let better = (0..HALVINGS).find_map(|_| {
            let next = &at - &step * part;
            part /= 2.0;
            let (next_off, next_shape) = miss(beam, &next).ok()?;
            (next_off.amax() < off.amax()).then_some((next, next_off, next_shape))
        });
        let Some(better) = better else { break };
        (at, off, shape) = better;
    }
    Err(InverseError::NotFound { miss_mm: off.amax() })
}
