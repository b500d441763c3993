//! Cases of samples exactly on label boundaries.

use nalgebra::{Matrix4, Rotation3, Vector3};

use super::super::record::{Record, Unexpected};
use super::setup::{Tally, everywhere, gpus, name, settings};
use crate::imaging::effects::Effects;
use crate::imaging::effects::slice::Boundary;
use crate::imaging::synth::FrameState;
use crate::imaging::synth::tables::Anatomy;
use crate::study::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::study::parity::{Case, check};
use crate::tracking::probe::ProbeShape;

/// Creates random labels at every voxel of 1 mm, with faces at whole millimetres.
fn voxels(seed: u64) -> Anatomy {
    let tissue = |echo_db| Acoustics { echo_db, ..PLAIN };
    anatomies::random(
        Frame::around([0.0, 20.0, 0.0], [40; 3], 1.0),
        &[SILENT, tissue(0.0), tissue(6.0), tissue(-12.0)],
        seed as u32,
    )
}

/// Returns poses whose plane lies exactly between two layers of voxels across z, x and, seen from the side, y. Quarter turns are exact.
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

/// Tests linear probes: with 33 scanlines over 24 mm every position is a sum of few powers of two, exact in either precision; with 25
/// scanlines, 1 mm apart, samples lie on faces, edges and corners, and with 49, half a millimetre apart, many do.
pub fn on_faces(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let anatomy = voxels(record.seed());
    let shape = ProbeShape::Linear { width_mm: 24.0 };
    let mut tally = Tally::default();
    let (mut apart, mut moved, mut on_face): (Vec<(String, usize)>, usize, usize) = (Vec::new(), 0, 0);
    for boundary in [Boundary::Nearest, Boundary::Vote, Boundary::Smooth] {
        let mut effects = Effects::default();
        effects.slice.boundary = boundary;
        for (at, state) in poses().into_iter().enumerate() {
            let exact_settings = settings(shape, 40.0, [33, 160], effects.clone());
            let mut synths = everywhere(&anatomy, &exact_settings, &gpus)?.into_iter();
            let Some(mut reference) = synths.next() else { continue };
            let expected = reference.render_until("slice", &state)?;
            on_face += expected
                .position
                .iter()
                .filter(|p| p[..3].iter().any(|x| x.fract() == 0.0))
                .count();
            for (place, mut synth) in synths.enumerate() {
                let found = synth.render_until("slice", &state)?;
                moved += expected
                    .position
                    .iter()
                    .zip(&found.position)
                    .filter(|(a, b)| a != b)
                    .count();
                let labels = expected.label.iter().zip(&found.label).filter(|(a, b)| a != b).count();
                if apart.len() <= place {
                    apart.push((name(&synth), 0));
                }
                apart[place].1 += labels;
            }
            for grid in [[25, 80], [49, 160]] {
                let case = Case::new(
                    format!("{boundary:?}, pose {at}, {grid:?}"),
                    anatomy.clone(),
                    settings(shape, 40.0, grid, effects.clone()),
                    state.clone(),
                );
                let verdicts = check(&case, &gpus)?;
                tally.add(&case, verdicts);
            }
            record.done((at as f64 + 1.0) / 3.0 * if boundary == Boundary::Nearest { 0.5 } else { 1.0 });
        }
    }
    // At least half of the planes must have samples in the critical positions.
    record.under("samples needed on faces over those there", 1000.0 / on_face as f64, 1.0);
    record.zero("places that round where none should", moved as f64);
    for (backend, apart) in apart {
        record.zero(format!("{backend}: labels apart where nothing rounds"), apart as f64);
    }
    tally.note(record)
}
