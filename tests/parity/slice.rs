//! Slice: the label of every sample. A twin may read another label only where the sample provably lies within rounding of
//! a place where the label changes.

use std::collections::BTreeSet;

use insonify::imaging::effects::slice::{Beyond, Boundary};
use insonify::study::parity::possible_labels;

use super::case::{Case, check_all};
use super::scenes;
use crate::support::gpu::gpu_or_skip;
use crate::support::scene;

#[test]
fn random_labels_by_nearest_voxel_and_by_vote() {
    let mut cases = Vec::new();
    for (name, anatomy) in [
        ("axis-aligned", scenes::random_anatomy()),
        ("oblique", scenes::oblique_anatomy()),
    ] {
        for boundary in [Boundary::Nearest, Boundary::Vote, Boundary::Smooth] {
            let mut settings = scene::settings(scene::probe(scene::SHAPES[1].1, 40.0, 64, 256), scene::bare());
            settings.effects.slice.boundary = boundary;
            for beyond in [Beyond::Void, Beyond::Continue] {
                settings.effects.slice.beyond = beyond;
                cases.push(Case::new(
                    format!("{name} {boundary:?} {beyond:?}"),
                    anatomy.clone(),
                    settings.clone(),
                    scenes::oblique_pose(),
                ));
            }
        }
    }
    check_all("labels", &cases);
}

#[test]
fn samples_on_voxel_faces() {
    // Sample depths, voxel faces and vote ties coincide: an axis-aligned probe over whole and half millimetres.
    let mut cases = Vec::new();
    for boundary in [Boundary::Nearest, Boundary::Vote, Boundary::Smooth] {
        let shape = insonify::tracking::probe::ProbeShape::Linear { width_mm: 24.0 };
        let mut settings = scene::settings(scene::probe(shape, 40.0, 49, 160), scene::bare());
        settings.effects.slice.boundary = boundary;
        cases.push(Case::new(
            format!("{boundary:?}"),
            scenes::unit_voxels(),
            settings,
            scene::straight(),
        ));
    }
    check_all("faces", &cases);
}

#[test]
fn where_nothing_rounds_labels_agree_on_faces_and_ties() {
    // Positions, indices and shares of the votes are sums of few powers of two: exact in single precision, whatever the
    // rounding. Samples on voxel faces and votes that tie must then come out alike.
    let shape = insonify::tracking::probe::ProbeShape::Linear { width_mm: 24.0 };
    let gpus: Vec<_> = gpu_or_skip("labels without rounding").into_iter().collect();
    for boundary in [Boundary::Nearest, Boundary::Vote, Boundary::Smooth] {
        let mut settings = scene::settings(scene::probe(shape, 40.0, 33, 160), scene::bare());
        settings.effects.slice.boundary = boundary;
        let case = Case::new(
            format!("{boundary:?}"),
            scenes::unit_voxels(),
            settings,
            scene::straight(),
        );
        let exact = case
            .exact()
            .expect("the reference")
            .render_until("slice", &case.state)
            .expect("a beam");
        for mut twin in case.twins(&gpus).expect("backends") {
            let found = twin.render_until("slice", &case.state).expect("a beam");
            assert!(
                found.position == exact.position,
                "{}: positions are exact",
                twin.backend()
            );
            assert!(found.label == exact.label, "{boundary:?} on {}", twin.backend());
        }
    }
}

#[test]
fn far_samples_are_possible_labels_only_at_faces() {
    let settings = scene::settings(scene::small_probe(), scene::bare());
    let case = Case::new("proof", scenes::unit_voxels(), settings, scene::straight());
    let exact = case.exact().expect("the reference");
    let tables = exact.tables();
    let off = [1e-6; 3];
    let middle = possible_labels(tables, [0.0, 20.0, 0.0, 0.0], off);
    assert_eq!(middle.len(), 1, "the middle of a voxel leaves no doubt: {middle:?}");
    assert_eq!(
        possible_labels(tables, [0.0, 500.0, 0.0, 0.0], off),
        BTreeSet::from([0])
    );
    assert_eq!(possible_labels(tables, [0.0, 20.0, 0.0, 1.0], off), BTreeSet::from([0]));
}
