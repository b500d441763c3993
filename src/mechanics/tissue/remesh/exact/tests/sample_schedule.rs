//! Detection of errors by sampling.

use super::*;
use crate::tissue::error::LinearError;

#[test]
fn an_error_in_c_or_in_the_contacts_is_seen_and_mended() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let spoil: [fn(&mut Exact); 2] = [
        |exact| exact.support.c.get_mut()[(3, 3)] *= 1.0 + 1e-6,
        |exact| exact.contacts.condensed.get_mut()[(1, 1)] *= 1.0 + 1e-6,
    ];
    for (salt, spoil) in spoil.into_iter().enumerate() {
        let mut exact = exact(&mesh, &inner[..2], RemesherOptions::default());
        let report = go(&mut mesh, &mut exact, inner[0], 20 + salt as u32);
        assert!(report.residual.is_some_and(|residual| residual < 1e-10), "{report:?}");
        spoil(&mut exact);
        // The second sample comes two updates after the first.
        assert_eq!(go(&mut mesh, &mut exact, inner[1], 1).residual, None);
        let report = go(&mut mesh, &mut exact, inner[1], 2);
        assert!(
            matches!(report.rebuilt, Some(Rebuilt::Residual(_))),
            "{salt}: {report:?}"
        );
        assert_eq!(exact.rebuilds(), 1);
        check(&mesh, &mut exact);
        while mesh.undo().expect("back").is_some() {}
    }
}

#[test]
fn samples_become_rarer_while_they_are_good() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(
        &mesh,
        &inner[..2],
        RemesherOptions {
            check_every: 4,
            ..RemesherOptions::default()
        },
    );
    let sampled: Vec<bool> = (0..16)
        .map(|n| go(&mut mesh, &mut exact, inner[n % 3], n as u32).residual.is_some())
        .collect();
    let expected = [1, 3, 7, 11, 15].map(|update| update - 1);
    for (n, sampled) in sampled.into_iter().enumerate() {
        assert_eq!(sampled, expected.contains(&n), "{n}");
    }
}

#[test]
fn the_residual_is_that_of_the_whole_mesh() {
    let mut mesh = adapted(0.45);
    let inner = inner_nodes(&mesh);
    let mut exact = exact(
        &mesh,
        &inner[..1],
        RemesherOptions {
            check_every: 0,
            ..RemesherOptions::default()
        },
    );
    let report = go(&mut mesh, &mut exact, inner[0], 1);
    assert_eq!(report.residual, None);
    let dofs = dofs_of(&mesh, &inner[..2]);
    assert!(exact.residual(&mesh, &dofs).expect("a residual") < 1e-11);
    // An error e in one entry of C leaves a force e G[., dof] on that row.
    let error = 1e-3 * exact.correction()[(3, 3)];
    exact.support.c.get_mut()[(3, 3)] += error;
    let row = exact.support_dofs()[3];
    let residual = exact.residual(&mesh, &[row]).expect("a residual");
    let size = mesh.dofs().free();
    let diagonal = exact.support.g.get()[(3, 3)];
    let amplified = 1.0 + size as f64 * mesh.stiffness().norm_inf() * exact.support.g.get().norm_max();
    assert!(
        residual >= 1e-3 * error.abs() * diagonal && residual <= error.abs() * diagonal * amplified,
        "{residual}"
    );
    let wrong = LinearError::OutOfRange { dof: size, size };
    assert_eq!(exact.residual(&mesh, &[size]), Err(RemeshError::Compliance(wrong)));
}
