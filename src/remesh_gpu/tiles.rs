//! Lower triangle of a symmetric matrix in square tiles on a GPU.
//!
//! A row panel of [`Symmetric`] is a row of tiles in the same layout, so it is sent without conversion. Tiles are
//! numbered row by row and spread over buffers ("banks"), none larger than a pass can bind.

use crate::gpu::{Gpu, GpuError, StorageBuffer};
use crate::mechanics::tissue::symmetric::{PANEL_ROWS, Panel, Symmetric};

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
pub struct Bank {
    /// Buffer of the tiles.
    pub buffer: StorageBuffer,
    /// Index of the first tile.
    pub first: usize,
    /// Number of tiles.
    pub tiles: usize,
}

/// Symmetric matrix on a device.
#[derive(Debug)]
pub struct Tiles {
    /// Banks in the order of their tiles.
    pub banks: Vec<Bank>,
}

impl Tiles {
    /// Allocates a matrix of `size` rows in banks of at most `bank_bytes`.
    ///
    /// # Errors
    /// [`GpuError::Limit`] where not even one tile fits into a bank; [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: usize, bank_bytes: u64) -> Result<Self, GpuError> {
        let count = tiles_of(size.div_ceil(SIDE));
        // A dispatch has one workgroup per tile of a bank.
        let most = (bank_bytes / TILE_BYTES).min(u64::from(gpu.limits().max_compute_workgroups_per_dimension));
        if most == 0 {
            return Err(GpuError::Limit {
                what: "a tile of the inverse".to_owned(),
                limit: "max_storage_buffer_binding_size",
                needed: TILE_BYTES,
                available: bank_bytes,
            });
        }
        let most = most as usize;
        let banks = (0..count).step_by(most).map(|first| {
            let tiles = most.min(count - first);
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
    pub fn send(&self, gpu: &Gpu, matrix: &Symmetric<f32>) -> Result<(), GpuError> {
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

    /// Total size of all banks, bytes.
    pub fn bytes(&self) -> u64 {
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
