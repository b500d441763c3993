use super::*;
use crate::tissue::remesh::RemeshError;
use crate::tissue::remesh::testing::{adapted, current, free_nodes, inner_nodes, nearby};

/// Returns the state that a refused move must not change.
fn state(mesh: &AdaptedMesh) -> (Vec<[f64; 3]>, u64, Vec<u32>, Vec<u32>, usize) {
    let support = mesh.support().collect();
    (
        mesh.nodes().to_vec(),
        mesh.step(),
        mesh.away().to_vec(),
        support,
        mesh.moves().len(),
    )
}

#[test]
fn neighbours_share_an_element() {
    let mesh = adapted(0.3);
    for node in 0..mesh.nodes().len() as u32 {
        let elements = mesh
            .elements()
            .iter()
            .enumerate()
            .filter(|(_, corners)| corners.contains(&node));
        let expected: Vec<(u32, [u32; 4])> = elements.map(|(index, corners)| (index as u32, *corners)).collect();
        let mut around: Vec<_> = mesh.elements_around(node).collect();
        around.sort_unstable();
        assert_eq!(around.len(), expected.len());
        for ((element, corner), (expected_element, corners)) in around.into_iter().zip(&expected) {
            assert_eq!((element, corners[corner]), (*expected_element, node));
        }
        let mut neighbours: Vec<u32> = expected.iter().flat_map(|(_, corners)| *corners).collect();
        neighbours.sort_unstable();
        neighbours.dedup();
        assert_eq!(mesh.neighbours(node), neighbours);
    }
}

#[test]
fn a_change_is_the_difference_of_the_assembled_stiffnesses() {
    let mut mesh = adapted(0.45);
    // A node beside the floor has neighbours without degrees of freedom.
    let nodes = [free_nodes(&mesh)[3], inner_nodes(&mesh)[0]];
    for node in nodes {
        let before = current(&mesh);
        let target = nearby(&mesh, node, 1);
        let change = mesh.move_node(node, target).expect("a small move");
        let after = current(&mesh);
        // Each entry is a sum over at most all elements around a node of differences of terms no larger than the
        // largest.
        let bound = 4.0 * 32.0 * f64::EPSILON * after.norm_max().max(before.norm_max());
        let index_of = |dof: usize| change.support.binary_search(&(dof as u32)).ok();
        for (i, j) in (0..after.nrows()).flat_map(|i| (0..after.ncols()).map(move |j| (i, j))) {
            let expected = after[(i, j)] - before[(i, j)];
            match (index_of(i), index_of(j)) {
                (Some(a), Some(b)) => {
                    assert!((change.stiffness[(a, b)] - expected).abs() <= bound, "({i}, {j})");
                    assert_eq!(change.stiffness[(a, b)], change.stiffness[(b, a)]);
                }
                _ => assert_eq!(expected, 0.0, "({i}, {j})"),
            }
        }
        assert_eq!((change.node, change.to, change.step), (node, target, mesh.step()));
    }
}

#[test]
fn nodes_are_away_and_their_neighbours_touched_until_they_return() {
    let mut mesh = adapted(0.3);
    let inner = inner_nodes(&mesh);
    let (a, b) = (inner[0], inner[1]);
    let before = mesh.nodes().to_vec();
    mesh.move_node(a, nearby(&mesh, a, 1)).expect("a small move");
    mesh.move_node(b, nearby(&mesh, b, 1)).expect("a small move");
    mesh.move_node(a, nearby(&mesh, a, 2)).expect("a small move");
    assert_eq!(mesh.away(), [a.min(b), a.max(b)]);
    let touched = |mesh: &AdaptedMesh| -> Vec<u32> {
        let nodes = 0..mesh.nodes().len() as u32;
        nodes.filter(|node| mesh.is_touched(*node)).collect()
    };
    let mut expected = [mesh.neighbours(a), mesh.neighbours(b)].concat();
    expected.sort_unstable();
    expected.dedup();
    assert_eq!(touched(&mesh), expected);
    assert_eq!(mesh.support().count(), 3 * expected.len(), "all of them are free");
    mesh.restore(a).expect("home");
    assert_eq!(mesh.away(), [b]);
    assert_eq!(touched(&mesh), mesh.neighbours(b));
    assert_eq!(mesh.moves().len(), 1, "the moves of a restored node are forgotten");
    mesh.restore(b).expect("home");
    assert!(mesh.away().is_empty() && touched(&mesh).is_empty() && mesh.moves().is_empty());
    assert_eq!(mesh.nodes(), before);
    assert_eq!(mesh.step(), 5);
}

#[test]
fn undo_goes_back_move_by_move() {
    let mut mesh = adapted(0.3);
    let inner = inner_nodes(&mesh);
    let mut states = vec![mesh.nodes().to_vec()];
    for (salt, node) in [inner[0], inner[1], inner[0]].into_iter().enumerate() {
        mesh.move_node(node, nearby(&mesh, node, salt as u32))
            .expect("a small move");
        states.push(mesh.nodes().to_vec());
    }
    while let Some(expected) = states.pop() {
        assert_eq!(mesh.nodes(), expected);
        assert_eq!(mesh.undo().expect("back").is_some(), !states.is_empty());
    }
}

#[test]
fn unusable_moves_are_refused_and_change_nothing() {
    let mut mesh = adapted(0.3);
    let node = inner_nodes(&mesh)[0];
    mesh.move_node(node, nearby(&mesh, node, 1)).expect("a small move");
    let before = state(&mesh);
    let count = mesh.nodes().len();
    let refused = mesh.move_node(count as u32, [0.0; 3]).expect_err("no such node");
    assert_eq!(
        refused,
        RemeshError::Node {
            node: count as u32,
            nodes: count
        }
    );
    assert_eq!(mesh.restore(count as u32).expect_err("no such node"), refused);
    for target in [[f64::NAN, 0.0, 0.0], [0.0, f64::INFINITY, 0.0]] {
        assert!(matches!(
            mesh.move_node(node, target),
            Err(RemeshError::Position { .. })
        ));
    }
    // Beyond the far face of one of its tetrahedra, that tetrahedron is inverted.
    let (element, corner) = mesh.elements_around(node).next().expect("an element");
    let mut outside = [1.0; 4];
    outside[corner] = -2.0;
    let inverted = mesh.move_node(node, mesh.point(element, outside));
    assert!(matches!(inverted, Err(RemeshError::Element { .. })), "{inverted:?}");
    // Almost on that face, the tetrahedron is too thin.
    let mut close = [(1.0 - 1e-6) / 3.0; 4];
    close[corner] = 1e-6;
    let target = mesh.point(element, close);
    match mesh.move_node(node, target) {
        Err(RemeshError::Condition { condition, limit, .. }) => assert!(condition > limit && limit == CONDITION_LIMIT),
        other => panic!("{other:?}"),
    }
    assert_eq!(state(&mesh), before);
    // With a larger limit the move passes.
    let mut lenient = mesh.clone().with_condition_limit(1e9);
    lenient.move_node(node, target).expect("within the limit");
    // From there, a move passes that exceeds the usual limit but improves the mesh.
    let mut better = lenient.with_condition_limit(CONDITION_LIMIT);
    close = [(1.0 - 2e-6) / 3.0; 4];
    close[corner] = 2e-6;
    let target = mesh.point(element, close);
    assert!(better.assess(node, target).expect("better than before") > CONDITION_LIMIT);
    better.move_node(node, target).expect("better than before");
}

#[test]
fn a_point_follows_its_barycentric_coordinates() {
    let mesh = adapted(0.3);
    for (corner, node) in mesh.elements()[5].into_iter().enumerate() {
        let mut weights = [0.0; 4];
        weights[corner] = 1.0;
        assert_eq!(mesh.point(5, weights), mesh.nodes()[node as usize]);
    }
}

#[test]
fn the_memory_of_a_change_serves_the_next() {
    let mut mesh = adapted(0.3);
    let inner = inner_nodes(&mesh);
    let change = mesh
        .move_node(inner[0], nearby(&mesh, inner[0], 1))
        .expect("a small move");
    let places = (change.support.as_ptr(), change.stiffness.as_ptr());
    let fresh = mesh
        .clone()
        .move_node(inner[0], nearby(&mesh, inner[0], 2))
        .expect("a small move");
    mesh.reclaim(change);
    let change = mesh
        .move_node(inner[0], nearby(&mesh, inner[0], 2))
        .expect("a small move");
    assert_eq!((change.support.as_ptr(), change.stiffness.as_ptr()), places);
    assert_eq!(change.support, fresh.support);
    assert_eq!(
        change.stiffness, fresh.stiffness,
        "nothing is left of the change before"
    );
}
