//! Sparsity pattern of a stiffness matrix, and the entries that each element adds to.

use crate::tissue::error::LinearError;
use faer::sparse::SymbolicSparseColMat;
use insonify_mesh::lists::Lists;

use crate::tissue::dofs::{Dofs, NO_DOF};

/// Pairs of an element's corners, in the order of [`Pattern::places`].
pub(crate) const PAIRS: [(usize, usize); 10] = [
    (0, 0),
    (0, 1),
    (0, 2),
    (0, 3),
    (1, 1),
    (1, 2),
    (1, 3),
    (2, 2),
    (2, 3),
    (3, 3),
];

/// Index of each pair of corners in [`PAIRS`].
const PAIR_OF: [[usize; 4]; 4] = [[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]];

/// Pairs of nodes that share an element, one block each: the lower node gives the column, the higher nodes the rows,
/// ascending. Every node is paired with itself.
#[derive(Debug)]
pub(crate) struct Pattern {
    /// Start of each node's column of blocks, with a final end.
    starts: Vec<u32>,
    /// Row node of each block.
    rows: Vec<u32>,
    /// Blocks that each element adds to.
    places: Vec<[u32; 10]>,
    /// Lower triangle over the free degrees of freedom.
    pub lower: SymbolicSparseColMat<u32>,
}

impl Pattern {
    pub(super) fn new(elements: &[[u32; 4]], dofs: &Dofs) -> Result<Pattern, LinearError> {
        // Nine entries per block, and four times an element's number, stay below this.
        let limit = i32::MAX as usize;
        if elements.len() > limit / 9 {
            return Err(LinearError::TooLarge { limit });
        }
        let nodes = dofs.nodes();
        let corners = Lists::corners(elements, nodes);
        let mut starts = Vec::with_capacity(nodes + 1);
        let mut rows = Vec::with_capacity(8 * nodes);
        let mut places = vec![[0; 10]; elements.len()];
        // Last column in which each node occurred, and its block there.
        let mut last_column = vec![(NO_DOF, 0); nodes];
        for column in 0..nodes as u32 {
            let around = corners.get(column);
            let start = rows.len();
            starts.push(start as u32);
            rows.push(column);
            last_column[column as usize].0 = column;
            for &corner in around {
                for &row in &elements[corner as usize / 4] {
                    if row > column && last_column[row as usize].0 != column {
                        last_column[row as usize].0 = column;
                        rows.push(row);
                    }
                }
            }
            // Places are known only once the rows are in order, so the elements around are visited twice.
            rows[start..].sort_unstable();
            for (block, &row) in rows.iter().enumerate().skip(start) {
                last_column[row as usize].1 = block as u32;
            }
            for &corner in around {
                let (element, of_column) = (corner as usize / 4, corner as usize % 4);
                for (of_row, &row) in elements[element].iter().enumerate() {
                    if row >= column {
                        places[element][PAIR_OF[of_column][of_row]] = last_column[row as usize].1;
                    }
                }
            }
        }
        starts.push(rows.len() as u32);
        if rows.len() > limit / 9 {
            return Err(LinearError::TooLarge { limit });
        }
        let mut pattern = Pattern {
            starts,
            rows,
            places,
            lower: SymbolicSparseColMat::new_checked(0, 0, vec![0], None, Vec::new()),
        };
        pattern.lower = pattern.entries_of(dofs);
        Ok(pattern)
    }

    fn entries_of(&self, dofs: &Dofs) -> SymbolicSparseColMat<u32> {
        let free = dofs.free();
        let mut starts = vec![0; free + 1];
        let mut rows = Vec::with_capacity(9 * self.rows.len());
        self.for_each_entry(dofs, |row, column, _, _| {
            rows.push(row);
            starts[column as usize + 1] = rows.len() as u32;
        });
        SymbolicSparseColMat::new_checked(free, free, starts, None, rows)
    }

    /// Calls `entry` with row, column, block and place in the block for each entry of the lower triangle, in order.
    #[inline]
    pub(crate) fn for_each_entry(&self, dofs: &Dofs, mut entry: impl FnMut(u32, u32, usize, (usize, usize))) {
        for node in 0..dofs.nodes() as u32 {
            let span = self.starts[node as usize] as usize..self.starts[node as usize + 1] as usize;
            for (j, column) in dofs
                .of(node)
                .into_iter()
                .enumerate()
                .filter(|(_, column)| *column != NO_DOF)
            {
                for block in span.clone() {
                    for (i, row) in dofs.of(self.rows[block]).into_iter().enumerate() {
                        // Numbers ascend with node and axis: this omits entries above the diagonal.
                        if row != NO_DOF && row >= column {
                            entry(row, column, block, (i, j));
                        }
                    }
                }
            }
        }
    }

    /// Number of entries of the lower triangle.
    pub(super) fn entries(&self) -> usize {
        self.lower.row_idx().len()
    }

    /// Number of node pairs.
    pub(super) fn pairs(&self) -> usize {
        self.rows.len()
    }

    /// Blocks that the corner pairs of each element add to.
    pub(super) fn places(&self) -> &[[u32; 10]] {
        &self.places
    }

    /// All blocks as (column node, row node, number).
    pub(super) fn blocks(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        self.starts.windows(2).enumerate().flat_map(move |(column, span)| {
            (span[0] as usize..span[1] as usize).map(move |block| (column, self.rows[block] as usize, block))
        })
    }
}
