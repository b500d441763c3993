//! Places that single precision can barely tell apart.

use nalgebra::{Matrix4, Rotation3, Vector3};

use super::super::record::{Record, Unexpected, largest};
use super::setup::{everywhere, gpus, name, settings};
use crate::effects::Effects;
use crate::effects::slice::Boundary;
use crate::study::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::synth::FrameState;
use crate::synth::layers::Beam;
use crate::synth::tables::{Anatomy, Settings};
use crate::tracking::probe::ProbeShape;

/// A probe in a volume, both at `centre`, with voxels of `voxel_mm`.
struct Place {
    what: &'static str,
    /// Whether the criterion speaks of it; what is finer than single precision resolves so far away is told, not judged.
    judged: bool,
    centre: [f64; 3],
    voxel_mm: f64,
    depth_mm: f64,
}

const PLACES: [Place; 4] = [
    Place {
        what: "1e5 mm away",
        judged: true,
        centre: [57_000.0, -60_000.0, 56_000.0],
        voxel_mm: 1.0,
        depth_mm: 40.0,
    },
    Place {
        what: "1e5 mm away, samples of 0.016 mm",
        judged: false,
        centre: [0.0, 100_000.0, 0.0],
        voxel_mm: 0.2,
        depth_mm: 8.0,
    },
    Place {
        what: "voxels of 1e-3 mm",
        judged: true,
        centre: [31.0, -44.0, 57.0],
        voxel_mm: 1e-3,
        depth_mm: 0.1,
    },
    Place {
        what: "voxels of 1e3 mm",
        judged: true,
        centre: [3100.0, -4400.0, 5700.0],
        voxel_mm: 1e3,
        depth_mm: 1000.0,
    },
];

/// Slabs of one voxel each, whose faces no axis is parallel to; the probe's depth runs across them.
fn anatomy(place: &Place) -> Anatomy {
    let tissue = |echo_db| Acoustics { echo_db, ..PLAIN };
    let frame = Frame::around(place.centre, [48; 3], place.voxel_mm).oblique();
    let back = frame.index_to_world.try_inverse().unwrap_or_else(Matrix4::identity);
    anatomies::of(frame, &[SILENT, tissue(0.0), tissue(6.0)], |p| {
        let index = back.transform_point(&p.into());
        1 + (index.y.round().rem_euclid(2.0)) as u8
    })
}

/// The middle of the scan at the middle of the volume, turned about every axis.
fn pose(place: &Place) -> FrameState {
    let turn = Rotation3::from_euler_angles(0.41, 0.23, -0.37).to_homogeneous();
    let centre = Matrix4::new_translation(&Vector3::from(place.centre));
    let back = Matrix4::new_translation(&Vector3::new(0.0, -0.5 * place.depth_mm, 0.0));
    FrameState::at(centre * turn * back)
}

/// Samples away from a voxel face beyond which a label must be that of double precision, and how far places are off: both in samples.
fn worst(settings: &Settings, exact: &Beam, found: &Beam) -> [f64; 2] {
    let sample_mm = settings.probe.depth_mm / f64::from(settings.probe.samples);
    let off = |(a, b): (&[f64; 4], &[f64; 4])| {
        let apart = Vector3::new(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
        apart.norm() / sample_mm
    };
    let places = largest(exact.position.iter().zip(&found.position).map(off));
    // A label of another backend is that of double precision at the sample itself or at one so many samples along the line; bands
    // would be many samples thick.
    let samples = exact.samples;
    let mut bands = 0usize;
    for (exact, found) in exact.label.chunks(samples).zip(found.label.chunks(samples)) {
        let mut run = 0;
        for (a, b) in exact.iter().zip(found) {
            run = if a == b { 0 } else { run + 1 };
            bands = bands.max(run);
        }
    }
    [places, bands as f64]
}

/// Errors of places in samples, and of the boundaries of labels.
pub fn away(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let samples = 512;
    for (at, place) in PLACES.iter().enumerate() {
        let anatomy = anatomy(place);
        let mut effects = Effects::default();
        effects.slice.boundary = Boundary::Nearest;
        let shape = ProbeShape::Linear {
            width_mm: place.depth_mm.clamp(1.0, 300.0),
        };
        let settings = settings(shape, place.depth_mm, [64, samples], effects);
        let state = pose(place);
        let mut synths = everywhere(&anatomy, &settings, &gpus)?.into_iter();
        let Some(mut reference) = synths.next() else { continue };
        let exact = reference.render_until("slice", &state)?;
        let hit = exact.label.iter().filter(|label| **label > 0).count();
        record.under(
            format!("{}: samples over those in the volume", place.what),
            exact.label.len() as f64 / hit as f64,
            100.0,
        );
        for mut synth in synths {
            let found = synth.render_until("slice", &state)?;
            let [places, bands] = worst(&settings, &exact, &found);
            let backend = name(&synth);
            let figures = [
                ("places off, samples", places, 0.1),
                ("wrong labels in a row along a scanline", bands, 1.0),
            ];
            for (what, figure, limit) in figures {
                let what = format!("{}, {backend}: {what}", place.what);
                match place.judged {
                    true => record.under(what, figure, limit),
                    false => record.report(what, figure),
                }
            }
        }
        record.done((at + 1) as f64 / PLACES.len() as f64);
    }
    Ok(())
}
