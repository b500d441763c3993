//! Bevels in a block of PVC: deflection against depth (Goksel et al. 2011, section VI-A).
//!
//! In Goksel et al.'s experiment the tip of a brachytherapy needle came out 10.4 mm aside, which r = 0.6 mm fits. Depth, modulus and
//! the length of the bevel's part are not in the text: 140 mm, 20 kPa and nu = 0.49 are taken here, and a part of 18 mm makes
//! r = 0.6 mm do that.

use super::columns::{UNSETTLED, factor, lines, unsettled};
use super::course::{Step, timed};
use super::{Findings, InsertionOptions, InsertionStudyError, Progress};
use crate::mechanics::insertion::Interaction;
use crate::mechanics::insertion::finite::Finite;
use crate::mechanics::needle::{Bevel, Stiffness};
use crate::mechanics::tissue::material::Material;
use crate::study::block;
use crate::study::tradeoff::{Axis, Factor, Table};

/// Distances of the tip from the centre line, mm.
const SWEEP_MM: [f64; 5] = [0.0, 0.4, 0.6, 0.8, 1.0];
/// Length of the bevel's part, mm.
const BEVEL_MM: f64 = 18.0;
/// Extent of the block, mm.
const EXTENT: [f64; 3] = [80.0, 80.0, 160.0];
/// Edge of its cells, mm.
const CELL_MM: f64 = 10.0;
/// How far the tip goes in a step, mm.
const ADVANCE_MM: f64 = 0.5;
/// What a needle without bevel may be aside, mm.
const STRAIGHT_MM: f64 = 0.05;

const R: [Factor; 1] = [factor("r_mm", "r, mm")];
const DEPTH: Axis = Axis::linear("depth_mm", "depth mm", "depth of the tip, mm");
const ASIDE: Axis = Axis::linear("deflection_mm", "aside mm", "deflection of the tip, mm");

pub(super) fn run(options: &InsertionOptions, progress: Progress<'_>) -> Result<Findings, InsertionStudyError> {
    let half = Axis::linear("half_mm", "half way", "deflection of the tip at half the depth, mm");
    let mut table = Table::new(
        "bevel",
        format!("Bevels in a block of PVC: deflection at {} mm", options.bevel_depth_mm),
        &R,
        &[ASIDE, half, UNSETTLED],
    );
    let mut trace = Table::trace("bevel-depth", "Deflection against depth", &R, &[DEPTH, ASIDE]);
    let mut before = 0.0;
    for (at, r_mm) in SWEEP_MM.into_iter().enumerate() {
        progress(&format!("bevel, r = {r_mm} mm"), at as f64 / SWEEP_MM.len() as f64);
        let steps = insert(r_mm, options.bevel_depth_mm)?;
        let aside = |step: &Step| step.tip_mm.x - 0.5 * EXTENT[0];
        let Some(last) = steps.last().map(aside) else { continue };
        let middle = steps.get(steps.len() / 2).map(aside);
        let flag = match r_mm == 0.0 {
            true if last.abs() > STRAIGHT_MM => Some(format!("straight to {STRAIGHT_MM} mm is expected")),
            false if last <= before => Some("more than with the smaller r is expected".to_owned()),
            _ => None,
        };
        before = last;
        table.push(
            vec![r_mm.to_string()],
            vec![Some(last), middle, unsettled(&steps)],
            flag,
        );
        for (step, it) in steps.iter().enumerate().step_by(4) {
            let depth = Some(step as f64 * ADVANCE_MM);
            trace.push(vec![r_mm.to_string()], vec![depth, Some(aside(it))], None);
        }
    }
    let title = "Bevelled needles in PVC (20 kPa): deflection against depth";
    let axes = ["depth_mm", "deflection_mm"];
    Ok(Findings {
        tables: vec![table, trace],
        figures: vec![lines("insertion-bevel", title, "bevel-depth", axes, "r_mm")],
        ..Findings::default()
    })
}

fn insert(r_mm: f64, depth_mm: f64) -> Result<Vec<Step>, InsertionStudyError> {
    let bevel = Bevel {
        r_mm,
        length_mm: BEVEL_MM,
    };
    let interaction = Interaction {
        puncture_n: 0.0,
        friction_n_per_mm: 0.01,
        ..block::USUAL
    };
    let needle = block::springs(Stiffness::default(), block::LINK_MM, bevel)?;
    let mesh = block::mirrored(EXTENT, CELL_MM)?;
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
