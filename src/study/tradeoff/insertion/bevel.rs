//! Deflection by the bevel, and lengths of links and beam elements.

use super::{
    Course, InsertionOptions, Progress, Step, TIMES, UNSETTLED, largest, lines, points, timed, times, unsettled,
};
use crate::tradeoff::{Axis, Deadline, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use insonify::Error;
use insonify_base::range::OutOfRange;
use insonify_mechanics::block;
use insonify_mechanics::insertion::Interaction;
use insonify_mechanics::insertion::finite::Finite;
use insonify_mechanics::needle::{BEVEL_MM, Bevel, Needle, Shaft, Stiffness};
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

const FACTORS: [Factor; 3] = [
    Factor::new("length_mm", "length, mm"),
    Factor::new("r_mm", "r, mm"),
    Factor::new("cell_mm", "cells, mm"),
];
const DEPTH: Axis = Axis::linear("depth_mm", "depth mm", "depth of the tip, mm");
const ASIDE: Axis = Axis::linear("deflection_mm", "aside mm", "deflection of the tip, mm");
const HALF: Axis = Axis::linear("half_mm", "half way", "deflection of the tip at half the depth, mm");
const CHANGE: Axis = Axis::linear(
    "change_percent",
    "mesh %",
    "change of the deflection from the next coarser mesh, %",
);

/// Bevel, and edge length of the mesh cells, mm.
#[derive(Clone, Copy, PartialEq)]
struct Case {
    bevel: Bevel,
    cell_mm: f64,
}

impl Case {
    fn choices(&self) -> Vec<String> {
        let Bevel { r_mm, length_mm } = self.bevel;
        vec![length_mm.to_string(), r_mm.to_string(), cell_name(self.cell_mm)]
    }
}

fn cell_name(cell_mm: f64) -> String {
    format!("{}", (10.0 * cell_mm).round() / 10.0)
}

/// Returns every r of every length on every mesh, finer meshes last; without `sweep` only the default length on the coarsest mesh.
fn cases(sweep: bool) -> Vec<Case> {
    let (lengths, cells) = match sweep {
        true => (&LENGTHS_MM[..], &CELLS_MM[..]),
        false => (&LENGTHS_MM[1..2], &CELLS_MM[..1]),
    };
    let of_mesh = |&cell_mm: &f64| {
        let bevels = lengths
            .iter()
            .flat_map(|&length_mm| SWEEP_MM.map(|r_mm| Bevel { r_mm, length_mm }));
        bevels.map(move |bevel| Case { bevel, cell_mm })
    };
    cells.iter().flat_map(of_mesh).collect()
}

pub(super) fn run_bevel(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let mut table = Table::new(
        "bevel",
        format!("Bevels in a block of PVC: deflection at {} mm", options.bevel_depth_mm),
        &FACTORS,
        &[ASIDE, HALF, CHANGE, UNSETTLED],
    );
    let mut trace = Table::trace("bevel-depth", "Deflection against depth", &FACTORS, &[DEPTH, ASIDE]);
    let cases = cases(options.bevel_sweep);
    let mut done: Vec<(Case, f64)> = Vec::new();
    for (at, case) in cases.iter().enumerate() {
        let Bevel { r_mm, length_mm } = case.bevel;
        let text = format!(
            "bevel of {length_mm} mm, r = {r_mm} mm, cells of {} mm",
            cell_name(case.cell_mm)
        );
        progress(&text, at as f64 / cases.len() as f64);
        let steps = insert(case, options.bevel_depth_mm)?;
        let aside = |step: &Step| step.tip_mm.x - 0.5 * EXTENT[0];
        let Some(last) = steps.last().map(aside) else { continue };
        let middle = steps.get(steps.len() / 2).map(aside);
        let alike = |(other, _): &&(Case, f64)| other.bevel.length_mm == length_mm && other.cell_mm == case.cell_mm;
        let smaller = done.iter().rev().find(alike);
        let flag = match smaller {
            _ if r_mm == 0.0 && last.abs() > STRAIGHT_MM => Some(format!("straight to {STRAIGHT_MM} mm is expected")),
            Some((_, before)) if last <= *before => Some("more than with the smaller r is expected".to_owned()),
            _ => None,
        };
        let coarser = done
            .iter()
            .rev()
            .find(|(other, _)| other.bevel == case.bevel && r_mm > 0.0);
        let change = coarser.map(|(_, before)| 100.0 * (last - before) / last);
        if let (Some(change), Some((other, _))) = (change.filter(|it| it.abs() > CONVERGED_PERCENT), coarser) {
            study.notes.push(format!(
                "{text}: not converged with the mesh, {change:+.0} % from cells of {} mm",
                cell_name(other.cell_mm)
            ));
        }
        done.push((*case, last));
        table.push(
            case.choices(),
            vec![Some(last), middle, change, unsettled(&steps)],
            flag,
        );
        for (step, it) in steps.iter().enumerate().step_by(4) {
            let depth = Some(step as f64 * ADVANCE_MM);
            trace.push(case.choices(), vec![depth, Some(aside(it))], None);
        }
    }
    let usual = [LENGTHS_MM[1].to_string(), cell_name(CELLS_MM[0])];
    for depth_mm in [0.0, options.bevel_depth_mm] {
        let name = format!("measured: {MEASURED_MM} mm");
        let choices = vec![usual[0].clone(), name, usual[1].clone()];
        trace.push(choices, vec![Some(depth_mm), Some(MEASURED_MM)], None);
    }
    let axes = ["depth_mm", "deflection_mm"];
    let figure = |file: &str, title: &str, colour, only| Figure {
        only,
        ..lines(file, title, "bevel-depth", axes, colour)
    };
    let [length, cell] = usual;
    let title = "Bevelled needles in PVC (20 kPa): deflection against depth";
    let only = vec![("length_mm", length.clone()), ("cell_mm", cell)];
    study.figures.push(figure("insertion-bevel", title, "r_mm", only));
    if options.bevel_sweep {
        let title = "A bevelled needle in PVC, r = 0.6 mm: deflection by the cells of the mesh";
        let only = vec![("length_mm", length), ("r_mm", FITTED_MM.to_string())];
        study
            .figures
            .push(figure("insertion-bevel-mesh", title, "cell_mm", only));
    }
    study.tables.extend([table, trace]);
    Ok(())
}

fn insert(case: &Case, depth_mm: f64) -> Result<Vec<Step>, Error> {
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

/// Discretisation of a needle.
pub(super) struct Pieces {
    /// Name of the pieces, used in the keys of the table and its factor.
    name: &'static str,
    length: Factor,
    /// Lengths, mm; the last and finest is the gold standard.
    lengths_mm: &'static [f64],
    choosing: &'static str,
    figure: [&'static str; 2],
    needle: fn(f64) -> Result<Box<dyn Needle>, OutOfRange>,
}

/// Links joined by angular springs.
pub(super) const LINKS: Pieces = Pieces {
    name: "links",
    length: Factor::new("link_mm", "links of, mm"),
    lengths_mm: &[20.0, 10.0, 5.0, 2.5, 1.25],
    choosing: "links of the needle",
    figure: ["insertion-links", "Links of the needle: what accuracy costs"],
    needle: |length_mm| block::springs(Stiffness::default(), length_mm, block::BEVEL),
};

/// Elements of a beam.
pub(super) const ELEMENTS: Pieces = Pieces {
    name: "elements",
    length: Factor::new("element_mm", "elements of, mm"),
    lengths_mm: &[20.0, 10.0, 5.0, 2.5],
    choosing: "elements of a beam in an insertion",
    figure: ["insertion-elements", "Elements of a beam needle: what accuracy costs"],
    needle: |length_mm| block::beam(Stiffness::default(), length_mm, block::BEVEL),
};

pub(super) fn run_pieces(
    pieces: &Pieces,
    options: &InsertionOptions,
    study: &mut Study,
    progress: Progress<'_>,
) -> Result<(), Error> {
    let finest = pieces.lengths_mm[pieces.lengths_mm.len() - 1];
    let (name, key) = (pieces.name, pieces.length.key);
    let axes = [
        Axis::linear("pieces", "pieces", "pieces of the whole needle"),
        Axis::linear(
            "deflection_mm",
            "aside mm",
            "tip beside the straight path at full depth, mm",
        ),
        Axis::log(
            "tip_mm",
            "tip off, mm",
            "largest difference of the tip on the way in, mm",
        ),
        Axis::log(
            "force_n",
            "force off, N",
            "largest difference of the force at the base on the way in, N",
        ),
    ];
    let mut table = Table::new(
        name,
        format!("Needle in {name}: differences from {name} of {finest} mm"),
        &[pieces.length],
        &[&axes[..], &TIMES, &[UNSETTLED]].concat(),
    )
    .against(format!("{name} of {finest} mm"))
    .seeking(
        Goal::new("remesh_median_ms", "tip_mm", SHIFT_MM)
            .choosing(pieces.choosing)
            .in_every(Deadline::Step, "remesh_median_ms")
            .beside(&["median_ms", "p99_ms", "force_n"]),
    );
    let course = Course {
        depth_mm: options.depth_mm,
        probe: false,
    };
    let mut models = Vec::new();
    for &length_mm in pieces.lengths_mm {
        models.push(super::model(super::tissue(
            options.nodes,
            (pieces.needle)(length_mm)?,
        )?)?);
    }
    let traces = course.drive(&mut models, options.passes, &mut |share| {
        progress(pieces.choosing, share)
    })?;
    let gold = &traces[traces.len() - 1];
    let inward = course.moved();
    for (&length_mm, steps) in pieces.lengths_mm.iter().zip(&traces) {
        let most = |of: &dyn Fn(&Step, &Step) -> f64| {
            let pairs = gold.iter().zip(steps).take(inward);
            (length_mm != finest).then(|| largest(pairs.map(|(a, b)| of(a, b))))
        };
        let tip = steps[inward - 1].tip_mm;
        let aside = (tip.x - super::ENTRY_MM[0]).hypot(tip.y - super::ENTRY_MM[1]);
        let own = [
            Some((Shaft::default().length_mm / length_mm).round()),
            Some(aside),
            most(&|a, b| (a.tip_mm - b.tip_mm).norm()),
            most(&|a, b| (a.force_n - b.force_n).norm()),
        ];
        let values = [&own[..], &times(steps), &[unsettled(steps)]].concat();
        table.push(vec![length_mm.to_string()], values, None);
    }
    table.mark_gold(key, &finest.to_string());
    let [file, title] = pieces.figure;
    let figure = points(file, title, name, ["remesh_median_ms", "tip_mm"], key);
    study.tables.push(table);
    study.figures.push(figure);
    Ok(())
}
