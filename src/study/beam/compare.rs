//! Measured needles against computed ones: figures 6 to 8 and Table I of Wang et al. 2023 for a user's own scans.

use super::measure::crossing;
use crate::beam_case::BeamCase;
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Study, Table};
use insonify_base::machine::Machine;
use insonify_base::statistics::{mean, percentile, std};
use insonify_mechanics::needle::beam::{Base, BeamError, BeamLayer, FoundationBeam, Problem};

/// Inserted depths are grouped to multiples of this, mm.
const DEPTH_GROUP_MM: f64 = 10.0;
/// Control distances are grouped to multiples of this, mm.
const CONTROL_GROUP_MM: f64 = 10.0;

/// A measured needle and the computed one with a tissue.
struct CaseRow {
    case: String,
    tissue: String,
    /// Inserted depth and control distance, rounded to their groups, mm.
    depth_mm: f64,
    control_mm: f64,
    /// Figures, or why the needle has no shape.
    compared: Result<Compared, String>,
}

/// Figures of a measured and a computed needle, mm; centres of motion below the entry.
struct Compared {
    control_distance_mm: f64,
    inserted_mm: f64,
    displacement_mm: f64,
    rcm_mm: Option<f64>,
    rcm_free_mm: Option<f64>,
    com_measured_mm: Option<f64>,
    com_mm: Option<f64>,
    tip_mm: Option<f64>,
    tip_error_mm: Option<f64>,
    shape_rms_mm: f64,
}

impl CaseRow {
    fn value(&self, value: impl Fn(&Compared) -> Option<f64>) -> Option<f64> {
        self.compared.as_ref().ok().and_then(value)
    }
}

const CHOICES: [Choice<CaseRow>; 3] = [
    Factor::new("case", "case").of(|row| row.case.clone()),
    TISSUE.of(|row| row.tissue.clone()),
    DEPTH.of(|row| row.depth_mm.to_string()),
];
const TISSUE: Factor = Factor::new("tissue", "tissue");
const DEPTH: Factor = Factor::new("depth", "depth, mm");

const CASES: [Column<CaseRow>; 10] = [
    Axis::linear("control_distance_mm", "s mm", "base before the entry, mm")
        .of(|row| row.value(|needle| Some(needle.control_distance_mm))),
    Axis::linear("inserted_mm", "l mm", "inserted depth, mm").of(|row| row.value(|needle| Some(needle.inserted_mm))),
    Axis::linear("displacement_mm", "base mm", "displacement of the base, mm")
        .of(|row| row.value(|needle| Some(needle.displacement_mm))),
    Axis::linear("rcm_mm", "RCM mm", "RCM as measured, mm below the entry").of(|row| row.value(|needle| needle.rcm_mm)),
    Axis::linear("rcm_free_mm", "RCM free", "RCM of a free base, mm below the entry")
        .of(|row| row.value(|needle| needle.rcm_free_mm)),
    Axis::linear("com_measured_mm", "COM meas.", "COM as measured, mm below the entry")
        .of(|row| row.value(|needle| needle.com_measured_mm)),
    Axis::linear("com_mm", "COM mm", "COM, mm below the entry").of(|row| row.value(|needle| needle.com_mm)),
    Axis::linear("tip_mm", "tip mm", "deflection of the tip as measured, mm")
        .of(|row| row.value(|needle| needle.tip_mm)),
    Axis::linear("tip_error_mm", "tip error", "error of the tip, mm").of(|row| row.value(|needle| needle.tip_error_mm)),
    Axis::linear("shape_rms_mm", "shape RMS", "RMS error of the shape, mm")
        .of(|row| row.value(|needle| Some(needle.shape_rms_mm))),
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

/// Compares a measured needle with that computed in the layers of a tissue.
fn compared(case: &BeamCase, problem: &Problem) -> Result<Compared, BeamError> {
    let mut beam = FoundationBeam::new(problem)?;
    let shape = beam.solve(&case.base)?;
    let moved = crossing(&case.measured_mm).is_some();
    let free = Base {
        slope: None,
        ..case.base
    };
    let rcm_free_mm = beam.solve(&free).ok().and_then(|shape| shape.rcm_mm());
    let deviation = |point: &[f64; 2]| point[1] - shape.at(point[0].min(problem.inserted_mm))[0];
    let squares: Vec<f64> = case.measured_mm.iter().map(|point| deviation(point).powi(2)).collect();
    let tip = case.measured_mm.last();
    Ok(Compared {
        control_distance_mm: problem.control_distance_mm,
        inserted_mm: problem.inserted_mm,
        displacement_mm: case.base.displacement_mm,
        rcm_mm: shape.rcm_mm().filter(|_| moved),
        rcm_free_mm,
        com_measured_mm: crossing(&case.measured_mm),
        com_mm: shape.com_mm().filter(|_| moved),
        tip_mm: tip.map(|point| point[1]),
        tip_error_mm: tip.map(|point| deviation(point).abs()),
        shape_rms_mm: mean(&squares).sqrt(),
    })
}

/// The nearest multiple of a step. Hardly two needles are alike: without rounding every group would have one needle.
fn rounded(mm: f64, step_mm: f64) -> f64 {
    (mm / step_mm).round() * step_mm
}

/// Compares measured needles with computed ones: each case with its own tissue, and with that of other cases.
///
/// Cases have a measured shape; `tissues` lend their layers.
pub fn compare(cases: &[(String, BeamCase)], tissues: &[(String, BeamCase)]) -> Study {
    let mut rows = Vec::new();
    for (case_name, case) in cases {
        let with_its_tissue = std::iter::once(("own".to_owned(), case.problem.clone()));
        let with_other_tissues = tissues.iter().map(|(name, other)| {
            let mut problem = case.problem.clone();
            problem.layers = reaching(&other.problem.layers, problem.inserted_mm);
            (name.clone(), problem)
        });
        for (tissue, problem) in with_its_tissue.chain(with_other_tissues) {
            rows.push(CaseRow {
                case: case_name.clone(),
                tissue,
                depth_mm: rounded(problem.inserted_mm, DEPTH_GROUP_MM),
                control_mm: rounded(problem.control_distance_mm, CONTROL_GROUP_MM),
                compared: compared(case, &problem).map_err(|error| error.to_string()),
            });
        }
    }
    let title = "Measured needles against computed ones";
    let table =
        Table::of("cases", title, &CHOICES, &CASES, &rows).flagged(&rows, |row| row.compared.as_ref().err().cloned());
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
        tables: vec![errors(&rows), centres(&rows), distribution(&rows), table],
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

/// Computed needles by a key, in the order of their first rows.
fn groups<K: PartialEq>(rows: &[CaseRow], key: impl Fn(&CaseRow) -> K) -> Vec<(K, Vec<&CaseRow>)> {
    let mut groups: Vec<(K, Vec<&CaseRow>)> = Vec::new();
    for row in rows.iter().filter(|row| row.compared.is_ok()) {
        let key = key(row);
        match groups.iter_mut().find(|group| group.0 == key) {
            Some(group) => group.1.push(row),
            None => groups.push((key, vec![row])),
        }
    }
    groups
}

/// Values of some rows, ascending.
fn ascending(rows: &[&CaseRow], value: impl Fn(&Compared) -> Option<f64>) -> Vec<f64> {
    let mut values: Vec<f64> = rows.iter().filter_map(|row| row.value(&value)).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Needles in a tissue, as deep as each other (of all depths: `None`).
struct ErrorsRow {
    tissue: String,
    depth_mm: Option<f64>,
    /// Errors of the tip, ascending, mm.
    tip_errors_mm: Vec<f64>,
    /// Mean RMS error of the shape, mm.
    shape_rms_mm: f64,
}

const ERRORS_CHOICES: [Choice<ErrorsRow>; 2] = [
    TISSUE.of(|row| row.tissue.clone()),
    DEPTH.of(|row| row.depth_mm.map_or("all".to_owned(), |depth| depth.to_string())),
];

const ERRORS: [Column<ErrorsRow>; 6] = [
    Axis::linear("count", "needles", "needles").of(|row| Some(row.tip_errors_mm.len() as f64)),
    Axis::linear("mean_mm", "mean", "mean error of the tip, mm").of(|row| Some(mean(&row.tip_errors_mm))),
    Axis::linear("median_mm", "median", "median error of the tip, mm").of(|row| percentile(&row.tip_errors_mm, 0.5)),
    Axis::linear("max_mm", "max", "largest error of the tip, mm").of(|row| row.tip_errors_mm.last().copied()),
    Axis::linear("variance_mm2", "variance", "variance of the error of the tip, mm^2")
        .of(|row| (row.tip_errors_mm.len() > 1).then(|| std(&row.tip_errors_mm).powi(2))),
    Axis::linear("shape_rms_mm", "shape RMS", "mean RMS error of the shape, mm").of(|row| Some(row.shape_rms_mm)),
];

/// Errors by tissue and depth, and over all depths (figures 7 and 8).
fn errors(cases: &[CaseRow]) -> Table {
    let by_depth = groups(cases, |row| (row.tissue.clone(), Some(row.depth_mm)));
    let all = groups(cases, |row| (row.tissue.clone(), None));
    let rows: Vec<ErrorsRow> = by_depth
        .into_iter()
        .chain(all)
        .map(|((tissue, depth_mm), needles)| ErrorsRow {
            tissue,
            depth_mm,
            tip_errors_mm: ascending(&needles, |needle| needle.tip_error_mm),
            shape_rms_mm: mean(&ascending(&needles, |needle| Some(needle.shape_rms_mm))),
        })
        .collect();
    Table::of("errors", "Errors of the tip, mm", &ERRORS_CHOICES, &ERRORS, &rows)
}

/// Mean centres of motion of needles in a tissue, mm below the entry.
struct CentresRow {
    tissue: String,
    control_mm: f64,
    depth_mm: f64,
    count: usize,
    rcm_mm: Option<f64>,
    rcm_free_mm: Option<f64>,
    com_measured_mm: Option<f64>,
    com_mm: Option<f64>,
}

const CENTRES_CHOICES: [Choice<CentresRow>; 3] = [
    TISSUE.of(|row| row.tissue.clone()),
    Factor::new("control", "base before entry, mm").of(|row| row.control_mm.to_string()),
    DEPTH.of(|row| row.depth_mm.to_string()),
];

const CENTRES: [Column<CentresRow>; 5] = [
    Axis::linear("count", "needles", "needles").of(|row| Some(row.count as f64)),
    Axis::linear("rcm_mm", "RCM", "RCM as measured, mm").of(|row| row.rcm_mm),
    Axis::linear("rcm_free_mm", "RCM free", "RCM of a free base, mm").of(|row| row.rcm_free_mm),
    Axis::linear("com_measured_mm", "COM measured", "COM as measured, mm").of(|row| row.com_measured_mm),
    Axis::linear("com_mm", "COM here", "COM, mm").of(|row| row.com_mm),
];

/// Mean centres of motion by tissue, distance of the base and depth (Table I).
fn centres(cases: &[CaseRow]) -> Table {
    let groups = groups(cases, |row| (row.tissue.clone(), row.control_mm, row.depth_mm));
    let rows: Vec<CentresRow> = groups
        .into_iter()
        .map(|((tissue, control_mm, depth_mm), needles)| {
            let mean_of = |value: fn(&Compared) -> Option<f64>| {
                let values = ascending(&needles, value);
                (!values.is_empty()).then(|| mean(&values))
            };
            CentresRow {
                tissue,
                control_mm,
                depth_mm,
                count: needles.len(),
                rcm_mm: mean_of(|needle| needle.rcm_mm),
                rcm_free_mm: mean_of(|needle| needle.rcm_free_mm),
                com_measured_mm: mean_of(|needle| needle.com_measured_mm),
                com_mm: mean_of(|needle| needle.com_mm),
            }
        })
        .collect();
    let title = "Mean centres of motion, mm below the entry";
    Table::of("centres", title, &CENTRES_CHOICES, &CENTRES, &rows)
}

/// A needle among those in its tissue and as deep.
struct ShareRow {
    tissue: String,
    depth_mm: f64,
    tip_error_mm: f64,
    /// Share of the needles whose tip errs by at most as much.
    share: f64,
}

const SHARES_CHOICES: [Choice<ShareRow>; 2] = [
    TISSUE.of(|row| row.tissue.clone()),
    DEPTH.of(|row| row.depth_mm.to_string()),
];

const SHARES: [Column<ShareRow>; 2] = [
    Axis::linear("tip_error_mm", "error mm", "error of the tip, mm").of(|row| Some(row.tip_error_mm)),
    Axis::linear("share", "share", "share of the needles").of(|row| Some(row.share)),
];

/// Share of the needles whose tip errs by at most this distance.
fn distribution(cases: &[CaseRow]) -> Table {
    let mut rows = Vec::new();
    for ((tissue, depth_mm), needles) in groups(cases, |row| (row.tissue.clone(), row.depth_mm)) {
        let errors = ascending(&needles, |needle| needle.tip_error_mm);
        for (index, &tip_error_mm) in errors.iter().enumerate() {
            rows.push(ShareRow {
                tissue: tissue.clone(),
                depth_mm,
                tip_error_mm,
                share: (index + 1) as f64 / errors.len() as f64,
            });
        }
    }
    let title = "Distribution of the error of the tip";
    Table::of("distribution", title, &SHARES_CHOICES, &SHARES, &rows).unlisted()
}
