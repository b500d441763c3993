//! Radius of the patch of tissue that bears the force at the tip.

use super::{InsertionOptions, Progress};
use crate::tradeoff::{Axis, Choice, Column, Factor, Study, Table};
use insonify::Error;
use insonify_mechanics::block;
use insonify_mechanics::insertion::finite::{Finite, FiniteOptions, Setup};
use insonify_mechanics::insertion::{EventKind, Interaction, Model};
use insonify_mechanics::tissue::material::Material;

/// Radii, mm: about that of a needle, up to twice the default.
const RADII_MM: [f64; 4] = [1.25, 2.5, 5.0, 10.0];
/// Extent of the block, mm.
const EXTENT: [f64; 3] = [120.0, 120.0, 120.0];
/// Edge lengths of the block's cells, mm.
const CELLS_MM: [f64; 3] = [24.0, 12.0, 8.0];
/// Young's modulus, kPa, and Poisson's ratio of the block.
const TISSUE: [f64; 2] = [10.0, 0.45];
/// Force that breaks the surface, N.
const PUNCTURE_N: f64 = 0.5;
/// Advance of the tip per step, mm.
const ADVANCE_MM: f64 = 0.02;
/// Depth at which the needle is given up, mm.
const MAX_DEPTH_MM: f64 = 60.0;
/// Allowed difference from the dent by a punch, %.
const ALLOWED_PERCENT: f64 = 10.0;

/// A surface pressed in until it breaks.
pub(crate) struct PatchRow {
    patch_mm: f64,
    pub nodes: usize,
    /// Way from touch to puncture, mm.
    dent_mm: Option<f64>,
    /// Depth of a rigid punch in a half-space under the same force, mm.
    punch_mm: f64,
}

impl PatchRow {
    /// Difference from the punch, %.
    pub(crate) fn off_percent(&self) -> Option<f64> {
        self.dent_mm.map(|dent| 100.0 * (dent / self.punch_mm - 1.0).abs())
    }
}

const CHOICES: [Choice<PatchRow>; 2] = [
    Factor::new("patch_mm", "patch, mm").of(|row| row.patch_mm.to_string()),
    Factor::new("nodes", "nodes").of(|row| row.nodes.to_string()),
];

const COLUMNS: [Column<PatchRow>; 3] = [
    Axis::linear("dent_mm", "dent mm", "way of the tip from touch to puncture, mm").of(|row| row.dent_mm),
    Axis::linear(
        "punch_mm",
        "punch mm",
        "depth of a rigid punch of this radius in a half-space, F (1 - nu^2) / (2 a E), mm",
    )
    .of(|row| Some(row.punch_mm)),
    Axis::linear("off_percent", "off %", "difference from the punch, %").of(PatchRow::off_percent),
];

/// Presses a needle into an even block, with patches of several radii and in several meshes.
pub(crate) fn measure(_: &InsertionOptions, progress: Progress<'_>) -> Result<Vec<PatchRow>, Error> {
    let mut rows = Vec::new();
    let total = (RADII_MM.len() * CELLS_MM.len()) as f64;
    for patch_mm in RADII_MM {
        for cell_mm in CELLS_MM {
            progress("radius of the patch at the tip", rows.len() as f64 / total);
            let tissue = Interaction {
                puncture_n: PUNCTURE_N,
                cutting_n: 0.1,
                ..Interaction::default()
            };
            let [young_kpa, poisson] = TISSUE;
            let material = Material::new(young_kpa, poisson)?;
            let mesh = block::plain(EXTENT, cell_mm)?;
            let setup = block::on_table(mesh, material, tissue, block::rigid()?);
            let options = FiniteOptions {
                patch_mm,
                ..setup.options
            };
            let mut model = Finite::new(Setup { options, ..setup }, |_, _| {})?;
            let mut touch_mm = None;
            let mut dent_mm = None;
            let steps = (MAX_DEPTH_MM / ADVANCE_MM) as usize;
            for z in (0..steps).map(|step| ADVANCE_MM * step as f64 - 1.0) {
                let outcome = model.step(&block::tip_at([0.512 * EXTENT[0], 0.489 * EXTENT[1], z]), 1e-3)?;
                let has = |kind| outcome.events.iter().any(|event| event.kind == kind);
                if has(EventKind::Skin) {
                    touch_mm = Some(z);
                }
                if has(EventKind::Puncture) {
                    dent_mm = touch_mm.map(|touch| z - touch);
                    break;
                }
            }
            rows.push(PatchRow {
                patch_mm,
                nodes: model.mesh().nodes().len(),
                dent_mm,
                punch_mm: PUNCTURE_N * (1.0 - poisson * poisson) / (2.0 * patch_mm * young_kpa * 1e-3),
            });
        }
    }
    Ok(rows)
}

pub(super) fn run(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let rows = measure(options, progress)?;
    let title = format!("Radius of the patch at the tip: the dent of an even block before {PUNCTURE_N} N break it");
    let table = Table::of("patch", &title, &CHOICES, &COLUMNS, &rows).flagged(&rows, |row| {
        let is_off = row.off_percent().is_none_or(|off| off > ALLOWED_PERCENT);
        is_off.then(|| format!("at most {ALLOWED_PERCENT} % from the punch are expected"))
    });
    study.tables.push(table);
    Ok(())
}
