use nalgebra::{DMatrix, DVector};

use super::*;
use crate::mechanics::tissue::columns::Columns;
use crate::mechanics::tissue::condensed::Contact;
use crate::mechanics::tissue::dofs::Dofs;
use crate::mechanics::tissue::frames::Frame;
use crate::mechanics::tissue::symmetric::Symmetric;
use crate::mechanics::tissue::testing::{Block, value};
use Prescribed::{Displacement, Force};

/// Returns K^c of contacts spread over a block of tissue, each in its own frame.
fn tissue(contacts: usize, poisson: f64) -> Condensed {
    let block = Block::new(400, poisson);
    let contact = |node| Contact {
        node,
        frame: Frame::along(std::array::from_fn(|axis| value(node as usize, axis, 5))).expect("a direction"),
    };
    let contacts: Vec<Contact> = block.free_nodes(contacts).into_iter().map(contact).collect();
    let mut condensed = Condensed::new();
    let mut columns = Columns::new(block.factor.clone(), 300);
    condensed.add(&mut columns, &block.dofs, &contacts).expect("contacts");
    condensed
}

/// Returns a K^c with the given entries.
fn made(contacts: usize, entry: impl Fn(usize, usize) -> f64 + Sync) -> Condensed {
    let dofs = Dofs::new(contacts, []);
    let frame = Frame::WORLD;
    let all: Vec<Contact> = (0..contacts as u32).map(|node| Contact { node, frame }).collect();
    let mut condensed = Condensed::new();
    let mut compliance = Symmetric::<f64>::from_fn(3 * contacts, entry);
    condensed.add(&mut compliance, &dofs, &all).expect("contacts");
    condensed
}

fn both(condensed: &Condensed) -> [Box<dyn ConstraintSolver>; 2] {
    [
        Box::new(Pivots::new(condensed, PIVOT_LIMIT).expect("a tableau")),
        Box::new(Refactorised::new(condensed, PIVOT_LIMIT).expect("a system")),
    ]
}

fn values(size: usize, salt: u32) -> Vec<f64> {
    (0..size).map(|i| value(i, 0, salt)).collect()
}

/// Computes the partitioned solution by LU, from the formulas of the module.
fn partitioned(condensed: &Condensed, prescribed: &[Prescribed], values: &[f64]) -> [Vec<f64>; 2] {
    let k = condensed.matrix();
    let of = |what| -> Vec<usize> { (0..values.len()).filter(|&i| prescribed[i] == what).collect() };
    let [d, f] = [of(Displacement), of(Force)];
    let block = |a: &[usize], b: &[usize]| DMatrix::from_fn(a.len(), b.len(), |i, j| k[(a[i], b[j])]);
    let part = |a: &[usize]| DVector::from_fn(a.len(), |i, _| values[a[i]]);
    let rhs = part(&d) - block(&d, &f) * part(&f);
    let force_d = if d.is_empty() {
        rhs
    } else {
        block(&d, &d).lu().solve(&rhs).expect("a solution")
    };
    let displacement_f = block(&f, &d) * &force_d + block(&f, &f) * part(&f);
    let [mut force, mut displacement] = [values.to_vec(), values.to_vec()];
    d.iter().zip(&force_d).for_each(|(&i, &x)| force[i] = x);
    f.iter().zip(&displacement_f).for_each(|(&i, &x)| displacement[i] = x);
    [force, displacement]
}

/// Returns the largest difference relative to the largest value.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let largest =
        |x: &mut dyn Iterator<Item = f64>| x.fold(0.0, |a: f64, x| if x.is_nan() { x } else { a.max(x.abs()) });
    let size = largest(&mut b.iter().copied());
    let change = largest(&mut a.iter().zip(b).map(|(a, b)| a - b));
    if change == 0.0 { 0.0 } else { change / size }
}

/// Returns the possible difference of two solutions: the condition of K_DD after scaling to unit diagonal, times
/// rounding, times 10 |D| for the number of operations (Higham, Accuracy and Stability of Numerical Algorithms, section
/// 10.1).
fn bound(condensed: &Condensed, prescribed: &[Prescribed]) -> f64 {
    let k = condensed.matrix();
    let d: Vec<usize> = (0..prescribed.len())
        .filter(|&i| prescribed[i] == Displacement)
        .collect();
    let entry = |i: usize, j: usize| k[(d[i], d[j])] / (k[(d[i], d[i])] * k[(d[j], d[j])]).sqrt();
    let scaled = DMatrix::from_fn(d.len(), d.len(), entry).symmetric_eigenvalues();
    let condition = if d.is_empty() { 1.0 } else { scaled.max() / scaled.min() };
    10.0 * (d.len() + 1) as f64 * f64::EPSILON * condition
}

#[test]
fn both_ways_give_the_partitioned_solution() {
    for poisson in [0.3, 0.499] {
        let condensed = tissue(8, poisson);
        let size = condensed.size();
        for salt in 0..20 {
            let prescribed: Vec<_> = values(size, salt)
                .iter()
                .map(|&x| if x > 0.0 { Displacement } else { Force })
                .collect();
            let given = values(size, 100 + salt);
            let [force, displacement] = partitioned(&condensed, &prescribed, &given);
            let bound = bound(&condensed, &prescribed);
            for mut solver in both(&condensed) {
                let changes: Vec<_> = prescribed.iter().copied().enumerate().collect();
                solver.switch(&changes).expect("independent contacts");
                assert_eq!(solver.prescribed(), prescribed);
                let state = solver.solve(&given).expect("a solution");
                assert!(
                    difference(&state.force_n, &force) <= bound,
                    "{:e}",
                    difference(&state.force_n, &force)
                );
                assert!(difference(&state.displacement_mm, &displacement) <= bound);
                for i in 0..size {
                    let returned = match prescribed[i] {
                        Force => state.force_n[i],
                        Displacement => state.displacement_mm[i],
                    };
                    assert_eq!(returned, given[i], "what is prescribed comes back to the bit");
                }
            }
        }
    }
}

/// Returns two contacts whose first axes have the correlation 1 - gap; everything else is independent.
fn pair(gap: f64) -> Condensed {
    made(2, move |i, j| match (i, j) {
        _ if i == j => 2.0,
        (3, 0) => 2.0 * (1.0 - gap),
        _ => 0.0,
    })
}

#[test]
fn nearly_dependent_contacts_are_refused_by_name_or_give_finite_forces() {
    for gap in [1e-1, 1e-3, 1e-5, 1e-6, 1e-7, 1e-9, 1e-12, 0.0] {
        // Remaining part of a compliance of 2 beside its neighbour: 2 (1 - (1 - gap)^2).
        let relative = gap * (2.0 - gap);
        for (way, mut solver) in both(&pair(gap)).into_iter().enumerate() {
            solver.switch(&[(0, Displacement)]).expect("the first");
            let before = solver.solve(&[1.0, 0.0, 0.0, 0.5, 0.0, 0.0]).expect("a solution");
            let second = solver.switch(&[(3, Displacement)]);
            if relative > PIVOT_LIMIT {
                second.expect("independent enough");
                let state = solver.solve(&[1.0, 0.0, 0.0, 1.1, 0.0, 0.0]).expect("a solution");
                // [2, 2r; 2r, 2] f = (1, 1.1) by hand.
                let [r, scale] = [1.0 - gap, 2.0 * relative];
                let expected = [(1.0 - r * 1.1) / scale, (1.1 - r) / scale];
                let error = difference(&[state.force_n[0], state.force_n[3]], &expected);
                assert!(
                    error <= 4.0 * f64::EPSILON / relative,
                    "gap {gap}, way {way}: {error:e}"
                );
            } else {
                let error = second.expect_err("hardly independent");
                let SwitchError::Dependent {
                    node,
                    axis,
                    pivot,
                    diagonal,
                    limit,
                } = error
                else {
                    panic!("{error}");
                };
                assert_eq!((node, axis, diagonal, limit), (1, 0, 2.0, PIVOT_LIMIT));
                assert!(
                    (pivot - 2.0 * relative).abs() <= 8.0 * f64::EPSILON,
                    "way {way}: {pivot:e}"
                );
                assert!(error.to_string().contains("node 1 along its axis 0"), "{error}");
                assert_eq!(solver.prescribed()[3], Force);
                let after = solver.solve(&[1.0, 0.0, 0.0, 0.5, 0.0, 0.0]).expect("a solution");
                assert_eq!(after, before);
            }
        }
    }
}

#[test]
fn a_refused_change_among_others_undoes_them_all() {
    let condensed = pair(1e-9);
    for mut solver in both(&condensed) {
        solver
            .switch(&[(4, Displacement), (1, Displacement)])
            .expect("independent");
        let given = values(6, 1);
        let before = solver.solve(&given).expect("a solution");
        let prescribed = solver.prescribed().to_vec();
        let changes = [
            (4, Force),
            (0, Displacement),
            (2, Displacement),
            (3, Displacement),
            (5, Displacement),
        ];
        let refused = solver.switch(&changes);
        assert!(
            matches!(refused, Err(SwitchError::Dependent { node: 1, axis: 0, .. })),
            "{refused:?}"
        );
        assert_eq!(solver.prescribed(), prescribed);
        assert_eq!(solver.solve(&given).expect("a solution"), before);
        // Releasing the neighbour first makes room.
        solver.switch(&[(0, Displacement)]).expect("alone");
        solver.switch(&[(0, Force), (3, Displacement)]).expect("in its place");
    }
}

#[test]
fn exchanges_near_the_limit_make_the_tableau_anew_before_forces_suffer() {
    // Relative pivots of about 2e-6 add 1e-10 of rounding each time.
    let condensed = pair(1e-6);
    let mut pivots = Pivots::new(&condensed, PIVOT_LIMIT).expect("a tableau");
    let given = values(6, 3);
    for step in 0..1000 {
        let dof = [0, 3][step % 2];
        let to = if step % 4 < 2 { Displacement } else { Force };
        pivots.switch(&[(dof, to)]).expect("above the limit");
        let [force, _] = partitioned(&condensed, pivots.prescribed(), &given);
        let state = pivots.solve(&given).expect("a solution");
        let error = difference(&state.force_n, &force);
        // The reference itself has an error of rounding times the condition of 1e6.
        assert!(error < 1e-9, "switch {step}: {error:e}");
    }
    assert!(pivots.refreshes() > 0);
    let mut calm = Pivots::new(&pair(0.5), PIVOT_LIMIT).expect("a tableau");
    for step in 0..1000 {
        calm.switch(&[(0, [Displacement, Force][step % 2])])
            .expect("independent");
    }
    assert_eq!(calm.refreshes(), 0);
}

#[test]
fn a_damaged_tableau_is_noticed_when_it_is_used() {
    let condensed = tissue(6, 0.45);
    let given = values(18, 4);
    let mut pivots = Pivots::new(&condensed, PIVOT_LIMIT).expect("a tableau");
    pivots
        .switch(&[(3, Displacement), (7, Displacement), (12, Displacement)])
        .expect("independent");
    let expected = pivots.solve(&given).expect("a solution");
    for damage in [1e-6, 1e-2, f64::NAN] {
        let before = pivots.refreshes();
        let entry = pivots.tableau[(7, 7)];
        pivots.tableau[(7, 7)] = entry * (1.0 + damage);
        let found = pivots.solve(&given).expect("a solution");
        assert_eq!(pivots.refreshes(), before + 1, "damage {damage}");
        assert!(difference(&found.force_n, &expected.force_n) <= bound(&condensed, pivots.prescribed()));
    }
}

#[test]
fn work_is_the_same_in_either_order_of_two_states() {
    // Betti: f_1 . u_2 = f_2 . u_1 for any two states of one elastic body.
    let condensed = tissue(8, 0.45);
    let size = condensed.size();
    for mut solver in both(&condensed) {
        let mut state = |salt| {
            let changes: Vec<_> = (0..size)
                .map(|i| (i, [Force, Displacement][usize::from(value(i, 1, salt) > 0.0)]))
                .collect();
            solver.switch(&changes).expect("independent contacts");
            let bound = bound(&condensed, solver.prescribed());
            (solver.solve(&values(size, salt)).expect("a solution"), bound)
        };
        let [(one, first), (two, second)] = [state(31), state(32)];
        let work = |a: &ContactState, b: &ContactState| -> [f64; 2] {
            let terms = a.force_n.iter().zip(&b.displacement_mm).map(|(f, u)| f * u);
            terms.fold([0.0, 0.0], |[sum, size], term| [sum + term, size + term.abs()])
        };
        let [[a, magnitude], [b, _]] = [work(&one, &two), work(&two, &one)];
        assert!((a - b).abs() <= (first + second) * magnitude, "{a} {b}");
        assert!(work(&one, &one)[0] > 0.0 || one.force_n.iter().all(|&f| f == 0.0));
    }
}

#[test]
fn forces_alone_displacements_alone_and_no_contacts() {
    let condensed = tissue(4, 0.45);
    let given = values(12, 6);
    for mut solver in both(&condensed) {
        let state = solver.solve(&given).expect("a solution");
        assert_eq!(state.force_n, given);
        let [_, expected] = partitioned(&condensed, &[Force; 12], &given);
        assert!(difference(&state.displacement_mm, &expected) <= 12.0 * f64::EPSILON);
        solver
            .switch(&std::array::from_fn::<_, 12, _>(|i| (i, Displacement)))
            .expect("independent");
        assert_eq!(solver.solve(&given).expect("a solution").displacement_mm, given);
        assert_eq!(solver.solve(&[0.0; 12]).expect("a solution").force_n, [0.0; 12]);
    }
    for mut solver in both(&Condensed::new()) {
        solver.switch(&[]).expect("nothing to do");
        assert_eq!(solver.solve(&[]).expect("nothing"), ContactState::default());
        assert_eq!(
            solver.switch(&[(0, Force)]),
            Err(SwitchError::OutOfRange { dof: 0, size: 0 })
        );
    }
}

#[test]
fn what_does_not_yield_or_is_not_definite_is_refused() {
    // Axis 1 of the contact is fixed; or has a negative diagonal, as an inverse spoiled by approximate updates may.
    for (diagonal, found) in [(0.0, 0.0), (-1e-3, -1e-3)] {
        let condensed = made(1, move |i, j| if i != j { 0.0 } else { [1.0, diagonal, 1.0][i] });
        for mut solver in both(&condensed) {
            let error = solver.switch(&[(1, Displacement)]).expect_err("no compliance");
            assert!(
                matches!(error, SwitchError::Dependent { node: 0, axis: 1, diagonal, .. } if diagonal == found),
                "{error}"
            );
            solver
                .switch(&[(0, Displacement), (2, Displacement)])
                .expect("the others");
        }
    }
    let undefined = made(1, |i, _| if i == 2 { f64::NAN } else { 1.0 });
    assert!(matches!(
        Pivots::new(&undefined, PIVOT_LIMIT),
        Err(SwitchError::NotFinite { node: 0, .. })
    ));
    assert!(matches!(
        Refactorised::new(&undefined, PIVOT_LIMIT),
        Err(SwitchError::NotFinite { .. })
    ));
}

#[test]
fn values_that_do_not_fit_are_refused() {
    let condensed = tissue(2, 0.45);
    for mut solver in both(&condensed) {
        let outside = SwitchError::OutOfRange { dof: 6, size: 6 };
        assert_eq!(solver.switch(&[(0, Displacement), (6, Force)]), Err(outside));
        assert_eq!(solver.prescribed(), [Force; 6]);
        assert_eq!(
            solver.solve(&[0.0; 5]),
            Err(SwitchError::Count { found: 5, expected: 6 })
        );
        let mut given = [0.0; 6];
        given[4] = f64::INFINITY;
        let error = solver.solve(&given).expect_err("infinite");
        assert!(matches!(error, SwitchError::NotFinite { axis: 1, .. }), "{error}");
    }
}
