//! Cases of sample places: voxel faces, and coordinates far from the origin.

use std::sync::Arc;

use nalgebra::{Matrix4, Point3, Rotation3, Vector3};

use super::drawn::scene;
use crate::stability::fixtures::{Tally, everywhere, gpus, name, settings};
use crate::stability::record::{Record, Unexpected, largest};
use insonify_gpu::Gpu;
use insonify_imaging::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::slice::Boundary;
use insonify_imaging::parity::{Case, check};
use insonify_imaging::synth::layers::{Beam, world_position};
use insonify_imaging::synth::tables::{Anatomy, Tables};
use insonify_imaging::synth::{FrameState, NeedleShaft, Synthesizer};
use insonify_mesh::TetMesh;
use insonify_tracking::probe::{Linear, ProbeShape};

/// Creates random labels at every voxel of 1 mm, with faces at whole millimetres.
fn voxels(seed: u64) -> Anatomy {
    let tissue = |echo_db| Acoustics { echo_db, ..PLAIN };
    anatomies::random(
        Frame::around([0.0, 20.0, 0.0], [40; 3], 1.0),
        &[SILENT, tissue(0.0), tissue(6.0), tissue(-12.0)],
        seed as u32,
    )
}

/// Returns poses whose plane lies exactly between two layers of voxels across z, x and, seen from the side, y. Quarter
/// turns are exact.
fn poses() -> [FrameState; 3] {
    let quarter = |axis: Vector3<f64>| {
        Rotation3::from_scaled_axis(axis * std::f64::consts::FRAC_PI_2)
            .to_homogeneous()
            .map(f64::round)
    };
    let beside = Matrix4::new_translation(&Vector3::new(-20.0, 20.0, 0.0));
    [
        Matrix4::identity(),
        quarter(Vector3::y()),
        beside * quarter(-Vector3::z()) * quarter(Vector3::y()),
    ]
    .map(FrameState::at)
}

/// Tests linear probes: with 33 scanlines over 24 mm every position is a sum of few powers of two, exact in either
/// precision; with 25 scanlines, 1 mm apart, samples lie on faces, edges and corners, and with 49, half a millimetre
/// apart, many do.
pub(super) fn on_faces(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let anatomy = voxels(record.seed());
    let shape = ProbeShape::Linear(Linear { width_mm: 24.0 });
    let mut tally = Tally::default();
    let (mut differing_labels, mut rounded_apart, mut on_face): (Vec<(String, usize)>, usize, usize) =
        (Vec::new(), 0, 0);
    for boundary in [Boundary::Nearest, Boundary::Vote, Boundary::Smooth] {
        let mut effects = Effects::default();
        effects.slice.boundary = boundary;
        for (index, state) in poses().into_iter().enumerate() {
            let exact_settings = settings(shape, 40.0, [33, 160], effects.clone());
            let mut synths = everywhere(&anatomy, &exact_settings, &gpus)?.into_iter();
            let Some(mut reference) = synths.next() else { continue };
            let expected = reference.render_until("slice", &state)?;
            on_face += expected
                .position
                .iter()
                .filter(|p| p[..3].iter().any(|x| x.fract() == 0.0))
                .count();
            for (index, mut synth) in synths.enumerate() {
                let beam = synth.render_until("slice", &state)?;
                rounded_apart += expected
                    .position
                    .iter()
                    .zip(&beam.position)
                    .filter(|(a, b)| a != b)
                    .count();
                let labels = expected.label.iter().zip(&beam.label).filter(|(a, b)| a != b).count();
                if differing_labels.len() <= index {
                    differing_labels.push((name(&synth), 0));
                }
                differing_labels[index].1 += labels;
            }
            for grid in [[25, 80], [49, 160]] {
                let case = Case::new(
                    format!("{boundary:?}, pose {index}, {grid:?}"),
                    anatomy.clone(),
                    settings(shape, 40.0, grid, effects.clone()),
                    state.clone(),
                );
                let verdicts = check(&case, &gpus)?;
                tally.add(&case, verdicts);
            }
            record.done((index as f64 + 1.0) / 3.0 * if boundary == Boundary::Nearest { 0.5 } else { 1.0 });
        }
    }
    // At least half of the planes must have samples in the critical positions.
    record.under("samples needed on faces over those there", 1000.0 / on_face as f64, 1.0);
    record.zero("places that round where none should", rounded_apart as f64);
    for (backend, count) in differing_labels {
        record.zero(format!("{backend}: labels apart where nothing rounds"), count as f64);
    }
    tally.note(record)
}

/// Probe in a volume, both at `centre`, with voxels of `voxel_mm`.
struct Place {
    what: &'static str,
    centre: [f64; 3],
    voxel_mm: f64,
    depth_mm: f64,
}

const PLACES: [Place; 6] = [
    Place {
        what: "1e5 mm away",
        centre: [57_000.0, -60_000.0, 56_000.0],
        voxel_mm: 1.0,
        depth_mm: 40.0,
    },
    Place {
        what: "1e5 mm away, samples of 0.016 mm",
        centre: [0.0, 100_000.0, 0.0],
        voxel_mm: 0.2,
        depth_mm: 8.0,
    },
    Place {
        what: "1e5 mm away across, samples of 0.016 mm",
        centre: [-57_512.3, 60_345.6, -55_987.1],
        voxel_mm: 0.2,
        depth_mm: 8.0,
    },
    Place {
        what: "the furthest without a local origin, samples of 0.016 mm",
        centre: [4090.0, -4090.0, 4090.0],
        voxel_mm: 0.2,
        depth_mm: 8.0,
    },
    Place {
        what: "voxels of 1e-3 mm",
        centre: [31.0, -44.0, 57.0],
        voxel_mm: 1e-3,
        depth_mm: 0.1,
    },
    Place {
        what: "voxels of 1e3 mm",
        centre: [3100.0, -4400.0, 5700.0],
        voxel_mm: 1e3,
        depth_mm: 1000.0,
    },
];

/// Creates slabs of one voxel each, whose faces are oblique to all axes; the probe's depth axis runs across them.
fn anatomy(situation: &Place) -> Anatomy {
    let tissue = |echo_db| Acoustics { echo_db, ..PLAIN };
    let frame = Frame::around(situation.centre, [48; 3], situation.voxel_mm).oblique();
    let to_index = frame.index_to_world.try_inverse().unwrap_or_else(Matrix4::identity);
    anatomies::anatomy_from(frame, &[SILENT, tissue(0.0), tissue(6.0)], |p| {
        let index = to_index.transform_point(&p.into());
        1 + (index.y.round().rem_euclid(2.0)) as u8
    })
}

/// Places the middle of the scan at the middle of the volume, turned about every axis.
fn pose(situation: &Place) -> FrameState {
    let turn = Rotation3::from_euler_angles(0.41, 0.23, -0.37).to_homogeneous();
    let centre = Matrix4::new_translation(&Vector3::from(situation.centre));
    let to_middle = Matrix4::new_translation(&Vector3::new(0.0, -0.5 * situation.depth_mm, 0.0));
    FrameState::at(centre * turn * to_middle)
}

/// Computes sample positions and labels from pose and volume in double precision, independently of passes and local
/// origin.
fn truth(tables: &Tables, state: &FrameState) -> Vec<(Point3<f64>, u8)> {
    let samples = (0..tables.lines()).flat_map(|line| (0..tables.samples()).map(move |sample| (line, sample)));
    samples
        .map(|(line, sample)| {
            let point = world_position(tables, &state.probe_to_world, line, sample);
            (point, tables.anatomy.volume.label_index_at(&point).unwrap_or(0))
        })
        .collect()
}

/// Returns the largest position error in samples, and the longest run of labels that differ from double precision.
fn worst(tables: &Tables, exact: &[(Point3<f64>, u8)], beam: &Beam) -> [f64; 2] {
    let error = |((exact, _), position): (&(Point3<f64>, u8), &[f64; 4])| {
        let difference = exact.coords - Vector3::new(position[0], position[1], position[2]);
        difference.norm() / tables.sample_mm()
    };
    let places = largest(exact.iter().zip(&beam.position).map(error));
    // Longest run of differing labels: a boundary may be shifted by a few samples along the scanline; bands would be
    // many samples thick.
    let samples = beam.samples;
    let mut bands = 0usize;
    for (exact, labels) in exact.chunks(samples).zip(beam.label.chunks(samples)) {
        let mut run = 0;
        for ((_, a), b) in exact.iter().zip(labels) {
            run = if a == b { 0 } else { run + 1 };
            bands = bands.max(run);
        }
    }
    [places, bands as f64]
}

/// Tests errors of positions, in samples, and of label boundaries.
pub(super) fn away(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    for (index, situation) in PLACES.iter().enumerate() {
        let anatomy = anatomy(situation);
        let mut effects = Effects::default();
        effects.slice.boundary = Boundary::Nearest;
        let shape = ProbeShape::Linear(Linear {
            width_mm: situation.depth_mm.clamp(1.0, 300.0),
        });
        let settings = settings(shape, situation.depth_mm, [64, 512], effects);
        let state = pose(situation);
        let synths = everywhere(&anatomy, &settings, &gpus)?;
        let Some(tables) = synths.first().map(|synth| synth.tables().clone()) else {
            continue;
        };
        let exact = truth(&tables, &state);
        let hit = exact.iter().filter(|(_, label)| *label > 0).count();
        record.under(
            format!("{}: samples over those in the volume", situation.what),
            exact.len() as f64 / hit as f64,
            100.0,
        );
        for mut synth in synths {
            let beam = synth.render_until("slice", &state)?;
            let [places, bands] = worst(&tables, &exact, &beam);
            let subject = format!("{}, {}", situation.what, name(&synth));
            record.under(format!("{subject}: places off, samples"), places, 0.1);
            record.under(format!("{subject}: wrong labels in a row along a scanline"), bands, 1.0);
        }
        record.done((index + 1) as f64 / PLACES.len() as f64);
    }
    Ok(())
}

/// Offsets of whole metres, on and off the axes, mm.
const METRES: [[f64; 3]; 4] = [
    [1e5, 0.0, 0.0],
    [0.0, -1e5, 0.0],
    [57_000.0, 60_000.0, -56_000.0],
    [-99_000.0, 3_000.0, 12_000.0],
];

/// Offset that is not in whole metres, mm.
const ANYWHERE: [f64; 3] = [-57_512.3, 60_345.6, -55_987.1];

/// Grid of all scene coordinates, mm, on which moving a scene causes no rounding: double-precision numbers of 1e5 are
/// 2^-36 apart.
const GRID_MM: f64 = 1.0 / (1 << 20) as f64;

/// Tolerance for offsets in double precision at 1e5 mm after a few products and sums, mm.
const DOUBLE_MM: f64 = 1e-9;

/// Compares frames near and far, pixel by pixel, and the resulting world coordinates.
pub(crate) fn moved_scenes(record: &mut Record<'_>) -> Result<(), Unexpected> {
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
        // Whole metres leave coordinates on the grid exact in f64, so that pixels must be equal; elsewhere
        // coordinates round, and backends may differ by rounding.
        let offset = METRES[index as usize % METRES.len()];
        compare(&case, offset, &gpus, &mut sums)?;
        let far = case.moved(ANYWHERE)?;
        let verdicts = check(&far, &gpus)?;
        tally.add(&far, verdicts);
        record.done((index + 1) as f64 / count as f64);
    }
    for (kind, count) in [("a mesh", meshes), ("a needle", needles), ("speckle", grainy)] {
        record.under(
            format!("scenes needed with {kind} over those there"),
            2.0 / count as f64,
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
    let origin: Vector3<f64> = volume.index_to_world().fixed_view::<3, 1>(0, 3).into();
    case.anatomy.volume = Arc::new(volume.moved(origin.map(round) - origin)?);
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
    for node_list in [&mut state.nodes, &mut state.reference] {
        *node_list = node_list.as_deref().map(nodes);
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

fn compare(case: &Case, offset: [f64; 3], gpus: &[Gpu], sums: &mut Vec<Sum>) -> Result<(), Unexpected> {
    let moved_case = case.moved(offset)?;
    let synths_of = |case: &Case| -> Result<Vec<Synthesizer>, Unexpected> {
        let mut synths = vec![case.exact()?];
        synths.extend(case.twins(gpus)?);
        Ok(synths)
    };
    let offset = Vector3::from(offset);
    for (index, (mut near, mut far)) in synths_of(case)?.into_iter().zip(synths_of(&moved_case)?).enumerate() {
        if sums.len() <= index {
            sums.push(Sum {
                backend: name(&near),
                pixels: 0,
                places_mm: 0.0,
                frame_mm: 0.0,
            });
        }
        let expected = near.render(&case.state)?.clone();
        let frame = far.render(&moved_case.state)?.clone();
        let differing_pixels = expected
            .pixels
            .iter()
            .zip(&frame.pixels)
            .filter(|(a, b)| a != b)
            .count();
        let frames = frame.image_to_world - Matrix4::new_translation(&offset) * expected.image_to_world;
        let (near_beam, far_beam) = (near.beam()?, far.beam()?);
        let places = near_beam
            .position
            .iter()
            .zip(&far_beam.position)
            .map(|(before, after)| {
                let displacement = Vector3::new(after[0] - before[0], after[1] - before[1], after[2] - before[2]);
                (displacement - offset).amax()
            });
        // `zip` stops at the shorter frame: pixels that only one of them has differ as well.
        let sum = &mut sums[index];
        sum.pixels += differing_pixels + expected.pixels.len().abs_diff(frame.pixels.len());
        sum.places_mm = largest(places.chain([sum.places_mm]));
        sum.frame_mm = largest(frames.iter().copied().chain([sum.frame_mm]));
    }
    Ok(())
}
