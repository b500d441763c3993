//! Two locators as the buffers of `shaders/warp.wgsl`.
//!
//! The arrays of the reference locator, which never change, come first and those of the deformed one behind them, so that a
//! frame rewrites one range of each buffer. The uniform says where each begins.

use bytemuck::{Pod, Zeroable};

use super::TetMesh;
use super::grid::CellGrid;
use super::locator::Locator;

/// One grid in the shader's uniform.
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

/// The uniform of `shaders/warp.wgsl`.
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

/// The contents of the shader's buffers. Refilled frame by frame without allocation.
#[derive(Clone, Debug)]
pub struct WarpBuffers {
    /// The uniform; `lines`, `samples` and `planes` are the caller's to set.
    pub params: WarpParams,
    /// Per element four vec4 from world to barycentric coordinates (reference, then deformed), then per deformed element
    /// three vec4 from world to reference.
    pub frames: Vec<[f32; 4]>,
    /// Per element the neighbours across the faces opposite its corners.
    pub neighbours: Vec<[u32; 4]>,
    /// Cell starts of the reference grid, then of the deformed one.
    pub starts: Vec<u32>,
    /// Element lists of the reference grid, then of the deformed one.
    pub lists: Vec<u32>,
    static_lengths: StaticLengths,
    capacities: WarpCapacities,
}

/// How much of each buffer belongs to the reference locator, in the buffer's own items: what lies before stays as it is from
/// frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StaticLengths {
    /// Of [`WarpBuffers::frames`].
    pub frames: usize,
    /// Of [`WarpBuffers::starts`].
    pub starts: usize,
    /// Of [`WarpBuffers::lists`].
    pub lists: usize,
}

/// The most that each buffer can come to hold, in its own items, whatever the displacements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WarpCapacities {
    /// Of [`WarpBuffers::frames`] (16 bytes each).
    pub frames: usize,
    /// Of [`WarpBuffers::neighbours`] (16 bytes each).
    pub neighbours: usize,
    /// Of [`WarpBuffers::starts`] (4 bytes each).
    pub starts: usize,
    /// Of [`WarpBuffers::lists`] (4 bytes each).
    pub lists: usize,
}

impl WarpCapacities {
    /// The capacities of a mesh.
    pub fn of(mesh: &TetMesh) -> WarpCapacities {
        let locator = Locator::new(mesh);
        WarpBuffers::new(&locator, &locator).capacities
    }
}

impl WarpBuffers {
    /// The buffers of a mesh: `reference` and `deformed` locate in its two states.
    ///
    /// # Panics
    /// If the locators are of meshes with different numbers of elements.
    pub fn new(deformed: &Locator<f32>, reference: &Locator<f32>) -> WarpBuffers {
        let count = reference.elements.len();
        assert_eq!(count, deformed.elements.len(), "two states of one mesh");
        let (starts, lists) = CellGrid::<f32>::capacities(count);
        let capacities = WarpCapacities {
            frames: 11 * count,
            neighbours: count,
            starts: reference.grid.starts.len() + starts,
            lists: reference.grid.lists.len() + lists,
        };
        let mut buffers = WarpBuffers {
            params: WarpParams {
                lines: 1,
                samples: 1,
                planes: 1,
                elements: count as u32,
                ..WarpParams::default()
            },
            frames: Vec::with_capacity(capacities.frames),
            neighbours: reference.neighbours.clone(),
            starts: Vec::with_capacity(capacities.starts),
            lists: Vec::with_capacity(capacities.lists),
            static_lengths: StaticLengths {
                frames: 0,
                starts: 0,
                lists: 0,
            },
            capacities,
        };
        buffers.params.reference = buffers.append(reference);
        buffers.static_lengths = StaticLengths {
            frames: buffers.frames.len(),
            starts: buffers.starts.len(),
            lists: buffers.lists.len(),
        };
        buffers.refill(deformed);
        buffers
    }

    /// Replaces what belongs to the deformed locator after an update of it.
    ///
    /// # Panics
    /// If the locator is of another mesh.
    pub fn refill(&mut self, deformed: &Locator<f32>) {
        assert_eq!(
            deformed.elements.len(),
            self.neighbours.len(),
            "the same mesh as before"
        );
        self.frames.truncate(self.static_lengths.frames);
        self.starts.truncate(self.static_lengths.starts);
        self.lists.truncate(self.static_lengths.lists);
        self.params.deformed = self.append(deformed);
        self.params.carries_at = self.frames.len() as u32;
        self.frames.extend_from_slice(deformed.carries.as_flattened());
        self.params.tangled = u32::from(deformed.grid.any_tangled);
    }

    /// How much of each buffer stays from frame to frame.
    pub fn static_lengths(&self) -> StaticLengths {
        self.static_lengths
    }

    /// How large to make the buffers.
    pub fn capacities(&self) -> WarpCapacities {
        self.capacities
    }

    fn append(&mut self, locator: &Locator<f32>) -> GridParams {
        let grid = &locator.grid;
        let params = GridParams {
            origin: grid.origin,
            per_mm: grid.per_mm,
            low: finite(grid.low),
            starts_at: self.starts.len() as u32,
            high: finite(grid.high),
            lists_at: self.lists.len() as u32,
            cells: grid.cells,
            frames_at: self.frames.len() as u32,
        };
        self.frames.extend_from_slice(locator.frames.as_flattened());
        self.starts.extend_from_slice(&grid.starts);
        self.lists.extend_from_slice(&grid.lists);
        params
    }
}

/// Shaders may take infinities for anything; the bounds of a mesh without a single sound element hold them.
fn finite(corner: [f32; 3]) -> [f32; 3] {
    corner.map(|x| x.clamp(f32::MIN, f32::MAX))
}

#[cfg(test)]
mod tests {
    use naga::front::wgsl;
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;
    use crate::mechanics::mesh::TetMesh;
    use crate::mechanics::mesh::grid::TANGLED;
    use crate::mechanics::mesh::locator::MAX_WALK;

    const SHADER: &str = include_str!("../../../shaders/warp.wgsl");

    #[test]
    fn shader_is_valid_and_its_uniform_has_the_layout_of_the_struct() {
        let module = wgsl::parse_str(SHADER).unwrap_or_else(|e| panic!("{}", e.emit_to_string(SHADER)));
        Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}", e.emit_to_string(SHADER)));
        let members = |name: &str| {
            let (_, ty) = module
                .types
                .iter()
                .find(|(_, ty)| ty.name.as_deref() == Some(name))
                .expect(name);
            match &ty.inner {
                naga::TypeInner::Struct { members, span } => (members.clone(), *span as usize),
                other => panic!("{name} is {other:?}"),
            }
        };
        let (params, span) = members("WarpParams");
        assert_eq!(span, size_of::<WarpParams>());
        let offsets: Vec<usize> = params.iter().map(|m| m.offset as usize).collect();
        use std::mem::offset_of;
        assert_eq!(
            offsets,
            [
                offset_of!(WarpParams, lines),
                offset_of!(WarpParams, samples),
                offset_of!(WarpParams, planes),
                offset_of!(WarpParams, elements),
                offset_of!(WarpParams, carries_at),
                offset_of!(WarpParams, tangled),
                offset_of!(WarpParams, deformed),
                offset_of!(WarpParams, reference),
            ]
        );
        let (grid, span) = members("Grid");
        assert_eq!(span, size_of::<GridParams>());
        let offsets: Vec<usize> = grid.iter().map(|m| m.offset as usize).collect();
        assert_eq!(
            offsets,
            [
                offset_of!(GridParams, origin),
                offset_of!(GridParams, per_mm),
                offset_of!(GridParams, low),
                offset_of!(GridParams, starts_at),
                offset_of!(GridParams, high),
                offset_of!(GridParams, lists_at),
                offset_of!(GridParams, cells),
                offset_of!(GridParams, frames_at),
            ]
        );
    }

    #[test]
    fn shader_uses_the_constants_of_the_locator() {
        for line in [
            format!("const TANGLED: u32 = 0x{TANGLED:x}u;"),
            format!("const MAX_WALK: u32 = {MAX_WALK}u;"),
            format!("const MAPPED: f32 = {:.1};", super::super::map::MAPPED as f32),
            format!("const BACKGROUND: f32 = {:.1};", super::super::map::BACKGROUND as f32),
            format!("const FOLDED: f32 = {:.1};", super::super::map::FOLDED as f32),
            format!("const OUTSIDE: f32 = {:.1};", super::super::map::OUTSIDE as f32),
        ] {
            assert!(SHADER.lines().any(|l| l == line), "warp.wgsl lacks `{line}`");
        }
    }

    #[test]
    fn refilling_moves_only_what_is_deformed_and_stays_within_capacity() {
        let mesh = TetMesh::over_box([0.0; 3], [10.0; 3], 200).unwrap();
        let reference = Locator::<f32>::new(&mesh);
        let mut deformed = reference.clone();
        let mut buffers = WarpBuffers::new(&deformed, &reference);
        let before = buffers.clone();
        let capacity = (
            buffers.frames.capacity(),
            buffers.starts.capacity(),
            buffers.lists.capacity(),
        );
        let moved: Vec<[f64; 3]> = mesh
            .nodes()
            .iter()
            .map(|n| [n[0] * 1.7 - n[1], n[1] * 0.2, n[2] + 500.0])
            .collect();
        deformed.update(&moved).unwrap();
        buffers.refill(&deformed);
        let fixed = buffers.static_lengths();
        assert_eq!(buffers.frames[..fixed.frames], before.frames[..fixed.frames]);
        assert_eq!(buffers.lists[..fixed.lists], before.lists[..fixed.lists]);
        assert_eq!(buffers.starts[..fixed.starts], before.starts[..fixed.starts]);
        assert_ne!(buffers.frames[fixed.frames..], before.frames[fixed.frames..]);
        assert_eq!(
            capacity,
            (
                buffers.frames.capacity(),
                buffers.starts.capacity(),
                buffers.lists.capacity()
            )
        );
        assert!(buffers.lists.len() <= buffers.capacities().lists);
        assert!(buffers.starts.len() <= buffers.capacities().starts);
        assert_eq!(buffers.frames.len(), buffers.capacities().frames);
    }
}
