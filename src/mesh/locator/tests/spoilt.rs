//! Meshes that are folded, flat, not finite or not convex, and points that lie in no element.

use super::*;

#[test]
fn inverted_elements_are_hit_whatever_the_start() {
    let mesh = lattice(4, 0.0);
    let mut nodes = mesh.nodes().to_vec();
    let centre = nodes.iter().position(|n| *n == [2.0; 3]).unwrap();
    nodes[centre] = [3.4, 2.2, 2.1];
    let (located, report) = locator::<f32>(&mesh, &nodes);
    let inverted = mesh.volumes(&nodes).filter(|v| *v < 0.0).count();
    assert!(inverted > 0);
    assert_eq!(
        report,
        LocatorReport {
            inverted,
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
        let holders = depths.iter().filter(|d| **d > 0.0).count();
        if holders > 1 { folded += 1 } else { plain += 1 }
    }
    assert!(folded > 20 && plain > 1000, "{folded}, {plain}");
}

#[test]
fn elements_without_volume_are_never_hit_and_leave_no_hole() {
    let mesh = lattice(4, 10.0);
    let mut nodes = mesh.nodes().to_vec();
    for node in &mut nodes {
        // The cells between 11 and 12 mm vanish; the rest stays intact.
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
        assert_ne!(hit.element, NO_ELEMENT, "hole at {p:?}");
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
            let truth = Locator::<f32>::new(&mesh).locate(p, NO_ELEMENT).element;
            let hit = from_all_starts(&located, p, index);
            if depth(&mesh, mesh.nodes(), truth as usize, p.map(f64::from)) < 1e-4 {
                continue;
            }
            let expected = if mesh.elements()[truth as usize].contains(&(node as u32)) {
                NO_ELEMENT
            } else {
                truth
            };
            assert_eq!(hit.element, expected, "{p:?}, {truth}");
        }
    }
    let (located, report) = locator::<f32>(&mesh, &vec![[f64::NAN; 3]; mesh.nodes().len()]);
    assert_eq!(report.not_finite, mesh.elements().len());
    assert_eq!(located.locate([1.0; 3], 0).element, NO_ELEMENT);
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
    assert_ne!(hit.element, NO_ELEMENT);
}

#[test]
fn queries_that_are_not_finite_or_far_away_hit_nothing() {
    let located = Locator::<f32>::new(&lattice(2, 0.0));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e30] {
        for axis in 0..3 {
            let mut p = [1.0; 3];
            p[axis] = bad;
            assert_eq!(from_all_starts(&located, p, 1).element, NO_ELEMENT);
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
            None => outside += usize::from(hit.element == NO_ELEMENT),
        }
    }
    assert!(outside > 100);
}
