use faer::Mat;

use super::*;
use crate::tissue::remesh::testing::{adapted, current, dense, free_nodes, inner_nodes, nearby};
use crate::tissue::testing::value;

fn moved() -> AdaptedMesh {
    let mut mesh = adapted(0.45);
    for node in free_nodes(&mesh).into_iter().step_by(7) {
        let target = nearby(&mesh, node, 1);
        if mesh.assess(node, target).is_ok() {
            mesh.move_node(node, target).expect("assessed");
        }
    }
    mesh
}

#[test]
fn it_is_the_assembled_stiffness_less_that_of_the_base() {
    let mesh = moved();
    assert!(mesh.away().len() > 5);
    let expected = current(&mesh) - dense(mesh.stiffness());
    let size = expected.nrows();
    let mut summed = Mat::<f64>::zeros(size, size);
    for (row, column, value) in mesh.difference().entries() {
        summed[(row as usize, column as usize)] += value;
    }
    // Sums over at most 32 elements around a pair of nodes, of terms no larger than the largest entry.
    let bound = 4.0 * 32.0 * f64::EPSILON * current(&mesh).norm_max();
    assert!((&summed - &expected).norm_max() <= bound);
    assert_eq!(summed, summed.transpose().to_owned());

    let sums = summed.row_iter().map(|row| row.iter().map(|x| x.abs()).sum::<f64>());
    let norm = sums.fold(0.0, f64::max);
    assert!((mesh.difference().norm_inf() - norm).abs() <= size as f64 * f64::EPSILON * norm);

    let x: Vec<f64> = (0..size).map(|i| value(i, 0, 3)).collect();
    let mut product = vec![1.0; size];
    mesh.difference().add_product(&x, &mut product);
    for i in 0..size {
        let terms = || (0..size).map(|j| summed[(i, j)] * x[j]);
        let magnitude: f64 = 1.0 + terms().map(f64::abs).sum::<f64>();
        let expected = 1.0 + terms().sum::<f64>();
        assert!(
            (product[i] - expected).abs() <= 2.0 * size as f64 * f64::EPSILON * magnitude,
            "row {i}"
        );
    }
}

#[test]
fn it_depends_on_where_nodes_are_and_not_on_how_they_came_there() {
    let mut mesh = moved();
    let entries = |mesh: &AdaptedMesh| mesh.difference().entries().collect::<Vec<_>>();
    let before = entries(&mesh);
    let (node, home) = (mesh.away()[0], mesh.nodes()[mesh.away()[0] as usize]);
    for salt in 10..40 {
        let target = nearby(&mesh, node, salt);
        if mesh.assess(node, target).is_ok() {
            mesh.move_node(node, target).expect("assessed");
        }
    }
    assert_ne!(entries(&mesh), before);
    mesh.move_node(node, home).expect("where it was");
    assert_eq!(entries(&mesh), before, "bit for bit");
}

#[test]
fn a_mesh_at_its_base_has_none_and_memory_is_used_again() {
    let mut mesh = adapted(0.3);
    let mut difference = mesh.difference();
    assert!(difference.is_empty() && difference.nodes().is_empty() && difference.blocks().next().is_none());
    assert_eq!(difference.norm_inf(), 0.0);
    let node = inner_nodes(&mesh)[0];
    mesh.move_node(node, nearby(&mesh, node, 1)).expect("a small move");
    mesh.difference_into(&mut difference);
    assert_eq!(difference.nodes(), mesh.neighbours(node));
    let fresh = mesh.difference();
    assert!(difference.blocks().eq(fresh.blocks()));
    // Nothing of the first difference is left in the second.
    mesh.move_node(node, nearby(&mesh, node, 2)).expect("a small move");
    mesh.difference_into(&mut difference);
    assert!(difference.blocks().eq(mesh.difference().blocks()));
    while mesh.undo().expect("back").is_some() {}
    mesh.difference_into(&mut difference);
    assert!(difference.is_empty() && difference.entries().next().is_none());
}
