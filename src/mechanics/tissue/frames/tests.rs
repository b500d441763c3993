use super::*;

/// Products of three terms of at most 1, twice over: six roundings and their room.
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
    let frame = Frame::new([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]).expect("a rotation");
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
fn rounded_axes_are_made_orthonormal_and_exact_ones_stay() {
    let rounded = [0.6_f32, 0.8_f32].map(f64::from);
    let frame = Frame::new([
        [rounded[0], rounded[1], 0.0],
        [-rounded[1], rounded[0], 0.0],
        [0.0, 0.0, 1.0],
    ]);
    check_orthonormal(&frame.expect("axes in f32"));
    let turned = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
    assert_eq!(Frame::new(turned).expect("a rotation").axes(), &turned);
}

#[test]
fn what_is_no_rotation_is_refused() {
    let [x, y, z] = *Frame::WORLD.axes();
    let refused = |axes| Frame::new(axes).expect_err("no frame");
    assert_eq!(refused([x, y, [0.0, 0.0, -1.0]]), InvalidFrame::LeftHanded);
    let found = 4.0;
    let (first, second) = (1, 1);
    let error = refused([x, [0.0, 2.0, 0.0], z]);
    assert_eq!(error, InvalidFrame::NotOrthonormal { first, second, found });
    assert!(error.to_string().contains("unit length"), "{error}");
    let error = refused([x, [0.1, 0.995_f64.sqrt(), 0.0], z]);
    assert!(
        matches!(
            error,
            InvalidFrame::NotOrthonormal {
                first: 0,
                second: 1,
                ..
            }
        ),
        "{error}"
    );
    assert!(matches!(
        refused([x, [f64::NAN; 3], z]),
        InvalidFrame::NotFinite { axis: 1, .. }
    ));
    assert!(matches!(Frame::along([0.0; 3]), Err(InvalidFrame::NoDirection { .. })));
    assert!(matches!(
        Frame::along([f64::INFINITY, 0.0, 0.0]),
        Err(InvalidFrame::NotFinite { .. })
    ));
}
