//! Slice: the label of every sample. A twin may read another label only where the sample provably lies within rounding
//! of a place where the label changes.

use std::collections::BTreeSet;

use insonify_imaging::effects::slice::{Beyond, Boundary};
use insonify_imaging::parity::possible_labels;

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
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
    check_all(&cases);
}

#[test]
fn far_samples_are_possible_labels_only_at_faces() {
    let settings = scene::settings(scene::small_probe(), scene::bare());
    let case = Case::new("proof", scenes::unit_voxels(), settings, scene::straight());
    let exact = case.exact().expect("the reference");
    let tables = exact.tables();
    let error = [1e-6; 3];
    let middle = possible_labels(tables, [0.0, 20.0, 0.0, 0.0], error);
    assert_eq!(middle.len(), 1, "the middle of a voxel leaves no doubt: {middle:?}");
    assert_eq!(
        possible_labels(tables, [0.0, 500.0, 0.0, 0.0], error),
        BTreeSet::from([0])
    );
    assert_eq!(
        possible_labels(tables, [0.0, 20.0, 0.0, 1.0], error),
        BTreeSet::from([0])
    );
}
