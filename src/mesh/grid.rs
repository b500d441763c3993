//! Uniform grid over the elements, with the elements whose boxes touch each cell, ascending.
//!
//! The cell of a point is a monotone function of its coordinates in the scalar of the locator, and the same function is
//! applied to the boxes: a point inside a box always finds the element in its cell, regardless of rounding. Cells at
//! the border extend to infinity, so a few distant nodes do not coarsen the grid for all others.

use super::element::{Kind, Outline};
use insonify_base::real::Real;

/// Flag, in the start of a cell's list, of a cell that an inverted element touches.
const TANGLED: u32 = 1 << 31;
/// Target number of cells per element within the volume of the mesh: more make the update slower, fewer the scans.
const CELLS_PER_ELEMENT: f64 = 0.25;
/// Capacity in cells per element: a mesh of scattered parts fills only part of the grid.
const CELL_CAPACITY_PER_ELEMENT: usize = 4;
/// Capacity in list entries per element; the grid is coarsened where boxes would need more.
const ENTRIES_PER_ELEMENT: usize = 32;
/// Number of nodes from which the extent of the grid is estimated.
const EXTENT_SAMPLES: usize = 1024;
/// Fraction of the nodes at either end of each axis that the extent excludes; it then widens by `EXTENT_MARGIN` of
/// itself.
const EXTENT_TAIL: f64 = 0.01;
const EXTENT_MARGIN: f64 = 0.05;

/// Cell range of an element that is never hit.
const NOWHERE: [[u32; 3]; 2] = [[1; 3], [0; 3]];

/// Grid of cells. All lists keep their memory between updates.
#[derive(Clone, Debug)]
pub(super) struct CellGrid<T> {
    pub origin: [T; 3],
    /// Cells per mm.
    pub per_mm: T,
    pub cells: [u32; 3],
    /// Bounds of all elements' boxes.
    pub low: [T; 3],
    pub high: [T; 3],
    /// Whether any cell is flagged as tangled.
    pub any_tangled: bool,
    /// Start of each cell's list, with [`TANGLED`]; one more than there are cells.
    pub starts: Vec<u32>,
    pub lists: Vec<u32>,
    ranges: Vec<[[u32; 3]; 2]>,
    samples: Vec<T>,
}

impl<T: Real> CellGrid<T> {
    pub(crate) fn new(elements: usize) -> CellGrid<T> {
        CellGrid {
            origin: [T::zero(); 3],
            per_mm: T::one(),
            cells: [1; 3],
            low: [T::infinity(); 3],
            high: [T::neg_infinity(); 3],
            any_tangled: false,
            starts: Vec::with_capacity(cell_capacity(elements) + 1),
            lists: Vec::with_capacity(entry_capacity(elements)),
            ranges: Vec::with_capacity(elements),
            samples: Vec::with_capacity(EXTENT_SAMPLES),
        }
    }

    /// Rebuilds the grid for elements with these outlines over these nodes.
    pub(crate) fn rebuild(&mut self, nodes: &[[T; 3]], outlines: &[Outline<T>]) {
        self.place(nodes, outlines);
        self.ranges.clear();
        (self.low, self.high) = ([T::infinity(); 3], [T::neg_infinity(); 3]);
        let mut entries = 0;
        for outline in outlines {
            let [low, high] = outline.bounds;
            let mut range = NOWHERE;
            if low[0] <= high[0] {
                range = [self.cell(low), self.cell(high)];
                for axis in 0..3 {
                    self.low[axis] = self.low[axis].min(low[axis]);
                    self.high[axis] = self.high[axis].max(high[axis]);
                }
                entries += size(&range);
            }
            self.ranges.push(range);
        }
        while entries > entry_capacity(outlines.len()) && self.cells != [1; 3] {
            entries = self.coarsen();
        }
        self.fill(entries);
        self.mark(outlines);
    }

    /// Returns the cell of a point that is not NaN.
    #[inline(always)]
    fn cell(&self, p: [T; 3]) -> [u32; 3] {
        std::array::from_fn(|axis| {
            let last = f64::from(self.cells[axis] - 1);
            let cells = (p[axis] - self.origin[axis]) * self.per_mm;
            cells.wide().clamp(0.0, last) as u32
        })
    }

    /// Returns the elements whose boxes touch the cell of `p`, ascending, and whether one of them is inverted. Empty
    /// outside the bounds of all boxes.
    #[inline(always)]
    pub(crate) fn around(&self, p: [T; 3]) -> (&[u32], bool) {
        if (0..3).any(|axis| p[axis] < self.low[axis] || p[axis] > self.high[axis]) {
            return (&[], false);
        }
        let index = self.index(self.cell(p));
        let (start, end) = (self.starts[index], self.starts[index + 1]);
        (
            &self.lists[(start & !TANGLED) as usize..(end & !TANGLED) as usize],
            start & TANGLED != 0,
        )
    }

    #[inline(always)]
    fn index(&self, cell: [u32; 3]) -> usize {
        let [nx, ny, _] = self.cells.map(|n| n as usize);
        cell[0] as usize + nx * (cell[1] as usize + ny * cell[2] as usize)
    }

    /// Chooses origin, cell size and cell counts from where most nodes lie.
    fn place(&mut self, nodes: &[[T; 3]], outlines: &[Outline<T>]) {
        let mut extent = [0.0; 3];
        let mut origin = [0.0; 3];
        for axis in 0..3 {
            let (low, high) = self.core(nodes, axis);
            let margin = EXTENT_MARGIN * (high - low);
            origin[axis] = low - margin;
            extent[axis] = high - low + 2.0 * margin;
        }
        let longest = extent.iter().fold(0.0f64, |a, b| a.max(*b));
        if !(longest > 0.0 && longest.is_finite()) {
            (self.origin, self.per_mm, self.cells) = ([T::zero(); 3], T::one(), [1; 3]);
            return;
        }
        // A few elements stretched over a distance would make the cells too large for all others.
        let whole: f64 = extent.iter().map(|e| e.max(1e-6 * longest)).product();
        let volume = outlines.iter().map(|outline| outline.volume).sum::<f64>().min(whole);
        let elements = outlines.len();
        let target = (CELLS_PER_ELEMENT * elements as f64).max(1.0);
        let mut edge = (volume / target).cbrt().clamp(1e-6 * longest, longest);
        let mut cells = extent.map(|e| (e / edge).ceil().max(1.0));
        while cells.iter().product::<f64>() > cell_capacity(elements) as f64 {
            edge *= 1.125;
            cells = extent.map(|e| (e / edge).ceil().max(1.0));
        }
        self.origin = origin.map(T::of);
        self.per_mm = T::of(edge.recip());
        self.cells = cells.map(|n| n as u32);
    }

    /// Returns the interval on one axis that contains nearly all finite nodes.
    fn core(&mut self, nodes: &[[T; 3]], axis: usize) -> (f64, f64) {
        self.samples.clear();
        let step = nodes.len().div_ceil(EXTENT_SAMPLES).max(1);
        self.samples.extend(
            nodes
                .iter()
                .step_by(step)
                .map(|node| node[axis])
                .filter(|x| x.is_finite()),
        );
        if self.samples.is_empty() {
            return (0.0, 0.0);
        }
        self.samples
            .sort_unstable_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        let last = self.samples.len() - 1;
        let tail = (EXTENT_TAIL * last as f64) as usize;
        (self.samples[tail].wide(), self.samples[last - tail].wide())
    }

    /// Doubles the cell size, exactly: cell numbers halve. Returns the number of entries then needed.
    fn coarsen(&mut self) -> usize {
        self.per_mm *= T::of(0.5);
        self.cells = self.cells.map(|n| n.div_ceil(2));
        let mut entries = 0;
        for range in &mut self.ranges {
            if size(range) > 0 {
                *range = range.map(|corner| corner.map(|n| n >> 1));
                entries += size(range);
            }
        }
        entries
    }

    /// Sorts the elements into their cells by counting; elements come in ascending order, so each list is ascending.
    fn fill(&mut self, entries: usize) {
        let cells = self.cells.iter().map(|n| *n as usize).product::<usize>();
        self.starts.clear();
        self.starts.resize(cells + 1, 0);
        self.lists.clear();
        self.lists.resize(entries, 0);
        let [nx, ny, _] = self.cells.map(|n| n as usize);
        let (starts, lists) = (&mut self.starts, &mut self.lists);
        for range in &self.ranges {
            rows(range, nx, ny, |row| {
                starts[row.start + 1..row.end + 1].iter_mut().for_each(|n| *n += 1)
            });
        }
        let mut sum = 0;
        for start in starts.iter_mut() {
            sum += *start;
            *start = sum;
        }
        for (element, range) in self.ranges.iter().enumerate() {
            rows(range, nx, ny, |row| {
                for next in &mut starts[row] {
                    lists[*next as usize] = element as u32;
                    *next += 1;
                }
            });
        }
        // Each cursor is now at the start of the next cell's list.
        starts.copy_within(0..cells, 1);
        starts[0] = 0;
    }

    fn mark(&mut self, outlines: &[Outline<T>]) {
        self.any_tangled = false;
        let [nx, ny, _] = self.cells.map(|n| n as usize);
        let starts = &mut self.starts;
        for (outline, range) in outlines.iter().zip(&self.ranges) {
            if outline.kind == Kind::Inverted {
                self.any_tangled = true;
                rows(range, nx, ny, |row| {
                    starts[row].iter_mut().for_each(|start| *start |= TANGLED);
                });
            }
        }
    }
}

fn cell_capacity(elements: usize) -> usize {
    CELL_CAPACITY_PER_ELEMENT * elements + 64
}

fn entry_capacity(elements: usize) -> usize {
    ENTRIES_PER_ELEMENT * elements
}

fn size([low, high]: &[[u32; 3]; 2]) -> usize {
    (0..3)
        .map(|axis| (high[axis] + 1).saturating_sub(low[axis]) as usize)
        .product()
}

/// Visits the runs of consecutive cells in a range of cells.
#[inline(always)]
fn rows([low, high]: &[[u32; 3]; 2], nx: usize, ny: usize, mut each: impl FnMut(std::ops::Range<usize>)) {
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            let row = nx * (j as usize + ny * k as usize);
            each(row + low[0] as usize..row + high[0] as usize + 1);
        }
    }
}
