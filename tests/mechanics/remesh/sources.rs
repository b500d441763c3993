//! Where the compliance of the base comes from must not matter.

use std::sync::Arc;

use insonify::mechanics::tissue::columns::Columns;
use insonify::mechanics::tissue::factor::Factor;
use insonify::mechanics::tissue::remesh::{Level, Options, Precision, RemeshError, Source};

use super::running::{condensed_error, follow, go, source};
use super::support::{contacts, error, free_nodes, gold, mesh, part, rounding};

#[test]
fn columns_on_demand_are_the_dense_inverse() {
    let mesh = mesh(0.45);
    let nodes: Vec<u32> = free_nodes(&mesh).into_iter().step_by(5).collect();
    let factor = Arc::new(Factor::new(mesh.stiffness()).unwrap());
    // With room for all that is touched, and with so little that columns are solved again and again.
    for capacity in [1000, 20] {
        let columns = Source::Columns(Columns::new(factor.clone(), capacity));
        let options = Options::default();
        let mut demanded = follow(mesh.clone(), columns, Level::Exact, Precision::Double, options);
        let mut stored = follow(mesh.clone(), source(&mesh), Level::Exact, Precision::Double, options);
        go(&mut demanded, &nodes, 0, 25);
        go(&mut stored, &nodes, 0, 25);
        let [found, bound] = condensed_error(&demanded);
        assert!(found <= bound, "{found:e} > {bound:e}");
        let between = error(demanded.remesher().condensed(), stored.remesher().condensed());
        assert!(between <= bound, "{between:e} > {bound:e}");

        let gold = gold(demanded.mesh());
        let (rows, columns) = (contacts(&mesh), [0, 7, gold.ncols() - 1]);
        let block = demanded.parts().1.compliance(&rows, &columns).unwrap();
        let expected = part(gold.as_ref(), &rows, &columns);
        assert!((block - &expected).norm_max() <= rounding(&mesh, gold.as_ref()) * gold.norm_max());
    }
}

#[test]
fn levels_one_to_four_need_a_dense_inverse_and_the_exact_level_does_not() {
    let mesh = mesh(0.45);
    let factor = Arc::new(Factor::new(mesh.stiffness()).unwrap());
    let columns = Source::Columns(Columns::new(factor, 100));
    let mut adaptation = follow(mesh, columns, Level::Exact, Precision::Double, Options::default());
    for level in [Level::I, Level::II, Level::III, Level::IV] {
        match adaptation.switch(level, Precision::Double) {
            Err(RemeshError::Unsuited { level: of, .. }) => assert_eq!(of, level),
            other => panic!("{other:?}"),
        }
        assert_eq!(adaptation.remesher().level(), Level::Exact, "it stays what it was");
    }
}
