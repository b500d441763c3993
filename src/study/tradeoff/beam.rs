//! Beam on a hyperelastic foundation: effect and cost of element length, friction, and material and compression model. The last is the
//! study of figures 7 and 8 of Wang et al. 2023, in which the truth was measured; here it is a fine solution by this program, so that only
//! the choice differs. Finally, springs and beam are compared as needle models in insertion.

mod elements;
mod friction;
mod models;
mod needles;
#[cfg(test)]
mod tests;

use super::gather::Entry;
use super::{Axis, Factor, Study};
use crate::base::report::machine::Machine;
use crate::mechanics::needle::beam::{Base, BeamError, FoundationBeam, Problem, Shape};
use crate::study::beam::INITIAL_LENGTH_MM;

/// Registration of this study.
pub const ENTRY: Entry = Entry {
    name: "beam",
    title: "The needle as a beam",
    question: "How long may elements be, what does friction along the shaft do to its shape, how well must the tissue be known, and are \
               springs enough?",
    run: |_, _, progress| {
        progress("beam", 0.0);
        Ok(study()?)
    },
};

/// Element length of the reference solution, mm.
const FINE_MM: f64 = 0.1;

const fn factor(key: &'static str, label: &'static str) -> Factor {
    Factor { key, label }
}

const fn axis(key: &'static str, heading: &'static str, label: &'static str, log: bool) -> Axis {
    Axis {
        key,
        heading,
        label,
        log,
    }
}

/// Runs the study.
///
/// # Errors
/// [`BeamError`] if a needle shape cannot be solved.
pub fn study() -> Result<Study, BeamError> {
    let tables = vec![
        elements::table()?,
        friction::table()?,
        friction::term()?,
        models::table()?,
        needles::table()?,
    ];
    Ok(Study {
        name: "tradeoff-beam",
        title: ENTRY.title,
        about: vec![
            ("needle", "steel, 200 GPa, 1 mm".to_owned()),
            (
                "tissue",
                "PVC: Ogden, mu 12.72 kPa, alpha -1; PSM: Ogden, mu 3.63 kPa, alpha 8.74".to_owned(),
            ),
            (
                "initial length of the tissue",
                format!("{INITIAL_LENGTH_MM} mm where not said otherwise, assumed"),
            ),
            (
                "truth",
                format!("elements of {FINE_MM} mm; of the models: UEng for PVC and UTru for PSM"),
            ),
        ],
        machine: Machine::here(),
        tables,
        figures: [
            elements::figures(),
            friction::figures(),
            models::figures(),
            needles::figures(),
        ]
        .concat(),
        notes: vec![
            "models: every model is driven with the base motion that a free base takes in the true one".to_owned(),
            "errors below 1e-11 mm are rounding".to_owned(),
        ],
    })
}

fn solve(problem: &Problem, base: &Base) -> Result<Shape, BeamError> {
    FoundationBeam::new(problem)?.solve(base)
}

/// Returns the largest distance between two shapes of the same needle at the points of the first, mm.
fn apart(shape: &Shape, other: &Shape) -> f64 {
    let apart = shape
        .points
        .iter()
        .map(|point| (point.u_mm - other.at(point.x_mm)[0]).abs());
    apart.fold(0.0, f64::max)
}
