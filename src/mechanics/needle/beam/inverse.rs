//! Inverse problem: base motion for a given tip or centre of motion, within limits of compression (Wang et al. 2023,
//! section III-E).

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};

use super::BeamError;
use super::newton::FoundationBeam;
use super::problem::Base;
use super::shape::Shape;
use insonify_base::range::check;

/// Convergence tolerance of the goals, mm.
pub const TOLERANCE_MM: f64 = 1e-9;
/// Maximum number of Newton steps.
const STEPS: usize = 60;
/// Maximum number of halvings of a step.
const HALVINGS: usize = 12;
/// Increment for finite differences: mm, and mm at the needle's tip.
const NUDGE_MM: f64 = 1e-4;
/// Number of ratios of slope and displacement tried for the least compression, and of steps of the golden section
/// between the best.
const RATIOS: usize = 60;
const SECTIONS: usize = 40;

/// Goal of the base motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wanted {
    /// Deflection of the tip, with the base turning with its displacement about a remote centre of motion at a depth
    /// below the base.
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
    /// Deflection of the tip with the least compression of the tissue: that motion of the base, about any centre, for
    /// which the largest share that a layer has of its limit (of its whole length, without one) is least.
    TipLeast {
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
/// [`BeamError`]; also if a layer is compressed beyond its limit.
pub fn find(beam: &mut FoundationBeam, wanted: &Wanted) -> Result<(Base, Shape), BeamError> {
    let solution = reach(beam, wanted)?;
    let limits = &beam.problem().layers;
    let over = solution
        .1
        .layers
        .iter()
        .find(|load| load.least_ratio < limits[load.layer].least_ratio);
    match over {
        None => Ok(solution),
        Some(load) => Err(BeamError::Compressed {
            layer: load.layer + 1,
            ratio: load.least_ratio,
            least: limits[load.layer].least_ratio,
            depth_mm: load.least_at_mm,
            always: matches!(wanted, Wanted::TipLeast { .. }),
        }),
    }
}

/// Finds the motion of the base, and the resulting shape of the needle, even if a layer is compressed beyond its limit.
///
/// # Errors
/// [`BeamError`].
pub fn reach(beam: &mut FoundationBeam, wanted: &Wanted) -> Result<(Base, Shape), BeamError> {
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
        Wanted::TipLeast { tip_mm } => least_compressing(beam, tip_mm),
        Wanted::Centre {
            com_mm,
            displacement_mm,
        } => {
            within(com_mm)?;
            // A base that does not move is met by the straight needle, of which every depth is a centre.
            not_zero("displacement_mm", displacement_mm)?;
            let turned = |c: &[f64]| prescribed(displacement_mm, c[0]);
            // The slope is nudged by what moves the tip as far as a nudge of the displacement does.
            let solution = seek(beam, &[(com_mm, 0.0)], &turned, &[NUDGE_MM / length.max(1.0)])?;
            first(solution, com_mm)
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

/// Largest share that a layer has of the compression that its limit allows.
fn strain_share(beam: &FoundationBeam, shape: &Shape) -> f64 {
    let limits = &beam.problem().layers;
    let shares = shape.layers.iter();
    let shares = shares.map(|load| (1.0 - load.least_ratio) / (1.0 - limits[load.layer].least_ratio));
    shares.fold(0.0, f64::max)
}

/// Moves the tip by the motion of the base that compresses the tissue least: displacement and slope times length are in
/// the ratio of cosine and sine of an angle, which is scanned and then refined by golden sections.
fn least_compressing(beam: &mut FoundationBeam, tip_mm: f64) -> Result<(Base, Shape), BeamError> {
    let [distance, inserted] = [beam.problem().control_distance_mm, beam.problem().inserted_mm];
    let length = (distance + inserted).max(1.0);
    let mut solve_at = |angle: f64| {
        let base = |c: &[f64]| Base {
            displacement_mm: c[0] * angle.cos(),
            slope: Some(c[0] * angle.sin() / length),
        };
        let solution = seek(beam, &[(inserted, tip_mm)], &base, &[NUDGE_MM])?;
        Ok((strain_share(beam, &solution.1), solution))
    };
    let share = |solution: &Result<(f64, (Base, Shape)), BeamError>| {
        solution.as_ref().map_or(f64::INFINITY, |solution| solution.0)
    };
    // Half a turn covers all ratios: opposite angles differ only in the sign of the solution.
    let width = PI / RATIOS as f64;
    let mut best = (0.0, solve_at(0.0));
    for step in 1..RATIOS {
        let angle = step as f64 * width;
        let solution = solve_at(angle);
        if share(&solution) < share(&best.1) {
            best = (angle, solution);
        }
    }
    // The largest share has kinks where another layer takes over as the most compressed: golden sections ask for no
    // derivative.
    let golden = 0.5 * (5.0f64.sqrt() - 1.0);
    let (mut low, mut high) = (best.0 - width, best.0 + width);
    let (mut near, mut far) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_near, mut at_far) = (solve_at(near), solve_at(far));
    for _ in 0..SECTIONS {
        if share(&at_near) < share(&at_far) {
            (high, far) = (far, near);
            near = high - golden * (high - low);
            at_far = std::mem::replace(&mut at_near, solve_at(near));
        } else {
            (low, near) = (near, far);
            far = low + golden * (high - low);
            at_near = std::mem::replace(&mut at_far, solve_at(far));
        }
    }
    // With several minima between its neighbours, golden sections may end above the best of the scan.
    let candidates = [best.1, at_near, at_far];
    let least = candidates.into_iter().min_by(|a, b| share(a).total_cmp(&share(b)));
    least.map_or(Err(BeamError::NoMotion { miss_mm: tip_mm.abs() }), |solution| {
        Ok(solution?.1)
    })
}

/// Rejects a needle that crosses its undeflected line above the goal.
fn first(solution: (Base, Shape), wanted_mm: f64) -> Result<(Base, Shape), BeamError> {
    match solution.1.com_mm() {
        Some(found_mm) if found_mm < wanted_mm - 1e-3 => Err(BeamError::Earlier { wanted_mm, found_mm }),
        _ => Ok(solution),
    }
}

/// Solves for the parameters of the base motion by Newton's method with finite differences, from rest; goals are
/// positions and deflections, mm.
fn seek(
    beam: &mut FoundationBeam,
    goals: &[(f64, f64)],
    base: &dyn Fn(&[f64]) -> Base,
    nudges: &[f64],
) -> Result<(Base, Shape), BeamError> {
    let count = nudges.len();
    let error_at = |beam: &mut FoundationBeam, parameters: &DVector<f64>| -> Result<(DVector<f64>, Shape), BeamError> {
        let shape = beam.solve(&base(parameters.as_slice()))?;
        let errors = goals
            .iter()
            .map(|(x_mm, deflection_mm)| shape.at(*x_mm)[0] - deflection_mm);
        Ok((DVector::from_iterator(count, errors), shape))
    };
    let mut parameters = DVector::zeros(count);
    let (mut error, mut shape) = error_at(beam, &parameters)?;
    for _ in 0..STEPS {
        if error.amax() <= TOLERANCE_MM {
            return Ok((base(parameters.as_slice()), shape));
        }
        // By central differences: a solution of the beam does not come with its derivatives by the motion of the base.
        let mut slopes = DMatrix::zeros(count, count);
        for (j, nudge) in nudges.iter().enumerate() {
            let mut error_beside = |sign: f64| {
                let mut nudged = parameters.clone();
                nudged[j] += sign * nudge;
                error_at(beam, &nudged).map(|(error, _)| error)
            };
            let column = (error_beside(1.0)? - error_beside(-1.0)?) / (2.0 * nudge);
            slopes.set_column(j, &column);
        }
        let Some(step) = slopes
            .lu()
            .solve(&error)
            .filter(|step| step.iter().all(|x| x.is_finite()))
        else {
            break;
        };
        // Far from the goal a full step may overshoot, or find no equilibrium of the beam.
        let mut part = 1.0;
        let better = (0..HALVINGS).find_map(|_| {
            let next = &parameters - &step * part;
            part /= 2.0;
            let (next_error, next_shape) = error_at(beam, &next).ok()?;
            (next_error.amax() < error.amax()).then_some((next, next_error, next_shape))
        });
        let Some(better) = better else { break };
        (parameters, error, shape) = better;
    }
    Err(BeamError::NoMotion { miss_mm: error.amax() })
}
