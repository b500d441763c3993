use nalgebra::{Matrix3, Matrix4, Vector3};
use proptest::prelude::*;

use super::*;
use crate::mechanics::mesh::Displacement;
use crate::random::{hash3, seed_words, unit};

/// A number in [-1, 1) from integers.
fn noise(a: u64, b: u64, seed: u64) -> f64 {
    2.0 * f64::from(unit(hash3([a as i32, b as i32, 7], seed_words(seed))[0])) - 1.0
}

/// A lattice of `n`^3 cells over [0, n]^3 mm, placed far from the origin, as scanner coordinates are.
fn lattice(n: usize, shift: f64) -> TetMesh {
    let to_world = Matrix4::new_translation(&Vector3::repeat(shift)) * Matrix4::new_scaling(n as f64);
    TetMesh::lattice([n; 3], &to_world).unwrap()
}

/// The nodes with those inside the box moved by up to `amount` cells; below 0.2 no element folds.
fn jitter(mesh: &TetMesh, amount: f64, seed: u64) -> Vec<[f64; 3]> {
    let [low, high] = mesh.bounds();
    let nodes = mesh.nodes().iter().enumerate().map(|(index, node)| {
        std::array::from_fn(|axis| match node[axis] == low[axis] || node[axis] == high[axis] {
            true => node[axis],
            false => node[axis] + amount * noise(index as u64, axis as u64, seed),
        })
    });
    nodes.collect()
}

/// Barycentric coordinates by ratios of volumes: the oracle.
fn coordinates(mesh: &TetMesh, nodes: &[[f64; 3]], element: usize, p: [f64; 3]) -> [f64; 4] {
    let corners = mesh.elements()[element].map(|node| Vector3::from(nodes[node as usize]));
    let volume = |c: [Vector3<f64>; 4]| Matrix3::from_columns(&[c[1] - c[0], c[2] - c[0], c[3] - c[0]]).determinant();
    let whole = volume(corners);
    std::array::from_fn(|place| {
        let mut replaced = corners;
        replaced[place] = Vector3::from(p);
        volume(replaced) / whole
    })
}

fn depth(mesh: &TetMesh, nodes: &[[f64; 3]], element: usize, p: [f64; 3]) -> f64 {
    coordinates(mesh, nodes, element, p)
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

fn locator<T: Real>(mesh: &TetMesh, nodes: &[[f64; 3]]) -> (Locator<T>, LocatorReport) {
    let mut locator = Locator::new(mesh);
    let report = locator.update(nodes).unwrap();
    (locator, report)
}

/// The one answer from the grid, from some elements and from some beyond the last.
fn from_all_starts<T: Real>(locator: &Locator<T>, p: [T; 3], seed: u64) -> Hit<T> {
    let hit = locator.locate(p, NONE);
    let count = locator.elements.len() as u64;
    for attempt in 0..12 {
        let start = (hash3([attempt, 0, 0], seed_words(seed))[0] as u64 % (count + 2)) as u32;
        assert_eq!(locator.locate(p, start), hit, "start {start} of {count} at {p:?}");
    }
    hit
}

fn sound(report: LocatorReport) {
    assert_eq!(report, LocatorReport::default());
}

/// Every point of a lattice of quarter cells, all on faces, edges or vertices or at exact places inside: the lowest element
/// that holds it, in exact arithmetic.
fn exact_ties<T: Real>(shift: f64) {
    let mesh = lattice(2, shift);
    let locator = Locator::<T>::new(&mesh);
    sound(locator.report());
    for index in 0..9usize.pow(3) {
        let p = [index % 9, index / 9 % 9, index / 81].map(|n| shift + n as f64 / 4.0);
        let lowest = (0..mesh.elements().len())
            .find(|e| depth(&mesh, mesh.nodes(), *e, p) >= 0.0)
            .unwrap();
        let hit = from_all_starts(&locator, p.map(T::of), index as u64);
        assert_eq!(hit.element as usize, lowest, "{p:?}");
        assert!(!hit.folded);
    }
}

#[test]
fn shared_faces_edges_and_vertices_go_to_the_lowest_element() {
    exact_ties::<f32>(0.0);
    exact_ties::<f64>(0.0);
    exact_ties::<f32>(-256.0);
    exact_ties::<f64>(-256.0);
}

/// Agreement with a search over all elements, from any start, for points anywhere and points on faces, edges and vertices.
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
            NONE => assert!(
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
        // A point on a face, an edge or a vertex, as near as `T` comes to it.
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
        assert_ne!(hit.element, NONE, "hole at {on:?} on element {chosen}");
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
        // 256 mm is held to 3e-5 mm; element heights are above 0.1 mm.
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
            let hit = located.locate(p, NONE);
            // Rounding p can carry it out of the mesh only through the surface, and rounding the nodes can turn an element
            // about only when it is thinner than the rounding.
            if report.inverted == 0 {
                prop_assert_eq!(from_all_starts(&located, p, query), hit);
            }
            let inside = corners.iter().all(|n| !on_surface(&mesh, *n));
            if inside && report.flat == 0 {
                prop_assert_ne!(hit.element, NONE);
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
        let hit = gold.locate(p, NONE);
        let found = gold.to_reference(hit.element, p);
        assert!(
            (0..3).all(|axis| (found[axis] - reference[axis]).abs() < 1e-11),
            "{found:?} for {reference:?}"
        );
        // f32 holds 150 mm to 1e-5 mm; the inverse field magnifies by less than 2.
        let rounded = p.map(|x| x as f32);
        let hit = twin.locate(rounded, hit.element);
        let found = twin.to_reference(hit.element, rounded);
        assert!(
            (0..3).all(|axis| (f64::from(found[axis]) - reference[axis]).abs() < 5e-5),
            "{found:?}"
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
        let hit = located.locate(p, NONE);
        let found = located.to_reference(hit.element, p);
        assert!(
            (0..3).all(|axis| (f64::from(found[axis]) - reference[axis]).abs() < 2e-5),
            "{found:?}, {reference:?}"
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
        let (a, b) = (gold.locate(wide, NONE), twin.locate(p, NONE));
        if a.element != b.element {
            differing += 1;
            // Only a point within rounding of a face may change hands.
            let near = |e: u32| e == NONE || depth(&mesh, &nodes, e as usize, wide).abs() < 1e-4;
            assert!(near(a.element) && near(b.element), "{wide:?}: {a:?}, {b:?}");
        }
        if a.element != NONE && b.element != NONE {
            let (x, y) = (gold.to_reference(a.element, wide), twin.to_reference(b.element, p));
            assert!(
                (0..3).all(|axis| (x[axis] - f64::from(y[axis])).abs() < 2e-4),
                "{x:?}, {y:?}"
            );
        }
    }
    assert!(differing < 10, "{differing}");
}

#[test]
fn inverted_elements_are_hit_and_flagged_whatever_the_start() {
    let mesh = lattice(4, 0.0);
    let mut nodes = mesh.nodes().to_vec();
    let centre = nodes.iter().position(|n| *n == [2.0; 3]).unwrap();
    nodes[centre] = [3.4, 2.2, 2.1];
    let (located, report) = locator::<f32>(&mesh, &nodes);
    let inverted: Vec<usize> = mesh
        .volumes(&nodes)
        .enumerate()
        .filter(|(_, v)| *v < 0.0)
        .map(|(element, _)| element)
        .collect();
    assert!(!inverted.is_empty());
    assert_eq!(
        report,
        LocatorReport {
            inverted: inverted.len(),
            ..LocatorReport::default()
        }
    );
    let (mut folded, mut plain) = (0, 0);
    for index in 0..4000u64 {
        let p: [f32; 3] = std::array::from_fn(|a| (2.0 + 1.99 * noise(index, a as u64, 21)) as f32);
        let wide = p.map(f64::from);
        let hit = from_all_starts(&located, p, index);
        let depths: Vec<f64> = (0..mesh.elements().len())
            .map(|e| depth(&mesh, &nodes, e, wide))
            .collect();
        if depths.iter().any(|d| d.abs() < 1e-4) {
            continue;
        }
        assert_eq!(Some(hit.element as usize), depths.iter().position(|d| *d > 0.0));
        assert_eq!(hit.folded, inverted.iter().any(|e| depths[*e] > 0.0));
        if hit.folded { folded += 1 } else { plain += 1 }
    }
    assert!(folded > 20 && plain > 1000, "{folded}, {plain}");
}

#[test]
fn elements_without_volume_are_never_hit_and_leave_no_hole() {
    let mesh = lattice(4, 10.0);
    let mut nodes = mesh.nodes().to_vec();
    for node in &mut nodes {
        // The cells between 11 and 12 mm vanish; the rest stays whole.
        node[0] = if node[0] >= 12.0 { node[0] - 1.0 } else { node[0] };
    }
    let (located, report) = locator::<f32>(&mesh, &nodes);
    assert_eq!(
        report,
        LocatorReport {
            flat: 6 * 16,
            ..LocatorReport::default()
        }
    );
    for index in 0..1000u64 {
        let mut p: [f32; 3] = std::array::from_fn(|a| (11.5 + 1.49 * noise(index, a as u64, 2)) as f32);
        if index % 2 == 0 {
            p[0] = 11.0;
        }
        let hit = from_all_starts(&located, p, index);
        assert_ne!(hit.element, NONE, "hole at {p:?}");
        assert!(mesh.volumes(&nodes).nth(hit.element as usize).unwrap() > 0.0);
    }
    let (_, all) = locator::<f64>(&mesh, &vec![[1.0; 3]; nodes.len()]);
    assert_eq!(all.flat, mesh.elements().len());
}

#[test]
fn nodes_that_are_not_finite_take_their_elements_away_and_no_others() {
    let mesh = lattice(4, 0.0);
    for bad in [f64::NAN, f64::INFINITY, 1e300] {
        let mut nodes = mesh.nodes().to_vec();
        let node = nodes.iter().position(|n| *n == [2.0; 3]).unwrap();
        nodes[node][1] = bad;
        let (located, report) = locator::<f32>(&mesh, &nodes);
        let touching = mesh.elements().iter().filter(|c| c.contains(&(node as u32))).count();
        assert_eq!(
            report,
            LocatorReport {
                not_finite: touching,
                ..LocatorReport::default()
            },
            "{bad}"
        );
        for index in 0..1000u64 {
            let p: [f32; 3] = std::array::from_fn(|a| (2.0 + 1.99 * noise(index, a as u64, 4)) as f32);
            let truth = Locator::<f32>::new(&mesh).locate(p, NONE).element;
            let hit = from_all_starts(&located, p, index);
            if depth(&mesh, mesh.nodes(), truth as usize, p.map(f64::from)) < 1e-4 {
                continue;
            }
            let expected = if mesh.elements()[truth as usize].contains(&(node as u32)) {
                NONE
            } else {
                truth
            };
            assert_eq!(hit.element, expected, "{p:?}, {truth}");
        }
    }
    let (located, report) = locator::<f32>(&mesh, &vec![[f64::NAN; 3]; mesh.nodes().len()]);
    assert_eq!(report.not_finite, mesh.elements().len());
    assert_eq!(located.locate([1.0; 3], 0).element, NONE);
}

#[test]
fn a_far_node_does_not_empty_the_grid() {
    let mesh = lattice(8, 0.0);
    let mut nodes = mesh.nodes().to_vec();
    let node = nodes.iter().position(|n| *n == [0.0; 3]).unwrap();
    nodes[node] = [-1e5; 3];
    let (located, report) = locator::<f32>(&mesh, &nodes);
    sound(report);
    let longest = located.grid.starts.windows(2).map(|w| w[1] - w[0]).max().unwrap();
    assert!(longest < 200, "{longest} elements in one cell");
    let p = [-5e4f32; 3];
    let hit = from_all_starts(&located, p, 1);
    assert_ne!(hit.element, NONE);
}

#[test]
fn queries_that_are_not_finite_or_far_away_hit_nothing() {
    let located = Locator::<f32>::new(&lattice(2, 0.0));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e30] {
        for axis in 0..3 {
            let mut p = [1.0; 3];
            p[axis] = bad;
            assert_eq!(from_all_starts(&located, p, 1).element, NONE);
        }
    }
}

#[test]
fn the_gap_of_a_mesh_that_is_not_convex_is_outside_and_walks_cross_it() {
    let whole = lattice(6, 0.0);
    // A U: the middle of the upper half is missing.
    let in_gap = |p: &[f64; 3]| p[0] > 2.0 && p[0] < 4.0 && p[1] > 2.0;
    let kept: Vec<[u32; 4]> = whole
        .elements()
        .iter()
        .copied()
        .filter(|corners| {
            let middle =
                std::array::from_fn(|a| corners.iter().map(|n| whole.nodes()[*n as usize][a]).sum::<f64>() / 4.0);
            !in_gap(&middle)
        })
        .collect();
    let regions = vec![0; kept.len()];
    let mesh = TetMesh::new(whole.nodes().to_vec(), kept, regions).unwrap();
    let field = Displacement::Swirl {
        centre_mm: [3.0; 3],
        axis: [0.0, 0.0, 1.0],
        angle_deg: 40.0,
        radius_mm: 4.0,
    };
    let mut nodes = Vec::new();
    field.displace(mesh.nodes(), &mut nodes);
    let (located, report) = locator::<f32>(&mesh, &nodes);
    sound(report);
    let mut outside = 0;
    for index in 0..2000u64 {
        let p: [f32; 3] = std::array::from_fn(|a| (3.0 + 3.0 * noise(index, a as u64, 31)) as f32);
        let hit = from_all_starts(&located, p, index);
        let wide = p.map(f64::from);
        let holder = (0..mesh.elements().len()).find(|e| depth(&mesh, &nodes, *e, wide) >= 0.0);
        match holder {
            Some(element) if depth(&mesh, &nodes, element, wide) > 1e-4 => assert_eq!(hit.element as usize, element),
            Some(_) => {}
            None => outside += usize::from(hit.element == NONE),
        }
    }
    assert!(outside > 100);
}

#[test]
fn updates_allocate_nothing_and_return_to_the_same_state() {
    let mesh = TetMesh::over_box([0.0; 3], [100.0, 80.0, 60.0], 1500).unwrap();
    let mut located = Locator::<f32>::new(&mesh);
    let fresh = located.clone();
    let room = |l: &Locator<f32>| (l.grid.starts.capacity(), l.grid.lists.capacity(), l.frames.capacity());
    let before = room(&located);
    let mut nodes = Vec::new();
    for shear in [0.0, 3.0, 500.0, -1e6] {
        let sheared = Displacement::Affine {
            matrix: [
                [1.0, shear, shear, 0.0],
                [0.0, 1.0, shear, 0.0],
                [shear, 0.0, 1.0, 5.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        };
        sheared.displace(mesh.nodes(), &mut nodes);
        located.update(&nodes).unwrap();
        assert_eq!(room(&located), before, "shear {shear}");
    }
    located.update(mesh.nodes()).unwrap();
    assert_eq!(located.frames, fresh.frames);
    assert_eq!(
        (located.grid.starts, located.grid.lists),
        (fresh.grid.starts, fresh.grid.lists)
    );
}

#[test]
fn a_wrong_number_of_nodes_is_refused() {
    let mesh = lattice(1, 0.0);
    let error = Locator::<f64>::new(&mesh).update(&[[0.0; 3]; 3]).unwrap_err();
    assert_eq!(
        error,
        NodeCount {
            state: "current",
            found: 3,
            expected: 8
        }
    );
}
