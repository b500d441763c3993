use nalgebra::Matrix3;
use proptest::prelude::*;

use super::CORNER;
use crate::quality::{Shape, jacobian_condition};

/// A regular tetrahedron with edges of 1.
fn regular() -> [[f64; 3]; 4] {
    let (a, b, c) = (0.75f64.sqrt(), 12.0f64.sqrt().recip(), (2.0f64 / 3.0).sqrt());
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, a, 0.0], [0.5, b, c]]
}

fn matrix(corners: &[[f64; 3]; 4]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| corners[column + 1][row] - corners[0][row])
}

/// The definition, with matrices.
fn defined(corners: &[[f64; 3]; 4]) -> f64 {
    let jacobian = matrix(corners) * matrix(&regular()).try_inverse().unwrap();
    jacobian.norm() * jacobian.try_inverse().unwrap().norm() / 3.0
}

fn close(computed: f64, expected: f64) -> bool {
    (computed - expected).abs() <= 1e-14 * expected.abs()
}

#[test]
fn the_regular_tetrahedron_is_the_best() {
    let shape = Shape::of(&regular());
    // acos(1/3), sqrt(2)/12.
    let angle = (1.0f64 / 3.0).acos().to_degrees();
    assert!(
        close(shape.condition, 1.0) && close(shape.volume_mm3, 2.0f64.sqrt() / 12.0),
        "{shape:?}"
    );
    assert!(
        close(shape.min_dihedral_deg, angle) && close(shape.max_dihedral_deg, angle),
        "{shape:?}"
    );
}

#[test]
fn the_corner_of_a_cube_is_known() {
    let shape = Shape::of(&CORNER);
    // With W the regular edges: |W|^2 = 3 and |W^-1|^2 = 9/2, so sqrt(3 * 9/2) / 3 = sqrt(3/2). Angles: 90 and atan
    // sqrt 2.
    assert!(close(shape.condition, 1.5f64.sqrt()), "{shape:?}");
    assert!(close(shape.volume_mm3, 1.0 / 6.0));
    assert!(
        close(shape.min_dihedral_deg, 2.0f64.sqrt().atan().to_degrees()),
        "{shape:?}"
    );
    assert!(close(shape.max_dihedral_deg, 90.0), "{shape:?}");
}

#[test]
fn thin_ones_grow_with_the_inverse_of_their_height() {
    // A cap over an equilateral base with its tip at height h over the centre: squared edges 3 + 3 (1/3 + h^2), squared
    // inverse heights 1/h^2 + 3 (1/h^2 + 12) / 9, as its sides are planes at distance h / sqrt(1 + 12 h^2) from the
    // opposite corners times 3.
    for exponent in 0..9 {
        let height = 0.1f64.powi(exponent);
        let mut corners = regular();
        corners[3][2] = height;
        let edges = 3.0 + 3.0 * (1.0 / 3.0 + height * height);
        let side = 3.0 * height / (1.0 + 12.0 * height * height).sqrt();
        let heights = height.powi(-2) + 3.0 * side.powi(-2);
        let expected = (edges * heights).sqrt() / 6.0;
        let computed = jacobian_condition(&corners);
        assert!(
            (computed / expected - 1.0).abs() < 1e-13,
            "{height}: {computed}, {expected}"
        );
        let shape = Shape::of(&corners);
        // The sides rise over the base, whose inscribed circle has the radius 1 / sqrt 12.
        let slope = (height * 12.0f64.sqrt()).atan().to_degrees();
        assert!(
            (shape.min_dihedral_deg / slope - 1.0).abs() < 1e-12 || height > 0.9,
            "{height}: {shape:?}"
        );
    }
}

#[test]
fn inverted_flat_and_broken_ones_have_no_condition() {
    let mut inverted = regular();
    inverted.swap(0, 1);
    let mut flat = CORNER;
    flat[3] = [1.0, 1.0, 0.0];
    let line = [0.0, 1.0, 2.0, 3.0].map(|x| [x; 3]);
    for corners in [inverted, flat, line, [[7.0; 3]; 4]] {
        let shape = Shape::of(&corners);
        assert_eq!(jacobian_condition(&corners), f64::INFINITY, "{corners:?}");
        assert!(shape.condition == f64::INFINITY && shape.volume_mm3 <= 0.0, "{shape:?}");
        assert!((0.0..=180.0).contains(&shape.min_dihedral_deg), "{shape:?}");
        assert!(
            shape.min_dihedral_deg <= shape.max_dihedral_deg && shape.max_dihedral_deg <= 180.0,
            "{shape:?}"
        );
    }
    for broken in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for place in 0..12 {
            let mut corners = regular();
            corners[place / 3][place % 3] = broken;
            assert_eq!(jacobian_condition(&corners), f64::INFINITY);
            assert!(Shape::of(&corners).volume_mm3.is_nan());
        }
    }
}

#[test]
fn size_does_not_matter() {
    for power in [-500, -100, -3, 0, 7, 300] {
        let scale = 2.0f64.powi(power);
        let corners = CORNER.map(|corner| corner.map(|x| x * scale));
        assert_eq!(jacobian_condition(&corners), jacobian_condition(&CORNER), "{power}");
    }
}

fn corners() -> impl Strategy<Value = [[f64; 3]; 4]> {
    prop::array::uniform4(prop::array::uniform3(-1.0..1.0f64)).prop_filter_map("a volume", |mut corners| {
        if matrix(&corners).determinant() < 0.0 {
            corners.swap(2, 3);
        }
        (matrix(&corners).determinant() > 1e-3).then_some(corners)
    })
}

proptest! {
    #[test]
    fn the_closed_form_is_the_definition(corners in corners()) {
        // Both lose digits in proportion to the condition.
        let (computed, expected) = (jacobian_condition(&corners), defined(&corners));
        prop_assert!((computed / expected - 1.0).abs() < 1e-14 * expected.max(10.0), "{computed} {expected}");
        prop_assert!(computed >= 1.0 - 1e-14);
    }

    #[test]
    fn the_order_of_corners_does_not_matter(corners in corners()) {
        let expected = Shape::of(&corners);
        // The even permutations keep the orientation.
        for order in [[1, 2, 0, 3], [0, 2, 3, 1], [3, 2, 1, 0], [1, 0, 3, 2]] {
            let shape = Shape::of(&order.map(|place: usize| corners[place]));
            for (a, b) in [
                (shape.condition, expected.condition),
                (shape.volume_mm3, expected.volume_mm3),
                (shape.min_dihedral_deg, expected.min_dihedral_deg),
                (shape.max_dihedral_deg, expected.max_dihedral_deg),
            ] {
                prop_assert!((a / b - 1.0).abs() < 1e-14 * expected.condition.max(10.0), "{a} {b}");
            }
        }
    }

    #[test]
    fn the_angles_at_the_faces_hold_gaddums_bounds(corners in corners()) {
        // J. W. Gaddum, "The sums of the dihedral and trihedral angles in a tetrahedron", 1952: between 360 and 540
        // degrees over the six edges, so the least is below 90 and the greatest above 60.
        let shape = Shape::of(&corners);
        prop_assert!(shape.min_dihedral_deg < 90.0 && shape.max_dihedral_deg > 60.0);
    }
}
