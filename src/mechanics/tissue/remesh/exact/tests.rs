use std::sync::Arc;

use super::*;
use crate::tissue::columns::Columns;
use crate::tissue::dofs::NO_DOF;
use crate::tissue::error::LinearError;
use crate::tissue::factor::Factor;
use crate::tissue::remesh::testing::{
    adapted, dofs_of, free_nodes, gold, inner_nodes, inverse, nearby, part, rounding,
};
use crate::tissue::testing::value;

mod sample_schedule;
mod speculation;

/// Creates a remesher at the base of a mesh, with contacts at some nodes.
fn exact(mesh: &AdaptedMesh, nodes: &[u32], options: RemesherOptions) -> Exact {
    let mut exact = Exact::new(mesh, Box::new(inverse(mesh)), Precision::Double, options).expect("a remesher");
    exact.set_contacts(&dofs_of(mesh, nodes)).expect("contacts");
    exact
}

/// Moves a node of the mesh and updates the remesher.
fn go(mesh: &mut AdaptedMesh, exact: &mut Exact, node: u32, salt: u32) -> RemeshReport {
    let change = mesh.move_node(node, nearby(mesh, node, salt)).expect("a small move");
    exact.remesh(mesh, &change).expect("a remesh")
}

/// Checks K^c and other entries against the recomputed inverse.
fn check(mesh: &AdaptedMesh, exact: &mut Exact) {
    let gold = gold(mesh);
    let bound = rounding(mesh, &gold);
    let contacts = exact.contacts().to_vec();
    let expected = part(&gold, &contacts, &contacts);
    assert!((exact.condensed() - &expected).norm_max() <= bound * expected.norm_max());
    assert_eq!(exact.condensed(), exact.condensed().transpose());
    let (rows, columns) = ([0, 5, 17], [3, gold.ncols() - 1]);
    let block = exact.compliance(&rows, &columns).expect("a block");
    assert!((&block - part(&gold, &rows, &columns)).norm_max() <= bound * gold.norm_max());
}

#[test]
fn each_move_is_followed_and_s_is_what_is_touched() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &[inner[0], free_nodes(&mesh)[40]], RemesherOptions::default());
    for (salt, node) in [inner[0], inner[1], inner[0], inner[2], inner[1]]
        .into_iter()
        .enumerate()
    {
        let report = go(&mut mesh, &mut exact, node, salt as u32);
        assert_eq!(report.rank, 3 * mesh.neighbours(node).len());
        let mut support: Vec<u32> = exact.support_dofs().iter().map(|dof| *dof as u32).collect();
        support.sort_unstable();
        assert_eq!(support, mesh.support().collect::<Vec<_>>());
        assert_eq!(report.support_size, support.len());
        assert_eq!(report.rebuilt, None);
        check(&mesh, &mut exact);
    }
    // C is (I + dK G)^-1 dK, as an LU factorisation from scratch gives.
    let updated = exact.correction().to_owned();
    mesh.difference_into(&mut exact.difference);
    exact.recompute().expect("well conditioned");
    let k = mesh.stiffness().norm_inf() + exact.difference.norm_inf();
    let g = exact.support.g.get().norm_l1();
    let bound = f64::EPSILON * k * g;
    assert!((&updated - exact.correction()).norm_max() <= bound * updated.norm_max());
    check(&mesh, &mut exact);
}

#[test]
fn nodes_that_return_give_the_base_back_bit_for_bit() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &inner, RemesherOptions::default());
    let before = exact.condensed().to_owned();
    for (salt, node) in inner.iter().enumerate() {
        go(&mut mesh, &mut exact, *node, salt as u32);
    }
    assert_ne!(exact.condensed(), before.as_ref());
    // Restored in another order than moved.
    for node in &inner {
        let change = mesh.restore(*node).expect("home");
        exact.remesh(&mesh, &change).expect("a remesh");
        check(&mesh, &mut exact);
    }
    assert!(exact.support_dofs().is_empty() && exact.correction().nrows() == 0);
    assert_eq!(exact.condensed(), before.as_ref());
}

#[test]
fn contacts_can_come_and_go_between_moves() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &[], RemesherOptions::default());
    assert_eq!(exact.condensed().nrows(), 0);
    go(&mut mesh, &mut exact, inner[0], 1);
    let sets = [
        vec![inner[0], inner[1]],
        vec![inner[2], inner[0]],
        vec![],
        vec![free_nodes(&mesh)[50], inner[2]],
    ];
    for (salt, nodes) in sets.into_iter().enumerate() {
        exact.set_contacts(&dofs_of(&mesh, &nodes)).expect("contacts");
        assert_eq!(exact.contacts(), dofs_of(&mesh, &nodes));
        check(&mesh, &mut exact);
        go(&mut mesh, &mut exact, inner[salt % 3], 10 + salt as u32);
        check(&mesh, &mut exact);
    }
    let (contacts, before) = (exact.contacts().to_vec(), exact.condensed().to_owned());
    let size = mesh.dofs().free();
    for wrong in [vec![0, size], vec![4, 4]] {
        assert!(matches!(exact.set_contacts(&wrong), Err(RemeshError::Compliance(_))));
    }
    assert_eq!((exact.contacts(), exact.condensed()), (&contacts[..], before.as_ref()));
}

#[test]
fn a_change_out_of_step_is_refused_and_a_refresh_catches_up() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &inner[..2], RemesherOptions::default());
    let first_change = mesh
        .move_node(inner[0], nearby(&mesh, inner[0], 1))
        .expect("a small move");
    exact.remesh(&mesh, &first_change).expect("a remesh");
    let before = exact.condensed().to_owned();
    let out_of_step = RemeshError::OutOfStep {
        expected: 2,
        found: 1,
        mesh: 1,
    };
    assert_eq!(exact.remesh(&mesh, &first_change), Err(out_of_step));
    let second = mesh
        .move_node(inner[1], nearby(&mesh, inner[1], 1))
        .expect("a small move");
    let third = mesh
        .move_node(inner[1], nearby(&mesh, inner[1], 2))
        .expect("a small move");
    for change in [&third, &second] {
        assert!(matches!(
            exact.remesh(&mesh, change),
            Err(RemeshError::OutOfStep { .. })
        ));
    }
    assert_eq!(exact.condensed(), before.as_ref());
    assert_eq!(
        exact.refresh(&mesh).expect("a refresh").rebuilt,
        Some(Rebuilt::Requested)
    );
    check(&mesh, &mut exact);
    go(&mut mesh, &mut exact, inner[2], 1);
    check(&mesh, &mut exact);
}

#[test]
fn a_near_singular_capacitance_is_refused_and_changes_nothing() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &inner[..2], RemesherOptions::default());
    go(&mut mesh, &mut exact, inner[0], 1);
    let (condensed, support) = (exact.condensed().to_owned(), exact.support_dofs().to_vec());
    exact.options.reciprocal_limit = 0.9;
    let change = mesh
        .move_node(inner[1], nearby(&mesh, inner[1], 1))
        .expect("a small move");
    match exact.remesh(&mesh, &change) {
        Err(RemeshError::Singular {
            node,
            reciprocal_condition,
            limit,
        }) => {
            assert!(node == inner[1] && limit == 0.9 && reciprocal_condition < 0.9);
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(
        (exact.condensed(), exact.support_dofs()),
        (condensed.as_ref(), &support[..])
    );
    assert!(matches!(exact.refresh(&mesh), Err(RemeshError::FarFromBase { .. })));
    assert_eq!(
        (exact.condensed(), exact.support_dofs()),
        (condensed.as_ref(), &support[..])
    );
    exact.options.reciprocal_limit = 1e-10;
    exact.remesh(&mesh, &change).expect("a remesh");
    check(&mesh, &mut exact);
}

#[test]
fn displacements_are_those_of_the_moved_mesh_and_come_from_forces_on_the_base() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &[inner[0], inner[3]], RemesherOptions::default());
    go(&mut mesh, &mut exact, inner[0], 1);
    go(&mut mesh, &mut exact, inner[1], 2);
    let size = mesh.dofs().free();
    let forces: Vec<f64> = (0..6).map(|i| value(i, 0, 4)).collect();
    let gold = gold(&mesh);
    let bound = rounding(&mesh, &gold) * 6.0 * gold.norm_max();
    let expected = |i: usize| -> f64 {
        exact
            .contacts
            .dofs()
            .iter()
            .zip(&forces)
            .map(|(dof, force)| gold[(i, *dof)] * force)
            .sum()
    };
    let expected: Vec<f64> = (0..size).map(expected).collect();
    let mut u = vec![0.0; size];
    exact.displacement(&forces, &mut u).expect("displacements");
    assert!(
        u.iter()
            .zip(&expected)
            .all(|(u, expected)| (u - expected).abs() <= bound)
    );
    let left = exact
        .displacement_refined(&mesh, &forces, &mut u)
        .expect("displacements");
    assert!(left <= size as f64 * f64::EPSILON, "{left}");
    assert!(
        u.iter()
            .zip(&expected)
            .all(|(u, expected)| (u - expected).abs() <= bound)
    );

    let mut base = vec![0.0; size];
    exact.base_forces(&forces, &mut base).expect("forces");
    for (dof, force) in base.iter().enumerate() {
        let may = exact.contacts().contains(&dof) || exact.support_dofs().contains(&dof);
        assert!(may || *force == 0.0, "{dof}");
    }
    for (forces, length) in [(&forces[..5], size), (&forces[..], size - 1)] {
        let mut short = vec![0.0; length];
        assert!(matches!(
            exact.displacement(forces, &mut short),
            Err(RemeshError::Compliance(_))
        ));
        assert!(exact.base_forces(forces, &mut short).is_err());
    }
}

#[test]
fn a_source_that_does_not_fit_is_refused() {
    let mesh = adapted(0.45);
    let too_small = crate::tissue::symmetric::Symmetric::<f64>::zeros(5);
    let refused = Exact::new(
        &mesh,
        Box::new(too_small),
        Precision::Double,
        RemesherOptions::default(),
    );
    let shape = LinearError::Shape {
        what: "rows of the compliance",
        found: 5,
        expected: mesh.dofs().free(),
    };
    assert_eq!(refused.err(), Some(RemeshError::Compliance(shape)));
    let mut exact = exact(&mesh, &[], RemesherOptions::default());
    let refusal = exact.set_level(&mesh, Level::II);
    assert_eq!(
        refusal,
        Err(RemeshError::Level {
            asked: Level::II,
            offered: Level::Exact
        })
    );
    assert_eq!(exact.set_level(&mesh, Level::Exact), Ok(None));
}

#[test]
fn nodes_beside_the_fixed_floor_move_too() {
    let mut mesh = adapted(0.45);
    let free = free_nodes(&mesh);
    let is_beside = |node: &&u32| {
        mesh.neighbours(**node)
            .iter()
            .any(|neighbour| mesh.dofs().of(*neighbour) == [NO_DOF; 3])
    };
    let beside = *free.iter().find(is_beside).expect("a node beside the floor");
    let mut exact = exact(&mesh, &[beside], RemesherOptions::default());
    let report = go(&mut mesh, &mut exact, beside, 3);
    assert!(report.rank < 3 * mesh.neighbours(beside).len());
    check(&mesh, &mut exact);
}

#[test]
fn columns_on_demand_serve_as_a_dense_inverse_does() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let factor = Arc::new(Factor::new(mesh.stiffness()).expect("a factor"));
    // So few are kept that columns are solved again.
    let columns = Columns::new(factor, 20);
    let mut exact =
        Exact::new(&mesh, Box::new(columns), Precision::Double, RemesherOptions::default()).expect("a remesher");
    exact.set_contacts(&dofs_of(&mesh, &inner)).expect("contacts");
    for (salt, node) in (1..).zip(&inner) {
        go(&mut mesh, &mut exact, *node, salt);
        check(&mesh, &mut exact);
    }
}

/// One step of refinement in f64 multiplies the error by at most |I - X K|, which for an inverse X in f32 is the
/// rounding unit of f32 times the condition of K (N. J. Higham, "Accuracy and Stability of Numerical Algorithms",
/// section 12).
#[test]
fn a_refined_displacement_regains_what_single_precision_loses() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let single = Arc::new(inverse(&mesh).cast::<f32>());
    let mut exact =
        Exact::new(&mesh, Box::new(single), Precision::Single, RemesherOptions::default()).expect("a remesher");
    let contacts = dofs_of(&mesh, &inner);
    exact.set_contacts(&contacts).expect("contacts");
    go(&mut mesh, &mut exact, inner[0], 1);
    let forces: Vec<f64> = (0..contacts.len()).map(|i| (i as f64).cos()).collect();
    let (mut plain, mut refined) = (vec![0.0; mesh.dofs().free()], vec![0.0; mesh.dofs().free()]);
    exact.displacement(&forces, &mut plain).expect("displacements");
    let left = exact
        .displacement_refined(&mesh, &forces, &mut refined)
        .expect("displacements");
    let gold = gold(&mesh);
    let factor = rounding(&mesh, &gold) * f64::from(f32::EPSILON) / f64::EPSILON;
    assert!(factor < 1e-2 && left <= factor * factor, "{left:e} {factor:e}");
    let expected = |i: usize| -> f64 {
        contacts
            .iter()
            .zip(&forces)
            .map(|(dof, force)| gold[(i, *dof)] * force)
            .sum()
    };
    let error = |u: &[f64]| (0..u.len()).fold(0.0, |largest: f64, i| largest.max((u[i] - expected(i)).abs()));
    assert!(
        error(&refined) < 1e-3 * error(&plain),
        "{:e} {:e}",
        error(&refined),
        error(&plain)
    );
}
