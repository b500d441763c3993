//! Bounded work for any shape of the voxels: counted, not timed.

use nalgebra::Matrix3;
use proptest::prelude::*;

use super::*;

/// Maximum work per requested node, where a mesh of so many or none is found; shapes here take a third of it.
const PER_NODE: u64 = 3_000_000;

/// Returns result and work.
fn counted(volume: &Volume, nodes: usize) -> (Result<Generated, GenerateError>, u64) {
    let sampler = Sampler::new();
    let generated = generate_with(
        &sampler,
        &volume.grid(),
        nodes,
        &GenerateOptions::default(),
        &mut |_| {},
    );
    (generated, sampler.work())
}

fn flat(spacing: [f64; 3]) -> Volume {
    Volume::new([16; 3], spacing, |_| 1)
}

#[test]
fn tissue_too_thin_for_its_extent_is_refused_at_once() {
    let slice = Volume::new([16, 16, 1], [1.0, 1.0, 1e-3], |_| 1);
    let mut sheared = flat([5.0; 3]);
    sheared.index_to_world[(0, 2)] = 5000.0;
    for volume in [flat([5.0, 0.001, 5.0]), slice, sheared] {
        for nodes in [60, 20_000] {
            let (generated, work) = counted(&volume, nodes);
            assert!(matches!(generated, Err(GenerateError::TooThin { .. })), "{generated:?}");
            assert_eq!(work, 0, "{nodes} nodes");
        }
    }
}

#[test]
fn elements_without_volume_where_they_lie_are_refused() {
    let mut volume = flat([5.0; 3]);
    volume.index_to_world[(0, 3)] = 1e20;
    assert_eq!(counted(&volume, 60).0.unwrap_err(), GenerateError::Far);
}

/// Returns tissue in an ellipsoid, `radius` of which 1 reaches the corners of the box, in sheared voxels.
fn sheared(size: [usize; 3], spacing: [f64; 3], [x, y, z]: [f64; 3], radius: f64, around: u8) -> Volume {
    let extent = [0, 1, 2].map(|axis| size[axis] as f64 * spacing[axis]);
    let mut volume = Volume::new(size, spacing, |at| {
        let off: f64 = (0..3).map(|axis| (2.0 * at[axis] / extent[axis] - 1.0).powi(2)).sum();
        if off <= 3.0 * radius * radius { 1 } else { around }
    });
    volume.index_to_world =
        Matrix3::new(1.0, x, y, 0.0, 1.0, z, 0.0, 0.0, 1.0).to_homogeneous() * volume.index_to_world;
    volume
}

/// A volume for which 29,696 nodes were found to be the least by 17 billion units of work.
#[test]
fn search_for_the_least_budget_is_bounded() {
    let shear = [
        -1.386_804_621_554_911_f64,
        -2.404_079_483_987_751,
        1.623_190_127_311_949,
    ]
    .map(|x| x * x * x);
    let volume = sheared(
        [3, 3, 6],
        [1.0, 10f64.powf(2.765_359_259_363_994), 1.0],
        shear,
        0.344_375_693_969_463,
        0,
    );
    let (generated, work) = counted(&volume, 8);
    assert!(
        matches!(
            generated,
            Err(GenerateError::TooFewNodes { .. } | GenerateError::TooThin { .. })
        ),
        "{generated:?}"
    );
    assert!(work <= 8 * PER_NODE + 2 * budget::MAX_SEARCH, "{work}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 16, ..ProptestConfig::default() })]

    #[test]
    fn work_is_bounded_for_voxels_of_any_shape(
        size in prop::array::uniform3(1usize..17),
        lengths in prop::array::uniform3(-3.0..3.7f64),
        shear in prop::array::uniform3(-3.0..3.0f64),
        radius in 0.05..1.0f64,
        nodes in 8usize..120,
        around in 0u8..3,
    ) {
        let spacing = lengths.map(|length| 10f64.powf(length));
        let volume = sheared(size, spacing, shear.map(|x| x * x * x), radius, around);
        let (generated, work) = counted(&volume, nodes);
        let most = nodes as u64 * PER_NODE + 2 * budget::MAX_SEARCH;
        prop_assert!(work <= most, "{} of {} for {} nodes: {:?}", work, most, nodes, generated.map(|generated| generated.report));
    }
}
