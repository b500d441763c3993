//! Cases of positions that single precision can barely resolve.

use nalgebra::{Matrix4, Point3, Rotation3, Vector3};

use super::super::record::{Record, Unexpected, largest};
use super::setup::{everywhere, gpus, name, settings};
use crate::imaging::effects::Effects;
use crate::imaging::effects::slice::Boundary;
use crate::imaging::synth::FrameState;
use crate::imaging::synth::layers::{Beam, world_position};
use crate::imaging::synth::tables::{Anatomy, Tables};
use crate::study::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::tracking::probe::ProbeShape;

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
fn anatomy(place: &Place) -> Anatomy {
    let tissue = |echo_db| Acoustics { echo_db, ..PLAIN };
    let frame = Frame::around(place.centre, [48; 3], place.voxel_mm).oblique();
    let back = frame.index_to_world.try_inverse().unwrap_or_else(Matrix4::identity);
    anatomies::of(frame, &[SILENT, tissue(0.0), tissue(6.0)], |p| {
        let index = back.transform_point(&p.into());
        1 + (index.y.round().rem_euclid(2.0)) as u8
    })
}

/// Places the middle of the scan at the middle of the volume, turned about every axis.
fn pose(place: &Place) -> FrameState {
    let turn = Rotation3::from_euler_angles(0.41, 0.23, -0.37).to_homogeneous();
    let centre = Matrix4::new_translation(&Vector3::from(place.centre));
    let back = Matrix4::new_translation(&Vector3::new(0.0, -0.5 * place.depth_mm, 0.0));
    FrameState::at(centre * turn * back)
}

/// Computes sample positions and labels from pose and volume in double precision, independently of passes and local origin.
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
fn worst(tables: &Tables, exact: &[(Point3<f64>, u8)], found: &Beam) -> [f64; 2] {
    let off = |((exact, _), found): (&(Point3<f64>, u8), &[f64; 4])| {
        let apart = exact.coords - Vector3::new(found[0], found[1], found[2]);
        apart.norm() / tables.sample_mm()
    };
    let places = largest(exact.iter().zip(&found.position).map(off));
    // Longest run of differing labels: a boundary may be shifted by a few samples along the scanline; bands would be many samples thick.
    let samples = found.samples;
    let mut bands = 0usize;
    for (exact, found) in exact.chunks(samples).zip(found.label.chunks(samples)) {
        let mut run = 0;
        for ((_, a), b) in exact.iter().zip(found) {
            run = if a == b { 0 } else { run + 1 };
            bands = bands.max(run);
        }
    }
    [places, bands as f64]
}

/// Tests errors of positions, in samples, and of label boundaries.
pub fn away(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    for (at, place) in PLACES.iter().enumerate() {
        let anatomy = anatomy(place);
        let mut effects = Effects::default();
        effects.slice.boundary = Boundary::Nearest;
        let shape = ProbeShape::Linear {
            width_mm: place.depth_mm.clamp(1.0, 300.0),
        };
        let settings = settings(shape, place.depth_mm, [64, 512], effects);
        let state = pose(place);
        let synths = everywhere(&anatomy, &settings, &gpus)?;
        let Some(tables) = synths.first().map(|synth| synth.tables().clone()) else {
            continue;
        };
        let exact = truth(&tables, &state);
        let hit = exact.iter().filter(|(_, label)| *label > 0).count();
        record.under(
            format!("{}: samples over those in the volume", place.what),
            exact.len() as f64 / hit as f64,
            100.0,
        );
        for mut synth in synths {
            let found = synth.render_until("slice", &state)?;
            let [places, bands] = worst(&tables, &exact, &found);
            let what = format!("{}, {}", place.what, name(&synth));
            record.under(format!("{what}: places off, samples"), places, 0.1);
            record.under(format!("{what}: wrong labels in a row along a scanline"), bands, 1.0);
        }
        record.done((at + 1) as f64 / PLACES.len() as f64);
    }
    Ok(())
}
