//! Lower triangle of a symmetric matrix in square tiles on a GPU.
//!
//! A row panel of [`Symmetric`] is a row of tiles in the same layout, so it is sent without conversion. Tiles are
//! numbered row by row and spread over buffers ("banks"), none larger than a pass can bind.

use bytemuck::{Pod, Zeroable};

use crate::tissue::symmetric::{PANEL_ROWS, Panel, Symmetric};
use insonify_gpu::{Access, Gpu, GpuError, Loops, PassSource, Pipeline, Recorder, StorageBuffer};

/// Rows and columns of a tile; must equal the shader's constant.
pub const SIDE: usize = PANEL_ROWS;
const TILE: usize = SIDE * SIDE;
const TILE_BYTES: u64 = (TILE * size_of::<f32>()) as u64;

/// Number of tiles in the first `rows` rows of tiles.
fn tiles_of(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

/// Device memory of a matrix of `size` rows, bytes.
pub fn bytes_of(size: usize) -> u64 {
    tiles_of(size.div_ceil(SIDE)) as u64 * TILE_BYTES
}

/// Consecutive tiles in one buffer.
#[derive(Debug)]
pub(crate) struct Bank {
    /// Buffer of the tiles.
    pub buffer: StorageBuffer,
    /// Index of the first tile.
    pub first: usize,
    /// Number of tiles.
    pub tiles: usize,
}

/// Symmetric matrix on a device.
#[derive(Debug)]
pub(crate) struct Tiles {
    /// Banks in the order of their tiles.
    pub banks: Vec<Bank>,
}

impl Tiles {
    /// Allocates a matrix of `size` rows in banks of at most `bank_bytes`.
    ///
    /// # Errors
    /// [`GpuError::Limit`] where not even one tile fits into a bank; [`GpuError::OutOfMemory`].
    pub(crate) fn new(gpu: &Gpu, size: usize, bank_bytes: u64) -> Result<Self, GpuError> {
        let count = tiles_of(size.div_ceil(SIDE));
        // A dispatch has one workgroup per tile of a bank.
        let max_tiles = (bank_bytes / TILE_BYTES).min(u64::from(gpu.limits().max_compute_workgroups_per_dimension));
        if max_tiles == 0 {
            return Err(GpuError::Limit {
                what: "a tile of the inverse".to_owned(),
                limit: "max_storage_buffer_binding_size",
                needed: TILE_BYTES,
                available: bank_bytes,
            });
        }
        let max_tiles = max_tiles as usize;
        let banks = (0..count).step_by(max_tiles).map(|first| {
            let tiles = max_tiles.min(count - first);
            let label = format!("tiles {first} to {} of the inverse", first + tiles - 1);
            Ok(Bank {
                buffer: StorageBuffer::zeroed(gpu, &label, tiles as u64 * TILE_BYTES)?,
                first,
                tiles,
            })
        });
        Ok(Tiles {
            banks: banks.collect::<Result<_, GpuError>>()?,
        })
    }

    /// Uploads a matrix of the allocated size.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails.
    pub(crate) fn send(&self, gpu: &Gpu, matrix: &Symmetric<f32>) -> Result<(), GpuError> {
        let mut values = Vec::new();
        for (row, panel) in matrix.row_panels().enumerate() {
            pack(&panel, &mut values);
            let (from, to) = (tiles_of(row), tiles_of(row + 1));
            for bank in &self.banks {
                let start = bank.first.max(from);
                let end = (bank.first + bank.tiles).min(to);
                if start < end {
                    let part = &values[(start - from) * TILE..((end - from) * TILE).min(values.len())];
                    bank.buffer.write(gpu, (start - bank.first) as u64 * TILE_BYTES, part)?;
                }
            }
            // Written data stays in driver memory until something is submitted.
            gpu.submit("sending the inverse", |_| Ok(()))?;
        }
        gpu.wait("sending the inverse")
    }

    /// Copies all banks to a matrix of the same size in the same banks.
    pub(crate) fn copy_to(&self, other: &Tiles, recorder: &mut Recorder<'_>) {
        for (from, to) in self.banks.iter().zip(&other.banks) {
            let (source, target) = (from.buffer.raw(), to.buffer.raw());
            recorder
                .encoder()
                .copy_buffer_to_buffer(source, 0, target, 0, from.buffer.bytes());
        }
    }

    /// Total size of all banks, bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.banks.iter().map(|bank| bank.buffer.bytes()).sum()
    }
}

/// Copies the values of a panel, with zeros in the rows beyond its last.
fn pack(panel: &Panel<'_, f32>, values: &mut Vec<f32>) {
    values.clear();
    for column in panel.columns {
        values.extend_from_slice(&column.0[..panel.rows]);
        values.resize(values.len().next_multiple_of(SIDE), 0.0);
    }
}

// Compute passes of `shaders/remesh.wgsl` and `shaders/remesh_capacitance.wgsl`.

/// WGSL source of all passes but `CAPACITANCE`.
pub const SHADER: &str = include_str!("../../../shaders/remesh.wgsl");
/// WGSL source of all passes, for devices with f64.
pub const SHADER_F64: &str = concat!(
    include_str!("../../../shaders/remesh.wgsl"),
    include_str!("../../../shaders/remesh_capacitance.wgsl")
);
/// Largest rank of a change whose capacitance matrix a device inverts; must equal the shader's constant.
pub const MAX_RANK: usize = 128;

/// Uniform parameters of a dispatch, shared by all passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TileParams {
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
    /// Place of the first listed row.
    pub rows_from: u32,
    /// Place of the first listed column.
    pub columns_from: u32,
    /// 0 to start a sum, 1 to add to it.
    pub add: u32,
    /// Smallest reciprocal condition of I + dK G.
    pub limit: f32,
}

/// Declaration of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Declared {
    /// Entry point in the shader.
    pub entry: &'static str,
    /// Access modes of the buffers at bindings 1, 2, ...
    pub storage: &'static [Access],
    /// Invocations per workgroup.
    pub workgroup: u32,
}

/// Every loop of these shaders counts towards a bound that does not change within it, or narrows an interval of
/// integers.
#[allow(unsafe_code, reason = "says that loops end")]
// SAFETY: as above.
const LOOPS: Loops = unsafe { Loops::ending() };

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
pub(crate) const TAKE: Declared = declared("take", &[R, R, W], 128);
/// Pass that copies the entries of a bank at the listed rows and columns, less those of Y Z^T, to a small block.
pub(crate) const ENTRIES: Declared = declared("entries", &[R, R, W, R, R], 64);
/// Pass that computes Z = Y C.
pub(crate) const PRODUCT: Declared = declared("product", &[R, R, W], 128);
/// Pass that subtracts Y Z^T from a bank.
pub(crate) const UPDATE_ALL: Declared = declared("update_all", &[W, R, R], 256);
/// Pass that subtracts Y Z^T from the listed rows and columns of a bank.
pub(crate) const UPDATE_ROWS: Declared = declared("update_rows", &[W, R, R, R], 128);
/// Pass that computes a weighted sum of the columns of Y.
pub(crate) const COMBINE: Declared = declared("combine", &[R, R, W], 128);
/// Pass that multiplies a bank by a vector.
pub(crate) const MULTIPLY: Declared = declared("multiply", &[R, R, W], 128);

/// Pass that computes C = (I + dK G)^-1 dK in f64 and the reciprocal condition of I + dK G.
pub(crate) const CAPACITANCE: Declared = declared("capacitance", &[R, R, R, W, W, W], 256);

/// Declarations of all passes.
pub const ALL: [Declared; 8] = [
    TAKE,
    ENTRIES,
    PRODUCT,
    UPDATE_ALL,
    UPDATE_ROWS,
    COMBINE,
    MULTIPLY,
    CAPACITANCE,
];

#[derive(Debug)]
pub(super) struct Passes {
    pub take: Pipeline,
    pub entries: Pipeline,
    pub product: Pipeline,
    pub update_all: Pipeline,
    pub update_rows: Pipeline,
    pub combine: Pipeline,
    pub multiply: Pipeline,
    /// Only where the device has f64.
    pub capacitance: Option<Pipeline>,
}

impl Passes {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let compile = |pass: Declared, source| {
            let source = PassSource {
                label: pass.entry,
                source,
                entry: pass.entry,
                storage: pass.storage,
                loops: LOOPS,
            };
            Pipeline::new(gpu, &source)
        };
        let compiled = |pass| compile(pass, SHADER);
        Ok(Passes {
            take: compiled(TAKE)?,
            entries: compiled(ENTRIES)?,
            product: compiled(PRODUCT)?,
            update_all: compiled(UPDATE_ALL)?,
            update_rows: compiled(UPDATE_ROWS)?,
            combine: compiled(COMBINE)?,
            multiply: compiled(MULTIPLY)?,
            capacitance: if gpu.has_f64() {
                Some(compile(CAPACITANCE, SHADER_F64)?)
            } else {
                None
            },
        })
    }
}
