//! Declaration of a pass: one step of a frame, on both backends.

use bytemuck::Pod;

use super::buffers::Buffer;
#[cfg(feature = "internals")]
use crate::base::lossy::Lossy;
pub use crate::gpu::Access;
use crate::imaging::synth::slab::Slab;
use crate::imaging::synth::store::Store;
use crate::imaging::synth::{FrameState, tables::Tables};

/// Inputs of a pass besides its resources.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// Tables fixed until the scene is edited.
    pub tables: &'a Tables,
    /// State of the frame, relative to the local origin.
    pub state: &'a FrameState,
    /// Elements of the mesh in the slab of the frame, on a GPU; `None` on the CPU, whose store has them.
    pub slab: Option<&'a Slab<f32>>,
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
    pub bindings: &'static [(&'static Buffer, Access)],
    /// Parameter block, binding 0, for one band of rows (all rows for passes that are not per pixel).
    pub params: fn(&View, Band) -> ParamBlock,
    /// Number of workgroups along x, y, z.
    pub workgroups: fn(&Tables, Band) -> [u32; 3],
    /// Whether the executors swap `AMPLITUDE` and `AMPLITUDE_NEXT` after the pass.
    pub flips: bool,
    /// CPU reference.
    pub cpu: Reference,
}

/// CPU reference of a pass in each scalar.
pub struct Reference {
    /// In single precision, matching the shader.
    pub single: fn(&View, &mut Store<f32>),
    /// In double precision.
    pub double: fn(&View, &mut Store<f64>),
    /// In the least accurate single precision that WGSL allows.
    #[cfg(feature = "internals")]
    pub lossy: fn(&View, &mut Store<Lossy>),
}

/// The reference of a pass, from a function that is generic over the scalar.
macro_rules! reference {
    ($($run:ident)::+) => {
        crate::imaging::effects::pass::Reference {
            single: $($run)::+::<f32>,
            double: $($run)::+::<f64>,
            #[cfg(feature = "internals")]
            lossy: $($run)::+::<crate::base::lossy::Lossy>,
        }
    };
}
pub(crate) use reference;

/// Number of workgroups of `size` invocations that cover `count`.
pub fn groups(count: usize, size: u32) -> u32 {
    (count as u64).div_ceil(u64::from(size)) as u32
}

/// Workgroups of a pass with 64 samples to a group, over lines and planes.
pub fn per_sample(tables: &Tables, _: Band) -> [u32; 3] {
    [
        groups(tables.samples(), 64),
        tables.lines() as u32,
        tables.planes() as u32,
    ]
}

/// Numbers of workgroups of `size` invocations that cover `count` in one dimension, spread over y past the limit on
/// x.
pub fn spread(count: usize, size: u32) -> [u32; 3] {
    const MOST: u32 = 65_535;
    let groups = groups(count, size);
    [groups.min(MOST), groups.div_ceil(MOST), 1]
}
