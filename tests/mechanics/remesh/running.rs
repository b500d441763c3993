//! Remeshers on the small mesh, taken through sequences of moves.

use std::sync::Arc;

use insonify::mechanics::tissue::remesh::{Adaptation, AdaptedMesh, Level, Options, Precision, RemeshReport, Source};

use super::support::{contacts, error, gold, nth_move, part, rounding, symmetric};

/// The gold standard of the base as a source in f64.
pub fn source(mesh: &AdaptedMesh) -> Source {
    Source::Double(Arc::new(symmetric(gold(mesh).as_ref())))
}

/// A mesh with its remesher, contacts named.
pub fn follow(mesh: AdaptedMesh, source: Source, level: Level, precision: Precision, options: Options) -> Adaptation {
    let contacts = contacts(&mesh);
    let mut adaptation = Adaptation::new(mesh, source, level, precision, options).unwrap();
    adaptation.parts().1.set_contacts(&contacts).unwrap();
    adaptation
}

/// Makes the moves `from..to` of the sequence; the few that would spoil an element are left out.
pub fn go(adaptation: &mut Adaptation, nodes: &[u32], from: u64, to: u64) -> Vec<RemeshReport> {
    let moves = (from..to).filter_map(|n| {
        let (node, position) = nth_move(adaptation.mesh(), nodes, n);
        let fits = adaptation.mesh().assess(node, position).is_ok();
        fits.then(|| adaptation.move_node(node, position).unwrap())
    });
    moves.collect()
}

/// The relative error of K^c, and what rounding may make of it.
pub fn condensed_error(adaptation: &Adaptation) -> [f64; 2] {
    let (gold, contacts) = (gold(adaptation.mesh()), adaptation.remesher().contacts());
    let expected = part(gold.as_ref(), contacts, contacts);
    let found = error(adaptation.remesher().condensed(), expected.as_ref());
    [found, rounding(adaptation.mesh(), gold.as_ref())]
}
