//! Warp: mapping of current sample positions to the reference state of the tissue (Zhu et al. 2007, section 2.2).
//!
//! All later look-ups, of labels, textures and scatterers, use the reference state. See
//! [`crate::mechanics::mesh::map`] for the point location and the treatment of points outside the mesh.

use bytemuck::Zeroable;

use super::buffers::{ADJACENCY, CELL_ELEMENTS, CELL_STARTS, ELEMENT, ELEMENT_MAPS, POSITION};
use super::pass::{Access::*, Band, ParamBlock, Pass, View, spread};
use super::{Effect, Stage, Verdict};
use crate::base::real::Real;
use crate::imaging::synth::store::Store;
use crate::imaging::synth::tables::Tables;
use crate::mechanics::mesh::map::map_lines;
use crate::mechanics::mesh::pack::WarpParams;

/// Registry entry.
pub const EFFECT: Effect = Effect {
    name: "warp",
    stage: Stage::Tissue,
    wanted,
    passes: |_| PASSES.iter().collect(),
    // The mesh is part of the anatomy.
    remove: Some(|_| {}),
    ..Effect::PLAIN
};

static PASSES: &[Pass] = &[Pass {
    name: "warp",
    shader: include_str!("../../../shaders/warp.wgsl"),
    entry: "main",
    bindings: &[
        (&POSITION, Write),
        (&ELEMENT, Write),
        (&ELEMENT_MAPS, Read),
        (&ADJACENCY, Read),
        (&CELL_STARTS, Read),
        (&CELL_ELEMENTS, Read),
    ],
    params,
    workgroups: |tables, _| spread(tables.lines() * tables.samples() * tables.planes(), 64),
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

fn wanted(tables: &Tables) -> Verdict {
    match &tables.anatomy.mesh {
        Some(mesh) => Ok(format!(
            "a mesh of {} nodes and {} tetrahedra deforms the tissue",
            mesh.nodes().len(),
            mesh.elements().len()
        )),
        None => Err("no tissue model deforms: world and reference state are the same".into()),
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let (lines, samples, planes) = (tables.lines() as u32, tables.samples() as u32, tables.planes() as u32);
    ParamBlock::of(&WarpParams {
        lines,
        samples,
        planes,
        ..view.warp.copied().unwrap_or(WarpParams::zeroed())
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let samples = view.tables.samples();
    if let Some(states) = &store.states {
        let (positions, elements) = (&mut store.position, &mut store.element);
        map_lines(states.deformed(), states.reference(), samples, positions, elements);
    }
}
