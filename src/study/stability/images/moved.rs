//! Cases of scenes far from the world origin, compared with the same scenes near it.

use std::sync::Arc;

use nalgebra::{Matrix4, Vector3};

use super::super::record::{Record, Unexpected, largest};
use super::drawn::scene;
use super::setup::{Tally, gpus, name};
use crate::gpu::Gpu;
use crate::imaging::synth::{NeedleShaft, Synthesizer};
use crate::mechanics::mesh::TetMesh;
use crate::study::parity::{Case, check};

/// Offsets of whole metres, on and off the axes, mm.
const METRES: [[f64; 3]; 4] = [
    [1e5, 0.0, 0.0],
    [0.0, -1e5, 0.0],
    [57_000.0, 60_000.0, -56_000.0],
    [-99_000.0, 3_000.0, 12_000.0],
];

/// Offset that is not in whole metres, mm.
const ANYWHERE: [f64; 3] = [-57_512.3, 60_345.6, -55_987.1];

/// Grid of all scene coordinates, mm, on which moving a scene causes no rounding: double-precision numbers of 1e5 are 2^-36 apart.
const GRID_MM: f64 = 1.0 / (1 << 20) as f64;

/// Tolerance for offsets in double precision at 1e5 mm after a few products and sums, mm.
const DOUBLE_MM: f64 = 1e-9;

/// Compares frames near and far, pixel by pixel, and the resulting world coordinates.
pub fn scenes(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let count = record.effort().pick(12, 60);
    let mut sums: Vec<Sum> = Vec::new();
    let mut tally = Tally::default();
    let [mut meshes, mut needles, mut grainy] = [0; 3];
    for index in 0..count {
        let case = gridded(seeded(scene(record.seed(), index)))?;
        meshes += usize::from(case.anatomy.mesh.is_some());
        needles += usize::from(case.state.needle.is_some());
        grainy += usize::from(case.settings.effects.speckle.is_some());
        let by = METRES[index as usize % METRES.len()];
        compare(&case, by, &gpus, &mut sums)?;
        let far = case.moved(ANYWHERE)?;
        let verdicts = check(&far, &gpus)?;
        tally.add(&far, verdicts);
        record.done((index + 1) as f64 / count as f64);
    }
    for (what, found) in [("a mesh", meshes), ("a needle", needles), ("speckle", grainy)] {
        record.under(
            format!("scenes needed with {what} over those there"),
            2.0 / found as f64,
            1.0,
        );
    }
    for sum in sums {
        record.zero(
            format!("{}: pixels that differ from the scene at the origin", sum.backend),
            sum.pixels as f64,
        );
        record.under(
            format!("{}: places in the world off, mm", sum.backend),
            sum.places_mm,
            DOUBLE_MM,
        );
        record.under(
            format!("{}: frames in the world off, mm", sum.backend),
            sum.frame_mm,
            DOUBLE_MM,
        );
    }
    tally.note(record)
}

/// Adds a seed to the scene in the tissue at the tip of its needle, if it has one.
fn seeded(mut case: Case) -> Case {
    let needle = case.state.needle.as_ref().filter(|needle| !needle.nodes.is_empty());
    if let Some(needle) = needle {
        let tip = needle.nodes[needle.nodes.len() - 1];
        case.state
            .seeds
            .push(NeedleShaft::seed(tip, &Vector3::new(1.0, 2.0, 3.0)));
    }
    case
}

/// Rounds every coordinate of the scene to the grid.
fn gridded(mut case: Case) -> Result<Case, Unexpected> {
    let round = |x: f64| (x / GRID_MM).round() * GRID_MM;
    let volume = &case.anatomy.volume;
    let place: Vector3<f64> = volume.index_to_world().fixed_view::<3, 1>(0, 3).into();
    case.anatomy.volume = Arc::new(volume.moved(place.map(round) - place)?);
    let nodes = |nodes: &[[f64; 3]]| nodes.iter().map(|node| node.map(round)).collect::<Vec<_>>();
    if let Some(mesh) = &case.anatomy.mesh {
        let rounded = TetMesh::new(nodes(mesh.nodes()), mesh.elements().to_vec(), mesh.regions().to_vec())?;
        case.anatomy.mesh = Some(Arc::new(rounded));
    }
    let state = &mut case.state;
    for row in 0..3 {
        state.probe_to_world[(row, 3)] = round(state.probe_to_world[(row, 3)]);
    }
    for shaft in state.needle.iter_mut().chain(&mut state.seeds) {
        shaft.nodes.iter_mut().for_each(|node| *node = node.map(round));
    }
    for moved in [&mut state.nodes, &mut state.reference] {
        *moved = moved.as_deref().map(nodes);
    }
    Ok(case)
}

/// Totals of one backend.
struct Sum {
    backend: String,
    pixels: usize,
    places_mm: f64,
    frame_mm: f64,
}

fn compare(case: &Case, by: [f64; 3], gpus: &[Gpu], sums: &mut Vec<Sum>) -> Result<(), Unexpected> {
    let there = case.moved(by)?;
    let all = |case: &Case| -> Result<Vec<Synthesizer>, Unexpected> {
        let mut synths = vec![case.exact()?];
        synths.extend(case.twins(gpus)?);
        Ok(synths)
    };
    let by = Vector3::from(by);
    for (at, (mut near, mut far)) in all(case)?.into_iter().zip(all(&there)?).enumerate() {
        if sums.len() <= at {
            sums.push(Sum {
                backend: name(&near),
                pixels: 0,
                places_mm: 0.0,
                frame_mm: 0.0,
            });
        }
        let expected = near.render(&case.state)?.clone();
        let found = far.render(&there.state)?.clone();
        let apart = expected
            .pixels
            .iter()
            .zip(&found.pixels)
            .filter(|(a, b)| a != b)
            .count();
        let frames = found.image_to_world - Matrix4::new_translation(&by) * expected.image_to_world;
        let (here, there) = (near.beam()?, far.beam()?);
        let places = here.position.iter().zip(&there.position).map(|(here, there)| {
            let moved = Vector3::new(there[0] - here[0], there[1] - here[1], there[2] - here[2]);
            (moved - by).amax()
        });
        let sum = &mut sums[at];
        sum.pixels += apart + expected.pixels.len().abs_diff(found.pixels.len());
        sum.places_mm = largest(places.chain([sum.places_mm]));
        sum.frame_mm = largest(frames.iter().copied().chain([sum.frame_mm]));
    }
    Ok(())
}
