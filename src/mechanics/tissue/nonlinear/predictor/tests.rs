//! Predictions for increments with a known outcome.

use super::*;

/// Returns the outcome of a proposal: half as much again in one component, zero in another.
fn outcome(proposal: [f64; 3]) -> [f64; 3] {
    [1.5 * proposal[0], proposal[1], 0.0]
}

fn taught(proposal: [f64; 3], contact: &[(u32, f64)]) -> Predictor {
    let mut predictor = Predictor::default();
    assert!(!predictor.apply(&mut proposal.clone(), contact));
    predictor.record(outcome(proposal).into_iter());
    predictor
}

#[test]
fn increments_alike_end_where_they_are_foreseen() {
    for share in [1.0, -1.0, 0.25, -3.0] {
        let increment = [2.0, -1.0, 0.5];
        let proposal = increment.map(|x| share * x);
        let mut change = proposal;
        assert!(taught(increment, &[]).apply(&mut change, &[]));
        let expected = outcome(proposal);
        let errors = change.iter().zip(expected).map(|(a, b)| (a - b).abs());
        assert!(errors.fold(0.0, f64::max) < 1e-15, "{change:?}, expected {expected:?}");
    }
}

#[test]
fn other_increments_are_left_as_they_are() {
    let increment = [2.0, 0.0, 0.0];
    let (this_contact, other_contact) = ([(4, 1.0)], [(5, 1.0)]);
    // Of another kind, far longer, zero, with another contact or with none.
    let cases: [([f64; 3], &[(u32, f64)]); 5] = [
        ([1.0, 1.1, 0.0], &this_contact),
        ([9.0, 0.0, 0.0], &this_contact),
        ([0.0, 0.0, 0.0], &this_contact),
        ([2.0, 0.0, 0.0], &other_contact),
        ([2.0, 0.0, 0.0], &[]),
    ];
    for (proposal, contact) in cases {
        let mut change = proposal;
        assert!(
            !taught(increment, &this_contact).apply(&mut change, contact),
            "{proposal:?}"
        );
        assert_eq!(change, proposal);
    }
    let mut forgetful = taught(increment, &this_contact);
    forgetful.clear();
    // An increment without a proposal teaches nothing.
    forgetful.record([7.0, 7.0, 7.0].into_iter());
    assert!(!forgetful.apply(&mut increment.clone(), &this_contact));
}
