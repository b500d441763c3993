//! Models of tissue around a beam, and of a needle in tissue.

use std::time::Instant;

use nalgebra::{Isometry3, Vector3};

use super::{Axis, Choice, Column, FINE_MM, Factor, solve};
use crate::beam::{CONTROLS_MM, DEPTHS_MM, DISPLACEMENTS_MM, ELEMENT_MM, TISSUES, Tissue, problem};
use crate::tradeoff::{Figure, Goal, SHIFT_MM, Table};
use insonify_base::range::OutOfRange;
use insonify_base::statistics::{Spread, percentile};
use insonify_mechanics::needle::beam::{Base, BeamError, Compression, FoundationBeam, Material};
use insonify_mechanics::needle::{CentreLine, Flexible, Load, Needle, Row, Shaft, Stiffness};

const LENGTHS_MM: [f64; 5] = [20.0, 10.0, 5.0, 2.0, 1.0];
/// Element length of the reference needle, mm.
const FINE_NEEDLE_MM: f64 = 0.25;
/// Number of contacts along the inserted half of the needle. Each pushes as tissue does: in one direction near the
/// entry, in the opposite one at the tip.
const CONTACTS: usize = 20;
/// Number of timed calls.
const REPEATS: usize = 41;
/// Number of calls after which the lever arms follow the bent shape.
const CALLS: usize = 60;

/// A needle in pieces of a length.
struct NeedleRow {
    model: &'static str,
    length_mm: f64,
    time: Option<Spread>,
    error_mm: f64,
    tip_mm: f64,
}

const NEEDLE_CHOICES: [Choice<NeedleRow>; 2] = [
    Factor::new("model", "needle").of(|row| row.model.to_owned()),
    Factor::new("length", "link or element").of(|row| format!("{} mm", row.length_mm)),
];

const NEEDLE_COLUMNS: [Column<NeedleRow>; 5] = [
    Axis::log("length_mm", "length mm", "length of a link or an element, mm").of(|row| Some(row.length_mm)),
    Axis::log(
        "median_ms",
        "ms",
        "time of shape and flexibility at 20 contacts (median), ms",
    )
    .of(|row| Some(row.time?.median_ms)),
    Axis::log(
        "p95_ms",
        "p95 ms",
        "time of shape and flexibility at 20 contacts (95th percentile), ms",
    )
    .of(|row| Some(row.time?.p95_ms)),
    Axis::log("error_mm", "error mm", "largest error of the shaft, mm").of(|row| Some(row.error_mm)),
    Axis::log("tip_mm", "tip mm", "error of the tip, mm").of(|row| Some(row.tip_mm)),
];

pub(super) fn table() -> Result<Table, OutOfRange> {
    let beam = |length| Flexible::beam(Shaft::default(), Stiffness::default(), length, None);
    let truth = bent(&mut beam(FINE_NEEDLE_MM)?);
    let mut rows = Vec::new();
    for length_mm in LENGTHS_MM {
        let springs = Flexible::springs(Shaft::default(), Stiffness::default(), length_mm, None)?;
        let models: [(&str, Box<dyn Needle>); 2] =
            [("springs", Box::new(springs)), ("beam", Box::new(beam(length_mm)?))];
        for (model, mut needle) in models {
            let line = bent(&mut *needle);
            let distances = (0..=200).map(|arc| {
                let [point, exact] = [&line, &truth].map(|line| line.point_at_arc(f64::from(arc)).point_mm);
                (point - exact).norm()
            });
            rows.push(NeedleRow {
                model,
                length_mm,
                error_mm: distances.fold(0.0, f64::max),
                tip_mm: (line.tip() - truth.tip()).norm(),
                time: time(&mut *needle, line),
            });
        }
    }
    let title = "Models of a needle in insertion: 200 mm, EI 6131 N mm^2, bent by 20 contacts";
    let goal = Goal::new("median_ms", "error_mm", SHIFT_MM)
        .choosing("springs or a beam as the model of a needle, at one length of its pieces")
        .each(&["length"])
        .beside(&["p95_ms"]);
    Ok(Table::of("needles", title, &NEEDLE_CHOICES, &NEEDLE_COLUMNS, &rows)
        .against(format!("a beam in elements of {FINE_NEEDLE_MM} mm"))
        .seeking(goal))
}

fn loads() -> Vec<Load> {
    let load = |contact: usize| {
        let share = contact as f64 / (CONTACTS - 1) as f64;
        Load {
            arc_mm: 100.0 + 100.0 * share,
            force_n: Vector3::new(0.05 - 0.08 * share, 0.002, -0.002),
        }
    };
    (0..CONTACTS).map(load).collect()
}

/// Returns the equilibrium shape under the loads, with updated lever arms.
fn bent(needle: &mut dyn Needle) -> CentreLine {
    let (loads, mut line) = (loads(), CentreLine::default());
    for _ in 0..CALLS {
        needle.place(&Isometry3::identity(), None, &loads, &loads, &mut line);
    }
    line
}

/// Times the computation of a shape and its flexibility.
fn time(needle: &mut dyn Needle, mut line: CentreLine) -> Option<Spread> {
    let loads = loads();
    let rows = loads.iter().flat_map(|load| {
        [Vector3::x(), Vector3::y()].map(|direction| Row {
            arc_mm: load.arc_mm,
            direction,
        })
    });
    let rows: Vec<Row> = rows.collect();
    let (mut drift, mut out) = (vec![0.0; rows.len()], vec![0.0; rows.len() * rows.len()]);
    let times = (0..REPEATS).map(|_| {
        let start = Instant::now();
        needle.place(&Isometry3::identity(), None, &loads, &loads, &mut line);
        needle.linearise(&line, &loads, &rows, &mut drift, &mut out);
        start.elapsed().as_secs_f64() * 1e3
    });
    Spread::of(times.collect())
}

pub(super) fn figures() -> Vec<Figure> {
    vec![Figure {
        marker: vec!["length"],
        joined: false,
        ..Figure::new(
            "beam-needles",
            "Springs and beam: what accuracy costs",
            "needles",
            ["median_ms", "error_mm"],
            "model",
        )
    }]
}

/// Motion of the base, and the resulting tip position.
struct Truth {
    control_mm: f64,
    base: Base,
    tip_mm: f64,
}

/// A model of the tissue, with the errors of the tip over all base motions.
struct ModelRow {
    tissue: &'static str,
    compression: Compression,
    parameters: &'static str,
    depth_mm: f64,
    /// Ascending, mm.
    errors_mm: Result<Vec<f64>, BeamError>,
}

const MODEL_CHOICES: [Choice<ModelRow>; 4] = [
    Factor::new("tissue", "tissue").of(|row| row.tissue.to_owned()),
    Factor::new("compression", "compression").of(|row| row.compression.name().to_owned()),
    Factor::new("parameters", "parameters").of(|row| row.parameters.to_owned()),
    Factor::new("depth", "depth").of(|row| format!("{} mm", row.depth_mm)),
];

const MODEL_COLUMNS: [Column<ModelRow>; 3] = [
    Axis::linear("inserted_mm", "l mm", "inserted depth, mm").of(|row| Some(row.depth_mm)),
    Axis::linear(
        "median_mm",
        "median mm",
        "error of the tip (median over base motions), mm",
    )
    .of(|row| percentile(row.errors_mm.as_ref().ok()?, 0.5)),
    Axis::linear("largest_mm", "largest mm", "error of the tip (largest), mm")
        .of(|row| row.errors_mm.as_ref().ok()?.last().copied()),
];

pub(super) fn models_table() -> Result<Table, BeamError> {
    let mut rows = Vec::new();
    for (tissue, other) in [(TISSUES[0], TISSUES[1]), (TISSUES[1], TISSUES[0])] {
        for depth_mm in DEPTHS_MM {
            let truths = truths(&tissue, depth_mm)?;
            for compression in Compression::ALL {
                rows.extend(materials(&tissue, &other).map(|(parameters, material)| ModelRow {
                    tissue: tissue.name,
                    compression,
                    parameters,
                    depth_mm,
                    errors_mm: errors(&truths, material, compression, depth_mm),
                }));
            }
        }
    }
    let title = "Models: error of the tip over base motions of 2.5 to 15 mm, 20 and 40 mm before the entry";
    let gold = format!("UEng for PVC and UTru for PSM with the right parameters, elements of {FINE_MM} mm");
    Ok(Table::of("models", title, &MODEL_CHOICES, &MODEL_COLUMNS, &rows)
        .flagged(&rows, |row| Some(row.errors_mm.as_ref().err()?.to_string()))
        .against(gold))
}

/// Returns the parameters to compare: the right ones, wrong moduli, and those of the other tissue.
fn materials(tissue: &Tissue, other: &Tissue) -> [(&'static str, Material); 4] {
    [
        ("right", tissue.material),
        ("mu x 0.5", tissue.material.scaled(0.5, 1.0)),
        ("mu x 2", tissue.material.scaled(2.0, 1.0)),
        ("swapped", other.material),
    ]
}

/// Returns the motion of a freely rotating base in the true tissue.
fn truths(tissue: &Tissue, depth: f64) -> Result<Vec<Truth>, BeamError> {
    let mut truths = Vec::new();
    for control_mm in CONTROLS_MM {
        let needle = problem(tissue.material, tissue.compression, control_mm, depth, FINE_MM);
        let mut beam = FoundationBeam::new(&needle)?;
        for displacement_mm in DISPLACEMENTS_MM {
            let shape = beam.solve(&Base {
                displacement_mm,
                slope: None,
            })?;
            truths.push(Truth {
                control_mm,
                base: Base {
                    displacement_mm,
                    slope: Some(shape.points[0].slope),
                },
                tip_mm: shape.tip_mm(),
            });
        }
    }
    Ok(truths)
}

/// Returns the errors of the tip with a model, mm, ascending.
fn errors(truths: &[Truth], material: Material, compression: Compression, depth: f64) -> Result<Vec<f64>, BeamError> {
    let errors = truths.iter().map(|truth| {
        let needle = problem(material, compression, truth.control_mm, depth, ELEMENT_MM);
        Ok((solve(&needle, &truth.base)?.tip_mm() - truth.tip_mm).abs())
    });
    let mut errors = errors.collect::<Result<Vec<f64>, BeamError>>()?;
    errors.sort_by(f64::total_cmp);
    Ok(errors)
}

pub(super) fn models_figures() -> Vec<Figure> {
    let figure = |tissue: &str| Figure {
        marker: vec!["parameters"],
        only: vec![("tissue", tissue.to_owned())],
        ..Figure::new(
            format!("beam-models-{}", tissue.to_lowercase()),
            format!("Models of tissue, {tissue}: error of the tip"),
            "models",
            ["inserted_mm", "median_mm"],
            "compression",
        )
    };
    TISSUES.map(|tissue| figure(tissue.name)).to_vec()
}
