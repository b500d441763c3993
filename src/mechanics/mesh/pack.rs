//! Two locators as the buffers of `shaders/warp.wgsl`.
//!
//! The arrays of the reference locator come first in each buffer and those of the deformed one behind them, each at a place
//! of its own whatever the other holds: a frame rewrites what belongs to the state that moved. The parameter block says where each
//! begins.

use bytemuck::{Pod, Zeroable};

use super::TetMesh;
use super::grid::CellGrid;
use super::locator::Locator;
use super::map::States;

/// One grid in the shader's parameter block.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GridParams {
    /// Corner of cell (0, 0, 0), mm.
    pub origin: [f32; 3],
    /// Cells per mm.
    pub per_mm: f32,
    /// Lowest coordinates that any element reaches, mm.
    pub low: [f32; 3],
    /// Where this grid's cell starts begin in their buffer.
    pub starts_at: u32,
    /// Highest coordinates that any element reaches, mm.
    pub high: [f32; 3],
    /// Where this grid's element lists begin in their buffer; cell starts count from here.
    pub lists_at: u32,
    /// Cells along each axis.
    pub cells: [u32; 3],
    /// Where the element frames begin in their buffer, in vec4.
    pub frames_at: u32,
}

/// The parameter block of `shaders/warp.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct WarpParams {
    /// Scanlines of one plane.
    pub lines: u32,
    /// Samples along a scanline.
    pub samples: u32,
    /// Planes across the elevation (1 unless the slice has a thickness).
    pub planes: u32,
    /// Elements of the mesh.
    pub elements: u32,
    /// Where the world-to-reference maps of the deformed elements begin in the buffer of frames, in vec4.
    pub carries_at: u32,
    /// 1 where the deformed mesh has inverted elements, else 0.
    pub tangled: u32,
    /// Not read.
    pub padding: [u32; 2],
    /// The grid over the deformed mesh.
    pub deformed: GridParams,
    /// The grid over the reference mesh.
    pub reference: GridParams,
}

/// A buffer of the shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WarpBuffer {
    /// Per element four vec4 from world to barycentric coordinates (reference, then deformed), then per deformed element
    /// three vec4 from world to reference.
    Frames,
    /// Per element the neighbours across the faces opposite its corners.
    Neighbours,
    /// Cell starts of the reference grid, and those of the deformed one.
    Starts,
    /// Element lists of the reference grid, and those of the deformed one.
    Lists,
}

/// A part of a buffer's contents.
#[derive(Clone, Copy, Debug)]
pub struct Piece<'a> {
    /// Which buffer.
    pub buffer: WarpBuffer,
    /// Where in it the piece begins, in bytes; a multiple of 4.
    pub at: u64,
    /// What stands there.
    pub bytes: &'a [u8],
}

/// The most that each buffer can come to hold, in its own items, wherever the nodes of either state are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WarpCapacities {
    /// Of [`WarpBuffer::Frames`] (16 bytes each).
    pub frames: usize,
    /// Of [`WarpBuffer::Neighbours`] (16 bytes each).
    pub neighbours: usize,
    /// Of [`WarpBuffer::Starts`] (4 bytes each).
    pub starts: usize,
    /// Of [`WarpBuffer::Lists`] (4 bytes each).
    pub lists: usize,
}

impl WarpCapacities {
    /// The capacities of a mesh.
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

/// The parameter block of a mesh in its two states; `lines`, `samples` and `planes` are the caller's to set.
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

/// What never changes.
pub fn topology(states: &States<f32>) -> Piece<'_> {
    piece(WarpBuffer::Neighbours, 0, &states.deformed().neighbours)
}

/// What changes with the reference state, beside [`deformed`].
pub fn reference(states: &States<f32>) -> [Piece<'_>; 3] {
    located(states.reference(), &Places::default())
}

/// What changes with either state.
pub fn deformed(states: &States<f32>) -> [Piece<'_>; 4] {
    let locator = states.deformed();
    let places = Places::of(locator);
    let [frames, starts, lists] = located(locator, &places);
    let carries = piece(WarpBuffer::Frames, places.carries, &locator.carries);
    [frames, starts, lists, carries]
}

/// Where the arrays of a locator begin, in items of their buffers; by default those of the reference one, which come first.
#[derive(Default)]
struct Places {
    frames: usize,
    starts: usize,
    lists: usize,
    carries: usize,
}

impl Places {
    /// Those of the deformed locator: behind all that the reference one can come to hold.
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

/// Shaders may take infinities for anything; the bounds of a mesh without a single sound element hold them.
fn finite(corner: [f32; 3]) -> [f32; 3] {
    corner.map(|x| x.clamp(f32::MIN, f32::MAX))
}

#[cfg(test)]
mod tests;
