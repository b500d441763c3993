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
    ((10.0 * cell_mm).round() / 10.0).to_string()
}

/// Returns every r of every length on every mesh, finer meshes last; without `sweep` only the default length on the
/// coarsest mesh.
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

impl BevelCase {
    fn name(&self) -> String {
        let Bevel { r_mm, length_mm } = self.bevel;
        let cell = cell_name(self.cell_mm);
        format!("bevel of {length_mm} mm, r = {r_mm} mm, cells of {cell} mm")
    }

    /// The row of this bevel on the next coarser mesh; a straight needle has nothing to converge to.
    fn coarser<'a>(&self, rows: &'a [BevelRow]) -> Option<&'a BevelRow> {
        let mut coarser = rows.iter().rev();
        coarser.find(|row| row.case.bevel == self.bevel && self.bevel.r_mm > 0.0)
    }

    /// Fault of a deflection, mm, beside the rows before. No theory gives the deflection itself, but two bounds hold on
    /// every mesh: without an offset of the tip the needle goes straight, and a larger offset bends it more.
    fn flag(&self, deflection_mm: f64, rows: &[BevelRow]) -> Option<String> {
        if self.bevel.r_mm == 0.0 && deflection_mm.abs() > STRAIGHT_MM {
            return Some(format!("straight to {STRAIGHT_MM} mm is expected"));
        }
        let smaller = rows.iter().rev().find(|row| {
            let BevelCase { bevel, cell_mm } = row.case;
            bevel.length_mm == self.bevel.length_mm && cell_mm == self.cell_mm
        })?;
        let is_less = deflection_mm <= smaller.deflection_mm;
        is_less.then(|| "more than with the smaller r is expected".to_owned())
    }
}

/// Deflection of the tip, mm.
fn aside_mm(step: &Step) -> f64 {
    step.tip_mm.x - 0.5 * EXTENT[0]
}

/// Warns of a deflection that has not converged with the mesh.
fn unconverged(row: &BevelRow, coarser: Option<&BevelRow>) -> Option<String> {
    let change = row.change_percent.filter(|change| change.abs() > CONVERGED_PERCENT)?;
    let (name, cell) = (row.case.name(), cell_name(coarser?.case.cell_mm));
    Some(format!(
        "{name}: not converged with the mesh, {change:+.0} % from cells of {cell} mm"
    ))
}

pub(super) fn run(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let cases = cases(options.bevel_sweep);
    let (mut rows, mut trace): (Vec<BevelRow>, Vec<DepthRow>) = (Vec::new(), Vec::new());
    for (index, case) in cases.iter().enumerate() {
        progress(&case.name(), index as f64 / cases.len() as f64);
        let steps = insert(case, options.bevel_depth_mm)?;
        let Some(deflection_mm) = steps.last().map(aside_mm) else {
            continue;
        };
        let coarser = case.coarser(&rows);
        let change = |before: &BevelRow| 100.0 * (deflection_mm - before.deflection_mm) / deflection_mm;
        let row = BevelRow {
            case: *case,
            deflection_mm,
            half_mm: steps.get(steps.len() / 2).map(aside_mm),
            change_percent: coarser.map(change),
            times: StepTimes::of(&steps),
            flag: case.flag(deflection_mm, &rows),
        };
        study.notes.extend(unconverged(&row, coarser));
        rows.push(row);
        trace.extend(steps.iter().enumerate().step_by(4).map(|(step, state)| DepthRow {
            length_mm: case.bevel.length_mm,
            r: case.bevel.r_mm.to_string(),
            cell_mm: case.cell_mm,
            depth_mm: step as f64 * ADVANCE_MM,
            deflection_mm: aside_mm(state),
        }));
    }
    trace.extend([0.0, options.bevel_depth_mm].map(|depth_mm| DepthRow {
        length_mm: DRAWN.0,
        r: format!("measured: {MEASURED_MM} mm"),
        cell_mm: DRAWN.1,
        depth_mm,
        deflection_mm: MEASURED_MM,
    }));
    study.figures.extend(figures(options.bevel_sweep));
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

/// Length of the bevel and edge of the cells that are drawn, mm.
const DRAWN: (f64, f64) = (LENGTHS_MM[1], CELLS_MM[0]);

/// Deflection against depth by r and, in a sweep, by the cells.
fn figures(sweep: bool) -> Vec<Figure> {
    let length = ("length_mm", DRAWN.0.to_string());
    let figure = |file: &str, title: &str, colour, condition| Figure {
        only: vec![length.clone(), condition],
        ..lines(file, title, "bevel-depth", ["depth_mm", "deflection_mm"], colour)
    };
    let title = "Bevelled needles in PVC (20 kPa): deflection against depth";
    let by_r = figure("insertion-bevel", title, "r_mm", ("cell_mm", cell_name(DRAWN.1)));
    let title = "A bevelled needle in PVC, r = 0.6 mm: deflection by the cells of the mesh";
    let by_cell = || {
        figure(
            "insertion-bevel-mesh",
            title,
            "cell_mm",
            ("r_mm", FITTED_MM.to_string()),
        )
    };
    std::iter::once(by_r).chain(sweep.then(by_cell)).collect()
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
