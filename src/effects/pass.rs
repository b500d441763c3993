//! Declaration of a pass: one step of a frame, on both backends.

use bytemuck::Pod;

use crate::mechanics::mesh::pack::WarpParams;
use crate::synth::store::Store;
use crate::synth::{FrameState, tables::Tables};

/// Inputs of a pass besides its resources.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// Tables fixed until the scene is edited.
    pub tables: &'a Tables,
    /// State of the frame, relative to the local origin.
    pub state: &'a FrameState,
    /// Search grids of the mesh as packed for the GPU; `None` on the CPU.
    pub warp: Option<&'a WarpParams>,
}

/// A buffer shared by passes. On the CPU it is a vector of [`Store`] or a table; on the GPU a storage buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Resource {
    /// Per scanline: origin and direction in the probe plane (`vec4<f32>`).
    Rays,
    /// Per scanline and sub-plane: gap between array and body, mm (`f32`).
    Gaps,
    /// Per sample and sub-plane: current, then reference position, relative to the local origin, and a flag
    /// (`vec4<f32>`).
    Position,
    /// Per sample and sub-plane: element that contained it in the last frame (`u32`).
    Element,
    /// Affine maps of the deformed and reference elements (`vec4<f32>`).
    ElementMaps,
    /// Neighbours of the elements through their faces (`vec4<u32>`).
    Adjacency,
    /// Starts of the cells of the search grids (`u32`).
    CellStarts,
    /// Elements of the cells of the search grids (`u32`).
    CellElements,
    /// Label indices of the volume, four to a `u32`.
    Voxels,
    /// Per label index: echo, attenuation, texture, impedance.
    LabelRows,
    /// Placement of the solid textures in the atlas.
    TextureEntries,
    /// Voxels of the solid textures (`f32`).
    TextureAtlas,
    /// Per sample and sub-plane: label index (`u32`).
    Label,
    /// Per sample (and sub-plane, up to `thickness`): echo amplitude; after `tone`, grey level (`f32`).
    Amplitude,
    /// Second buffer of the pair that `Amplitude` is swapped with (`f32`).
    AmplitudeNext,
    /// Per sample: complex echo of surfaces and needles, before the point spread (`vec2<f32>`).
    Specular,
    /// Per fine scanline and sample: complex echo (`vec2<f32>`).
    Scatter,
    /// Complex echo after the axial point spread (`vec2<f32>`).
    ScatterAxial,
    /// Weights of the axial point spread, then two factors per sample (`f32`).
    AxialKernel,
    /// Weights of the lateral point spread, one row per depth (`f32`).
    LateralKernel,
    /// Weights of the radial blur, one row per depth (`f32`).
    BlurKernel,
    /// Weights of the beam used for shadows, one row per depth (`f32`).
    PenumbraKernel,
    /// Segments of needle and seeds in the probe frame (`vec4<f32>` pairs).
    Needle,
    /// Per sample: fractions of the scan plane's thickness and of the beam filled by needle and seeds
    /// (`vec2<f32>`).
    NeedleMask,
    /// Per sample: two-way loss down to it, in units of [`super::shadow::UNITS_PER_DB`] (`u32`).
    Loss,
    /// Per off-centre ray of the aperture and sample depth: scanlines between a point and the ray's element (`u32`).
    ApertureShifts,
    /// Per ray, element and sample: one-way transmittance of the occluders on it (`f32`).
    Through,
    /// Per scanline: sample of the first opaque tissue, or the number of samples (`u32`).
    Reflectors,
    /// Per sample: power of acoustic clutter and ring-down (`f32`).
    Clutter,
    /// Per sample depth: linear gain (`f32`).
    Gain,
    /// Per band of depth: automatic gain, octaves (`f32`).
    AutoGain,
    /// Per pixel: scanline and sample coordinates, or -1 (`vec2<f32>`).
    ScanMap,
    /// Per pixel: grey level (`f32`).
    Image,
    /// Per pixel: grey level, four to a `u32`.
    Pixels,
}

impl Resource {
    /// Whether its size is proportional to the pixels of the image, so that a large one is processed in bands of
    /// rows.
    pub fn is_per_pixel(self) -> bool {
        matches!(self, Self::ScanMap | Self::Image | Self::Pixels)
    }
}

/// Access of a pass to a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read only.
    Read,
    /// Written, and possibly read.
    Write,
}

/// Parameter block of a pass: binding 0, at most 256 bytes.
#[derive(Clone, Copy, Debug)]
pub struct ParamBlock {
    bytes: [u8; Self::CAPACITY],
}

impl ParamBlock {
    /// Capacity of a block, bytes; also the alignment of the blocks' offsets in WebGPU's default limits.
    pub const CAPACITY: usize = 256;

    /// Copies a parameter struct.
    pub fn of<P: Pod>(params: &P) -> Self {
        const { assert!(size_of::<P>() <= Self::CAPACITY && size_of::<P>().is_multiple_of(16)) };
        let mut bytes = [0; Self::CAPACITY];
        let source = bytemuck::bytes_of(params);
        bytes[..source.len()].copy_from_slice(source);
        Self { bytes }
    }

    /// Parameters as seen by the shader, padded to a full slot.
    pub fn slot(&self) -> &[u8; Self::CAPACITY] {
        &self.bytes
    }
}

/// Rows of an image covered by one dispatch of a per-pixel pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Band {
    /// First row.
    pub first_row: u32,
    /// Number of rows.
    pub rows: u32,
}

/// A step of a frame.
pub struct Pass {
    /// Name, unique over all effects.
    pub name: &'static str,
    /// WGSL source, common parts included.
    pub shader: &'static str,
    /// Entry point in the source.
    pub entry: &'static str,
    /// Storage bindings from binding 1 on, in order.
    pub bindings: &'static [(Resource, Access)],
    /// Parameter block, binding 0, for one band of rows (all rows for passes that are not per pixel).
    pub params: fn(&View, Band) -> ParamBlock,
    /// Number of workgroups along x, y, z.
    pub workgroups: fn(&Tables, Band) -> [u32; 3],
    /// Whether `AmplitudeNext` becomes `Amplitude` after the pass.
    pub flips: bool,
    /// CPU reference in single precision, matching the shader.
    pub cpu: fn(&View, &mut Store<f32>),
    /// CPU reference in double precision.
    pub cpu_f64: fn(&View, &mut Store<f64>),
}

/// Number of workgroups of `size` invocations that cover `count`.
pub fn groups(count: usize, size: u32) -> u32 {
    (count as u64).div_ceil(u64::from(size)) as u32
}

/// Numbers of workgroups of `size` invocations that cover `count` in one dimension, spread over y past the limit on
/// x.
pub fn spread(count: usize, size: u32) -> [u32; 3] {
    const MOST: u32 = 65_535;
    let groups = groups(count, size);
    [groups.min(MOST), groups.div_ceil(MOST), 1]
}
