use super::*;
use crate::anatomies::{self, Frame, PLAIN, SILENT};

/// A volume of 20 mm about a point.
fn about(centre: [f64; 3]) -> Arc<LabelVolume> {
    anatomies::anatomy_from(Frame::around(centre, [20; 3], 1.0), &[SILENT, PLAIN], |_| 1).volume
}

#[test]
fn nearby_it_is_the_worlds_own_and_nothing_is_copied() {
    for centre in [[0.0; 3], [-310.0, 95.0, 1820.0], [FAR_MM, -FAR_MM, FAR_MM]] {
        let volume = about(centre);
        let origin = LocalOrigin::of(&volume);
        assert!(origin.is_world(), "{centre:?}");
        assert!(Arc::ptr_eq(&volume, &origin.volume(&volume).unwrap()));
        let point = [-0.0, 1e-300, f64::NAN];
        let same = |a: [f64; 3]| a.map(f64::to_bits) == point.map(f64::to_bits);
        assert!(same(origin.to_local(point)) && same(origin.to_world(point)));
        let (mut local, state) = (LocalFrame::new(origin), FrameState::at(Matrix4::identity()));
        local.take(&state).unwrap();
        assert!(std::ptr::eq(local.localized(&state), &state));
    }
}

#[test]
fn far_away_it_is_the_nearest_whole_metre() {
    let volume = about([4096.5, -499.0, -100_501.0]);
    let origin = LocalOrigin::of(&volume);
    assert_eq!(<[f64; 3]>::from(origin.world_mm), [4000.0, 0.0, -101_000.0]);
    let local = origin.volume(&volume).unwrap();
    assert_eq!(local.centre_mm(), Point3::new(96.5, -499.0, 499.0));
    assert!(std::ptr::eq(local.voxels(), volume.voxels()), "voxels are shared");
    let world = Point3::new(4101.25, -495.0, -100_497.5);
    assert_eq!(
        volume.label_index_at(&world),
        local.label_index_at(&origin.to_local(world.into()).into())
    );
}

#[test]
fn there_and_back_is_exact() {
    let origin = LocalOrigin::of(&about([1e5, -1e5, 57_300.0]));
    for at in 0..1000 {
        let world = [1e5, -1e5, 57_300.0].map(|x: f64| x + 0.377 * f64::from(at - 500));
        assert_eq!(origin.to_world(origin.to_local(world)), world);
    }
}

#[test]
fn all_of_a_frame_moves_together() {
    let origin = LocalOrigin::of(&about([1e5, 0.0, 0.0]));
    let mut local = LocalFrame::new(origin);
    let node = |x: f64| [1e5 + x, 2.0, -3.0];
    let mut world = FrameState {
        frame: 7,
        needle: Some(NeedleShaft {
            nodes: vec![node(1.5).into(), node(4.5).into()],
            diameter_mm: 1.3,
        }),
        seeds: vec![NeedleShaft::seed(node(0.5).into(), &Vector3::x())],
        nodes: Some(vec![node(0.25), node(0.75)]),
        reference: Some(vec![node(0.125)]),
        ..FrameState::at(Matrix4::new_translation(&Vector3::from(node(9.0))))
    };
    local.take(&world).unwrap();
    let seen = local.localized(&world);
    assert_eq!((seen.frame, seen.probe_to_world[(0, 3)]), (7, 9.0));
    let needle = seen.needle.as_ref().unwrap();
    assert_eq!(
        (needle.nodes[1], needle.diameter_mm),
        (Point3::new(4.5, 2.0, -3.0), 1.3)
    );
    assert_eq!(seen.seeds[0].nodes[0].x, 0.5 - crate::synth::SEED_LENGTH_MM / 2.0);
    assert_eq!(seen.nodes.as_deref(), Some(&[[0.25, 2.0, -3.0], [0.75, 2.0, -3.0]][..]));
    assert_eq!(seen.reference.as_deref(), Some(&[[0.125, 2.0, -3.0]][..]));

    // The memory of nodes is reused while frames have none.
    let memory = seen.nodes.as_ref().map(|nodes| nodes.as_ptr());
    let nodes = world.nodes.take();
    world.needle = None;
    world.seeds.clear();
    local.take(&world).unwrap();
    let seen = local.localized(&world);
    assert!(seen.nodes.is_none() && seen.needle.is_none() && seen.seeds.is_empty());
    world.nodes = nodes;
    local.take(&world).unwrap();
    assert_eq!(
        local.localized(&world).nodes.as_ref().map(|nodes| nodes.as_ptr()),
        memory
    );
}

#[test]
fn a_pose_with_the_noise_of_a_tracker_is_rounded_to_a_rigid_one() {
    for centre in [[0.0; 3], [1e5, 0.0, 0.0]] {
        let mut local = LocalFrame::new(LocalOrigin::of(&about(centre)));
        let mut world = FrameState::at(Matrix4::new_translation(&Vector3::new(centre[0] + 9.0, 2.0, 3.0)));
        world.probe_to_world[(0, 1)] = 3e-3;
        world.frame = 5;
        let rigid = local.take(&world).unwrap();
        assert!((rigid[(0, 1)] - 1.5e-3).abs() < 1e-5 && (rigid[(1, 0)] + 1.5e-3).abs() < 1e-5);
        let seen = local.localized(&world);
        assert_eq!(seen.probe_to_world[(0, 1)], rigid[(0, 1)]);
        assert_eq!((seen.frame, seen.probe_to_world[(0, 3)]), (5, 9.0));
    }
}
