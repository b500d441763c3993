//! What adds up over many remeshes, and what does not.

use insonify::mechanics::tissue::remesh::{Level, Options, Precision, State};

use super::running::{condensed_error, follow, go, source};
use super::support::{free_nodes, mesh};

/// The exact level is watched and mended, so however many remeshes, and however near to incompressible, it stays within what
/// rounding does to a backward stable inverse.
#[test]
fn the_exact_level_does_not_drift() {
    // Nodes spread over the block, moved again and again.
    for (poisson, counts) in [(0.45, &[100, 1000][..]), (0.499, &[100]), (0.4999, &[50])] {
        let mesh = mesh(poisson);
        let nodes: Vec<u32> = free_nodes(&mesh).into_iter().step_by(9).collect();
        let source = source(&mesh);
        let mut adaptation = follow(mesh, source, Level::Exact, Precision::Double, Options::default());
        let (mut done, mut rebuilt) = (0, 0);
        for &count in counts {
            let reports = go(&mut adaptation, &nodes, done, count);
            rebuilt += reports.iter().filter(|report| report.rebuilt.is_some()).count();
            assert!(reports.iter().all(|report| !report.rebuild_failed));
            done = count;
            let [found, bound] = condensed_error(&adaptation);
            assert!(found <= bound, "nu {poisson} after {count}: {found:e} > {bound:e}");
        }
        assert!(
            poisson > 0.45 || rebuilt == 0,
            "usual tissue needs no rebuild, {rebuilt} found"
        );
    }
}

/// Level I gathers the rounding of each update: no more than the count times that of one.
#[test]
fn level_one_gathers_rounding() {
    let mesh = mesh(0.45);
    let nodes: Vec<u32> = free_nodes(&mesh).into_iter().step_by(9).collect();
    let source = source(&mesh);
    let mut adaptation = follow(mesh, source, Level::I, Precision::Double, Options::default());
    let reports = go(&mut adaptation, &nodes, 0, 300);
    let [found, bound] = condensed_error(&adaptation);
    assert!(
        found <= reports.len() as f64 * bound,
        "{found:e} > {} x {bound:e}",
        reports.len()
    );
    assert!(reports.iter().all(|report| report.rebuilt.is_none()));
}

/// Levels II and III lose entries with each change; they say so, K^c stays positive definite, and level I begins afresh.
#[test]
fn lower_levels_stay_definite_and_going_up_is_a_rebuild() {
    for level in [Level::II, Level::III] {
        let mesh = mesh(0.45);
        let nodes = free_nodes(&mesh);
        let source = source(&mesh);
        let mut adaptation = follow(mesh, source, level, Precision::Double, Options::default());
        for n in 0..80 {
            go(&mut adaptation, &nodes, n, n + 1);
            let condensed = adaptation.remesher().condensed();
            assert!(condensed.llt(faer::Side::Lower).is_ok(), "{level} after {n}");
        }
        assert!(matches!(
            adaptation.remesher().state(),
            State::Approximate { .. } | State::Current
        ));
        adaptation.switch(Level::I, Precision::Double).unwrap();
        assert_eq!(adaptation.remesher().state(), State::Current);
        let [found, bound] = condensed_error(&adaptation);
        assert!(found <= bound, "{level}: {found:e} > {bound:e}");
    }
}
