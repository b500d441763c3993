use super::*;
use crate::tissue::remesh::RemeshError;
use crate::tissue::remesh::testing::{adapted, inner_nodes};

/// Returns an element whose corners are all free, and a point in it.
fn inside(mesh: &AdaptedMesh) -> (u32, [f64; 3]) {
    let (element, _) = mesh.elements_around(inner_nodes(mesh)[0]).next().expect("an element");
    (element, mesh.point(element, [0.4, 0.3, 0.2, 0.1]))
}

#[test]
fn the_corner_with_the_best_elements_after_the_move_wins() {
    let mesh = adapted(0.3);
    let (element, tip) = inside(&mesh);
    let corner = best_corner(&mesh, element, tip, |_| false).expect("a corner");
    let corners = mesh.elements()[element as usize];
    let conditions = corners.map(|node| mesh.assess(node, tip).unwrap_or(f64::INFINITY));
    let best = conditions.into_iter().fold(f64::INFINITY, f64::min);
    assert_eq!(corner.condition, best);
    assert_eq!(mesh.assess(corner.node, tip), Ok(best));
    // The next best is chosen when that one is taken.
    let next = best_corner(&mesh, element, tip, |node| node == corner.node).expect("a corner");
    assert!(next.node != corner.node && next.condition >= corner.condition);
}

#[test]
fn a_tip_on_a_vertex_moves_that_vertex_and_on_an_edge_one_of_its_ends() {
    let mesh = adapted(0.3);
    let (element, _) = inside(&mesh);
    let corners = mesh.elements()[element as usize];
    let on_vertex = mesh.point(element, [0.0, 0.0, 1.0, 0.0]);
    assert_eq!(
        best_corner(&mesh, element, on_vertex, |_| false)
            .expect("a corner")
            .node,
        corners[2]
    );
    let on_edge = mesh.point(element, [0.6, 0.0, 0.4, 0.0]);
    let chosen = best_corner(&mesh, element, on_edge, |_| false).expect("a corner").node;
    assert!([corners[0], corners[2]].contains(&chosen), "{chosen}");
}

#[test]
fn without_a_usable_corner_it_says_what_is_wrong_with_each() {
    let mesh = adapted(0.3);
    let (element, tip) = inside(&mesh);
    let mut corners = mesh.elements()[element as usize];
    corners.sort_unstable();
    let expected = corners.map(|node| RemeshError::Taken { node }).to_vec();
    let none = best_corner(&mesh, element, tip, |_| true).expect_err("all are taken");
    assert_eq!(
        none,
        RemeshError::NoCorner {
            element,
            tip,
            unfit: expected
        }
    );
    assert!(
        none.to_string()
            .contains(&format!("node {} is already a contact", corners[0])),
        "{none}"
    );

    let fixed = (0..mesh.nodes().len() as u32)
        .find(|node| mesh.dofs().of(*node).contains(&NO_DOF))
        .expect("the floor");
    let (element, _) = mesh.elements_around(fixed).next().expect("an element");
    let tip = mesh.nodes()[fixed as usize];
    match best_corner(&mesh, element, tip, |_| false) {
        Err(RemeshError::NoCorner { unfit, .. }) => {
            assert!(unfit.contains(&RemeshError::Fixed { node: fixed }), "{unfit:?}");
            assert!(
                unfit.iter().any(|reason| matches!(reason, RemeshError::Element { .. })),
                "{unfit:?}"
            );
        }
        other => panic!("on a fixed node every other corner flattens the element: {other:?}"),
    }
    let elements = mesh.elements().len();
    let outside = best_corner(&mesh, elements as u32, tip, |_| false);
    assert_eq!(
        outside,
        Err(RemeshError::NoElement {
            element: elements as u32,
            elements
        })
    );
}
