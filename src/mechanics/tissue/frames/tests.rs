use super::*;

/// Rounding of two products of three terms of at most 1: six roundings, with a margin.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

fn check_orthonormal(frame: &Frame) {
    for first in 0..3 {
        for second in 0..3 {
            let product = frame.to_frame(frame.axes()[first])[second];
            let expected = if first == second { 1.0 } else { 0.0 };
            assert!((product - expected).abs() <= ROUNDING, "{first}, {second}: {product}");
        }
    }
    let [a, b, c] = frame.axes().map(Vector3::from);
    assert!(a.cross(&b).dot(&c) > 0.0);
}

#[test]
fn a_vector_goes_to_the_frame_and_back() {
    let (sin, cos) = 0.7_f64.sin_cos();
    let frame = Frame::of([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]].map(Vector3::from));
    check_orthonormal(&frame);
    let vector = [1.0, -2.0, 3.0];
    // R^T v by hand.
    let expected = [cos - 2.0 * sin, -sin - 2.0 * cos, 3.0];
    let inside = frame.to_frame(vector);
    let back = frame.to_world(inside);
    for axis in 0..3 {
        assert!((inside[axis] - expected[axis]).abs() <= 4.0 * ROUNDING);
        assert!((back[axis] - vector[axis]).abs() <= 4.0 * ROUNDING);
    }
    assert_eq!(Frame::WORLD.to_frame(vector), vector);
    assert_eq!(Frame::WORLD.to_world(vector), vector);
}

#[test]
fn a_frame_follows_any_direction() {
    for direction in [
        [1.0, 0.0, 0.0],
        [0.0, -2.0, 0.0],
        [0.0, 0.0, 1e-200],
        [1e200, 1e200, -1e200],
        [1.0, 1e-9, 0.0],
        [0.3, 0.2, -0.9],
    ] {
        let frame = Frame::along(direction).expect("a direction");
        check_orthonormal(&frame);
        let vector = Vector3::from(direction);
        let unit = (vector / vector.amax()).normalize();
        assert!((Vector3::from(frame.axes()[0]) - unit).norm() <= ROUNDING);
    }
}

#[test]
fn what_is_no_direction_is_refused() {
    assert!(matches!(Frame::along([0.0; 3]), Err(InvalidFrame::NoDirection { .. })));
    assert!(matches!(
        Frame::along([f64::INFINITY, 0.0, 0.0]),
        Err(InvalidFrame::NotFinite { .. })
    ));
}
