use super::*;

/// Options that defer work not needed at once.
fn deferred() -> RemesherOptions {
    RemesherOptions {
        deferred: true,
        ..RemesherOptions::default()
    }
}

/// Announces a move of a node and performs `tends` tasks.
fn expect(mesh: &AdaptedMesh, exact: &mut Exact, node: u32, tends: usize) {
    let support: Vec<u32> = mesh.support_of(node).collect();
    exact.expect(&support);
    for _ in 0..tends {
        exact.run_deferred(mesh);
    }
}

#[test]
fn a_change_that_was_expected_is_that_of_one_that_was_not() {
    for tends in [0, 1, 2, 3, 40] {
        let mut mesh = adapted(0.45);
        let inner = inner_nodes(&mesh);
        let mut exact = exact(&mesh, &[inner[0], free_nodes(&mesh)[40]], deferred());
        for (salt, node) in [inner[0], inner[1], inner[0], inner[2], inner[1]]
            .into_iter()
            .enumerate()
        {
            expect(&mesh, &mut exact, node, tends);
            check(&mesh, &mut exact);
            let report = go(&mut mesh, &mut exact, node, salt as u32);
            assert_eq!(report.support_size, mesh.support().count());
            assert_eq!(report.rebuilt, None);
            check(&mesh, &mut exact);
        }
        // Moved back, with the last moves also expected.
        for node in &inner[..3] {
            expect(&mesh, &mut exact, *node, tends);
            let change = mesh.restore(*node).expect("home");
            exact.remesh(&mesh, &change).expect("a remesh");
            check(&mesh, &mut exact);
        }
        assert!(exact.support_dofs().is_empty());
    }
}

#[test]
fn the_work_that_is_done_ahead_is_used() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &inner, deferred());
    go(&mut mesh, &mut exact, inner[0], 1);
    expect(&mesh, &mut exact, inner[1], 40);
    // The precomputed columns are used, not computed again.
    exact.work.v.get_mut().fill(f64::NAN);
    let change = mesh
        .move_node(inner[1], nearby(&mesh, inner[1], 2))
        .expect("a small move");
    assert!(
        !exact
            .remesh(&mesh, &change)
            .is_ok_and(|report| report.reciprocal_condition > 0.0)
    );
}

#[test]
fn what_was_expected_and_did_not_come_leaves_nothing() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(&mesh, &inner[..1], deferred());
    let before = exact.condensed().to_owned();
    go(&mut mesh, &mut exact, inner[0], 1);
    expect(&mesh, &mut exact, inner[2], 40);
    assert!(exact.support_dofs().len() > mesh.support().count());
    // Another change arrives.
    let report = go(&mut mesh, &mut exact, inner[1], 2);
    assert_eq!(report.support_size, mesh.support().count());
    check(&mesh, &mut exact);
    // Something else is expected, contacts are set, everything is recomputed, and all moves are undone.
    expect(&mesh, &mut exact, inner[2], 3);
    exact.set_contacts(&dofs_of(&mesh, &inner[..3])).expect("contacts");
    expect(&mesh, &mut exact, inner[0], 3);
    check(&mesh, &mut exact);
    exact.refresh(&mesh).expect("well conditioned");
    assert_eq!(exact.support_dofs().len(), mesh.support().count());
    expect(&mesh, &mut exact, inner[2], 2);
    exact.set_contacts(&dofs_of(&mesh, &inner[..1])).expect("contacts");
    for node in [inner[0], inner[1]] {
        let change = mesh.restore(node).expect("home");
        exact.remesh(&mesh, &change).expect("a remesh");
        check(&mesh, &mut exact);
    }
    assert!(exact.support_dofs().is_empty());
    assert_eq!(exact.condensed(), before.as_ref());
}
