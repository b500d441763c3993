use super::*;
use crate::mechanics::tissue::remesh::testing::{
    adapted, dofs_of, error, gold, inner_nodes, inverse, nearby, part, rounding,
};
use crate::mechanics::tissue::remesh::{Adaptation, Level, Options, Precision};
use crate::mechanics::tissue::testing::Block;

fn adaptation(level: Level) -> Adaptation {
    let mesh = adapted(0.45);
    let (source, contacts) = (Source::Double(inverse(&mesh)), dofs_of(&mesh, &inner_nodes(&mesh)[..2]));
    let mut adaptation = Adaptation::new(mesh, source, level, Precision::Double, Options::default()).expect("one");
    adaptation.parts().1.set_contacts(&contacts).expect("contacts");
    adaptation
}

fn go(adaptation: &mut Adaptation, node: u32, salt: u32) {
    let to = nearby(adaptation.mesh(), node, salt);
    adaptation.move_node(node, to).expect("a remesh");
}

fn check(adaptation: &Adaptation) {
    let (gold, contacts) = (gold(adaptation.mesh()), adaptation.remesher().contacts());
    let found = error(
        &adaptation.remesher().condensed().to_owned(),
        &part(&gold, contacts, contacts),
    );
    assert!(found <= rounding(adaptation.mesh(), &gold), "{found:e}");
}

#[test]
fn what_moved_since_the_snapshot_is_away_from_the_new_base() {
    let mut adaptation = adaptation(Level::Exact);
    let inner = inner_nodes(adaptation.mesh());
    go(&mut adaptation, inner[0], 1);
    go(&mut adaptation, inner[1], 1);
    let snapshot = Snapshot::of(adaptation.mesh(), adaptation.remesher().contacts(), 300);
    // The loop goes on while the base is prepared, on another thread.
    let prepared = std::thread::spawn(move || snapshot.prepare());
    go(&mut adaptation, inner[2], 1);
    go(&mut adaptation, inner[0], 2);
    let moves = adaptation.mesh().moves().to_vec();
    let rebase = prepared.join().expect("no panic").expect("a base");
    adaptation.adopt(rebase).expect("adopted");
    let mut away = [inner[0], inner[2]];
    away.sort_unstable();
    assert_eq!(adaptation.mesh().away(), away);
    assert_eq!(adaptation.mesh().moves(), moves);
    check(&adaptation);
    go(&mut adaptation, inner[1], 2);
    check(&adaptation);
    // Back to where the mesh was loaded, which is away from this base.
    while adaptation.undo().expect("back").is_some() {}
    assert_eq!(adaptation.mesh().nodes(), adapted(0.45).nodes());
    assert_eq!(adaptation.mesh().away().len(), 2);
    check(&adaptation);
}

#[test]
fn a_base_that_does_not_fit_leaves_everything_as_it_is() {
    let mut adaptation = adaptation(Level::I);
    let inner = inner_nodes(adaptation.mesh());
    go(&mut adaptation, inner[0], 1);
    let state = |adaptation: &Adaptation| {
        let mesh = adaptation.mesh();
        (
            mesh.base().to_vec(),
            mesh.away().to_vec(),
            adaptation.remesher().condensed().to_owned(),
        )
    };
    let before = state(&adaptation);
    let rebase = Snapshot::of(adaptation.mesh(), &[], 10).prepare().expect("a base");
    // Level I has no dense inverse of it.
    let refused = adaptation.adopt(rebase);
    assert!(
        matches!(refused, Err(RebaseError::Remesh(RemeshError::Unsuited { .. }))),
        "{refused:?}"
    );
    assert_eq!(state(&adaptation), before);
    let block = Block::new(60, 0.45);
    let other = AdaptedMesh::new(&block.mesh, &block.materials, &block.dofs).expect("a mesh");
    let rebase = Snapshot::of(&other, &[], 10).prepare().expect("a base");
    let expected = adaptation.mesh().dofs().free();
    assert_eq!(
        adaptation.adopt(rebase),
        Err(RebaseError::Mesh {
            found: other.dofs().free(),
            expected
        })
    );
    assert_eq!(state(&adaptation), before);
    let outside = Snapshot::of(adaptation.mesh(), &[expected], 10).prepare();
    assert!(matches!(outside, Err(RebaseError::Compliance(_))));
}
