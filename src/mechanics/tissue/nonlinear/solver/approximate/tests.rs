//! Precision tests on chains of springs with known condition.

use crate::tissue::error::LinearError;
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};

use super::*;

const LINKS: usize = 40;

/// Nodes on a line, each on a spring of stiffness `ground` and joined to the next by one of stiffness 1.
struct Chain {
    pattern: SymbolicSparseColMat<u32>,
    values: Vec<f64>,
}

impl Chain {
    fn new(ground: f64) -> Self {
        let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for node in 0..LINKS as u32 {
            let links = if node == 0 || node as usize == LINKS - 1 {
                1.0
            } else {
                2.0
            };
            rows.push(node);
            values.push(ground + links);
            if (node as usize) < LINKS - 1 {
                rows.push(node + 1);
                values.push(-1.0);
            }
            starts.push(rows.len() as u32);
        }
        let pattern = SymbolicSparseColMat::new_checked(LINKS, LINKS, starts, None, rows);
        Chain { pattern, values }
    }
}

impl Symmetric for Chain {
    fn lower(&self) -> SparseColMatRef<'_, u32, f64> {
        SparseColMatRef::new(self.pattern.as_ref(), &self.values)
    }

    fn node_of(&self, dof: u32) -> (u32, u8) {
        (dof, 0)
    }
}

/// Returns the relative error for all nodes displaced alike, when the links carry no force.
fn alike(chain: &Chain, factor: &mut Approximate, ground: f64, displacement: f64) -> f64 {
    let mut forces = vec![ground * displacement; LINKS];
    let mut check = vec![0.0; LINKS];
    chain.product(&vec![displacement; LINKS], &mut check);
    assert!(
        check
            .iter()
            .zip(&forces)
            .all(|(a, b)| (a - b).abs() <= 1e-15 * displacement.abs() * (ground + 4.0))
    );
    factor.solve_in_place(&mut forces);
    forces
        .iter()
        .map(|u| (u / displacement - 1.0).abs())
        .fold(0.0, f64::max)
}

#[test]
fn a_sound_matrix_is_factored_in_single_precision() {
    let chain = Chain::new(1.0);
    let mut factor = Approximate::new(&chain).unwrap();
    assert!(factor.is_single());
    // Its condition is 5 and rounding 6e-8; forces far outside the range of single precision do not matter.
    for displacement in [1.0, 1e-60, -1e60] {
        let error = alike(&chain, &mut factor, 1.0, displacement);
        assert!(error > 1e-12 && error < 1e-6, "{error:e} for {displacement:e}");
    }
    let mut none = vec![0.0; LINKS];
    factor.solve_in_place(&mut none);
    assert_eq!(none, vec![0.0; LINKS]);
}

/// A spring of 1e-9 beside one of 1 is lost in single precision, one of 2e-7 is off by a third: condition times
/// rounding.
#[test]
fn what_single_precision_loses_is_factored_in_double() {
    for ground in [1e-9, 2e-7] {
        let chain = Chain::new(ground);
        let mut factor = Approximate::new(&chain).unwrap();
        assert!(!factor.is_single(), "{ground:e}");
        let error = alike(&chain, &mut factor, ground, 1.0);
        assert!(error < 4.0 / ground * f64::EPSILON * LINKS as f64, "{error:e}");
        // Another matrix of the same pattern: in single precision until it fails, in double from then on.
        let mut factor = Approximate::new(&Chain::new(1.0)).unwrap();
        factor.refactor(&Chain::new(0.5)).unwrap();
        assert!(factor.is_single());
        factor.refactor(&chain).unwrap();
        assert!(!factor.is_single());
        factor.refactor(&Chain::new(0.5)).unwrap();
        assert!(alike(&Chain::new(0.5), &mut factor, 0.5, 1.0) < 1e-13);
    }
}

#[test]
fn what_is_not_positive_definite_is_told() {
    let error = Approximate::new(&Chain::new(-0.1)).unwrap_err();
    assert!(matches!(error, LinearError::NotPositiveDefinite { .. }));
}
