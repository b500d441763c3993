//! Penetration rule on one element.

use nalgebra::Vector3;

use super::super::geometry::FarFace;

/// A corner of a cube: the far face of corner 0 has a circumference of 3 sqrt 2 = 4.243.
fn element() -> [Vector3<f64>; 4] {
    [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()]
}

fn diagonal() -> Vector3<f64> {
    Vector3::new(1.0, 1.0, 1.0).normalize()
}

#[test]
fn a_tip_node_is_penetrated_within_lambda_circumferences() {
    // Along the diagonal the face is 1 / sqrt 3 = 0.577 away; 0.05 circumferences are 0.212.
    for (share, is_met) in [(0.0, false), (0.36, false), (0.37, true), (0.57, true)] {
        let mut corners = element();
        corners[0] = diagonal() * share;
        let far = FarFace::of(&corners, &corners[0], &diagonal(), Some(0)).unwrap();
        assert!((far.distance - (1.0 / 3f64.sqrt() - share)).abs() < 1e-14);
        assert!((far.at - Vector3::repeat(1.0 / 3.0)).norm() < 1e-14);
        assert!((far.circumference - 18f64.sqrt()).abs() < 1e-14);
        assert_eq!((far.opposite, far.is_met(0.05)), (0, is_met), "{share}");
    }
}

/// The rule does not depend on the size of the element.
#[test]
fn the_rule_is_the_same_at_any_size() {
    for size in [1e-3, 1.0, 1e3] {
        let mut corners = element().map(|corner| corner * size);
        for (share, is_met) in [(0.36, false), (0.37, true)] {
            corners[0] = diagonal() * (share * size);
            let far = FarFace::of(&corners, &corners[0], &diagonal(), Some(0)).unwrap();
            assert_eq!(far.is_met(0.05), is_met);
        }
    }
}

#[test]
fn exactly_through_a_corner_an_edge_a_face() {
    let corners = element();
    // Along an edge of the element: P_inter is the corner.
    let far = FarFace::of(&corners, &corners[0], &Vector3::z(), Some(0)).unwrap();
    assert_eq!(
        (far.at, far.distance, far.nearest_first(&corners)[0]),
        (Vector3::z(), 1.0, 3)
    );
    // In a face of the element: P_inter is the midpoint of an edge of the far face; the first of the ties is taken.
    let direction = Vector3::new(1.0, 1.0, 0.0).normalize();
    let far = FarFace::of(&corners, &corners[0], &direction, Some(0)).unwrap();
    assert!((far.at - Vector3::new(0.5, 0.5, 0.0)).norm() < 1e-15);
    assert_eq!(far.nearest_first(&corners), [1, 2, 3]);
    // The tip exactly on the far face.
    let tip = Vector3::new(0.5, 0.25, 0.25);
    let far = FarFace::of(&corners, &tip, &diagonal(), None).unwrap();
    assert_eq!((far.opposite, far.distance, far.at), (0, 0.0, tip));
    assert_eq!(far.nearest_first(&corners)[0], 1);
}

/// Without a node at the tip the far face is the one through which the needle leaves; faces along which it runs do not
/// count.
#[test]
fn without_a_tip_node_the_far_face_is_the_way_out() {
    let corners = element();
    let tip = Vector3::new(0.0, 0.0, 0.25);
    let far = FarFace::of(&corners, &tip, &Vector3::z(), None).unwrap();
    assert_eq!((far.opposite, far.distance), (0, 0.75));
    // Backwards out of the same edge.
    let far = FarFace::of(&corners, &tip, &-Vector3::z(), None).unwrap();
    assert_eq!((far.opposite, far.distance), (3, 0.25));
    // There is none away from the face of a held tip node, nor in a flat element.
    assert_eq!(FarFace::of(&corners, &corners[0], &-Vector3::z(), Some(0)), None);
    let mut flat = corners;
    flat[3] = Vector3::new(0.5, 0.5, 0.0);
    assert_eq!(FarFace::of(&flat, &tip, &Vector3::z(), None), None);
}
