//! The passes of `shaders/remesh.wgsl`.

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Access, Gpu, GpuError, PassSource, Pipeline};

/// The shader.
pub const SHADER: &str = include_str!("../../shaders/remesh.wgsl");

/// Parameters of a dispatch: the uniform block of all passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Params {
    /// Rows of the matrix.
    pub size: u32,
    /// Columns of Y and Z in use.
    pub rank: u32,
    /// Columns of Y and Z that there is room for.
    pub stride: u32,
    /// First tile of the bank.
    pub first_tile: u32,
    /// Tiles of the bank.
    pub tiles: u32,
    /// Rows on the list.
    pub rows: u32,
    /// Columns on the list.
    pub columns: u32,
    /// Whether a sum begins (0) or goes on (1).
    pub add: u32,
}

/// A pass as it is declared.
#[derive(Clone, Copy, Debug)]
pub struct Declared {
    /// Its entry point.
    pub entry: &'static str,
    /// Access of the buffers at bindings 1, 2, ...
    pub storage: &'static [Access],
    /// Invocations of a workgroup.
    pub workgroup: u32,
}

const R: Access = Access::Read;
const W: Access = Access::ReadWrite;

const fn declared(entry: &'static str, storage: &'static [Access], workgroup: u32) -> Declared {
    Declared {
        entry,
        storage,
        workgroup,
    }
}

/// Columns of a bank, by the list, to Y.
pub const TAKE: Declared = declared("take", &[R, R, W], 128);
/// Entries of a bank, by the lists, to a small block.
pub const ENTRIES: Declared = declared("entries", &[R, R, W], 64);
/// Y and C to Z.
pub const PRODUCT: Declared = declared("product", &[R, R, W], 128);
/// A bank less Y Z^T.
pub const UPDATE_ALL: Declared = declared("update_all", &[W, R, R], 256);
/// The same in the rows and columns of the list.
pub const UPDATE_ROWS: Declared = declared("update_rows", &[W, R, R, R], 128);
/// Y and weights to a vector.
pub const COMBINE: Declared = declared("combine", &[R, R, W], 128);
/// A bank and a vector to a vector.
pub const MULTIPLY: Declared = declared("multiply", &[R, R, W], 128);

/// All of them.
pub const ALL: [Declared; 7] = [TAKE, ENTRIES, PRODUCT, UPDATE_ALL, UPDATE_ROWS, COMBINE, MULTIPLY];

/// The compiled passes.
#[derive(Debug)]
pub(super) struct Passes {
    pub take: Pipeline,
    pub entries: Pipeline,
    pub product: Pipeline,
    pub update_all: Pipeline,
    pub update_rows: Pipeline,
    pub combine: Pipeline,
    pub multiply: Pipeline,
}

impl Passes {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let compiled = |pass: Declared| {
            let source = PassSource {
                label: pass.entry,
                source: SHADER,
                entry: pass.entry,
                storage: pass.storage,
                constants: &[],
            };
            Pipeline::new(gpu, &source)
        };
        Ok(Passes {
            take: compiled(TAKE)?,
            entries: compiled(ENTRIES)?,
            product: compiled(PRODUCT)?,
            update_all: compiled(UPDATE_ALL)?,
            update_rows: compiled(UPDATE_ROWS)?,
            combine: compiled(COMBINE)?,
            multiply: compiled(MULTIPLY)?,
        })
    }
}
