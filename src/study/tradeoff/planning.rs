//! Path planning and parameter identification: time saved and error added by two-dimensional tissue and by coarse
//! meshes.

use std::ops::ControlFlow;
use std::path::Path;
use std::time::Instant;

use nalgebra::{Point3, Vector3};

use super::entry::{About, Backends, Context, Entry, StudyOption};
use super::{Axis, Choice, Column, Factor, Figure, Goal, Study, Table};
use crate::identification::{CaseFile, IdentificationCase};
use crate::identify::identify_simulated;
use crate::path::{Entry as Entries, Goal as Target, PathOptions, liver, miss_mm, plan};
use crate::stability::Effort;
use insonify::Error;
use insonify::input::scenario::ScenarioFile;
use insonify_base::machine::Machine;

/// Registration of this study.
pub(crate) const ENTRY: Entry<Effort> = Entry {
    about: About {
        name: "planning",
        title: "Planned paths and identified tissue",
        question: "Is planning in a section by the image plane as accurate as in three dimensions, and how fine a mesh does the identification of moduli need?",
        help: "Paths planned in two and in three dimensions, and moduli identified with several meshes",
        examples: "\
Examples:
  insonify tradeoff planning --quick       coarse meshes
  insonify tradeoff planning -o study      meshes of up to 2000 nodes, with plots

A row with a star is a best choice: no other is both faster and nearer to the truth.",
        backends: Backends::Cpu,
    },
    options: &[StudyOption::quick("Coarse meshes")],
    settings: |effort| effort,
    in_report: |effort| effort,
    run: |effort, Context { progress, .. }| study(*effort, progress),
};

/// Angle of the planned line to the beam, degrees.
const ANGLE_DEG: f64 = -24.0;
/// Tolerance of a path, mm, with its reason.
const MISS_MM: (f64, &str) = (1.0, "a third of the 3 mm that paths keep from structures");
/// Tolerance of Young's moduli, percent, with its reason.
const MODULUS_PERCENT: (f64, &str) = (
    10.0,
    "half of the range of 30 to 36 kPa that rheometry of a phantom gave",
);
/// Case whose layers are sought from 50 % above and below what made the measurement.
const CASE: &str = "scenario = \"two-layer-insertion\"\nforce.file = \"force\"\nmotion.file = \"motion\"\n\
                    [[layer]]\nregion = \"phantom_top\"\nyoung_kpa = 15.0\n[[layer]]\nregion = \"phantom_inclusion\"\nyoung_kpa = 22.0\n";

/// Runs the study.
///
/// # Errors
/// [`Error`] if no path is found, or no insertion can be simulated.
pub(crate) fn study(effort: Effort, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<Study, Error> {
    let tables = vec![
        paths(effort, &mut |what, share| progress(what, 0.5 * share))?,
        identified(effort, &mut |what, share| progress(what, 0.5 + 0.5 * share))?,
    ];
    progress("done", 1.0);
    let figure = |file, title, table, error| Figure {
        joined: false,
        ..Figure::new(file, title, table, ["seconds", error], "tissue")
    };
    Ok(Study {
        name: "tradeoff-planning",
        title: ENTRY.about.title,
        about: vec![
            (
                "paths",
                "`liver-puncture`, to the middle of the vein, one line".to_owned(),
            ),
            ("moduli", "`two-layer-insertion`, measured without errors".to_owned()),
        ],
        machine: Machine::here(),
        tables,
        figures: vec![
            figure("planning-paths", "Paths: what accuracy costs", "paths", "miss_mm"),
            figure(
                "planning-moduli",
                "Moduli: what accuracy costs",
                "moduli",
                "off_percent",
            ),
        ],
        notes: vec![
            "a coarse mesh is too stiff, and its layers are not those of the labels: it finds other moduli than those that made the measurement".to_owned(),
        ],
    })
}

const TISSUE: Factor = Factor::new("tissue", "tissue");

/// A plan, followed in the finest tissue; without a plan, the needle goes to the target at rest.
struct PlanRow {
    tissue: String,
    seconds: Option<f64>,
    miss_mm: Option<f64>,
    own_miss_mm: Option<f64>,
    insertion_mm: Option<f64>,
}

const PLANNED: [Choice<PlanRow>; 1] = [TISSUE.of(|row| row.tissue.clone())];

const PLAN_COLUMNS: [Column<PlanRow>; 4] = [
    Axis::log("seconds", "s", "time of a plan, s").of(|row| row.seconds),
    Axis::log("miss_mm", "miss mm", "miss in the finest tissue, mm").of(|row| row.miss_mm),
    Axis::linear("own_miss_mm", "own miss mm", "miss in the tissue of the plan, mm").of(|row| row.own_miss_mm),
    Axis::linear("insertion_mm", "depth mm", "way of the tip beyond the entry, mm").of(|row| row.insertion_mm),
];

/// Plans the path to the vein with several models of the tissue, and follows each in the finest.
fn paths(effort: Effort, progress: &mut dyn FnMut(&str, f64)) -> Result<Table, Error> {
    let finest = effort.pick(400, 2000);
    let reference = liver(finest, &[])?;
    let sections = effort.pick(&[20.0][..], &[10.0, 20.0, 40.0]).iter();
    let sections = sections.map(|mm| (format!("2-D, {mm} mm thick"), None, Some(*mm)));
    let meshes = [250, finest].map(|nodes| (format!("3-D, {nodes} nodes"), Some(nodes), None));
    let work = (sections.len() + meshes.len()) as f64;
    let mut rows = Vec::new();
    let mut unplanned = None;
    for (name, nodes, section_mm) in sections.chain(meshes) {
        progress(&name, rows.len() as f64 / work);
        let scenario = nodes.map_or_else(|| Ok(reference.clone()), |nodes| liver(nodes, &[]))?;
        let options = PathOptions {
            target: Target::Named("vessel".to_owned()),
            entry: Entries::Plane(Some([ANGLE_DEG; 2])),
            lines: 1,
            clearance_mm: 0.0,
            tolerance_mm: 0.1,
            section_mm,
            speed_mm_s: None,
        };
        let start = Instant::now();
        let plan = plan(&scenario, &options, &|_, _| ControlFlow::Continue(()))?;
        let seconds = start.elapsed().as_secs_f64();
        let Some((_, path)) = plan.best() else { continue };
        rows.push(PlanRow {
            tissue: name,
            seconds: Some(seconds),
            // The own miss only says that a plan meets its own tissue; what a
            // plan is worth shows in the finest.
            miss_mm: miss_mm(&reference, &path.course, &plan.target_mm.into())?,
            own_miss_mm: Some(path.miss_mm),
            insertion_mm: Some(path.insertion_mm - path.back_mm),
        });
        // The last plan is in the finest tissue: its miss before the
        // correction is that of going without a plan.
        unplanned = Some(path.miss_before_mm);
    }
    rows.push(PlanRow {
        tissue: "none: to the target at rest".to_owned(),
        seconds: None,
        miss_mm: unplanned,
        own_miss_mm: None,
        insertion_mm: None,
    });
    let goal = Goal::new("seconds", "miss_mm", MISS_MM).choosing("tissue of a plan");
    let title =
        format!("Tissue of a plan: the tip's distance from the target where the path is followed in {finest} nodes");
    Ok(Table::of("paths", title, &PLANNED, &PLAN_COLUMNS, &rows)
        .against(format!("the target, in tissue of {finest} nodes"))
        .seeking(goal))
}

/// An identification in a mesh.
struct IdentificationRow {
    nodes: usize,
    seconds: f64,
    /// Young's moduli of the surrounding and the inclusion, and those that made the measurement, kPa.
    young_kpa: [f64; 2],
    exact_kpa: [f64; 2],
    /// Largest standard deviation of the displacements' error, mm.
    sd_mm: Option<f64>,
    insertions: usize,
}

impl IdentificationRow {
    /// Largest error of Young's modulus, %.
    fn off_percent(&self) -> f64 {
        let errors = self.young_kpa.iter().zip(&self.exact_kpa);
        errors.fold(0.0, |largest: f64, (young, exact)| {
            largest.max(100.0 * (young / exact - 1.0).abs())
        })
    }
}

const IDENTIFIED: [Choice<IdentificationRow>; 1] = [TISSUE.of(|row| format!("{} nodes", row.nodes))];

const IDENTIFICATION_COLUMNS: [Column<IdentificationRow>; 6] = [
    Axis::log("seconds", "s", "time of an identification, s").of(|row| Some(row.seconds)),
    Axis::log("off_percent", "off %", "largest error of Young's modulus, %").of(|row| Some(row.off_percent())),
    Axis::linear(
        "surrounding_kpa",
        "around kPa",
        "Young's modulus of the surrounding, kPa",
    )
    .of(|row| Some(row.young_kpa[0])),
    Axis::linear(
        "inclusion_kpa",
        "inclusion kPa",
        "Young's modulus of the inclusion, kPa",
    )
    .of(|row| Some(row.young_kpa[1])),
    Axis::linear(
        "sd_mm",
        "SD mm",
        "largest standard deviation of the displacements' error, mm",
    )
    .of(|row| row.sd_mm),
    Axis::linear("insertions", "insertions", "simulated insertions").of(|row| Some(row.insertions as f64)),
];

/// Identifies moduli with several meshes from one insertion into the finest.
fn identified(effort: Effort, progress: &mut dyn FnMut(&str, f64)) -> Result<Table, Error> {
    let (finest, meshes): (usize, &[usize]) = effort.pick((400, &[150, 400]), (2000, &[300, 1000, 2000]));
    let (measured, exact) = case(finest)?;
    let exact_kpa = [exact[0], exact[1]];
    // In the image plane, 5 mm beside the needle, along the beam.
    let column = |x: f64| (0..10).map(move |step| (Point3::new(x, 0.0, 6.0 * f64::from(step) - 40.0), Vector3::z()));
    let points: Vec<_> = [-8.0, -4.0, 4.0, 8.0].into_iter().flat_map(column).collect();
    let mut rows = Vec::new();
    for &nodes in meshes {
        progress("identification", rows.len() as f64 / meshes.len() as f64);
        let (case, _) = case(nodes)?;
        let start = Instant::now();
        let identified = identify_simulated(&measured, &case, points.clone())?;
        rows.push(IdentificationRow {
            nodes,
            seconds: start.elapsed().as_secs_f64(),
            young_kpa: [0, 1].map(|layer| identified.layers[layer].young_kpa),
            exact_kpa,
            sd_mm: identified.motion.map(|motion| motion.largest_sd_mm),
            insertions: identified.insertions,
        });
    }
    let goal = Goal::new("seconds", "off_percent", MODULUS_PERCENT).choosing("mesh of an identification");
    let title = format!(
        "Mesh of an identification: {} and {} kPa, measured in {finest} nodes",
        exact_kpa[0], exact_kpa[1]
    );
    Ok(Table::of("moduli", title, &IDENTIFIED, &IDENTIFICATION_COLUMNS, &rows)
        .against("the moduli that made the measurement")
        .seeking(goal))
}

/// The case with a mesh of about `nodes` nodes, and the moduli of the scenario, kPa.
fn case(nodes: usize) -> Result<(IdentificationCase, Vec<f64>), Error> {
    let mut case = CaseFile::parse(CASE, "two-layer-insertion")?.resolve(Path::new(""), &mut |_| ())?;
    let text = case.text.0.replace("nodes = 991", &format!("nodes = {nodes}"));
    case.scenario = ScenarioFile::parse(&text, "two-layer-insertion")?.resolve(Path::new(""), |_| ())?;
    let young = |region: i32| {
        let material = case.scenario.linear_material(region);
        material.map_or(f64::NAN, |material| material.young_kpa())
    };
    let young = case.layers.iter().map(|layer| young(layer.region)).collect();
    Ok((case, young))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The path planned in a mesh meets the target there and misses it in another; the mesh that made a measurement
    /// finds its moduli, a coarser one others.
    #[test]
    fn plans_and_moduli_are_those_of_their_mesh() {
        let study = study(Effort::Quick, &mut |_, _| {}).unwrap();
        let value = |table: usize, row: &str, key: &str| {
            let table = &study.tables[table];
            let row = table
                .rows
                .iter()
                .find(|candidate| candidate.choices[0] == row)
                .expect("a row");
            table.value(row, key).expect("a value")
        };
        let miss_mm = value(0, "3-D, 400 nodes", "miss_mm");
        assert!(
            miss_mm < 0.1 && miss_mm == value(0, "3-D, 400 nodes", "own_miss_mm"),
            "{miss_mm}"
        );
        assert!(value(0, "none: to the target at rest", "miss_mm") > 10.0 * miss_mm);
        for row in ["2-D, 20 mm thick", "3-D, 250 nodes"] {
            let miss = value(0, row, "miss_mm");
            assert!(miss > miss_mm, "{row}: {miss}");
        }
        assert!(value(1, "400 nodes", "off_percent") < 5.0, "{:?}", study.tables[1].rows);
        assert!(value(1, "150 nodes", "off_percent") > 20.0);
    }
}
