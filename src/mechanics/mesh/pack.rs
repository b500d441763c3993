//! Packing of two locators into the buffers of `shaders/warp.wgsl`.
//!
//! The arrays of the reference locator come first in each buffer, followed by those of the deformed one, each at a place
//! that does not depend on the other's size: a frame rewrites only the data of the state that moved. The parameter block
//! contains the start of each.

use bytemuck::{Pod, Zeroable};

use super::TetMesh;
use super::grid::CellGrid;
use super::locator::Locator;
use super::map::States;

/// Parameters of one grid in the shader's parameter block.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GridParams {
    /// Corner of cell (0, 0, 0), mm.
    pub origin: [f32; 3],
    /// Cells per mm.
    pub per_mm: f32,
    /// Lowest coordinates that any element reaches, mm.
    pub low: [f32; 3],
    /// Start of this grid's cell starts in their buffer.
    pub starts_at: u32,
    /// Highest coordinates that any element reaches, mm.
    pub high: [f32; 3],
    /// Start of this grid's element lists in their buffer; cell starts count from here.
    pub lists_at: u32,
    /// Number of cells along each axis.
    pub cells: [u32; 3],
    /// Start of the element frames in their buffer, in vec4.
    pub frames_at: u32,
}

/// Parameter block of `shaders/warp.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct WarpParams {
    /// Number of scanlines of one plane.
    pub lines: u32,
    /// Number of samples along a scanline.
    pub samples: u32,
    /// Number of planes across the elevation (1 unless the slice has a thickness).
    pub planes: u32,
    /// Number of elements of the mesh.
    pub elements: u32,
    /// Start of the world-to-reference maps of the deformed elements in the buffer of frames, in vec4.
    pub carries_at: u32,
    /// 1 where the deformed mesh has inverted elements, else 0.
    pub tangled: u32,
    /// Unused padding.
    pub padding: [u32; 2],
    /// Grid over the deformed mesh.
    pub deformed: GridParams,
    /// Grid over the reference mesh.
    pub reference: GridParams,
}

/// Buffers of the shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WarpBuffer {
    /// Four vec4 per element from world to barycentric coordinates (reference, then deformed), then three vec4 per deformed
    /// element from world to reference.
    Frames,
    /// Neighbours of each element across the faces opposite its corners.
    Neighbours,
    /// Cell starts of the reference grid, and those of the deformed one.
    Starts,
    /// Element lists of the reference grid, and those of the deformed one.
    Lists,
}

/// A part of a buffer's contents.
#[derive(Clone, Copy, Debug)]
pub struct Piece<'a> {
    /// Buffer that contains the piece.
    pub buffer: WarpBuffer,
    /// Offset of the piece in the buffer, bytes; a multiple of 4.
    pub at: u64,
    /// Contents of the piece.
    pub bytes: &'a [u8],
}

/// Maximum size of each buffer, in its own items, for any node positions of either state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WarpCapacities {
    /// Capacity of [`WarpBuffer::Frames`], in items of 16 bytes.
    pub frames: usize,
    /// Capacity of [`WarpBuffer::Neighbours`], in items of 16 bytes.
    pub neighbours: usize,
    /// Capacity of [`WarpBuffer::Starts`], in items of 4 bytes.
    pub starts: usize,
    /// Capacity of [`WarpBuffer::Lists`], in items of 4 bytes.
    pub lists: usize,
}

impl WarpCapacities {
    /// Returns the capacities for a mesh.
    pub fn of(mesh: &TetMesh) -> WarpCapacities {
        let count = mesh.elements().len();
        let (starts, lists) = CellGrid::<f32>::capacities(count);
        WarpCapacities {
            frames: 11 * count,
            neighbours: count,
            starts: 2 * starts,
            lists: 2 * lists,
        }
    }
}

/// Returns the parameter block of a mesh in its two states; the caller sets `lines`, `samples` and `planes`.
pub fn params(states: &States<f32>) -> WarpParams {
    let (deformed, reference) = (states.deformed(), states.reference());
    let places = Places::of(deformed);
    WarpParams {
        lines: 1,
        samples: 1,
        planes: 1,
        elements: deformed.elements.len() as u32,
        carries_at: places.carries as u32,
        tangled: u32::from(deformed.grid.any_tangled),
        padding: [0; 2],
        deformed: grid(&deformed.grid, &places),
        reference: grid(&reference.grid, &Places::default()),
    }
}

/// Returns the data that never changes.
pub fn topology(states: &States<f32>) -> Piece<'_> {
    piece(WarpBuffer::Neighbours, 0, &states.deformed().neighbours)
}

/// Returns the data that changes with the reference state, in addition to [`deformed`].
pub fn reference(states: &States<f32>) -> [Piece<'_>; 3] {
    located(states.reference(), &Places::default())
}

/// Returns the data that changes with either state.
pub fn deformed(states: &States<f32>) -> [Piece<'_>; 4] {
    let locator = states.deformed();
    let places = Places::of(locator);
    let [frames, starts, lists] = located(locator, &places);
    let carries = piece(WarpBuffer::Frames, places.carries, &locator.carries);
    [frames, starts, lists, carries]
}

/// Starts of the arrays of a locator, in items of their buffers; by default those of the reference locator, which come
/// first.
#[derive(Default)]
struct Places {
    frames: usize,
    starts: usize,
    lists: usize,
    carries: usize,
}

impl Places {
    /// Returns the starts of the deformed locator: after the capacity of the reference one.
    fn of(deformed: &Locator<f32>) -> Self {
        let count = deformed.elements.len();
        let (starts, lists) = CellGrid::<f32>::capacities(count);
        Self {
            frames: 4 * count,
            starts,
            lists,
            carries: 8 * count,
        }
    }
}

fn located<'a>(locator: &'a Locator<f32>, at: &Places) -> [Piece<'a>; 3] {
    [
        piece(WarpBuffer::Frames, at.frames, &locator.frames),
        piece(WarpBuffer::Starts, at.starts, &locator.grid.starts),
        piece(WarpBuffer::Lists, at.lists, &locator.grid.lists),
    ]
}

fn piece<V: Pod>(buffer: WarpBuffer, at: usize, values: &[V]) -> Piece<'_> {
    let item = match buffer {
        WarpBuffer::Frames | WarpBuffer::Neighbours => 16,
        WarpBuffer::Starts | WarpBuffer::Lists => 4,
    };
    Piece {
        buffer,
        at: at as u64 * item,
        bytes: bytemuck::cast_slice(values),
    }
}

fn grid(grid: &CellGrid<f32>, at: &Places) -> GridParams {
    GridParams {
        origin: grid.origin,
        per_mm: grid.per_mm,
        low: finite(grid.low),
        starts_at: at.starts as u32,
        high: finite(grid.high),
        lists_at: at.lists as u32,
        cells: grid.cells,
        frames_at: at.frames as u32,
    }
}

/// Clamps to finite numbers: shaders may evaluate infinities arbitrarily, and the bounds of a mesh without a single sound
/// element contain them.
fn finite(corner: [f32; 3]) -> [f32; 3] {
    corner.map(|x| x.clamp(f32::MIN, f32::MAX))
}

#[cfg(test)]
mod tests;
