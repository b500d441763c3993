//! Compute passes of `shaders/remesh.wgsl`.

use bytemuck::{Pod, Zeroable};

use crate::gpu::{Access, Gpu, GpuError, PassSource, Pipeline};

/// WGSL source of all passes.
pub const SHADER: &str = include_str!("../../shaders/remesh.wgsl");

/// Uniform parameters of a dispatch, shared by all passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Params {
    /// Number of matrix rows.
    pub size: u32,
    /// Number of columns of Y and Z in use.
    pub rank: u32,
    /// Column capacity of Y and Z.
    pub stride: u32,
    /// Index of the first tile of the bank.
    pub first_tile: u32,
    /// Number of tiles in the bank.
    pub tiles: u32,
    /// Number of listed rows.
    pub rows: u32,
    /// Number of listed columns.
    pub columns: u32,
    /// 0 to start a sum, 1 to add to it.
    pub add: u32,
}

/// Declaration of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Declared {
    /// Entry point in the shader.
    pub entry: &'static str,
    /// Access modes of the buffers at bindings 1, 2, ...
    pub storage: &'static [Access],
    /// Invocations per workgroup.
    #[cfg_attr(
        not(feature = "internals"),
        expect(dead_code, reason = "compared with the shader by tests")
    )]
    pub workgroup: u32,
}

const R: Access = Access::Read;
const W: Access = Access::Write;

const fn declared(entry: &'static str, storage: &'static [Access], workgroup: u32) -> Declared {
    Declared {
        entry,
        storage,
        workgroup,
    }
}

/// Pass that copies the listed columns of a bank to Y.
pub const TAKE: Declared = declared("take", &[R, R, W], 128);
/// Pass that copies the entries of a bank at the listed rows and columns to a small block.
pub const ENTRIES: Declared = declared("entries", &[R, R, W], 64);
/// Pass that computes Z = Y C.
pub const PRODUCT: Declared = declared("product", &[R, R, W], 128);
/// Pass that subtracts Y Z^T from a bank.
pub const UPDATE_ALL: Declared = declared("update_all", &[W, R, R], 256);
/// Pass that subtracts Y Z^T from the listed rows and columns of a bank.
pub const UPDATE_ROWS: Declared = declared("update_rows", &[W, R, R, R], 128);
/// Pass that computes a weighted sum of the columns of Y.
pub const COMBINE: Declared = declared("combine", &[R, R, W], 128);
/// Pass that multiplies a bank by a vector.
pub const MULTIPLY: Declared = declared("multiply", &[R, R, W], 128);

/// Declarations of all passes.
#[cfg(feature = "internals")]
pub const ALL: [Declared; 7] = [TAKE, ENTRIES, PRODUCT, UPDATE_ALL, UPDATE_ROWS, COMBINE, MULTIPLY];

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
