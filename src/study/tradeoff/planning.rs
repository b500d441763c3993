//! Path planning and parameter identification: time saved and error added by two-dimensional tissue and by coarse meshes.

use std::path::Path;
use std::time::Instant;

use nalgebra::{Point3, Vector3};

use super::gather::Entry;
use super::{Axis, Factor, Figure, Goal, Study, Table};
use crate::identification::{CaseFile, IdentificationCase};
use crate::identify::identify_simulated;
use crate::path::{Entry as Entries, Goal as Target, PathOptions, liver, miss_mm, plan};
use crate::stability::Effort;
use insonify::Error;
use insonify::input::scenario::ScenarioFile;
use insonify_base::machine::Machine;

/// Registration of this study.
pub const ENTRY: Entry = Entry {
    name: "planning",
    title: "Planned paths and identified tissue",
    question: "Is planning in a section by the image plane as accurate as in three dimensions, and how fine a mesh does the identification of moduli need?",
    run: |_, effort, progress| Ok(study(effort, progress)?),
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
pub fn study(effort: Effort, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<Study, Error> {
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
        title: ENTRY.title,
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

const TISSUE: [Factor; 1] = [Factor::new("tissue", "tissue")];

/// Plans the path to the vein with several models of the tissue, and follows each in the finest.
fn paths(effort: Effort, progress: &mut dyn FnMut(&str, f64)) -> Result<Table, Error> {
    let axes = [
        Axis::log("seconds", "s", "time of a plan, s"),
        Axis::log("miss_mm", "miss mm", "miss in the finest tissue, mm"),
        Axis::linear("own_miss_mm", "own miss mm", "miss in the tissue of the plan, mm"),
        Axis::linear("insertion_mm", "depth mm", "way of the tip beyond the entry, mm"),
    ];
    let goal = Goal::new("seconds", "miss_mm", MISS_MM).choosing("tissue of a plan");
    let finest = effort.pick(400, 2000);
    let title =
        format!("Tissue of a plan: the tip's distance from the target where the path is followed in {finest} nodes");
    let mut table = Table::new("paths", title, &TISSUE, &axes)
        .against(format!("the target, in tissue of {finest} nodes"))
        .seeking(goal);
    let reference = liver(finest, &[])?;
    let sections = effort.pick(&[20.0][..], &[10.0, 20.0, 40.0]).iter();
    let sections = sections.map(|mm| (format!("2-D, {mm} mm thick"), None, Some(*mm)));
    let meshes = [250, finest].map(|nodes| (format!("3-D, {nodes} nodes"), Some(nodes), None));
    let work = (sections.len() + meshes.len()) as f64;
    let mut unplanned = None;
    for (name, nodes, section_mm) in sections.chain(meshes) {
        progress(&name, table.rows.len() as f64 / work);
        let scenario = nodes.map_or_else(|| Ok(reference.clone()), |nodes| liver(nodes, &[]))?;
        let options = PathOptions {
            target: Target::Named("vessel".to_owned()),
            entry: Entries::Plane([ANGLE_DEG; 2]),
            lines: 1,
            clearance_mm: 0.0,
            tolerance_mm: 0.1,
            section_mm,
        };
        let start = Instant::now();
        let plan = plan(&scenario, &options, &|_, _| ())?;
        let seconds = start.elapsed().as_secs_f64();
        let Some((_, path)) = plan.best() else { continue };
        let miss = miss_mm(&reference, &path.course, &plan.target_mm.into())?;
        let values = [
            Some(seconds),
            miss,
            Some(path.miss_mm),
            Some(path.insertion_mm - path.back_mm),
        ];
        table.push(vec![name], values.to_vec(), None);
        unplanned = Some(path.miss_before_mm);
    }
    let values = vec![None, unplanned, None, None];
    table.push(vec!["none: to the target at rest".to_owned()], values, None);
    Ok(table)
}

/// Identifies moduli with several meshes from one insertion into the finest.
fn identified(effort: Effort, progress: &mut dyn FnMut(&str, f64)) -> Result<Table, Error> {
    let axes = [
        Axis::log("seconds", "s", "time of an identification, s"),
        Axis::log("off_percent", "off %", "largest error of Young's modulus, %"),
        Axis::linear(
            "surrounding_kpa",
            "around kPa",
            "Young's modulus of the surrounding, kPa",
        ),
        Axis::linear(
            "inclusion_kpa",
            "inclusion kPa",
            "Young's modulus of the inclusion, kPa",
        ),
        Axis::linear(
            "sd_mm",
            "SD mm",
            "largest standard deviation of the displacements' error, mm",
        ),
        Axis::linear("insertions", "insertions", "simulated insertions"),
    ];
    let goal = Goal::new("seconds", "off_percent", MODULUS_PERCENT).choosing("mesh of an identification");
    let (finest, meshes): (usize, &[usize]) = effort.pick((400, &[150, 400]), (2000, &[300, 1000, 2000]));
    let made = case(finest)?;
    let exact: Vec<f64> = made.1;
    let title = format!(
        "Mesh of an identification: {} and {} kPa, measured in {finest} nodes",
        exact[0], exact[1]
    );
    let mut table = Table::new("moduli", title, &TISSUE, &axes)
        .against("the moduli that made the measurement")
        .seeking(goal);
    // In the image plane, 5 mm beside the needle, along the beam.
    let column = |x: f64| (0..10).map(move |at| (Point3::new(x, 0.0, 6.0 * f64::from(at) - 40.0), Vector3::z()));
    let points: Vec<_> = [-8.0, -4.0, 4.0, 8.0].into_iter().flat_map(column).collect();
    for (at, nodes) in meshes.iter().enumerate() {
        progress("identification", at as f64 / meshes.len() as f64);
        let (case, _) = case(*nodes)?;
        let start = Instant::now();
        let found = identify_simulated(&made.0, &case, points.clone())?;
        let seconds = start.elapsed().as_secs_f64();
        let young = [0, 1].map(|layer| found.layers[layer].young_kpa);
        let off = young
            .iter()
            .zip(&exact)
            .map(|(found, exact)| 100.0 * (found / exact - 1.0).abs());
        let values = [
            Some(seconds),
            Some(off.fold(0.0, f64::max)),
            Some(young[0]),
            Some(young[1]),
            found.motion.map(|motion| motion.largest_sd_mm),
            Some(found.insertions as f64),
        ];
        table.push(vec![format!("{nodes} nodes")], values.to_vec(), None);
    }
    Ok(table)
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

    /// The path planned in a mesh meets the target there and misses it in another; the mesh that made a measurement finds its moduli, a coarser one
    /// others.
    #[test]
    fn plans_and_moduli_are_those_of_their_mesh() {
        let study = study(Effort::Quick, &mut |_, _| {}).unwrap();
        let value = |table: usize, row: &str, key: &str| {
            let table = &study.tables[table];
            let row = table.rows.iter().find(|other| other.choices[0] == row).expect("a row");
            table.value(row, key).expect("a value")
        };
        let own = value(0, "3-D, 400 nodes", "miss_mm");
        assert!(own < 0.1 && own == value(0, "3-D, 400 nodes", "own_miss_mm"), "{own}");
        assert!(value(0, "none: to the target at rest", "miss_mm") > 10.0 * own);
        for row in ["2-D, 20 mm thick", "3-D, 250 nodes"] {
            let miss = value(0, row, "miss_mm");
            assert!(miss > own, "{row}: {miss}");
        }
        assert!(value(1, "400 nodes", "off_percent") < 5.0, "{:?}", study.tables[1].rows);
        assert!(value(1, "150 nodes", "off_percent") > 20.0);
    }
}
