//! Columns set aside for an update, and what is computed from them.

use super::tiles::{MAX_RANK, Passes, SIDE, Tiles};
use insonify_gpu::{Gpu, GpuError, Parameters, Pipeline, StorageBuffer};

/// Buffers of an update, with the bindings of all passes.
pub(super) struct Strips {
    /// Column capacity of Y and Z.
    pub stride: usize,
    y: StorageBuffer,
    z: StorageBuffer,
    pub c: StorageBuffer,
    /// dK of a change in f64; empty where the device has no f64.
    pub change: StorageBuffer,
    /// I + dK G, then its inverse.
    matrix: StorageBuffer,
    pub banks: Vec<BankBindings>,
    pub product: wgpu::BindGroup,
    pub combine: wgpu::BindGroup,
    pub capacitance: Option<wgpu::BindGroup>,
}

/// Bindings of the passes that process one bank.
pub(super) struct BankBindings {
    pub take: wgpu::BindGroup,
    pub entries: wgpu::BindGroup,
    pub update_all: wgpu::BindGroup,
    pub update_rows: wgpu::BindGroup,
    pub multiply: wgpu::BindGroup,
}

/// Buffers that do not depend on the rank.
pub(super) struct Shared {
    /// Rows and columns of a request.
    pub lists: StorageBuffer,
    /// Weights or forces.
    pub vector: StorageBuffer,
    /// Sums of columns or products.
    pub sums: StorageBuffer,
    /// A reciprocal condition, then the entries requested.
    pub block: StorageBuffer,
    pub parameters: Parameters,
}

impl Strips {
    /// Allocates room for `stride` columns of the height of the inverse.
    pub(super) fn new(
        gpu: &Gpu,
        passes: &Passes,
        tiles: &Tiles,
        size: usize,
        stride: usize,
        shared: &Shared,
    ) -> Result<Self, GpuError> {
        let zeroed =
            |label: &str, count: usize, entry: usize| StorageBuffer::zeroed(gpu, label, (count * entry) as u64);
        let values = size.div_ceil(SIDE) * SIDE * stride;
        let y = zeroed("Y", values, size_of::<f32>())?;
        let z = zeroed("Z", values, size_of::<f32>())?;
        let c = zeroed("C", stride * stride, size_of::<f32>())?;
        let capacitance = passes.capacitance.as_ref();
        // Devices without double precision leave this system to the host, and need no room for it.
        let solved = capacitance.map_or(0, |_| stride.min(MAX_RANK).pow(2));
        let change = zeroed("dK", solved, size_of::<f64>())?;
        let matrix = zeroed("I + dK G", solved, size_of::<f64>())?;
        let Shared {
            lists,
            vector,
            sums,
            block,
            parameters,
        } = shared;
        let bind = |pipeline: &Pipeline, buffers: &[&StorageBuffer]| pipeline.bind(gpu, parameters, buffers);
        let banks = tiles.banks.iter().map(|bank| {
            let tiles = &bank.buffer;
            Ok(BankBindings {
                take: bind(&passes.take, &[tiles, lists, &y])?,
                entries: bind(&passes.entries, &[tiles, lists, block, &y, &z])?,
                update_all: bind(&passes.update_all, &[tiles, &y, &z])?,
                update_rows: bind(&passes.update_rows, &[tiles, &y, &z, lists])?,
                multiply: bind(&passes.multiply, &[tiles, vector, sums])?,
            })
        });
        let solve = |pass| bind(pass, &[&y, lists, &change, &matrix, &c, block]);
        Ok(Strips {
            stride,
            banks: banks.collect::<Result<_, GpuError>>()?,
            product: bind(&passes.product, &[&y, &c, &z])?,
            combine: bind(&passes.combine, &[&y, vector, sums])?,
            capacitance: capacitance.map(solve).transpose()?,
            y,
            z,
            c,
            change,
            matrix,
        })
    }

    /// Size of all buffers, bytes.
    pub(super) fn bytes(&self) -> u64 {
        let buffers = [&self.y, &self.z, &self.c, &self.change, &self.matrix];
        buffers.map(StorageBuffer::bytes).iter().sum()
    }
}
