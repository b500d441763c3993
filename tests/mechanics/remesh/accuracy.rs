//! What each level gets right.

use insonify::mechanics::tissue::remesh::{Level, Options, Precision};

use super::running::{condensed_error, follow, go, source};
use super::support::{contacts, error, free_nodes, gold, mesh, rounding, single};

/// What the project promises of the levels that update everything, in f64.
const PROMISED: f64 = 1e-10;

#[test]
fn level_one_and_the_exact_level_are_the_rebuilt_inverse() {
    for level in [Level::I, Level::Exact] {
        let mesh = mesh(0.45);
        let (nodes, source) = (free_nodes(&mesh), source(&mesh));
        let mut adaptation = follow(mesh, source, level, Precision::Double, Options::default());
        for (from, to) in [(0, 1), (1, 10), (10, 60)] {
            go(&mut adaptation, &nodes, from, to);
            let [found, bound] = condensed_error(&adaptation);
            assert!(
                bound < PROMISED && found <= bound,
                "{level} after {to}: {found:e} > {bound:e}"
            );
            // All of it, not only at the contacts.
            let (mesh, remesher) = adaptation.parts();
            let all: Vec<usize> = (0..mesh.dofs().free()).collect();
            let gold = gold(mesh);
            let found = error(remesher.compliance(&all, &all).unwrap().as_ref(), gold.as_ref());
            assert!(found <= bound, "{level} after {to}: {found:e} > {bound:e}");
        }
        assert!(adaptation.mesh().away().len() > 30);
    }
}

/// Two levels agree with each other to what either may be off.
#[test]
fn the_exact_level_is_level_one() {
    let mesh = mesh(0.45);
    let (nodes, source) = (free_nodes(&mesh), source(&mesh));
    let start = |level| {
        follow(
            mesh.clone(),
            source.clone(),
            level,
            Precision::Double,
            Options::default(),
        )
    };
    let (mut first, mut exact) = (start(Level::I), start(Level::Exact));
    go(&mut first, &nodes, 0, 40);
    go(&mut exact, &nodes, 0, 40);
    let bound = rounding(exact.mesh(), gold(exact.mesh()).as_ref());
    let found = error(exact.remesher().condensed(), first.remesher().condensed());
    assert!(found <= bound && found < PROMISED, "{found:e}");
}

/// What levels II to IV leave out shows where the node and its neighbours are no contacts. The error of a row left as it was
/// is at most that of level IV, which leaves them all; so II and III are no worse than IV over the same first change.
#[test]
fn a_lower_level_is_off_by_no_more_than_leaving_everything_and_says_that_it_approximates() {
    let start = mesh(0.45);
    let (nodes, source) = (free_nodes(&start), source(&start));
    let errors = [Level::I, Level::II, Level::III, Level::IV].map(|level| {
        let mut adaptation = follow(
            start.clone(),
            source.clone(),
            level,
            Precision::Double,
            Options::default(),
        );
        go(&mut adaptation, &nodes, 0, 1);
        let all: Vec<usize> = (0..start.dofs().free()).collect();
        let (mesh, remesher) = adaptation.parts();
        let found = remesher.compliance(&all, &all).unwrap() - gold(mesh);
        // Every entry that a level updates is right, so the sum of squares can only shrink.
        found.norm_l2()
    });
    assert!(errors[0] < 1e-9 * errors[3], "{errors:?}");
    assert!(errors[1] <= errors[2] && errors[2] <= errors[3], "{errors:?}");
    assert!(errors[1] > 1e3 * errors[0], "level II leaves entries: {errors:?}");
}

/// One update in f32: each entry is read, changed by a sum of s products and rounded, which leaves the rounding unit of f32
/// times the condition of the change; C is computed in f64.
#[test]
fn single_precision_is_double_precision_to_its_rounding() {
    let start = mesh(0.45);
    let nodes = free_nodes(&start);
    for level in [Level::I, Level::Exact] {
        let mut adaptation = follow(
            start.clone(),
            single(&start),
            level,
            Precision::Single,
            Options::default(),
        );
        go(&mut adaptation, &nodes, 0, 10);
        let [found, bound] = condensed_error(&adaptation);
        let ratio = f64::from(f32::EPSILON) / f64::EPSILON;
        assert!(found <= bound * ratio, "{level}: {found:e} > {:e}", bound * ratio);
    }
}

/// With the defect taken in f64, one step of refinement multiplies the error by at most |I - X K|, for an inverse X in f32 the
/// rounding unit of f32 times the condition of K (Higham, section 12).
#[test]
fn a_refined_displacement_wins_back_what_single_precision_loses() {
    let start = mesh(0.45);
    let (nodes, size) = (free_nodes(&start), start.dofs().free());
    for level in [Level::I, Level::Exact] {
        let mut adaptation = follow(
            start.clone(),
            single(&start),
            level,
            Precision::Single,
            Options::default(),
        );
        go(&mut adaptation, &nodes, 0, 10);
        let forces: Vec<f64> = (0..contacts(&start).len()).map(|i| (i as f64).cos()).collect();
        let (mesh, remesher) = adaptation.parts();
        let (mut u, mut refined) = (vec![0.0; size], vec![0.0; size]);
        remesher.displacement(&forces, &mut u).unwrap();
        let left = remesher.displacement_refined(mesh, &forces, &mut refined).unwrap();
        let gold = gold(mesh);
        let factor = rounding(mesh, gold.as_ref()) * f64::from(f32::EPSILON) / f64::EPSILON;
        assert!(factor < 1e-2 && left <= factor * factor, "{level}: {left:e} {factor:e}");
        let expected: Vec<f64> = (0..size)
            .map(|i| {
                contacts(&start)
                    .iter()
                    .zip(&forces)
                    .map(|(dof, force)| gold[(i, *dof)] * force)
                    .sum()
            })
            .collect();
        let off = |u: &[f64]| u.iter().zip(&expected).fold(0.0, |a: f64, (u, e)| a.max((u - e).abs()));
        assert!(
            off(&refined) < 1e-3 * off(&u),
            "{level}: {:e} {:e}",
            off(&refined),
            off(&u)
        );
    }
}
