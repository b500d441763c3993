//! Sparse symmetric tangents over the free degrees of freedom, with a fixed pattern and replaceable values.

use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};

use super::body::{Moduli, NonlinearBody, Responses};
use super::{NO_DOF, Supports};
use crate::tissue::factor::Symmetric;
use insonify_mesh::vector::dot;

/// Kind of tangent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Element stiffnesses times Kobayashi et al.'s scalar tangent; of laws without a secant their moduli.
    Scalar,
    /// The symmetric part of the consistent tangent.
    Consistent,
}

/// Lower triangle of a tangent.
#[derive(Clone, Debug)]
pub(super) struct Tangent<const D: usize> {
    pattern: SymbolicSparseColMat<u32>,
    values: Vec<f64>,
    /// Entry that each pair of degrees of freedom of each element adds to, column by column of the element's lower
    /// triangle; [`NO_DOF`] where one is prescribed.
    places: Vec<u32>,
    free: Vec<u32>,
}

/// Error for more entries than 32-bit indices can address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TooLarge;

impl<const D: usize> Tangent<D> {
    pub(super) fn new<const N: usize>(elements: &[[u32; N]], supports: &Supports<D>) -> Result<Self, TooLarge> {
        let size = supports.free().len();
        let mut columns: Vec<Vec<u32>> = vec![Vec::new(); size];
        for corners in elements {
            each_pair(corners, supports, |pair| {
                if let Some((row, column)) = pair {
                    columns[column as usize].push(row);
                }
            });
        }
        let mut starts = Vec::with_capacity(size + 1);
        let mut rows = Vec::new();
        for column in &mut columns {
            starts.push(rows.len() as u32);
            column.sort_unstable();
            column.dedup();
            rows.extend_from_slice(column);
            if rows.len() > i32::MAX as usize {
                return Err(TooLarge);
            }
        }
        starts.push(rows.len() as u32);
        // The pattern is sorted only now. Places looked up once spare every later assembly the search.
        let mut places = Vec::with_capacity(elements.len() * (D * N * (D * N + 1)) / 2);
        for corners in elements {
            each_pair(corners, supports, |pair| {
                places.push(pair.map_or(NO_DOF, |(row, column)| {
                    let first_entry = starts[column as usize];
                    let span = &rows[first_entry as usize..starts[column as usize + 1] as usize];
                    first_entry + span.partition_point(|listed| *listed < row) as u32
                }));
            });
        }
        let values = vec![0.0; rows.len()];
        Ok(Tangent {
            pattern: SymbolicSparseColMat::new_checked(size, size, starts, None, rows),
            values,
            places,
            free: supports.free().to_vec(),
        })
    }

    /// Assembles the tangent of a body from the responses of its elements.
    pub(super) fn fill<const N: usize>(&mut self, body: &NonlinearBody<D, N>, responses: &Responses<D>, kind: Kind) {
        self.values.fill(0.0);
        let width = D * N;
        let per_element = width * (width + 1) / 2;
        let parts = body
            .cells()
            .iter()
            .zip(&responses.cells)
            .zip(self.places.chunks_exact(per_element));
        for ((cell, response), places) in parts {
            let gradients = &cell.shape.gradients;
            let moduli = responses.moduli_of(cell);
            let stiffness = match kind {
                Kind::Scalar => response.scalar,
                Kind::Consistent => response.secant,
            };
            let (lambda, mu) = (stiffness * cell.lambda, stiffness * cell.mu);
            let stiffens = kind == Kind::Consistent && response.rise.iter().flatten().any(|x| *x != 0.0);
            let (rise, normal) = (
                cell.shape.divergence(&response.rise),
                cell.shape.divergence(&response.normal),
            );
            // In the order of `each_pair`, whose places say where each entry goes.
            let mut places = places.iter();
            for a in 0..N {
                for i in 0..D {
                    for b in a..N {
                        let shear = mu * dot(gradients[a], gradients[b]);
                        for j in if a == b { i } else { 0 }..D {
                            let (ga, gb) = (gradients[a], gradients[b]);
                            let mut entry = lambda * (ga[i] * gb[j]) + mu * (gb[i] * ga[j]);
                            if i == j {
                                entry += shear;
                            }
                            if let Some(moduli) = moduli {
                                entry = contraction(moduli, [i, j], [&ga, &gb]);
                            }
                            // A modulus that depends on the strain adds the product of its rise and the stress: no
                            // symmetric matrix, of which the symmetric part allows a Cholesky factor.
                            if stiffens {
                                entry += 0.5 * (rise[a][i] * normal[b][j] + normal[a][i] * rise[b][j]);
                            }
                            if let Some(&destination) = places.next()
                                && destination != NO_DOF
                            {
                                self.values[destination as usize] += entry;
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Entry of the stiffness of directions i and j at two corners with these gradients.
fn contraction<const D: usize>(moduli: &Moduli<D>, [i, j]: [usize; 2], [a, b]: [&[f64; D]; 2]) -> f64 {
    (0..D).map(|row| a[row] * dot(moduli[i][row][j], *b)).sum()
}

/// Calls `visit` with row and column among the free degrees of freedom, in the order of [`Tangent::fill`]; with `None`
/// where one is prescribed.
fn each_pair<const D: usize, const N: usize>(
    corners: &[u32; N],
    supports: &Supports<D>,
    mut visit: impl FnMut(Option<(u32, u32)>),
) {
    let number = |corner: usize, axis: usize| supports.number(D * corners[corner] as usize + axis);
    for a in 0..N {
        for i in 0..D {
            for b in a..N {
                for j in if a == b { i } else { 0 }..D {
                    let (row, column) = (number(a, i), number(b, j));
                    let free = row != NO_DOF && column != NO_DOF;
                    visit(free.then(|| (row.max(column), row.min(column))));
                }
            }
        }
    }
}

impl<const D: usize> Symmetric for Tangent<D> {
    fn lower(&self) -> SparseColMatRef<'_, u32, f64> {
        SparseColMatRef::new(self.pattern.as_ref(), &self.values)
    }

    fn node_of(&self, dof: u32) -> (u32, u8) {
        let dof = self.free[dof as usize];
        (dof / D as u32, (dof % D as u32) as u8)
    }
}
