//! Refinement of time steps until the response converges.

use super::{Loading, Method, Point, Response};
use crate::mechanics::tissue::viscoelastic::HistoryError;

/// Change relative to the largest value below which refinement ends.
const SETTLED: f64 = 1e-7;
/// Initial number of steps between two points.
const FIRST: usize = 8;

/// Returns the largest total number of steps, which takes about a second.
fn most(method: Method) -> usize {
    match method {
        // Every step weighs all values before it, with weights that differ from those of the previous step.
        Method::Rectangle | Method::TimeScaledTrapezoid | Method::Trapezoid => 1 << 12,
        Method::GruenwaldLetnikov => 1 << 15,
        Method::Exponentials => 1 << 17,
    }
}

pub(super) fn refined(point: &Point, loading: &Loading, method: Method) -> Result<Response, HistoryError> {
    let intervals = loading.time_s.len() - 1;
    let fits = |substeps: usize| intervals.saturating_mul(substeps) <= most(method);
    let mut substeps = FIRST;
    while substeps > 1 && !fits(substeps) {
        substeps /= 2;
    }
    let mut response = point.respond_in(loading, method, substeps)?;
    if intervals == 0 {
        response.change = Some(0.0);
        return Ok(response);
    }
    while fits(2 * substeps) {
        substeps *= 2;
        let mut finer = point.respond_in(loading, method, substeps)?;
        let change = change(&response, &finer);
        finer.change = Some(change);
        response = finer;
        if change <= SETTLED {
            break;
        }
    }
    Ok(response)
}

/// Returns the largest difference of two responses relative to the largest value.
fn change(one: &Response, other: &Response) -> f64 {
    let share = |pairs: &mut dyn Iterator<Item = (f64, f64)>| {
        let (mut difference, mut largest) = (0.0f64, 0.0f64);
        for (a, b) in pairs {
            difference = difference.max((a - b).abs());
            largest = largest.max(b.abs());
        }
        if difference == 0.0 { 0.0 } else { difference / largest }
    };
    let strains = one.strain.iter().copied().zip(other.strain.iter().copied());
    let stresses = one.stress_kpa.iter().zip(&other.stress_kpa);
    let stresses = stresses.filter_map(|(a, b)| Some(((*a)?, (*b)?)));
    share(&mut { strains }).max(share(&mut { stresses }))
}
