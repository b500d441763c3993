//! The lower triangle of a symmetric matrix in square tiles on a device.
//!
//! A row panel of [`Symmetric`] is a row of tiles, laid out as it is there, so it is sent as it lies. Tiles are numbered row by
//! row and spread over buffers ("banks") none of which is larger than a pass can bind.

use crate::gpu::{Gpu, GpuError, StorageBuffer};
use crate::mechanics::tissue::symmetric::{PANEL_ROWS, Panel, Symmetric};

/// Rows, and columns, of a tile. The shader's own constant.
pub const SIDE: usize = PANEL_ROWS;
const TILE: usize = SIDE * SIDE;
const TILE_BYTES: u64 = (TILE * size_of::<f32>()) as u64;

/// Tiles of the first `rows` rows of tiles.
fn tiles_of(rows: usize) -> usize {
    rows * (rows + 1) / 2
}

/// Bytes on the device of a matrix of `size` rows.
pub fn bytes_of(size: usize) -> u64 {
    tiles_of(size.div_ceil(SIDE)) as u64 * TILE_BYTES
}

/// A run of tiles in one buffer.
#[derive(Debug)]
pub struct Bank {
    /// The buffer.
    pub buffer: StorageBuffer,
    /// Number of its first tile.
    pub first: usize,
    /// How many it holds.
    pub tiles: usize,
}

/// A matrix on a device.
#[derive(Debug)]
pub struct Tiles {
    /// Its banks, in order.
    pub banks: Vec<Bank>,
}

impl Tiles {
    /// Room for a matrix of `size` rows in banks of at most `bank_bytes`.
    ///
    /// # Errors
    /// [`GpuError::Limit`] where not even one tile fits a bank, [`GpuError::OutOfMemory`].
    pub fn new(gpu: &Gpu, size: usize, bank_bytes: u64) -> Result<Self, GpuError> {
        let count = tiles_of(size.div_ceil(SIDE));
        // A dispatch has a workgroup for each tile of a bank.
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

    /// Sends a matrix of the size that there is room for.
    ///
    /// # Errors
    /// [`GpuError`].
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
            // What is written waits in memory of the driver until something is submitted.
            gpu.submit("sending the inverse", |_| Ok(()))?;
        }
        gpu.wait("sending the inverse")
    }

    /// Bytes of all banks.
    pub fn bytes(&self) -> u64 {
        self.banks.iter().map(|bank| bank.buffer.bytes()).sum()
    }
}

/// The values of a panel, with zeros in the rows beyond its last.
fn pack(panel: &Panel<'_, f32>, values: &mut Vec<f32>) {
    values.clear();
    for column in panel.columns {
        values.extend_from_slice(&column.0[..panel.rows]);
        values.resize(values.len().next_multiple_of(SIDE), 0.0);
    }
}
