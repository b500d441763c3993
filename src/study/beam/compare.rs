//! Measured needles against computed ones: figures 6 to 8 and Table I of Wang et al. 2023 for a user's own scans.

use super::measure::crossing;
use crate::beam_case::BeamCase;
use crate::tradeoff::{Axis, Factor, Figure, Study, Table};
use insonify_base::machine::Machine;
use insonify_base::statistics::{mean, percentile, std};
use insonify_mechanics::needle::beam::{Base, BeamError, BeamLayer, FoundationBeam, Problem, Shape};

/// Inserted depths are grouped to multiples of this, mm.
const DEPTH_GROUP_MM: f64 = 10.0;
/// Control distances are grouped to multiples of this, mm.
const CONTROL_GROUP_MM: f64 = 10.0;

/// Axes of the cases.
const CASES: [Axis; 10] = [
    Axis::linear("control_distance_mm", "s mm", "base before the entry, mm"),
    Axis::linear("inserted_mm", "l mm", "inserted depth, mm"),
    Axis::linear("displacement_mm", "base mm", "displacement of the base, mm"),
    Axis::linear("rcm_mm", "RCM mm", "RCM as measured, mm below the entry"),
    Axis::linear("rcm_free_mm", "RCM free", "RCM of a free base, mm below the entry"),
    Axis::linear("com_measured_mm", "COM meas.", "COM as measured, mm below the entry"),
    Axis::linear("com_mm", "COM mm", "COM, mm below the entry"),
    Axis::linear("tip_mm", "tip mm", "deflection of the tip as measured, mm"),
    Axis::linear("tip_error_mm", "tip error", "error of the tip, mm"),
    Axis::linear("shape_rms_mm", "shape RMS", "RMS error of the shape, mm"),
];

/// Layers of another case, the last as thick as the needle needs.
fn reaching(layers: &[BeamLayer], inserted_mm: f64) -> Vec<BeamLayer> {
    let mut layers = layers.to_vec();
    let sum: f64 = layers.iter().map(|layer| layer.thickness_mm).sum();
    if let Some(last) = layers.last_mut() {
        last.thickness_mm += (inserted_mm - sum).max(0.0);
    }
    layers
}

/// Values of [`CASES`] for the layers of a tissue.
fn compared(case: &BeamCase, problem: &Problem) -> Result<Vec<Option<f64>>, BeamError> {
    let mut beam = FoundationBeam::new(problem)?;
    let shape = beam.solve(&case.base)?;
    let moved = crossing(&case.measured_mm).is_some();
    let free = Base {
        slope: None,
        ..case.base
    };
    let natural = beam.solve(&free).ok().and_then(|shape| shape.rcm_mm());
    let deviation = |point: &[f64; 2]| point[1] - shape.at(point[0].min(problem.inserted_mm))[0];
    let squares: Vec<f64> = case.measured_mm.iter().map(|point| deviation(point).powi(2)).collect();
    let tip = case.measured_mm.last();
    Ok(vec![
        Some(problem.control_distance_mm),
        Some(problem.inserted_mm),
        Some(case.base.displacement_mm),
        shape.rcm_mm().filter(|_| moved),
        natural,
        crossing(&case.measured_mm),
        Shape::com_mm(&shape).filter(|_| moved),
        tip.map(|point| point[1]),
        tip.map(|point| deviation(point).abs()),
        Some(mean(&squares).sqrt()),
    ])
}

/// Compares measured needles with computed ones: each case with its own tissue, and with that of other cases.
///
/// Cases have a measured shape; `tissues` lend their layers.
pub fn compare(cases: &[(String, BeamCase)], tissues: &[(String, BeamCase)]) -> Study {
    let factors = [
        Factor::new("case", "case"),
        Factor::new("tissue", "tissue"),
        Factor::new("depth", "depth, mm"),
    ];
    let title = "Measured needles against computed ones";
    let mut table = Table::new("cases", title, &factors, &CASES);
    for (name, case) in cases {
        let with_its_tissue = std::iter::once(("own".to_owned(), case.problem.clone()));
        let with_other_tissues = tissues.iter().map(|(name, other)| {
            let mut problem = case.problem.clone();
            problem.layers = reaching(&other.problem.layers, problem.inserted_mm);
            (name.clone(), problem)
        });
        for (tissue, problem) in with_its_tissue.chain(with_other_tissues) {
            // Hardly two measured needles are equally deep: without rounding
            // every group would have one needle.
            let depth = (problem.inserted_mm / DEPTH_GROUP_MM).round() * DEPTH_GROUP_MM;
            let choices = vec![name.clone(), tissue, depth.to_string()];
            match compared(case, &problem) {
                Ok(values) => table.push(choices, values, None),
                Err(error) => table.push(choices, vec![None; CASES.len()], Some(error.to_string())),
            }
        }
    }
    Study {
        name: "beam-compare",
        title: "Measured and computed needles",
        about: vec![
            ("cases", cases.len().to_string()),
            (
                "depths",
                format!("grouped to {DEPTH_GROUP_MM} mm, distances of the base to {CONTROL_GROUP_MM} mm"),
            ),
            (
                "error of the tip",
                "measured less computed deflection, magnitude".to_owned(),
            ),
        ],
        machine: Machine::here(),
        tables: vec![errors(&table), centres(&table), distribution(&table), table],
        figures: figures(),
        notes: Vec::new(),
    }
}

fn figures() -> Vec<Figure> {
    let scatter = |file: &'static str, title: &str, y: &'static str| Figure {
        joined: false,
        ..Figure::new(file, title, "cases", ["inserted_mm", y], "tissue")
    };
    vec![
        Figure {
            marker: vec!["depth"],
            ..Figure::new(
                "beam-compare-distribution",
                "Share of needles by error of the tip",
                "distribution",
                ["tip_error_mm", "share"],
                "tissue",
            )
        },
        scatter("beam-compare-tip", "Error of the tip by depth", "tip_error_mm"),
        scatter("beam-compare-shape", "RMS error of the shape by depth", "shape_rms_mm"),
        Figure {
            joined: false,
            marker: vec!["tissue"],
            ..Figure::new(
                "beam-compare-com",
                "COM computed against measured",
                "cases",
                ["com_measured_mm", "com_mm"],
                "depth",
            )
        },
    ]
}

/// Rows by tissue and another key, in the order of their first rows.
fn groups<'a>(
    table: &'a Table,
    key: impl Fn(&'a crate::tradeoff::Row) -> Vec<String>,
) -> Vec<(Vec<String>, Vec<&'a crate::tradeoff::Row>)> {
    let mut groups: Vec<(Vec<String>, Vec<_>)> = Vec::new();
    for row in table.rows.iter().filter(|row| row.flag.is_none()) {
        let key = key(row);
        match groups.iter_mut().find(|group| group.0 == key) {
            Some(group) => group.1.push(row),
            None => groups.push((key, vec![row])),
        }
    }
    groups
}

/// Numbers on an axis, ascending.
fn column(table: &Table, rows: &[&crate::tradeoff::Row], key: &str) -> Vec<f64> {
    let mut values: Vec<f64> = rows.iter().filter_map(|row| table.value(row, key)).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Errors by tissue and depth, and over all depths (figures 7 and 8).
fn errors(cases: &Table) -> Table {
    let axes = [
        Axis::linear("count", "needles", "needles"),
        Axis::linear("mean_mm", "mean", "mean error of the tip, mm"),
        Axis::linear("median_mm", "median", "median error of the tip, mm"),
        Axis::linear("max_mm", "max", "largest error of the tip, mm"),
        Axis::linear("variance_mm2", "variance", "variance of the error of the tip, mm^2"),
        Axis::linear("shape_rms_mm", "shape RMS", "mean RMS error of the shape, mm"),
    ];
    let factors = [Factor::new("tissue", "tissue"), Factor::new("depth", "depth, mm")];
    let mut table = Table::new("errors", "Errors of the tip, mm", &factors, &axes);
    let all = groups(cases, |row| vec![row.choices[1].clone(), "all".to_owned()]);
    for (key, rows) in groups(cases, |row| row.choices[1..].to_vec()).into_iter().chain(all) {
        let errors = column(cases, &rows, "tip_error_mm");
        let values = vec![
            Some(errors.len() as f64),
            Some(mean(&errors)),
            percentile(&errors, 0.5),
            errors.last().copied(),
            (errors.len() > 1).then(|| std(&errors).powi(2)),
            Some(mean(&column(cases, &rows, "shape_rms_mm"))),
        ];
        table.push(key, values, None);
    }
    table
}

/// Mean centres of motion by tissue, distance of the base and depth (Table I).
fn centres(cases: &Table) -> Table {
    let axes = [
        Axis::linear("count", "needles", "needles"),
        Axis::linear("rcm_mm", "RCM", "RCM as measured, mm"),
        Axis::linear("rcm_free_mm", "RCM free", "RCM of a free base, mm"),
        Axis::linear("com_measured_mm", "COM measured", "COM as measured, mm"),
        Axis::linear("com_mm", "COM here", "COM, mm"),
    ];
    let factors = [
        Factor::new("tissue", "tissue"),
        Factor::new("control", "base before entry, mm"),
        Factor::new("depth", "depth, mm"),
    ];
    let mut table = Table::new("centres", "Mean centres of motion, mm below the entry", &factors, &axes);
    let key = |row: &crate::tradeoff::Row| {
        let control = cases.value(row, "control_distance_mm").unwrap_or(f64::NAN);
        let control = (control / CONTROL_GROUP_MM).round() * CONTROL_GROUP_MM;
        vec![row.choices[1].clone(), control.to_string(), row.choices[2].clone()]
    };
    for (key, rows) in groups(cases, key) {
        let middle = |key: &str| {
            Some(column(cases, &rows, key))
                .filter(|values| !values.is_empty())
                .map(|values| mean(&values))
        };
        let means = axes[1..].iter().map(|axis| middle(axis.key));
        let values = std::iter::once(Some(rows.len() as f64)).chain(means).collect();
        table.push(key, values, None);
    }
    table
}

/// Share of the needles whose tip errs by at most this distance.
fn distribution(cases: &Table) -> Table {
    let axes = [
        Axis::linear("tip_error_mm", "error mm", "error of the tip, mm"),
        Axis::linear("share", "share", "share of the needles"),
    ];
    let factors = [Factor::new("tissue", "tissue"), Factor::new("depth", "depth, mm")];
    let mut table = Table::trace("distribution", "Distribution of the error of the tip", &factors, &axes);
    for (key, rows) in groups(cases, |row| row.choices[1..].to_vec()) {
        let errors = column(cases, &rows, "tip_error_mm");
        for (index, error) in errors.iter().enumerate() {
            let share = (index + 1) as f64 / errors.len() as f64;
            table.push(key.clone(), vec![Some(*error), Some(share)], None);
        }
    }
    table
}
