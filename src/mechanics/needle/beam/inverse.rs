//! Inverse problem: base motion for a given tip or centre of motion (Wang et al. 2023, section III-E).

use nalgebra::{DMatrix, DVector};

use super::BeamError;
use super::newton::FoundationBeam;
use super::problem::Base;
use super::shape::Shape;
use crate::base::range::check;

/// Convergence tolerance of the goals, mm.
pub const TOLERANCE_MM: f64 = 1e-9;
/// Maximum number of Newton steps.
const STEPS: usize = 60;
/// Maximum number of halvings of a step.
const HALVINGS: usize = 12;
/// Increment for finite differences: mm, and mm at the needle's tip.
const NUDGE_MM: f64 = 1e-4;

/// Goal of the base motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// Deflection of the tip, with the base turning with its displacement about a remote centre of motion at a depth below
    /// the base.
    TipAbout {
        /// Deflection of the tip, mm.
        tip_mm: f64,
        /// Depth of the centre, mm from the entry.
        rcm_mm: f64,
    },
    /// Deflection of the tip, with the base turning freely.
    TipFree {
        /// Deflection of the tip, mm.
        tip_mm: f64,
    },
    /// Centre of motion at a depth, for a displacement of the base.
    Centre {
        /// Depth of the centre, mm from the entry (0 to the inserted depth).
        com_mm: f64,
        /// Displacement of the base, mm (not 0).
        displacement_mm: f64,
    },
    /// Both the deflection of the tip and the depth of the centre of motion.
    TipAndCentre {
        /// Deflection of the tip, mm (not 0).
        tip_mm: f64,
        /// Depth of the centre, mm (above the tip).
        com_mm: f64,
    },
}

/// Finds the motion of the base, and the resulting shape of the needle.
///
/// # Errors
/// [`BeamError`].
pub fn find(beam: &mut FoundationBeam, wanted: &Wanted) -> Result<(Base, Shape), BeamError> {
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

/// Rejects a needle that crosses its undeflected line above the goal.
fn first(found: (Base, Shape), wanted_mm: f64) -> Result<(Base, Shape), BeamError> {
    match found.1.com_mm() {
        Some(found_mm) if found_mm < wanted_mm - 1e-3 => Err(BeamError::Earlier { wanted_mm, found_mm }),
        _ => Ok(found),
    }
}

/// Solves for the parameters of the base motion by Newton's method with finite differences, from rest; goals are positions
/// and deflections, mm.
fn seek(
    beam: &mut FoundationBeam,
    goals: &[(f64, f64)],
    base: &dyn Fn(&[f64]) -> Base,
    nudges: &[f64],
) -> Result<(Base, Shape), BeamError> {
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
    Err(BeamError::NoMotion { miss_mm: off.amax() })
}
