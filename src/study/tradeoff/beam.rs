//! Beam on a hyperelastic foundation: effect and cost of element length, friction, and material and compression model. The last is the
//! study of figures 7 and 8 of Wang et al. 2023, in which the truth was measured; here it is a fine solution by this program, so that only
//! the choice differs. Finally, springs and beam are compared as needle models in insertion.

mod needles;

use std::hint::black_box;

use super::gather::Entry;
use super::{Axis, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use crate::beam::{ELEMENT_MM, INITIAL_LENGTH_MM, TISSUES, problem};
use insonify_base::machine::Machine;
use insonify_base::statistics::Spread;
use insonify_mechanics::needle::beam::{Base, BeamError, Compression, FoundationBeam, Problem, Shape};

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

/// Runs the study.
///
/// # Errors
/// [`BeamError`] if a needle shape cannot be solved.
pub fn study() -> Result<Study, BeamError> {
    let tables = vec![
        elements_table()?,
        friction_table()?,
        term()?,
        needles::models_table()?,
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
            elements_figures(),
            friction_figures(),
            needles::models_figures(),
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

const ELEMENTS_MM: [f64; 5] = [5.0, 2.0, 1.0, 0.5, FINE_MM];
/// Number of timed solutions.
const REPEATS: usize = 41;

pub(super) fn elements_table() -> Result<Table, BeamError> {
    let axes = [
        Axis::log("elements", "elements", "elements"),
        Axis::log("median_ms", "ms", "time of a solution (median), ms"),
        Axis::log("p95_ms", "p95 ms", "time of a solution (95th percentile), ms"),
        Axis::log("error_mm", "error mm", "largest error of the deflection, mm"),
        Axis::linear("iterations", "Newton", "Newton steps"),
    ];
    let factors = [Factor::new("case", "case"), Factor::new("element_mm", "element")];
    let title = "Length of elements: 60 mm in, base 20 mm before the entry, moved by 15 mm, slope -0.2";
    let mut table = Table::new("elements", title, &factors, &axes)
        .against(format!("elements of {FINE_MM} mm"))
        .seeking(
            Goal::new("median_ms", "error_mm", SHIFT_MM)
                .over(&["case"])
                .choosing("elements of a beam alone in tissue (insonify beam)")
                .beside(&["p95_ms"]),
        );
    let base = Base {
        displacement_mm: 15.0,
        slope: Some(-0.2),
    };
    let [pvc, psm] = TISSUES;
    let cases = [
        ("PVC", pvc.material, pvc.compression, 50.0),
        ("PSM", psm.material, psm.compression, 50.0),
        ("PSM, CTru, t0 20 mm", psm.material, Compression::CTru, 20.0),
    ];
    for (name, material, compression, initial_length_mm) in cases {
        let of = |element_mm: f64| {
            let mut problem = problem(material, compression, 20.0, 60.0, element_mm);
            problem.layers[0].initial_length_mm = initial_length_mm;
            problem
        };
        let truth = solve(&of(FINE_MM), &base)?;
        for element_mm in ELEMENTS_MM {
            let mut beam = FoundationBeam::new(&of(element_mm))?;
            let shape = beam.solve(&base)?;
            let time = Spread::of_runs(REPEATS, || beam.solve(black_box(&base)))?;
            let error = (element_mm > FINE_MM).then(|| apart(&shape, &truth));
            let values = vec![
                Some((shape.points.len() - 1) as f64),
                time.map(|time| time.median_ms),
                time.map(|time| time.p95_ms),
                error,
                Some(shape.iterations as f64),
            ];
            table.push(vec![name.to_owned(), format!("{element_mm} mm")], values, None);
        }
    }
    table.mark_gold("element_mm", &format!("{FINE_MM} mm"));
    Ok(table)
}

pub(super) fn elements_figures() -> Vec<Figure> {
    vec![Figure {
        marker: vec!["element_mm"],
        joined: false,
        ..Figure::new(
            "beam-elements",
            "Length of elements: what accuracy costs",
            "elements",
            ["median_ms", "error_mm"],
            "case",
        )
    }]
}

const FRICTION: [f64; 5] = [0.0, 0.1, 0.3, 0.6, 1.0];
const SLOPES: [f64; 3] = [-0.1, -0.4, -0.8];

pub(super) fn friction_table() -> Result<Table, BeamError> {
    let axes = [
        Axis::linear("gamma", "gamma", "friction, gamma"),
        Axis::linear(
            "tip_mm",
            "tip mm",
            "change of the tip's deflection against no friction, mm",
        ),
        Axis::linear("shape_mm", "shape mm", "largest change of the deflection, mm"),
        Axis::linear("com_mm", "COM mm", "change of the centre of motion's depth, mm"),
    ];
    let factors = [
        Factor::new("tissue", "tissue"),
        Factor::new("slope", "slope"),
        Factor::new("friction", "friction"),
    ];
    let title = "Friction: change against none, 60 mm in, base 20 mm before the entry, moved by 15 mm";
    let mut table = Table::new("friction", title, &factors, &axes).against("the same needle without friction");
    for tissue in TISSUES {
        for slope in SLOPES {
            let base = Base {
                displacement_mm: 15.0,
                slope: Some(slope),
            };
            let mut needle = problem(tissue.material, tissue.compression, 20.0, 60.0, ELEMENT_MM);
            let smooth = solve(&needle, &base)?;
            for friction in FRICTION {
                needle.layers[0].friction = friction;
                let rough = solve(&needle, &base)?;
                let com = rough
                    .com_mm()
                    .zip(smooth.com_mm())
                    .map(|(rough, smooth)| rough - smooth);
                let values = vec![
                    Some(friction),
                    Some(rough.tip_mm() - smooth.tip_mm()),
                    Some(apart(&rough, &smooth)),
                    com,
                ];
                let choices = vec![tissue.name.to_owned(), format!("slope {slope}"), format!("{friction}")];
                table.push(choices, values, None);
            }
        }
    }
    Ok(table)
}

/// Compares solutions with and without the term in the presence of friction.
pub(super) fn term() -> Result<Table, BeamError> {
    let axes = [
        Axis::log("median_ms", "ms", "time of a solution (median), ms"),
        Axis::log("p95_ms", "p95 ms", "time of a solution (95th percentile), ms"),
        Axis::log("error_mm", "error mm", "largest error of the deflection, mm"),
    ];
    let factors = [
        Factor::new("friction", "friction gamma"),
        Factor::new("tissue", "tissue"),
        Factor::new("slope", "slope"),
        Factor::new("term", "friction term"),
    ];
    let goal = Goal::new("median_ms", "error_mm", SHIFT_MM).choosing("friction term of a beam");
    let title = "Friction: the term left out where there is friction";
    let mut table = Table::new("friction-term", title, &factors, &axes)
        .against(format!("the term kept, elements of {FINE_MM} mm"))
        .seeking(goal.each(&["friction"]).over(&["tissue", "slope"]).beside(&["p95_ms"]));
    for friction in FRICTION.into_iter().filter(|gamma| *gamma > 0.0) {
        for tissue in TISSUES {
            for slope in SLOPES {
                let base = Base {
                    displacement_mm: 15.0,
                    slope: Some(slope),
                };
                let of = |element_mm: f64, friction: f64| {
                    let mut needle = problem(tissue.material, tissue.compression, 20.0, 60.0, element_mm);
                    needle.layers[0].friction = friction;
                    needle
                };
                let truth = solve(&of(FINE_MM, friction), &base)?;
                for (term, gamma) in [("left out", 0.0), ("kept", friction)] {
                    let mut beam = FoundationBeam::new(&of(ELEMENT_MM, gamma))?;
                    let shape = beam.solve(&base)?;
                    let time = Spread::of_runs(REPEATS, || beam.solve(black_box(&base)))?;
                    let choices = [
                        friction.to_string(),
                        tissue.name.to_owned(),
                        format!("slope {slope}"),
                        term.to_owned(),
                    ];
                    let values = [
                        time.map(|time| time.median_ms),
                        time.map(|time| time.p95_ms),
                        Some(apart(&shape, &truth)),
                    ];
                    table.push(choices.to_vec(), values.to_vec(), None);
                }
            }
        }
    }
    Ok(table)
}

pub(super) fn friction_figures() -> Vec<Figure> {
    vec![Figure {
        marker: vec!["tissue"],
        ..Figure::new(
            "beam-friction",
            "Friction: how far it moves the needle",
            "friction",
            ["gamma", "shape_mm"],
            "slope",
        )
    }]
}

#[cfg(test)]
mod tests;
