//! Dense inverse in f32 on a GPU.

mod run;

use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use super::passes::{Params, Passes};
use super::tiles::{SIDE, Tiles};
use crate::gpu::{Gpu, GpuError, Parameters, Pipeline, Readback, StorageBuffer, Timer};
use crate::mechanics::tissue::remesh::levels::{Store, Which};
use crate::mechanics::tissue::remesh::{Precision, RemeshError};
use crate::mechanics::tissue::symmetric::{PANEL_ROWS, Symmetric};

/// Columns of Y that the shader processes at once; their number is padded to a multiple of this.
const DEPTH: usize = 16;
/// Most entries fetched by one request; larger blocks are split.
const ENTRIES: usize = 1 << 16;

/// Inverse on a device, with its base in CPU memory. In the steady state no buffer is allocated: results are read back
/// through staging buffers, one for each power of two of entries.
pub struct DeviceStore {
    gpu: Gpu,
    base: Arc<Symmetric<f32>>,
    tiles: Tiles,
    passes: Passes,
    parameters: Parameters,
    /// Column capacity of Y and Z.
    stride: usize,
    y: StorageBuffer,
    z: StorageBuffer,
    c: StorageBuffer,
    lists: StorageBuffer,
    vector: StorageBuffer,
    sums: StorageBuffer,
    block: StorageBuffer,
    /// Bindings of each bank.
    banks: Vec<BankBindings>,
    product: wgpu::BindGroup,
    combine: wgpu::BindGroup,
    sums_back: Readback,
    /// Staging buffers by log2 of their capacity in entries.
    blocks_back: Vec<Option<Readback>>,
    /// Columns of the base set aside.
    taken_base: Mat<f32>,
    /// Number of columns of the current inverse set aside on the device.
    taken: usize,
    timer: Option<Timer>,
    update_ms: Option<f64>,
}

/// Bindings of the passes that process one bank.
struct BankBindings {
    take: wgpu::BindGroup,
    entries: wgpu::BindGroup,
    update_all: wgpu::BindGroup,
    update_rows: wgpu::BindGroup,
    multiply: wgpu::BindGroup,
}

impl DeviceStore {
    /// Uploads `base` to a device in banks of at most `bank_bytes`, and allocates room for updates of rank `rank`.
    ///
    /// # Errors
    /// [`GpuError`] where the inverse does not fit the device, or the device fails.
    pub fn new(gpu: &Gpu, base: Arc<Symmetric<f32>>, rank: usize, bank_bytes: u64) -> Result<Self, GpuError> {
        let size = base.size();
        let stride = rank.max(1).next_multiple_of(DEPTH);
        let tiles = Tiles::new(gpu, size, bank_bytes)?;
        let floats = |label: &str, count: usize| StorageBuffer::zeroed(gpu, label, (count * size_of::<f32>()) as u64);
        let strips = size.div_ceil(SIDE) * SIDE * stride;
        let (y, z) = (floats("Y", strips)?, floats("Z", strips)?);
        let c = floats("C", stride * stride)?;
        let lists = floats("lists", 2 * size.max(stride))?;
        let (vector, sums) = (floats("vector", size.max(stride))?, floats("sums", size)?);
        let block = floats("entries", ENTRIES)?;
        let passes = Passes::new(gpu)?;
        let parameters = Parameters::new(gpu, "remeshing", tiles.banks.len() as u32)?;
        let bind = |pipeline: &Pipeline, buffers: &[&StorageBuffer]| pipeline.bind(gpu, &parameters, buffers);
        let banks = tiles.banks.iter().map(|bank| {
            let own = &bank.buffer;
            Ok(BankBindings {
                take: bind(&passes.take, &[own, &lists, &y])?,
                entries: bind(&passes.entries, &[own, &lists, &block])?,
                update_all: bind(&passes.update_all, &[own, &y, &z])?,
                update_rows: bind(&passes.update_rows, &[own, &y, &z, &lists])?,
                multiply: bind(&passes.multiply, &[own, &vector, &sums])?,
            })
        });
        let store = DeviceStore {
            stride,
            banks: banks.collect::<Result<_, GpuError>>()?,
            product: bind(&passes.product, &[&y, &c, &z])?,
            combine: bind(&passes.combine, &[&y, &vector, &sums])?,
            sums_back: Readback::new(gpu, "sums", sums.bytes())?,
            blocks_back: (0..=ENTRIES.ilog2()).map(|_| None).collect(),
            gpu: gpu.clone(),
            taken_base: Mat::new(),
            taken: 0,
            timer: None,
            update_ms: None,
            base,
            tiles,
            passes,
            parameters,
            y,
            z,
            c,
            lists,
            vector,
            sums,
            block,
        };
        store.tiles.send(gpu, &store.base)?;
        Ok(store)
    }

    /// Device that stores the inverse.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Number of buffers that the inverse is spread over.
    #[cfg(feature = "internals")]
    pub fn bank_count(&self) -> usize {
        self.banks.len()
    }

    /// Turns timing of updates on or off, where the device supports it. The time covers both products but no transfers
    /// of columns; each timed update waits for the device.
    ///
    /// # Errors
    /// [`GpuError`] where the timer cannot be created.
    pub fn time_updates(&mut self, on: bool) -> Result<(), GpuError> {
        self.timer = if on { Timer::new(&self.gpu, &["update"])? } else { None };
        self.update_ms = None;
        Ok(())
    }

    /// Device time of the last update, ms, where measured.
    pub fn update_ms(&self) -> Option<f64> {
        self.update_ms
    }

    fn params(&self) -> Params {
        Params {
            size: self.base.size() as u32,
            stride: self.stride as u32,
            ..Params::default()
        }
    }
}

impl From<GpuError> for RemeshError {
    fn from(error: GpuError) -> Self {
        RemeshError::Device(error.to_string())
    }
}

impl Store for DeviceStore {
    fn size(&self) -> usize {
        self.base.size()
    }

    fn precision(&self) -> Precision {
        Precision::Single
    }

    fn bytes(&self) -> usize {
        self.tiles.bytes() as usize
    }

    fn memory(&self) -> usize {
        let work = [
            &self.y,
            &self.z,
            &self.c,
            &self.lists,
            &self.vector,
            &self.sums,
            &self.block,
        ];
        self.base.bytes() + self.bytes() + work.map(|buffer| buffer.bytes() as usize).iter().sum::<usize>()
    }

    fn take(&mut self, which: Which, columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        if which == Which::Base {
            return self.take_base(columns);
        }
        if columns.len() > self.stride {
            return Err(RemeshError::Device(format!(
                "an update of rank {} where there is room for {}",
                columns.len(),
                self.stride
            )));
        }
        self.take_columns(columns)?;
        self.taken = columns.len();
        self.entries(columns, columns)
    }

    fn update(&mut self, c: MatRef<'_, f64>, rows: Option<&[usize]>) -> Result<(), RemeshError> {
        let rank = self.taken;
        if rank == 0 {
            return Ok(());
        }
        let values: Vec<f32> = c
            .col_iter()
            .flat_map(|column| column.iter())
            .map(|x| *x as f32)
            .collect();
        self.c.write(&self.gpu, 0, &values)?;
        let params = Params {
            rank: rank as u32,
            rows: rows.map_or(0, |rows| rows.len() as u32),
            ..self.params()
        };
        if let Some(rows) = rows {
            let mut named: Vec<u32> = rows.iter().map(|row| *row as u32).collect();
            named.sort_unstable();
            named.dedup();
            self.lists.write(&self.gpu, 0, &named)?;
        }
        self.run_update(params, true, rows.is_none())?;
        Ok(())
    }

    fn restart(&mut self, c: MatRef<'_, f64>) -> Result<(), RemeshError> {
        self.tiles.send(&self.gpu, &self.base)?;
        let y = std::mem::replace(&mut self.taken_base, Mat::new());
        let c: Mat<f32> = Mat::from_fn(c.nrows(), c.ncols(), |i, j| c[(i, j)] as f32);
        let mut z = Mat::<f32>::zeros(y.nrows(), y.ncols());
        matmul(z.as_mut(), Accum::Replace, y.as_ref(), c.as_ref(), 1.0, Par::rayon(0));
        let mut strips = Vec::new();
        for first in (0..y.ncols()).step_by(self.stride) {
            let count = self.stride.min(y.ncols() - first);
            for (matrix, buffer) in [(&y, &self.y), (&z, &self.z)] {
                self.pack(matrix.as_ref().subcols(first, count), &mut strips);
                buffer.write(&self.gpu, 0, &strips)?;
            }
            let params = Params {
                rank: count as u32,
                ..self.params()
            };
            self.run_update(params, false, true)?;
        }
        Ok(())
    }

    fn entries(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        let mut block = Mat::zeros(rows.len(), columns.len());
        let wide = columns.len().min(self.size()).clamp(1, ENTRIES);
        let high = (ENTRIES / wide).min(self.size()).max(1);
        let mut found = Vec::new();
        for (left, columns) in columns.chunks(wide).enumerate() {
            for (top, rows) in rows.chunks(high).enumerate() {
                self.fetch(rows, columns, &mut found)?;
                for (at, value) in found.iter().enumerate() {
                    let (i, j) = (at / columns.len(), at % columns.len());
                    block[(top * high + i, left * wide + j)] = f64::from(*value);
                }
            }
        }
        Ok(block)
    }

    fn combine(&mut self, columns: &[usize], weights: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        self.check_length(out.len())?;
        if columns.is_empty() {
            out.fill(0.0);
            return Ok(());
        }
        let stride = self.stride;
        for (at, (columns, weights)) in columns.chunks(stride).zip(weights.chunks(stride)).enumerate() {
            self.take_columns(columns)?;
            let weights: Vec<f32> = weights.iter().map(|weight| *weight as f32).collect();
            self.vector.write(&self.gpu, 0, &weights)?;
            self.run_combine(columns.len(), at > 0)?;
        }
        self.fetch_sums(out)?;
        Ok(())
    }

    fn multiply(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        self.check_length(x.len())?;
        self.check_length(out.len())?;
        let x: Vec<f32> = x.iter().map(|x| *x as f32).collect();
        self.vector.write(&self.gpu, 0, &x)?;
        self.run_multiply()?;
        self.fetch_sums(out)?;
        Ok(())
    }
}

const _: () = assert!(PANEL_ROWS == SIDE && SIDE == 128, "the shader's own constant");
