use nalgebra::{Point3, Vector3};

use super::*;
use crate::anatomies;
use crate::effects::needle::NeedleEcho;
use crate::synth::{NeedleShaft, SEED_DIAMETER_MM, SEED_LENGTH_MM};

/// Tables of a scene that shows needles, and a frame whose probe frame equals the world.
fn scene(thickness_mm: Option<f64>) -> (Tables, FrameState) {
    let (anatomy, mut settings, _) = anatomies::two_layers();
    settings.has_needle = true;
    settings.effects.needle = Some(NeedleEcho {
        thickness_mm,
        ..NeedleEcho::default()
    });
    let tables = Tables::new(anatomy, settings).unwrap();
    (tables, FrameState::at(nalgebra::Matrix4::identity()))
}

fn lying(z: f64) -> NeedleShaft {
    NeedleShaft::seed(Point3::new(1.0, 20.0, z), &Vector3::new(0.0, 3.0, 0.0))
}

#[test]
fn a_seed_is_a_segment_about_its_centre_with_radius_and_thickness() {
    let (tables, mut state) = scene(None);
    state.seeds = vec![lying(0.25)];
    let found: Vec<_> = segments(&tables, &state).collect();
    let half = SEED_LENGTH_MM / 2.0;
    let [radius, thickness] = [SEED_DIAMETER_MM / 2.0, SEED_DIAMETER_MM].map(|length| f64::from(length as f32));
    let [[start, end, [first, last, number, factor]]] = found[..] else {
        panic!("one segment: {found:?}")
    };
    assert_eq!(
        [start, end],
        [[1.0, 20.0 - half, 0.25, radius], [1.0, 20.0 + half, 0.25, thickness]]
    );
    assert_eq!((first, last, number), (SEED_LENGTH_MM, 0.0, 1.0));
    assert!(factor > 0.0 && factor <= 1.0);
}

#[test]
fn what_does_not_meet_the_plane_is_left_to_itself() {
    // Half a plane and half a seed: 0.8 mm with a plane as thick as the seed, 1.4 mm with one of 2 mm.
    for (thickness_mm, reach) in [(None, 0.8), (Some(2.0), 1.4)] {
        let (tables, mut state) = scene(thickness_mm);
        state.seeds = vec![
            lying(reach - 1e-3),
            lying(reach + 1e-3),
            lying(-reach + 1e-3),
            lying(-reach - 1e-3),
        ];
        let depths: Vec<f64> = segments(&tables, &state).map(|[start, ..]| start[2]).collect();
        assert_eq!(depths, [reach - 1e-3, -reach + 1e-3]);
        assert_eq!(left_out(&tables, &state), 0);
    }
}

#[test]
fn too_many_segments_are_told() {
    let (tables, mut state) = scene(None);
    let line = (0..MAX_NODES + 10)
        .map(|at| Point3::new(at as f64, 20.0, 0.0))
        .collect();
    state.needle = Some(NeedleShaft {
        nodes: line,
        diameter_mm: 1.2,
    });
    state.seeds = (0..200).map(|at| lying(f64::from(at) * 1e-3)).collect();
    let found: Vec<_> = segments(&tables, &state).collect();
    // The part of the needle towards the tip, and the first seeds.
    let needle = MAX_NODES - 1;
    assert_eq!(found.len(), MAX_SEGMENTS);
    assert_eq!(
        (found[0][0][0], found[needle - 1][1][0]),
        (10.0, (MAX_NODES + 9) as f64)
    );
    // The last needle segment ends at the tip.
    assert_eq!(found[needle - 1][2][..3], [1.0, 0.0, 0.0]);
    assert_eq!(found[0][2][0], needle as f64);
    assert_eq!(found[MAX_SEGMENTS - 1][0][2], (MAX_SEGMENTS - needle - 1) as f64 * 1e-3);
    assert_eq!(left_out(&tables, &state), 10 + 200 - (MAX_SEGMENTS - needle));
    let mut hidden = tables.clone();
    hidden.settings.has_needle = false;
    assert_eq!(left_out(&hidden, &state), 0);
}

#[test]
fn what_is_not_finite_or_has_no_thickness_is_not_shown() {
    let (tables, mut state) = scene(None);
    let good = lying(0.0);
    let with = |change: fn(&mut NeedleShaft)| {
        let mut shaft = good.clone();
        change(&mut shaft);
        shaft
    };
    state.seeds = vec![
        with(|shaft| shaft.nodes[1].y = f64::NAN),
        with(|shaft| shaft.nodes[0].x = f64::INFINITY),
        with(|shaft| shaft.diameter_mm = 0.0),
        with(|shaft| shaft.diameter_mm = -1.0),
        with(|shaft| shaft.diameter_mm = f64::NAN),
        with(|shaft| shaft.nodes.truncate(1)),
        NeedleShaft::seed(Point3::origin(), &Vector3::zeros()),
        good.clone(),
    ];
    assert_eq!(segments(&tables, &state).count(), 1);
}
