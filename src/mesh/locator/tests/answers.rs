//! Queries over entire meshes: one answer from every start, that of an exhaustive search, in both precisions.

use proptest::prelude::*;

use super::*;

/// Every point of a lattice of quarter cells, all on faces, edges or vertices or at exact positions inside: the lowest
/// element that contains it, in exact arithmetic.
fn exact_ties<T: Real>(shift: f64) {
    let mesh = lattice(2, shift);
    let locator = Locator::<T>::new(&mesh);
    sound(Locator::<T>::new(&mesh).update(mesh.nodes()).unwrap());
    for index in 0..9usize.pow(3) {
        let p = [index % 9, index / 9 % 9, index / 81].map(|n| shift + n as f64 / 4.0);
        let lowest = (0..mesh.elements().len())
            .find(|e| depth(&mesh, mesh.nodes(), *e, p) >= 0.0)
            .unwrap();
        let hit = from_all_starts(&locator, p.map(T::of), index as u64);
        assert_eq!(hit.element as usize, lowest, "{p:?}");
    }
}

#[test]
fn shared_faces_edges_and_vertices_go_to_the_lowest_element() {
    exact_ties::<f32>(0.0);
    exact_ties::<f64>(0.0);
    exact_ties::<f32>(-256.0);
    exact_ties::<f64>(-256.0);
}

/// Agreement with an exhaustive search, from any start, for points anywhere and points on faces, edges and vertices.
fn agrees_with_brute_force<T: Real>(seed: u64, amount: f64, shift: f64, tolerance: f64) {
    let mesh = lattice(3, shift);
    let nodes: Vec<[f64; 3]> = jitter(&mesh, amount, seed)
        .iter()
        .map(|n| n.map(|x| T::of(x).wide()))
        .collect();
    let (locator, report) = locator::<T>(&mesh, &nodes);
    sound(report);
    for query in 0..60u64 {
        let anywhere: [T; 3] = std::array::from_fn(|axis| T::of(shift + 1.5 + 1.9 * noise(query, axis as u64, !seed)));
        let p = anywhere.map(T::wide);
        let hit = from_all_starts(&locator, anywhere, query ^ seed);
        let holders: Vec<u32> = (0..mesh.elements().len())
            .filter(|e| depth(&mesh, &nodes, *e, p) >= -tolerance)
            .map(|e| e as u32)
            .collect();
        match hit.element {
            NO_ELEMENT => assert!(
                (0..mesh.elements().len()).all(|e| depth(&mesh, &nodes, e, p) < tolerance),
                "hole at {p:?}, held by {holders:?}"
            ),
            element => {
                assert!(holders.contains(&element), "{p:?} in {element}, not in {holders:?}");
                let expected = coordinates(&mesh, &nodes, element as usize, p);
                assert!(
                    hit.bary
                        .iter()
                        .zip(expected)
                        .all(|(b, e)| (b.wide() - e).abs() < tolerance)
                );
            }
        }
        // A point on a face, an edge or a vertex, to the precision of `T`.
        let chosen = query as usize * 7 % mesh.elements().len();
        let kept = 1 + query as usize % 3;
        let weights: [f64; 4] = std::array::from_fn(|c| {
            if c < kept {
                1.1 + noise(query, c as u64, seed)
            } else {
                0.0
            }
        });
        let sum: f64 = weights.iter().sum();
        let corners = mesh.elements()[chosen];
        let on: [T; 3] = std::array::from_fn(|axis| {
            T::of(
                (0..4)
                    .map(|c| weights[c] / sum * nodes[corners[c] as usize][axis])
                    .sum(),
            )
        });
        let hit = from_all_starts(&locator, on, query.wrapping_add(seed));
        assert_ne!(hit.element, NO_ELEMENT, "hole at {on:?} on element {chosen}");
        let named = &mesh.elements()[hit.element as usize];
        assert!(
            corners[..kept].iter().all(|node| named.contains(node)),
            "{on:?}: {named:?} for {corners:?}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn equals_brute_force_on_random_meshes_f64(seed: u64, shift in -300.0..300.0f64) {
        agrees_with_brute_force::<f64>(seed, 0.19, shift, 1e-10);
    }

    #[test]
    fn equals_brute_force_on_random_meshes_f32(seed: u64, shift in -300.0..300.0f64) {
        // 256 mm is resolved to 3e-5 mm; element heights are above 0.1 mm.
        agrees_with_brute_force::<f32>(seed, 0.19, shift, 1e-3);
    }

    #[test]
    fn squeezed_and_sheared_meshes_have_no_holes_and_one_answer(
        seed: u64, squeeze in -4.0..0.0f64, shear in -40.0..40.0f64, angle in 0.0..90.0f64,
    ) {
        let mesh = lattice(3, -1.5);
        let turn = |angle_deg| Displacement::Rotation { centre_mm: [0.0; 3], axis: [1.0, 2.0, 3.0], angle_deg };
        let mut nodes = Vec::new();
        let thin = 10f64.powf(squeeze);
        for node in jitter(&mesh, 0.15, seed) {
            let node = [node[0] + shear * node[1], node[1], node[2] * thin];
            let turned = turn(angle).apply(node);
            nodes.push(std::array::from_fn(|a| 120.0 + node[a] + turned[a]));
        }
        let (located, report) = locator::<f32>(&mesh, &nodes);
        prop_assert_eq!(report.not_finite, 0);
        for query in 0..200u64 {
            let element = query as usize * 5 % mesh.elements().len();
            let corners = mesh.elements()[element];
            let weights: [f64; 4] = std::array::from_fn(|c| (noise(query, c as u64, seed) * 1.3).max(0.0) + 1e-9);
            let sum: f64 = weights.iter().sum();
            let p: [f32; 3] = std::array::from_fn(|axis| {
                (0..4).map(|c| weights[c] / sum * nodes[corners[c] as usize][axis]).sum::<f64>() as f32
            });
            let hit = located.locate(p, NO_ELEMENT);
            // Rounding p can carry it out of the mesh only through the surface, and rounding the nodes can invert an
            // element only when it is thinner than the rounding.
            if report.inverted == 0 {
                prop_assert_eq!(from_all_starts(&located, p, query), hit);
            }
            let inside = corners.iter().all(|n| !on_surface(&mesh, *n));
            if inside && report.flat == 0 {
                prop_assert_ne!(hit.element, NO_ELEMENT);
            }
        }
    }
}

fn on_surface(mesh: &TetMesh, node: u32) -> bool {
    let [low, high] = mesh.bounds();
    let node = mesh.nodes()[node as usize];
    (0..3).any(|axis| node[axis] == low[axis] || node[axis] == high[axis])
}

#[test]
fn affine_fields_are_undone_exactly() {
    let mesh = lattice(4, -100.0);
    let matrix = [
        [1.25, 0.5, 0.0, 8.0],
        [-0.25, 0.75, 0.125, -40.0],
        [0.0, 0.25, 1.5, 16.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let field = Displacement::Affine { matrix };
    let mut nodes = Vec::new();
    field.displace(mesh.nodes(), &mut nodes);
    let (gold, _) = locator::<f64>(&mesh, &nodes);
    let (twin, _) = locator::<f32>(&mesh, &nodes);
    for index in 0..500u64 {
        let reference: [f64; 3] = std::array::from_fn(|axis| -98.0 + 1.99 * noise(index, axis as u64, 3));
        let u = field.apply(reference);
        let p = std::array::from_fn(|axis| reference[axis] + u[axis]);
        let hit = gold.locate(p, NO_ELEMENT);
        let carried = gold.to_reference(hit.element, p);
        assert!(
            (0..3).all(|axis| (carried[axis] - reference[axis]).abs() < 1e-11),
            "{carried:?} for {reference:?}"
        );
        // f32 resolves 150 mm to 1e-5 mm; the inverse field magnifies by less than 2.
        let rounded = p.map(|x| x as f32);
        let hit = twin.locate(rounded, hit.element);
        let carried = twin.to_reference(hit.element, rounded);
        assert!(
            (0..3).all(|axis| (f64::from(carried[axis]) - reference[axis]).abs() < 5e-5),
            "{carried:?}"
        );
    }
}

#[test]
fn nodes_map_to_their_reference_positions() {
    let mesh = lattice(4, 50.0);
    let nodes = jitter(&mesh, 0.19, 5);
    let (located, _) = locator::<f32>(&mesh, &nodes);
    for (node, reference) in nodes.iter().zip(mesh.nodes()) {
        let p = node.map(|x| x as f32);
        let hit = located.locate(p, NO_ELEMENT);
        let carried = located.to_reference(hit.element, p);
        assert!(
            (0..3).all(|axis| (f64::from(carried[axis]) - reference[axis]).abs() < 2e-5),
            "{carried:?}, {reference:?}"
        );
    }
}

#[test]
fn both_precisions_agree() {
    let mesh = TetMesh::over_box([-80.0, -60.0, 100.0], [80.0, 60.0, 200.0], 2000).unwrap();
    let field = Displacement::Indentation {
        centre_mm: [0.0, -60.0, 150.0],
        direction: [0.1, 1.0, 0.0],
        depth_mm: 25.0,
        radius_mm: 30.0,
    };
    let mut nodes = Vec::new();
    field.displace(mesh.nodes(), &mut nodes);
    let (gold, report) = locator::<f64>(&mesh, &nodes);
    sound(report);
    let (twin, _) = locator::<f32>(&mesh, &nodes);
    let mut differing = 0;
    for index in 0..4000u64 {
        let p: [f32; 3] = std::array::from_fn(|a| ([0.0, 0.0, 150.0][a] + 75.0 * noise(index, a as u64, 9)) as f32);
        let wide = p.map(f64::from);
        let (a, b) = (gold.locate(wide, NO_ELEMENT), twin.locate(p, NO_ELEMENT));
        if a.element != b.element {
            differing += 1;
            // Only a point within rounding of a face may change its element.
            let near = |e: u32| e == NO_ELEMENT || depth(&mesh, &nodes, e as usize, wide).abs() < 1e-4;
            assert!(near(a.element) && near(b.element), "{wide:?}: {a:?}, {b:?}");
        }
        if a.element != NO_ELEMENT && b.element != NO_ELEMENT {
            let (x, y) = (gold.to_reference(a.element, wide), twin.to_reference(b.element, p));
            assert!(
                (0..3).all(|axis| (x[axis] - f64::from(y[axis])).abs() < 2e-4),
                "{x:?}, {y:?}"
            );
        }
    }
    assert!(differing < 10, "{differing}");
}
