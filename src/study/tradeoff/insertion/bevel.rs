//! Deflection by the bevel.

use super::{InsertionOptions, Progress, Step, StepTimes, Timed, lines, timed, unsettled};
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Study, Table};
use insonify::Error;
use insonify_mechanics::block;
use insonify_mechanics::insertion::Interaction;
use insonify_mechanics::insertion::finite::Finite;
use insonify_mechanics::needle::{BEVEL_MM, Bevel, Stiffness};
use insonify_mechanics::tissue::material::Material;

/// Offsets r of the tip from the centre line, mm.
const SWEEP_MM: [f64; 5] = [0.0, 0.4, 0.6, 0.8, 1.0];
/// Fitted offset of the needle of Goksel et al. 2011, and its measured deflection, mm.
const FITTED_MM: f64 = 0.6;
const MEASURED_MM: f64 = 10.4;
/// Bevel lengths, mm.
const LENGTHS_MM: [f64; 3] = [0.5 * BEVEL_MM, BEVEL_MM, 1.5 * BEVEL_MM];
/// Extent of the block, mm.
const EXTENT: [f64; 3] = [80.0, 80.0, 160.0];
/// Edge lengths of the block's cells, mm; the needle runs along planes between them.
const CELLS_MM: [f64; 3] = [10.0, 20.0 / 3.0, 5.0];
/// Largest change of a converged deflection from one mesh to the next finer, %.
const CONVERGED_PERCENT: f64 = 5.0;
/// Advance of the tip per step, mm.
const ADVANCE_MM: f64 = 0.5;
/// Deflection allowed for a needle without bevel, mm.
const STRAIGHT_MM: f64 = 0.05;

const LENGTH: Factor = Factor::new("length_mm", "length, mm");
const R: Factor = Factor::new("r_mm", "r, mm");
const CELL: Factor = Factor::new("cell_mm", "cells, mm");
const ASIDE: Axis = Axis::linear("deflection_mm", "aside mm", "deflection of the tip, mm");

/// Bevel, and edge length of the mesh cells, mm.
#[derive(Clone, Copy, PartialEq)]
struct BevelCase {
    bevel: Bevel,
    cell_mm: f64,
}

/// A bevelled needle at full depth.
struct BevelRow {
    case: BevelCase,
    deflection_mm: f64,
    half_mm: Option<f64>,
    change_percent: Option<f64>,
    times: StepTimes,
    flag: Option<String>,
}

impl Timed for BevelRow {
    fn times(&self) -> &StepTimes {
        &self.times
    }
}

const CHOICES: [Choice<BevelRow>; 3] = [
    LENGTH.of(|row| row.case.bevel.length_mm.to_string()),
    R.of(|row| row.case.bevel.r_mm.to_string()),
    CELL.of(|row| cell_name(row.case.cell_mm)),
];

const COLUMNS: [Column<BevelRow>; 3] = [
    ASIDE.of(|row| Some(row.deflection_mm)),
    Axis::linear("half_mm", "half way", "deflection of the tip at half the depth, mm").of(|row| row.half_mm),
    Axis::linear(
        "change_percent",
        "mesh %",
        "change of the deflection from the next coarser mesh, %",
    )
    .of(|row| row.change_percent),
];

/// A bevelled needle on its way in, or the measured one.
struct DepthRow {
    length_mm: f64,
    r: String,
    cell_mm: f64,
    depth_mm: f64,
    deflection_mm: f64,
}

const DEPTH_CHOICES: [Choice<DepthRow>; 3] = [
    LENGTH.of(|row| row.length_mm.to_string()),
    R.of(|row| row.r.clone()),
    CELL.of(|row| cell_name(row.cell_mm)),
];

const DEPTH_COLUMNS: [Column<DepthRow>; 2] = [
    Axis::linear("depth_mm", "depth mm", "depth of the tip, mm").of(|row| Some(row.depth_mm)),
    ASIDE.of(|row| Some(row.deflection_mm)),
];

fn cell_name(cell_mm: f64) -> String {
    format!("{}", (10.0 * cell_mm).round() / 10.0)
}

/// Returns every r of every length on every mesh, finer meshes last; without `sweep` only the default length on the coarsest mesh.
fn cases(sweep: bool) -> Vec<BevelCase> {
    let (lengths, cells) = if sweep {
        (&LENGTHS_MM[..], &CELLS_MM[..])
    } else {
        (&LENGTHS_MM[1..2], &CELLS_MM[..1])
    };
    let of_mesh = |&cell_mm: &f64| {
        let bevels = lengths
            .iter()
            .flat_map(|&length_mm| SWEEP_MM.map(|r_mm| Bevel { r_mm, length_mm }));
        bevels.map(move |bevel| BevelCase { bevel, cell_mm })
    };
    cells.iter().flat_map(of_mesh).collect()
}

pub(super) fn run(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let cases = cases(options.bevel_sweep);
    let (mut rows, mut trace): (Vec<BevelRow>, Vec<DepthRow>) = (Vec::new(), Vec::new());
    for (index, case) in cases.iter().enumerate() {
        let Bevel { r_mm, length_mm } = case.bevel;
        let text = format!(
            "bevel of {length_mm} mm, r = {r_mm} mm, cells of {} mm",
            cell_name(case.cell_mm)
        );
        progress(&text, index as f64 / cases.len() as f64);
        let steps = insert(case, options.bevel_depth_mm)?;
        let aside = |step: &Step| step.tip_mm.x - 0.5 * EXTENT[0];
        let Some(end_mm) = steps.last().map(aside) else {
            continue;
        };
        let half_mm = steps.get(steps.len() / 2).map(aside);
        // No theory gives the deflection itself, but two bounds hold on every mesh: without an offset of the
        // tip the needle goes straight, and a larger offset bends it more.
        let smaller = rows.iter().rev().find(|row| {
            let BevelCase { bevel, cell_mm } = row.case;
            bevel.length_mm == length_mm && cell_mm == case.cell_mm
        });
        let flag = match smaller {
            _ if r_mm == 0.0 && end_mm.abs() > STRAIGHT_MM => Some(format!("straight to {STRAIGHT_MM} mm is expected")),
            Some(before) if end_mm <= before.deflection_mm => {
                Some("more than with the smaller r is expected".to_owned())
            }
            _ => None,
        };
        let coarser = rows.iter().rev().find(|row| row.case.bevel == case.bevel && r_mm > 0.0);
        let change_percent = coarser.map(|before| 100.0 * (end_mm - before.deflection_mm) / end_mm);
        if let (Some(change), Some(before)) = (
            change_percent.filter(|change| change.abs() > CONVERGED_PERCENT),
            coarser,
        ) {
            study.notes.push(format!(
                "{text}: not converged with the mesh, {change:+.0} % from cells of {} mm",
                cell_name(before.case.cell_mm)
            ));
        }
        rows.push(BevelRow {
            case: *case,
            deflection_mm: end_mm,
            half_mm,
            change_percent,
            times: StepTimes::of(&steps),
            flag,
        });
        trace.extend(steps.iter().enumerate().step_by(4).map(|(step, state)| DepthRow {
            length_mm,
            r: r_mm.to_string(),
            cell_mm: case.cell_mm,
            depth_mm: step as f64 * ADVANCE_MM,
            deflection_mm: aside(state),
        }));
    }
    let (length_mm, cell_mm) = (LENGTHS_MM[1], CELLS_MM[0]);
    trace.extend([0.0, options.bevel_depth_mm].map(|depth_mm| DepthRow {
        length_mm,
        r: format!("measured: {MEASURED_MM} mm"),
        cell_mm,
        depth_mm,
        deflection_mm: MEASURED_MM,
    }));
    let axes = ["depth_mm", "deflection_mm"];
    let figure = |file: &str, title: &str, colour, condition| Figure {
        only: condition,
        ..lines(file, title, "bevel-depth", axes, colour)
    };
    let length = || ("length_mm", length_mm.to_string());
    let title = "Bevelled needles in PVC (20 kPa): deflection against depth";
    let fixed_cell = vec![length(), ("cell_mm", cell_name(cell_mm))];
    study.figures.push(figure("insertion-bevel", title, "r_mm", fixed_cell));
    if options.bevel_sweep {
        let title = "A bevelled needle in PVC, r = 0.6 mm: deflection by the cells of the mesh";
        let fixed_radius = vec![length(), ("r_mm", FITTED_MM.to_string())];
        study
            .figures
            .push(figure("insertion-bevel-mesh", title, "cell_mm", fixed_radius));
    }
    let title = format!("Bevels in a block of PVC: deflection at {} mm", options.bevel_depth_mm);
    let columns: Vec<_> = COLUMNS.into_iter().chain([unsettled()]).collect();
    study.tables.extend([
        Table::of("bevel", title, &CHOICES, &columns, &rows).flagged(&rows, |row| row.flag.clone()),
        Table::of(
            "bevel-depth",
            "Deflection against depth",
            &DEPTH_CHOICES,
            &DEPTH_COLUMNS,
            &trace,
        )
        .unlisted(),
    ]);
    Ok(())
}

fn insert(case: &BevelCase, depth_mm: f64) -> Result<Vec<Step>, Error> {
    let interaction = Interaction {
        puncture_n: 0.0,
        friction_n_per_mm: 0.01,
        ..block::USUAL
    };
    let needle = block::springs(Stiffness::default(), block::LINK_MM, case.bevel)?;
    let mesh = block::mirrored(EXTENT, case.cell_mm)?;
    let setup = block::on_table(mesh, Material::new(20.0, 0.49)?, interaction, needle);
    let mut finite = Finite::new(setup, |_, _| {})?;
    let steps = (depth_mm / ADVANCE_MM).round() as usize;
    (0..=steps)
        .map(|step| {
            let tip = [0.5 * EXTENT[0], 0.5 * EXTENT[1], step as f64 * ADVANCE_MM];
            timed(&mut finite, &block::guided(tip))
        })
        .collect()
}
