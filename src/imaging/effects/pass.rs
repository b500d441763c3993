//! Declaration of a pass: one step of a frame, on both backends.

use bytemuck::Pod;

use super::buffers::Buffer;
use crate::synth::slab::Slab;
use crate::synth::store::Store;
use crate::synth::{FrameState, tables::Tables};
#[cfg(test)]
use insonify_testing::lossy::Lossy;

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

/// Parameters of a shader, with members at the offsets that WGSL gives them: see [`block`].
pub(crate) trait Block: Pod {
    /// Names of the members, and their offsets in bytes.
    const MEMBERS: &'static [(&'static str, usize)];
}

/// Declares a [`Block`].
macro_rules! block {
    ($(#[$doc:meta])* $visible:vis struct $name:ident { $($(#[$of:meta])* $seen:vis $member:ident: $kind:ty,)+ }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
        $visible struct $name {
            $($(#[$of])* $seen $member: $kind,)+
        }

        impl crate::effects::pass::Block for $name {
            const MEMBERS: &'static [(&'static str, usize)] = &[$((stringify!($member), std::mem::offset_of!($name, $member))),+];
        }
    };
}
pub(crate) use block;

/// Parameter block of a pass: binding 0, at most 256 bytes.
#[derive(Clone, Copy, Debug)]
pub struct ParamBlock {
    /// Size of the struct, bytes.
    pub size: usize,
    /// Names of its members, and their offsets in bytes.
    pub members: &'static [(&'static str, usize)],
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "shaders alone read it"))]
    bytes: [u8; Self::CAPACITY],
}

impl ParamBlock {
    /// Capacity of a block, bytes; also the alignment of the blocks' offsets in WebGPU's default limits.
    pub(crate) const CAPACITY: usize = 256;

    /// Copies a parameter struct.
    pub(crate) fn of<P: Block>(params: &P) -> Self {
        const { assert!(size_of::<P>() <= Self::CAPACITY && size_of::<P>().is_multiple_of(16)) };
        let mut bytes = [0; Self::CAPACITY];
        let source = bytemuck::bytes_of(params);
        bytes[..source.len()].copy_from_slice(source);
        Self {
            size: size_of::<P>(),
            members: P::MEMBERS,
            bytes,
        }
    }

    /// Parameters as seen by the shader, padded to a full slot.
    #[cfg(feature = "gpu")]
    pub(crate) fn slot(&self) -> &[u8; Self::CAPACITY] {
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

/// Use of a buffer by a pass, and its place: at its own sample or pixel, on its own scanline or row of pixels, or
/// anywhere. Passes are fused by it ([`crate::fusion`]). Where nothing in a frame writes a buffer, it does not matter
/// where it is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Read anywhere.
    Read,
    /// Read on the own scanline.
    ReadLine,
    /// Read at the own sample.
    ReadOwn,
    /// Written, and possibly read, anywhere.
    Write,
    /// Written, and possibly read, on the own scanline.
    WriteLine,
    /// Written, and possibly read, at the own sample.
    WriteOwn,
}

impl Use {
    /// Whether the pass writes the buffer.
    pub fn writes(self) -> bool {
        matches!(self, Self::Write | Self::WriteLine | Self::WriteOwn)
    }
}

/// Domain of the invocations of a pass: a shader gets them by `global_invocation_id`, in groups of 64 along x, or,
/// where a workgroup shares a scanline, 256 of them by `local_invocation_index` and `workgroup_id`.
#[derive(Clone, Copy)]
pub enum Grid {
    /// Samples (x) of the scanlines (y).
    Samples,
    /// Scanlines (y), a workgroup each.
    Scanlines,
    /// Samples of more densely spaced scanlines; gives their number.
    FineSamples(fn(&Tables) -> usize),
    /// Samples of the scanlines of several looks, one after another; gives their number.
    Looks(fn(&Tables) -> usize),
    /// Samples of more densely spaced scanlines of several looks; gives their number.
    FineLooks(fn(&Tables) -> usize),
    /// Pixels (x) of the rows (y) of a band.
    Pixels,
    /// Words of four pixels of the rows of a band.
    Words,
    /// Workgroups of 256 invocations; gives their number along y and z.
    Workgroups(fn(&Tables) -> [u32; 2]),
    /// This many workgroups of 64 invocations, which stride over the work.
    Shared(u32),
}

impl Grid {
    /// Number of workgroups along x, y, z.
    pub fn workgroups(self, tables: &Tables, band: Band) -> [u32; 3] {
        let groups = |count: usize| count.div_ceil(64) as u32;
        let (samples, lines) = (groups(tables.samples()), tables.lines() as u32);
        match self {
            Self::Samples => [samples, lines, 1],
            Self::Scanlines => [1, lines, 1],
            Self::FineSamples(count) | Self::Looks(count) | Self::FineLooks(count) => {
                [samples, count(tables) as u32, 1]
            }
            Self::Pixels => [groups(tables.width()), band.rows, 1],
            Self::Words => [groups(tables.words_per_row()), band.rows, 1],
            Self::Workgroups(count) => {
                let [y, z] = count(tables);
                [1, y, z]
            }
            Self::Shared(count) => [count, 1, 1],
        }
    }
}

/// A step of a frame.
pub struct Pass {
    /// Name, unique over all effects.
    pub name: &'static str,
    /// WGSL source, in which lines `#import NAME` stand for parts that shaders share.
    pub shader: &'static str,
    /// Entry point in the source.
    pub entry: &'static str,
    /// Storage bindings from binding 1 on, in order.
    pub bindings: &'static [(&'static Buffer, Use)],
    /// Parameter block, binding 0, for one band of rows (all rows for passes that are not per pixel).
    pub params: fn(&View, Band) -> ParamBlock,
    /// What its invocations stand for.
    pub grid: Grid,
    /// Whether the executors swap `AMPLITUDE` and `AMPLITUDE_NEXT` after the pass.
    pub flips: bool,
    /// CPU reference.
    pub cpu: Reference,
    /// Bound on the rounding error of a twin, with the feature `analysis`.
    #[cfg_attr(
        not(any(test, feature = "analysis")),
        expect(dead_code, reason = "bounds are part of the analysis")
    )]
    pub(crate) bound: Bound,
}

#[cfg(feature = "gpu")]
impl Pass {
    /// WGSL source with its imports.
    pub fn source(&self) -> String {
        super::imports::with_imports(self.shader)
    }
}

#[cfg(any(test, feature = "analysis"))]
pub(crate) use crate::parity::Bound;
#[cfg(not(any(test, feature = "analysis")))]
type Bound = ();

/// The bound of a pass: a variant of [`Bound`] with its content.
macro_rules! bound {
    ($variant:ident($($content:tt)+)) => {{
        #[cfg(any(test, feature = "analysis"))]
        {
            crate::parity::Bound::$variant($($content)+)
        }
    }};
}
pub(crate) use bound;

/// CPU reference of a pass in each scalar.
pub struct Reference {
    /// In single precision, matching the shader.
    pub single: fn(&View, &mut Store<f32>),
    /// In double precision.
    pub double: fn(&View, &mut Store<f64>),
    /// In the least accurate single precision that WGSL allows.
    #[cfg(test)]
    pub lossy: fn(&View, &mut Store<Lossy>),
}

/// The reference of a pass, from a function that is generic over the scalar.
macro_rules! reference {
    ($($run:ident)::+) => {
        crate::effects::pass::Reference {
            single: $($run)::+::<f32>,
            double: $($run)::+::<f64>,
            #[cfg(test)]
            lossy: $($run)::+::<insonify_testing::lossy::Lossy>,
        }
    };
}
pub(crate) use reference;
