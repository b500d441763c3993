//! Beam on a hyperelastic foundation: effect and cost of element length, friction, and material and compression model.
//! The last is the study of figures 7 and 8 of Wang et al. 2023, in which the truth was measured; here it is a fine
//! solution by this program, so that only the choice differs. Finally, springs and beam are compared as needle models
//! in insertion.

mod needles;

use std::hint::black_box;

use super::entry::{About, Backends, Context, Entry, StudyOption};
use super::{Axis, Choice, Column, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use crate::beam::{ELEMENT_MM, INITIAL_LENGTH_MM, TISSUES, problem};
use insonify_base::machine::Machine;
use insonify_base::statistics::Spread;
use insonify_mechanics::needle::beam::{Base, BeamError, Compression, FoundationBeam, Problem, Shape};

/// Registration of this study.
pub(crate) const ENTRY: Entry<()> = Entry {
    about: About {
        name: "beam",
        title: "The needle as a beam",
        question: "How long may elements be, what does friction along the shaft do to its shape, how well must the tissue be known, and are \
                   springs enough?",
        help: "Needle as a beam in tissue: element length, friction, tissue models",
        examples: "\
Examples:
  insonify tradeoff beam                 tables: length of elements, friction, models of tissue
  insonify tradeoff beam -o study        and plots
  insonify tradeoff beam --json

A row with a star is a best choice: no other is both faster and nearer to the truth.",
        backends: Backends::Cpu,
    },
    options: &[StudyOption::<()>::quick("No effect: this study takes a fraction of a second").hidden()],
    settings: |_| (),
    in_report: |_| (),
    run: |(), Context { progress, .. }| {
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
pub(crate) fn study() -> Result<Study, BeamError> {
    let tables = vec![
        elements_table()?,
        friction_table()?,
        term()?,
        needles::models_table()?,
        needles::table()?,
    ];
    Ok(Study {
        name: "tradeoff-beam",
        title: ENTRY.about.title,
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
fn largest_distance_mm(shape: &Shape, other: &Shape) -> f64 {
    let distances = shape
        .points
        .iter()
        .map(|point| (point.u_mm - other.at(point.x_mm)[0]).abs());
    distances.fold(0.0, f64::max)
}

const ELEMENTS_MM: [f64; 5] = [5.0, 2.0, 1.0, 0.5, FINE_MM];
/// Number of timed solutions.
const REPEATS: usize = 41;

const MEDIAN: Axis = Axis::log("median_ms", "ms", "time of a solution (median), ms");
const P95: Axis = Axis::log("p95_ms", "p95 ms", "time of a solution (95th percentile), ms");
const ERROR: Axis = Axis::log("error_mm", "error mm", "largest error of the deflection, mm");

/// A solution in elements of a length.
struct ElementRow {
    case: &'static str,
    element_mm: f64,
    shape: Shape,
    time: Option<Spread>,
    /// Largest error of the deflection, mm; `None` for the finest elements.
    error_mm: Option<f64>,
}

const ELEMENT_CHOICES: [Choice<ElementRow>; 2] = [
    Factor::new("case", "case").of(|row| row.case.to_owned()),
    Factor::new("element_mm", "element").of(|row| format!("{} mm", row.element_mm)),
];

const ELEMENT_COLUMNS: [Column<ElementRow>; 5] = [
    Axis::log("elements", "elements", "elements").of(|row| Some((row.shape.points.len() - 1) as f64)),
    MEDIAN.of(|row| Some(row.time?.median_ms)),
    P95.of(|row| Some(row.time?.p95_ms)),
    ERROR.of(|row| row.error_mm),
    Axis::linear("iterations", "Newton", "Newton steps").of(|row| Some(row.shape.iterations as f64)),
];

pub(super) fn elements_table() -> Result<Table, BeamError> {
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
    let mut rows = Vec::new();
    for (case, material, compression, initial_length_mm) in cases {
        let problem_of = |element_mm: f64| {
            let mut problem = problem(material, compression, 20.0, 60.0, element_mm);
            problem.layers[0].initial_length_mm = initial_length_mm;
            problem
        };
        let truth = solve(&problem_of(FINE_MM), &base)?;
        for element_mm in ELEMENTS_MM {
            let mut beam = FoundationBeam::new(&problem_of(element_mm))?;
            let shape = beam.solve(&base)?;
            rows.push(ElementRow {
                case,
                element_mm,
                time: Spread::of_runs(REPEATS, || beam.solve(black_box(&base)))?,
                // The finest elements are the truth: their distance from themselves is no measurement.
                error_mm: (element_mm > FINE_MM).then(|| largest_distance_mm(&shape, &truth)),
                shape,
            });
        }
    }
    let title = "Length of elements: 60 mm in, base 20 mm before the entry, moved by 15 mm, slope -0.2";
    let goal = Goal::new("median_ms", "error_mm", SHIFT_MM)
        .over(&["case"])
        .choosing("elements of a beam alone in tissue (insonify beam)")
        .beside(&["p95_ms"]);
    Ok(Table::of("elements", title, &ELEMENT_CHOICES, &ELEMENT_COLUMNS, &rows)
        .gold_where(&rows, |row| row.element_mm == FINE_MM)
        .against(format!("elements of {FINE_MM} mm"))
        .seeking(goal))
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

/// A needle with friction beside the one without.
struct FrictionRow {
    tissue: &'static str,
    slope: f64,
    friction: f64,
    /// Changes of the tip, of the whole deflection (largest) and of the centre of motion's depth, mm.
    tip_mm: f64,
    shape_mm: f64,
    com_mm: Option<f64>,
}

const FRICTION_CHOICES: [Choice<FrictionRow>; 3] = [
    Factor::new("tissue", "tissue").of(|row| row.tissue.to_owned()),
    Factor::new("slope", "slope").of(|row| format!("slope {}", row.slope)),
    Factor::new("friction", "friction").of(|row| row.friction.to_string()),
];

const FRICTION_COLUMNS: [Column<FrictionRow>; 4] = [
    Axis::linear("gamma", "gamma", "friction, gamma").of(|row| Some(row.friction)),
    Axis::linear(
        "tip_mm",
        "tip mm",
        "change of the tip's deflection against no friction, mm",
    )
    .of(|row| Some(row.tip_mm)),
    Axis::linear("shape_mm", "shape mm", "largest change of the deflection, mm").of(|row| Some(row.shape_mm)),
    Axis::linear("com_mm", "COM mm", "change of the centre of motion's depth, mm").of(|row| row.com_mm),
];

pub(super) fn friction_table() -> Result<Table, BeamError> {
    let mut rows = Vec::new();
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
                let com_mm = rough.com_mm().zip(smooth.com_mm());
                rows.push(FrictionRow {
                    tissue: tissue.name,
                    slope,
                    friction,
                    tip_mm: rough.tip_mm() - smooth.tip_mm(),
                    shape_mm: largest_distance_mm(&rough, &smooth),
                    com_mm: com_mm.map(|(rough, smooth)| rough - smooth),
                });
            }
        }
    }
    let title = "Friction: change against none, 60 mm in, base 20 mm before the entry, moved by 15 mm";
    Ok(
        Table::of("friction", title, &FRICTION_CHOICES, &FRICTION_COLUMNS, &rows)
            .against("the same needle without friction"),
    )
}

/// A solution with the friction term or without.
struct TermRow {
    friction: f64,
    tissue: &'static str,
    slope: f64,
    term: &'static str,
    time: Option<Spread>,
    error_mm: f64,
}

const TERM_CHOICES: [Choice<TermRow>; 4] = [
    Factor::new("friction", "friction gamma").of(|row| row.friction.to_string()),
    Factor::new("tissue", "tissue").of(|row| row.tissue.to_owned()),
    Factor::new("slope", "slope").of(|row| format!("slope {}", row.slope)),
    Factor::new("term", "friction term").of(|row| row.term.to_owned()),
];

const TERM_COLUMNS: [Column<TermRow>; 3] = [
    MEDIAN.of(|row| Some(row.time?.median_ms)),
    P95.of(|row| Some(row.time?.p95_ms)),
    ERROR.of(|row| Some(row.error_mm)),
];

/// Compares solutions with and without the term in the presence of friction.
pub(super) fn term() -> Result<Table, BeamError> {
    let mut rows = Vec::new();
    for friction in FRICTION.into_iter().filter(|gamma| *gamma > 0.0) {
        for tissue in TISSUES {
            for slope in SLOPES {
                let base = Base {
                    displacement_mm: 15.0,
                    slope: Some(slope),
                };
                let problem_of = |element_mm: f64, friction: f64| {
                    let mut needle = problem(tissue.material, tissue.compression, 20.0, 60.0, element_mm);
                    needle.layers[0].friction = friction;
                    needle
                };
                let truth = solve(&problem_of(FINE_MM, friction), &base)?;
                for (term, gamma) in [("left out", 0.0), ("kept", friction)] {
                    let mut beam = FoundationBeam::new(&problem_of(ELEMENT_MM, gamma))?;
                    let shape = beam.solve(&base)?;
                    rows.push(TermRow {
                        friction,
                        tissue: tissue.name,
                        slope,
                        term,
                        time: Spread::of_runs(REPEATS, || beam.solve(black_box(&base)))?,
                        error_mm: largest_distance_mm(&shape, &truth),
                    });
                }
            }
        }
    }
    let goal = Goal::new("median_ms", "error_mm", SHIFT_MM).choosing("friction term of a beam");
    let title = "Friction: the term left out where there is friction";
    Ok(Table::of("friction-term", title, &TERM_CHOICES, &TERM_COLUMNS, &rows)
        .against(format!("the term kept, elements of {FINE_MM} mm"))
        .seeking(goal.each(&["friction"]).over(&["tissue", "slope"]).beside(&["p95_ms"])))
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
