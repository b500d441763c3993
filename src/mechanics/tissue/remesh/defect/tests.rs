use super::*;
use crate::tissue::remesh::testing::{adapted, current, gold, inner_nodes, nearby};
use crate::tissue::testing::value;

#[test]
fn it_is_what_is_missing_to_hold_the_forces() {
    let mut mesh = adapted(0.45);
    let node = inner_nodes(&mesh)[0];
    mesh.move_node(node, nearby(&mesh, node, 1)).expect("a small move");
    let (k, difference) = (current(&mesh), mesh.difference());
    let size = k.nrows();
    let f: Vec<f64> = (0..size).map(|i| value(i, 0, 1)).collect();
    let u: Vec<f64> = (0..size).map(|i| value(i, 0, 2)).collect();
    let computed = defect(&mesh, &difference, &u, &f);
    for i in 0..size {
        let terms = || (0..size).map(|j| k[(i, j)] * u[j]);
        let magnitude: f64 = f[i].abs() + terms().map(f64::abs).sum::<f64>();
        let expected = f[i] - terms().sum::<f64>();
        // The base and the difference, which partly cancel, are added in turn.
        assert!(
            (computed[i] - expected).abs() <= 4.0 * size as f64 * f64::EPSILON * magnitude,
            "row {i}"
        );
    }
    // Displacements correct to rounding leave a backward error of the size of rounding; others do not.
    let right: Vec<f64> = (gold(&mesh) * faer::MatRef::from_column_major_slice(&f, size, 1))
        .col(0)
        .iter()
        .copied()
        .collect();
    assert!(backward_error(&mesh, &difference, &right, &f) <= size as f64 * f64::EPSILON);
    let norm = mesh.stiffness().norm_inf() + difference.norm_inf();
    let expected = largest(&computed) / (norm * largest(&u) + largest(&f));
    assert!(expected > 1e-3 && (backward_error(&mesh, &difference, &u, &f) / expected - 1.0).abs() < 1e-12);
    assert_eq!(
        backward_error(&mesh, &difference, &vec![0.0; size], &vec![0.0; size]),
        0.0
    );
}

#[test]
fn a_nan_is_the_largest() {
    assert_eq!(largest(&[1.0, -3.0, 2.0]), 3.0);
    assert!(largest(&[1.0, f64::NAN, 2.0]).is_nan());
    assert_eq!(largest(&[]), 0.0);
}
