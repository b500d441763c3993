//! Agreement of meshes with the volumes from which they are made.

use nalgebra::{Matrix3, Matrix4, Rotation3, Vector3};

use super::*;

/// Returns 1 within `radius` mm of a point, else 0.
fn ball(centre: [f64; 3], radius: f64) -> impl Fn([f64; 3]) -> u8 {
    move |at| u8::from((Vector3::from(at) - Vector3::from(centre)).norm() < radius)
}

/// A ball of 1 in a block of 2.
fn inclusion() -> Volume {
    let within = ball([20.0, 20.0, 20.0], 12.0);
    Volume::new([40; 3], [1.0; 3], move |at| 2 - within(at))
}

/// Returns the volume error of a region, per cent.
fn off(generated: &Generated, number: i32) -> f64 {
    region(generated, number).error_percent.abs()
}

#[test]
fn a_block_is_filled_exactly() {
    for nodes in [8, 30, 200, 1500] {
        let volume = Volume::new([20, 12, 9], [1.0, 1.5, 2.0], |_| 3);
        let generated = volume.mesh(nodes);
        // Nodes of the surface stay in the faces of the block, so volume and area are exact to rounding, and a crack
        // along a hanging node would add to the area.
        assert!(off(&generated, 30) < 1e-9, "{:?}", generated.report);
        let area = area(&generated.mesh);
        assert!(
            (area - 2.0 * (20.0 * 18.0 + 20.0 * 18.0 + 18.0 * 18.0)).abs() < 1e-8,
            "{area}"
        );
        assert_eq!(euler(&generated.mesh), 1);
        assert_eq!(generated.report.parts, 1);
        assert!(generated.report.mislabelled_percent < 1e-9);
        let bounds = generated.mesh.bounds();
        for (bound, expected) in bounds.as_flattened().iter().zip([0.0, 0.0, 0.0, 20.0, 18.0, 18.0]) {
            assert!((bound - expected).abs() < 1e-12, "{bounds:?}");
        }
    }
}

#[test]
fn the_budget_is_kept_and_used() {
    let volumes = [
        inclusion(),
        Volume::new([48; 3], [1.0; 3], ball([24.0; 3], 20.0)),
        Volume::new([30, 30, 60], [2.0, 2.0, 1.0], |at| {
            1 + u8::from(at[2] > 25.0) + u8::from(at[0] > 31.0)
        }),
    ];
    for volume in &volumes {
        for nodes in [300, 1000, 3000] {
            let generated = volume.mesh(nodes);
            // As `generate` documents: never more, and 15 % fewer at the most.
            let share = generated.report.nodes as f64 / nodes as f64;
            assert!(share >= 0.85, "{} nodes for {nodes}", generated.report.nodes);
        }
    }
}

#[test]
fn balls_keep_their_volume_and_stay_balls() {
    for nodes in [300, 1000, 3000] {
        let volume = Volume::new([48; 3], [1.0; 3], ball([24.0; 3], 20.0));
        let generated = volume.mesh(nodes);
        assert!(off(&generated, 10) <= 1.0, "{:?}", generated.report);
        assert_eq!((euler(&generated.mesh), generated.report.parts), (1, 1));
        // The staircase of the voxels has 6/4 of the area of the ball: a smooth surface stays below the mean of both.
        let share = area(&generated.mesh) / (4.0 * std::f64::consts::PI * 20.0 * 20.0);
        assert!((0.9..1.25).contains(&share), "{share} of the area at {nodes} nodes");
    }
}

#[test]
fn inclusions_share_their_nodes_with_the_block() {
    let volume = inclusion();
    let generated = volume.mesh(1500);
    assert!(
        off(&generated, 10) <= 1.0 && off(&generated, 20) <= 1.0,
        "{:?}",
        generated.report
    );
    // One part and one piece without holes: the ball and the block share the nodes between them.
    assert_eq!((euler(&generated.mesh), generated.report.parts), (1, 1));
    let area = area(&generated.mesh);
    assert!((area - 6.0 * 40.0 * 40.0).abs() < 1e-8, "{area}");
    // The interface lies where the ball ends: at 12 mm, within half the diagonal of a voxel and the sagitta of an edge.
    let mesh = &generated.mesh;
    let mut worst = 0.0f64;
    for (element, neighbours) in mesh.neighbours().iter().enumerate() {
        for (opposite, other) in neighbours.iter().enumerate() {
            if *other == NO_ELEMENT || mesh.regions()[*other as usize] == mesh.regions()[element] {
                continue;
            }
            for corner in FACES[opposite] {
                let at = Vector3::from(mesh.nodes()[mesh.elements()[element][corner] as usize]);
                worst = worst.max(((at - Vector3::repeat(20.0)).norm() - 12.0).abs());
            }
        }
    }
    // Edges at 1,500 nodes are about 4 mm long, and a node moves a third of one.
    assert!(worst < 2.0, "{worst} mm");
}

#[test]
fn nested_shells_and_a_hole_are_met() {
    // A core, a thick shell, a thin one of two voxels, and a hollow in the core that is not meshed.
    let radius = |at: [f64; 3]| (Vector3::from(at) - Vector3::repeat(25.0)).norm();
    let volume = Volume::new([50; 3], [1.0; 3], move |at| match radius(at) {
        r if r < 6.0 => 0,
        r if r < 14.0 => 1,
        r if r < 21.0 => 2,
        r if r < 23.0 => 3,
        _ => 0,
    });
    let generated = volume.mesh(6000);
    for number in [10, 20, 30] {
        assert!(off(&generated, number) <= 3.0, "{:?}", generated.report.regions);
    }
    assert_eq!((euler(&generated.mesh), generated.report.parts), (2, 1));
}

#[test]
fn a_ring_stays_a_ring_and_what_is_apart_stays_apart() {
    let ring = Volume::new([40, 40, 12], [1.0; 3], |at| {
        let across = (at[0] - 20.0).hypot(at[1] - 20.0) - 14.0;
        u8::from(across.hypot(at[2] - 6.0) < 4.5)
    });
    let generated = ring.mesh(1500);
    assert_eq!((euler(&generated.mesh), generated.report.parts), (0, 1));
    assert!(off(&generated, 10) <= 1.0, "{:?}", generated.report);

    let (left, right) = (ball([12.0; 3], 9.0), ball([40.0, 12.0, 12.0], 9.0));
    let pair = Volume::new([52, 24, 24], [1.0; 3], move |at| left(at) + 2 * right(at));
    let generated = pair.mesh(1500);
    assert_eq!((euler(&generated.mesh), generated.report.parts), (2, 2));
    assert!(
        off(&generated, 10) <= 1.0 && off(&generated, 20) <= 1.0,
        "{:?}",
        generated.report
    );
}

#[test]
fn sheets_and_rods_of_one_voxel_are_meshed() {
    for size in [[1, 1, 1], [2, 1, 1], [40, 1, 1], [30, 30, 1], [1, 25, 40]] {
        let volume = Volume::new(size, [1.0, 1.0, 1.0], |_| 1);
        let generated = volume.mesh(3000);
        assert_eq!(generated.report.parts, 1, "{size:?}");
        // Tissue far thinner than a cell lies inside it: then only a volume within a tenth is required.
        assert!(off(&generated, 10) < 10.0, "{size:?}: {:?}", generated.report);
    }
}

#[test]
fn a_label_of_one_voxel_does_no_harm() {
    let mut volume = Volume::new([20; 3], [2.0; 3], |at| 1 + u8::from(at[0] > 20.0));
    let middle = 7 + 20 * (9 + 20 * 11);
    volume.labels[middle] = 5;
    volume.regions.push((5, 50));
    for nodes in [100, 1000] {
        let generated = volume.mesh(nodes);
        assert!(
            off(&generated, 10) <= 1.0 && off(&generated, 20) <= 1.0,
            "{:?}",
            generated.report
        );
        // It may be lost, which the report shows, or become a few elements; not more than the elements around it.
        let tiny = region(&generated, 50);
        assert_eq!(tiny.voxel_ml, 0.008);
        assert!(tiny.mesh_ml < 0.1, "{tiny:?}");
    }
}

#[test]
fn labels_can_share_a_region_and_others_be_left_out() {
    let mut volume = Volume::new([24; 3], [1.0; 3], |at| 1 + (at[0] / 6.0) as u8);
    volume.regions = vec![(1, 7), (2, 7), (3, -4)];
    let generated = volume.mesh(800);
    assert_eq!(generated.report.regions.len(), 2);
    assert!(
        off(&generated, 7) <= 1.0 && off(&generated, -4) <= 1.0,
        "{:?}",
        generated.report
    );
    // Label 4 is outside: the block ends at 18 mm.
    assert!((generated.mesh.bounds()[1][0] - 18.0).abs() < 1e-9);
}

#[test]
fn flat_voxels_give_no_flat_elements() {
    let within = ball([40.0, 40.0, 40.0], 30.0);
    let volume = Volume::new([100, 100, 10], [0.8, 0.8, 8.0], move |at| 1 + within(at));
    let generated = volume.mesh(2000);
    assert!(
        off(&generated, 10) <= 1.0 && off(&generated, 20) <= 1.0,
        "{:?}",
        generated.report
    );
    assert_eq!((euler(&generated.mesh), generated.report.parts), (1, 1));
}

#[test]
fn where_the_volume_lies_does_not_matter() {
    let within = ball([13.0, 16.0, 15.0], 10.0);
    let straight = Volume::new([26, 16, 20], [1.0, 2.0, 1.5], move |at| 1 + within(at));
    let plain = straight.mesh(900);
    let at = |place: Matrix4<f64>| Volume {
        labels: straight.labels.clone(),
        size: straight.size,
        index_to_world: place * straight.index_to_world,
        regions: straight.regions.clone(),
    };
    // A quarter turn and a whole number of millimetres are exact, so only the node positions may change.
    let quarter = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0).to_homogeneous();
    let place = Matrix4::new_translation(&Vector3::new(-130.0, 45.5, 800.25)) * quarter;
    let moved = at(place).mesh(900);
    assert!(moved.mesh.elements() == plain.mesh.elements() && moved.mesh.regions() == plain.mesh.regions());
    for (node, from) in moved.mesh.nodes().iter().zip(plain.mesh.nodes()) {
        let expected = place.transform_point(&(*from).into());
        // Rounding of coordinates below 1000 mm.
        assert!(
            (Vector3::from(*node) - expected.coords).norm() < 1e-11,
            "{node:?}, {expected}"
        );
    }
    // Other turns change the side of a voxel's face to which a sample on it is counted, and no more than that.
    let turn = Rotation3::from_euler_angles(0.4, -0.7, 2.1).to_homogeneous();
    let turned = at(place * turn).mesh(900);
    assert!(
        off(&turned, 10) <= 1.0 && off(&turned, 20) <= 1.0,
        "{:?}",
        turned.report
    );
    assert_eq!(euler(&turned.mesh), 1);
    let area = area(&turned.mesh);
    assert!(
        (area - 2.0 * (26.0 * 32.0 + 26.0 * 30.0 + 32.0 * 30.0)).abs() < 1e-8,
        "{area}"
    );
}

#[test]
fn mirrored_and_sheared_volumes_have_sound_elements() {
    let within = ball([13.0, 16.0, 15.0], 10.0);
    let mirror = Matrix4::new_nonuniform_scaling(&Vector3::new(-1.0, 1.0, 1.0));
    let shear = Matrix3::new(1.0, 0.4, -0.2, 0.0, 1.0, 0.3, 0.0, 0.0, 1.0).to_homogeneous();
    for place in [mirror, shear, shear * mirror] {
        let mut volume = Volume::new([26, 16, 20], [1.0, 2.0, 1.5], |at| 1 + within(at));
        volume.index_to_world = place * volume.index_to_world;
        let generated = volume.mesh(1500);
        assert!(
            off(&generated, 10) <= 1.5 && off(&generated, 20) <= 1.5,
            "{:?}",
            generated.report
        );
        assert_eq!(generated.report.parts, 1);
    }
}

#[test]
fn the_same_input_gives_the_same_mesh_on_any_number_of_threads() {
    let volume = inclusion();
    let on = |threads: usize| {
        let pool = insonify_base::parallel::Pool::new(threads).expect("threads");
        pool.install(|| volume.mesh(1200))
    };
    let one = on(1);
    for threads in [2, 5] {
        let other = on(threads);
        assert_eq!(other.mesh, one.mesh, "{threads} threads");
        assert_eq!(other.report, one.report, "{threads} threads");
    }
}

#[test]
fn angles_are_as_asked() {
    let volume = inclusion();
    for min_dihedral_deg in [0.0, 5.0, 20.0, 30.0] {
        let options = GenerateOptions {
            min_dihedral_deg,
            max_edge_mm: None,
            ..GenerateOptions::default()
        };
        let generated = generate(&volume.grid(), 1000, &options, |_| {}).expect("a mesh");
        volume.check(&generated, 1000, min_dihedral_deg);
    }
}

#[test]
fn edges_are_as_short_as_asked() {
    let volume = Volume::new([30; 3], [1.0; 3], |_| 1);
    let longest = |max_edge_mm: Option<f64>| {
        let options = GenerateOptions {
            max_edge_mm,
            ..GenerateOptions::default()
        };
        let generated = generate(&volume.grid(), 5000, &options, |_| {}).expect("a mesh");
        volume.check(&generated, 5000, options.min_dihedral_deg);
        let nodes = generated.mesh.nodes();
        let edges = generated.mesh.elements().iter().flat_map(|corners| {
            let at = corners.map(|node| Vector3::from(nodes[node as usize]));
            (0..4).flat_map(move |a| (0..a).map(move |b| (at[a] - at[b]).norm()))
        });
        edges.fold(0.0, f64::max)
    };
    // Nodes of a pure block move within tissue only, to the mean of their neighbours, by less than half an edge.
    assert!(longest(Some(4.0)) < 1.5 * 4.0);
    let error = generate(
        &volume.grid(),
        200,
        &GenerateOptions {
            max_edge_mm: Some(1.0),
            ..GenerateOptions::default()
        },
        |_| {},
    );
    assert_eq!(
        error.unwrap_err(),
        GenerateError::LongEdges {
            max_edge_mm: 1.0,
            nodes: 200
        }
    );
}

#[test]
fn progress_rises_from_0_to_1() {
    let mut reported = Vec::new();
    generate(&inclusion().grid(), 500, &GenerateOptions::default(), |share| {
        reported.push(share)
    })
    .expect("a mesh");
    assert_eq!((reported[0], *reported.last().unwrap()), (0.0, 1.0));
    assert!(
        reported.len() > 10 && reported.windows(2).all(|pair| pair[0] < pair[1]),
        "{reported:?}"
    );
}
