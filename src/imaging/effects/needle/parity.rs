//! Needle: chords through a cylinder. The chord ends in a square root, so at the edge of the shaft rounding shows by
//! its root; in front of the tip and behind the hub the share may jump within rounding of the end.

use insonify_imaging::effects::Effects;
use insonify_imaging::effects::needle::NeedleEcho;
use insonify_imaging::synth::NeedleShaft;

use crate::parity_tests::case::{Case, check_all, random};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

/// A straight needle through the small probe's plane, in and out of it by angle and offset.
fn shaft(points: &[[f64; 3]], state: &mut insonify_imaging::synth::FrameState) {
    let nodes = points
        .iter()
        .map(|&point| state.probe_to_world.transform_point(&point.into()))
        .collect();
    state.needle = Some(NeedleShaft {
        nodes,
        diameter_mm: 1.3,
    });
}

#[test]
fn straight_and_bent_needles_in_and_out_of_the_plane() {
    let shafts: [(&str, &[[f64; 3]]); 8] = [
        ("in the plane", &[[-18.0, 4.0, 0.0], [9.0, 31.0, 0.0]]),
        ("beside the plane", &[[-18.0, 4.0, 0.5], [9.0, 31.0, 0.5]]),
        ("oblique", &[[-18.0, 4.0, -7.0], [9.0, 31.0, 5.0]]),
        ("across the plane", &[[1.0, 20.0, -15.0], [1.0, 20.0, 15.0]]),
        ("along a beam", &[[0.1, 2.0, 0.0], [0.1, 33.0, 0.0]]),
        (
            "bent in the plane",
            &[[-18.0, 4.0, 0.0], [-8.0, 12.0, 0.0], [0.0, 21.0, 0.0], [5.0, 33.0, 0.0]],
        ),
        (
            "bent out of the plane",
            &[[-18.0, 4.0, 0.0], [-8.0, 12.0, 0.1], [0.0, 21.0, 0.8], [5.0, 33.0, 3.0]],
        ),
        ("a point", &[[1.0, 20.0, 0.0], [1.0, 20.0, 0.001]]),
    ];
    let mut cases = Vec::new();
    for (number, (name, points)) in shafts.into_iter().enumerate() {
        let (kind, shape) = SHAPES[number % SHAPES.len()];
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
        settings.has_needle = true;
        settings.effects.needle = Some(NeedleEcho {
            thickness_mm: (number % 2 == 1).then_some(2.0),
            ..Default::default()
        });
        let mut state = scenes::oblique_pose();
        shaft(points, &mut state);
        cases.push(Case::new(
            format!("{name}, {kind}"),
            scenes::random_anatomy(),
            settings,
            state,
        ));
    }
    check_all(&cases);
}

#[test]
fn a_needle_along_a_beam_echoes_where_no_direction_counts() {
    // Its sine to the beam is 0, to the power 0.
    let mut settings = scene::settings(scene::probe(SHAPES[0].1, 40.0, 25, 96), scene::bare());
    settings.has_needle = true;
    settings.effects.needle = Some(NeedleEcho {
        directivity: 0.0,
        ..Default::default()
    });
    let mut state = scene::straight();
    shaft(&[[0.0, 2.0, 0.0], [0.0, 33.0, 0.0]], &mut state);
    let case = Case::new("sine 0, directivity 0", scenes::random_anatomy(), settings, state);
    let echoes = case
        .exact()
        .expect("the reference")
        .render_until("needle", &case.state)
        .expect("echoes");
    assert!(
        echoes.needle.iter().any(|&share| share > 0.5),
        "the needle is in the plane"
    );
    check_all(&[case]);
}

#[test]
fn no_needle_in_this_frame() {
    let mut settings = scene::settings(scene::small_probe(), Effects::all());
    settings.has_needle = true;
    check_all(&[random("no needle", settings)]);
}

#[test]
fn seeds_with_and_without_a_needle() {
    let seeds: [([f64; 3], [f64; 3], f64); 6] = [
        ([-6.0, 12.0, 0.0], [1.0, 0.0, 0.0], 0.8),
        ([2.0, 15.0, 0.2], [0.0, 1.0, 0.0], 0.8),
        ([4.0, 24.0, -0.3], [0.0, 0.0, 1.0], 0.8),
        ([-3.0, 28.0, 0.1], [0.3, 0.8, 0.2], 2.5),
        // Over the one before, and out of the plane.
        ([-3.2, 28.3, 0.1], [1.0, 0.8, 0.2], 0.8),
        ([0.0, 20.0, 6.0], [0.0, 1.0, 0.0], 0.8),
    ];
    let mut cases = Vec::new();
    for (number, (kind, shape)) in SHAPES.into_iter().enumerate() {
        let effects = [scene::bare(), Effects::all()][number % 2].clone();
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), effects);
        settings.has_needle = true;
        settings.effects.needle = Some(NeedleEcho {
            thickness_mm: (number % 3 == 2).then_some(1.5),
            ..Default::default()
        });
        settings.effects.shadow = Some(Default::default());
        let mut state = scenes::oblique_pose();
        state.seeds = seeds
            .iter()
            .map(|&(centre, along, diameter_mm)| {
                let pose = state.probe_to_world;
                let centre = pose.transform_point(&centre.into());
                let mut seed = NeedleShaft::seed(centre, &pose.transform_vector(&along.into()));
                seed.diameter_mm = diameter_mm;
                seed
            })
            .collect();
        let alone = Case::new(format!("seeds, {kind}"), scenes::random_anatomy(), settings, state);
        let mut beside = alone.clone();
        beside.name = format!("needle and seeds, {kind}");
        beside.state = scenes::with_needle(beside.state);
        cases.extend([alone, beside]);
    }
    check_all(&cases);
}
