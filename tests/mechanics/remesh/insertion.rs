//! A needle that goes in and comes out: corners chosen at the tip, moved and taken back.

use faer::Mat;
use faer::linalg::solvers::{Llt, Solve};
use insonify::mechanics::tissue::remesh::RemeshError;
use insonify::mechanics::tissue::remesh::corner::best_corner;
use insonify::mechanics::tissue::remesh::{Adaptation, AdaptedMesh, Level, Options, Precision};

use super::running::{condensed_error, follow, go, source};
use super::support::{contacts, dense, free_nodes, gold, mesh, rounding};

/// The element that holds a point of the current mesh, and the coordinates there.
fn locate(mesh: &AdaptedMesh, p: [f64; 3]) -> Option<u32> {
    let volume = |corners: [[f64; 3]; 4]| {
        let edge = |k: usize| -> [f64; 3] { std::array::from_fn(|axis| corners[k][axis] - corners[0][axis]) };
        let [a, b, c] = [edge(1), edge(2), edge(3)];
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    let holds = |corners: &[u32; 4]| {
        let corners = corners.map(|node| mesh.nodes()[node as usize]);
        (0..4).all(|place| {
            let mut other = corners;
            other[place] = p;
            volume(other) >= 0.0
        })
    };
    mesh.elements().iter().position(holds).map(|element| element as u32)
}

/// Where the tip is after so many steps.
fn tip(step: usize) -> [f64; 3] {
    let along = 1.0 + 0.8 * step as f64;
    [along, 9.3 + 0.1 * along, 10.4 + 0.05 * along]
}

/// Moves a corner to the tip at each step; how many were moved.
fn insert(adaptation: &mut Adaptation, steps: usize) -> Vec<u32> {
    let mut taken: Vec<u32> = Vec::new();
    for step in 0..steps {
        let mesh = adaptation.mesh();
        let Some(element) = locate(mesh, tip(step)) else {
            continue;
        };
        // On a node that holds the needle already there is nothing to move.
        match best_corner(mesh, element, tip(step), |node| taken.contains(&node)) {
            Ok(corner) => {
                adaptation.move_node(corner.node, tip(step)).unwrap();
                taken.push(corner.node);
            }
            Err(RemeshError::NoCorner { .. }) => {}
            Err(error) => panic!("{error}"),
        }
    }
    taken
}

#[test]
fn insertion_is_followed_exactly_and_retraction_ends_where_it_began() {
    let mesh = mesh(0.45);
    let source = source(&mesh);
    let mut adaptation = follow(mesh, source, Level::Exact, Precision::Double, Options::default());
    let before = (
        adaptation.mesh().nodes().to_vec(),
        adaptation.remesher().condensed().to_owned(),
    );
    for _ in 0..3 {
        let moved = insert(&mut adaptation, 25);
        assert!(moved.len() > 5, "{moved:?}");
        let last = *moved.last().unwrap();
        assert!((0..25).any(|step| adaptation.mesh().nodes()[last as usize] == tip(step)));
        let [found, bound] = condensed_error(&adaptation);
        assert!(found <= bound, "{found:e} > {bound:e}");
        while adaptation.undo().unwrap().is_some() {}
        assert_eq!(
            (adaptation.mesh().nodes(), adaptation.remesher().condensed()),
            (&before.0[..], before.1.as_ref())
        );
    }
}

#[test]
fn moves_that_spoil_the_mesh_are_refused_at_every_level_and_nothing_changes() {
    for level in [Level::I, Level::II, Level::III, Level::IV, Level::Exact] {
        let mesh = mesh(0.45);
        let source = source(&mesh);
        let mut adaptation = follow(mesh, source, level, Precision::Double, Options::default());
        let free = free_nodes(adaptation.mesh());
        go(&mut adaptation, &free, 0, 3);
        let state = |a: &Adaptation| {
            (
                a.mesh().nodes().to_vec(),
                a.mesh().step(),
                a.remesher().condensed().to_owned(),
            )
        };
        let before = state(&adaptation);
        let node = free[30];
        let far = adaptation.mesh().nodes()[node as usize].map(|x| x + 50.0);
        let refused = adaptation.move_node(node, far);
        assert!(
            matches!(refused, Err(RemeshError::Element { .. })),
            "{level}: {refused:?}"
        );
        let count = adaptation.mesh().nodes().len() as u32;
        assert!(matches!(adaptation.restore(count), Err(RemeshError::Node { .. })));
        let size = adaptation.mesh().dofs().free();
        assert!(adaptation.parts().1.set_contacts(&[size]).is_err(), "a contact outside");
        assert!(
            adaptation.parts().1.set_contacts(&[1, 1]).is_err(),
            "a contact named twice"
        );
        assert_eq!(state(&adaptation), before, "{level}");
        // And the remesher still follows.
        go(&mut adaptation, &free, 3, 4);
        assert_eq!(adaptation.mesh().step(), before.1 + 1);
    }
}

/// Displacements of the whole mesh from forces at the contacts, against a factorisation of the moved mesh.
#[test]
fn the_field_from_condensed_forces_is_the_full_solution() {
    let mesh = mesh(0.45);
    let nodes = free_nodes(&mesh);
    let source = source(&mesh);
    let size = mesh.dofs().free();
    for level in [Level::I, Level::Exact] {
        let mut adaptation = follow(
            mesh.clone(),
            source.clone(),
            level,
            Precision::Double,
            Options::default(),
        );
        go(&mut adaptation, &nodes, 0, 20);
        let contacts = contacts(adaptation.mesh());
        let forces: Vec<f64> = (0..contacts.len()).map(|i| 0.1 * (i as f64).sin()).collect();
        let mut load = Mat::zeros(size, 1);
        contacts
            .iter()
            .zip(&forces)
            .for_each(|(dof, force)| load[(*dof, 0)] = *force);
        let stiffness = mesh.stiffness().at_nodes(adaptation.mesh().nodes()).unwrap();
        let solved = Llt::new(dense(&stiffness).as_ref(), faer::Side::Lower)
            .unwrap()
            .solve(&load);
        let mut u = vec![0.0; size];
        adaptation.parts().1.displacement(&forces, &mut u).unwrap();
        let bound = rounding(adaptation.mesh(), gold(adaptation.mesh()).as_ref()) * contacts.len() as f64;
        let worst = u
            .iter()
            .enumerate()
            .fold(0.0, |a: f64, (i, u)| a.max((u - solved[(i, 0)]).abs()));
        assert!(worst <= bound * solved.norm_max(), "{level}: {worst:e}");
        // Its part at the contacts is K^c f.
        let at_contacts = adaptation.remesher().condensed() * Mat::from_fn(forces.len(), 1, |i, _| forces[i]);
        for (at, dof) in contacts.iter().enumerate() {
            assert!(
                (u[*dof] - at_contacts[(at, 0)]).abs() <= bound * solved.norm_max(),
                "{level}: contact {at}"
            );
        }
    }
}
