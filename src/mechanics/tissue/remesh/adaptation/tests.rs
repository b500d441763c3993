use super::*;
use crate::tissue::remesh::RemeshError;
use crate::tissue::remesh::testing::{adapted, dofs_of, error, gold, inner_nodes, inverse, nearby, part, rounding};
use faer::Mat;

const LEVELS: [Level; 5] = [Level::I, Level::II, Level::III, Level::IV, Level::Exact];

fn adaptation(level: Level, options: RemesherOptions) -> Adaptation {
    let mesh = adapted(0.45);
    let (source, contacts) = (Source::Double(inverse(&mesh)), dofs_of(&mesh, &inner_nodes(&mesh)[..2]));
    let mut adaptation = Adaptation::new(mesh, source, level, Precision::Double, options).expect("an adaptation");
    adaptation.parts().1.set_contacts(&contacts).expect("contacts");
    adaptation
}

fn go(adaptation: &mut Adaptation, node: u32, salt: u32) -> Result<RemeshReport, RemeshError> {
    let target = nearby(adaptation.mesh(), node, salt);
    adaptation.move_node(node, target)
}

/// Computes the expected K^c and its rounding.
fn expected(adaptation: &Adaptation) -> (Mat<f64>, f64) {
    let gold = gold(adaptation.mesh());
    let contacts = adaptation.remesher().contacts();
    (part(&gold, contacts, contacts), rounding(adaptation.mesh(), &gold))
}

#[test]
fn a_refused_request_changes_neither_mesh_nor_remesher() {
    for level in [Level::I, Level::II, Level::III, Level::Exact] {
        let mut adaptation = adaptation(level, RemesherOptions::default());
        let inner = inner_nodes(adaptation.mesh());
        // Install a remesher that refuses everything.
        let source = adaptation.source.clone();
        let strict = RemesherOptions {
            reciprocal_limit: 0.9,
            ..RemesherOptions::default()
        };
        let contacts = adaptation.remesher().contacts().to_vec();
        let at_base = adapted(0.45);
        let mut remesher = make(level, Precision::Double, &source, &at_base, strict).expect("a remesher");
        remesher.set_contacts(&contacts).expect("contacts");
        adaptation = Adaptation {
            mesh: at_base,
            remesher,
            source,
            options: strict,
            maker: None,
            failure: None,
            expected: Vec::new(),
        };
        let state = |adaptation: &Adaptation| {
            let mesh = adaptation.mesh();
            let condensed = adaptation.remesher().condensed().to_owned();
            (
                mesh.nodes().to_vec(),
                mesh.step(),
                mesh.moves().to_vec(),
                mesh.away().to_vec(),
                condensed,
            )
        };
        let before = state(&adaptation);
        let refused = go(&mut adaptation, inner[0], 1);
        assert!(
            matches!(refused, Err(RemeshError::Singular { .. })),
            "{level}: {refused:?}"
        );
        assert_eq!(state(&adaptation), before, "{level}");
        let refused = adaptation.move_node(inner[0], [f64::NAN; 3]);
        assert!(matches!(refused, Err(RemeshError::Position { .. })));
        assert_eq!(state(&adaptation), before, "{level}");
    }
}

#[test]
fn refused_restores_and_undos_leave_the_moves_listed() {
    let mut adaptation = adaptation(Level::IV, RemesherOptions::default());
    let inner = inner_nodes(adaptation.mesh());
    for salt in 1..3 {
        go(&mut adaptation, inner[0], salt).expect("a remesh");
    }
    let strict = RemesherOptions {
        reciprocal_limit: 0.9,
        ..RemesherOptions::default()
    };
    // Level IV refuses nothing, so it can reach a state where level I would.
    let (moves, nodes) = (adaptation.mesh().moves().to_vec(), adaptation.mesh().nodes().to_vec());
    let mut remesher =
        make(Level::IV, Precision::Double, &adaptation.source, &adapted(0.45), strict).expect("a remesher");
    remesher.set_level(&adapted(0.45), Level::I).expect("current");
    adaptation.remesher = remesher;
    // The remesher is two changes behind.
    let behind = |result: Result<(), RemeshError>| {
        assert!(matches!(result, Err(RemeshError::OutOfStep { .. })), "{result:?}");
    };
    behind(adaptation.undo().map(drop));
    behind(adaptation.restore(inner[0]).map(drop));
    assert_eq!(
        (adaptation.mesh().moves(), adaptation.mesh().nodes()),
        (&moves[..], &nodes[..])
    );
    assert_eq!(adaptation.mesh().step(), 2);
}

#[test]
fn levels_change_while_running_and_contacts_stay() {
    let mut adaptation = adaptation(Level::I, RemesherOptions::default());
    let inner = inner_nodes(adaptation.mesh());
    let contacts = adaptation.remesher().contacts().to_vec();
    let mut salt = 0;
    for first in LEVELS {
        for second in LEVELS {
            for precision in [Precision::Double, Precision::Single] {
                adaptation.switch(first, Precision::Double).expect("a switch");
                salt += 1;
                go(&mut adaptation, inner[salt % inner.len()], salt as u32).expect("a remesh");
                adaptation.switch(second, precision).expect("a switch");
                assert_eq!(adaptation.remesher().level(), second);
                assert_eq!(adaptation.remesher().contacts(), contacts);
                // To a higher level, or one of another kind or precision, it is current.
                if first == second
                    || (second > first && second != Level::Exact && first != Level::I && precision == Precision::Double)
                {
                    continue;
                }
                let (expected, bound) = expected(&adaptation);
                let single = adaptation.remesher().precision() == Precision::Single;
                let eps = if single {
                    f64::from(f32::EPSILON) / f64::EPSILON
                } else {
                    1.0
                };
                let largest_error = error(&adaptation.remesher().condensed().to_owned(), &expected);
                assert!(
                    largest_error <= bound * eps,
                    "{first} to {second} in {precision}: {largest_error:e} > {:e}",
                    bound * eps
                );
            }
        }
    }
}

#[test]
fn undo_and_restore_bring_the_exact_level_back_to_the_base() {
    let mut adaptation = adaptation(Level::Exact, RemesherOptions::default());
    let inner = inner_nodes(adaptation.mesh());
    let before = adaptation.remesher().condensed().to_owned();
    for (salt, node) in [inner[0], inner[1], inner[0]].into_iter().enumerate() {
        go(&mut adaptation, node, salt as u32).expect("a remesh");
    }
    assert!(adaptation.undo().expect("back").is_some());
    let (expected, bound) = expected(&adaptation);
    assert!(error(&adaptation.remesher().condensed().to_owned(), &expected) <= bound);
    let report = adaptation.restore(inner[1]).expect("home");
    assert_eq!(report.support_size, 3 * adaptation.mesh().neighbours(inner[0]).len());
    assert_eq!(
        adaptation.undo().expect("back").map(|report| report.support_size),
        Some(0)
    );
    assert_eq!(adaptation.undo(), Ok(None));
    assert_eq!(adaptation.remesher().condensed(), before.as_ref());
}
