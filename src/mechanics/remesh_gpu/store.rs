//! Dense inverse in f32 on a GPU.

use std::sync::Arc;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use super::tiles::{Params, Passes, SIDE, Tiles};
use crate::gpu::{Dispatch, Gpu, GpuError, Parameters, Pipeline, Readback, StorageBuffer, Timer};
use crate::mechanics::tissue::error::LinearError;
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

// Transfers and dispatches of the device store.

impl DeviceStore {
    /// Sets columns of the base aside, and returns their rows of the same indices.
    pub(super) fn take_base(&mut self, columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        let mut y = Mat::<f32>::zeros(self.base.size(), columns.len());
        let mut values = vec![0.0; self.base.size()];
        for (k, &column) in columns.iter().enumerate() {
            self.base.column_into(column, &mut values)?;
            y.col_mut(k).iter_mut().zip(&values).for_each(|(to, from)| *to = *from);
        }
        let block = Mat::from_fn(columns.len(), columns.len(), |i, j| f64::from(y[(columns[i], j)]));
        self.taken_base = y;
        Ok(block)
    }

    pub(super) fn check_length(&self, found: usize) -> Result<(), RemeshError> {
        let expected = self.base.size();
        if found == expected {
            return Ok(());
        }
        let what = "values of a vector";
        Err(LinearError::Shape { what, found, expected }.into())
    }

    /// Copies columns of the current inverse to Y, at most its capacity.
    pub(super) fn take_columns(&mut self, columns: &[usize]) -> Result<(), GpuError> {
        let list: Vec<u32> = columns.iter().map(|column| *column as u32).collect();
        self.lists.write(&self.gpu, 0, &list)?;
        self.set(Params {
            rank: columns.len() as u32,
            ..self.params()
        })?;
        let groups = [self.blocks(), padded(columns.len()), 1];
        let dispatches = (0..).zip(&self.banks).map(|(slot, bank)| Dispatch {
            pipeline: &self.passes.take,
            bindings: &bank.take,
            slot,
            workgroups: groups,
        });
        self.gpu
            .submit("columns", |recorder| recorder.run("columns", dispatches))
            .map(drop)
    }

    /// Fetches a block of the current inverse, row by row.
    pub(super) fn fetch(&mut self, rows: &[usize], columns: &[usize], found: &mut Vec<f32>) -> Result<(), GpuError> {
        found.clear();
        found.resize(rows.len() * columns.len(), 0.0);
        if found.is_empty() {
            return Ok(());
        }
        let lists: Vec<u32> = rows.iter().chain(columns).map(|dof| *dof as u32).collect();
        self.lists.write(&self.gpu, 0, &lists)?;
        self.set(Params {
            rows: rows.len() as u32,
            columns: columns.len() as u32,
            ..self.params()
        })?;
        let groups = [columns.len().div_ceil(64) as u32, rows.len() as u32, 1];
        let dispatches = (0..).zip(&self.banks).map(|(slot, bank)| Dispatch {
            pipeline: &self.passes.entries,
            bindings: &bank.entries,
            slot,
            workgroups: groups,
        });
        let power = found.len().next_power_of_two();
        let slot = &mut self.blocks_back[power.ilog2() as usize];
        let readback = match slot {
            Some(readback) => readback,
            None => slot.insert(Readback::new(&self.gpu, "entries", (power * size_of::<f32>()) as u64)?),
        };
        let block = &self.block;
        self.gpu.submit("entries", |recorder| {
            recorder.run("entries", dispatches)?;
            recorder.read_back(block, readback)
        })?;
        readback.read(&self.gpu, found)
    }

    /// Subtracts Y Z^T from all entries or from the listed rows and columns; with `product`, computes Z = Y C first.
    pub(super) fn run_update(&mut self, params: Params, product: bool, all: bool) -> Result<(), GpuError> {
        self.set(params)?;
        let first = product.then(|| Dispatch {
            pipeline: &self.passes.product,
            bindings: &self.product,
            slot: 0,
            workgroups: [self.blocks(), padded(params.rank as usize), 1],
        });
        let banks = (0..).zip(self.banks.iter().zip(&self.tiles.banks));
        let updates = banks.map(|(slot, (bindings, bank))| {
            if all {
                Dispatch {
                    pipeline: &self.passes.update_all,
                    bindings: &bindings.update_all,
                    slot,
                    workgroups: [bank.tiles as u32, 1, 1],
                }
            } else {
                Dispatch {
                    pipeline: &self.passes.update_rows,
                    bindings: &bindings.update_rows,
                    slot,
                    workgroups: [self.blocks(), params.rows, 1],
                }
            }
        });
        let dispatches = first.into_iter().chain(updates);
        self.gpu.submit("update", |recorder| match &self.timer {
            Some(timer) => recorder.run_timed_whole(timer, dispatches),
            None => recorder.run("update", dispatches),
        })?;
        if let Some(timer) = &mut self.timer {
            self.update_ms = Some(timer.read(&self.gpu)?.frame_ms);
        }
        Ok(())
    }

    /// Sums the columns of Y weighted by the vector; with `add`, on top of the existing sums.
    pub(super) fn run_combine(&mut self, rank: usize, add: bool) -> Result<(), GpuError> {
        self.set(Params {
            rank: rank as u32,
            add: u32::from(add),
            ..self.params()
        })?;
        let dispatch = Dispatch {
            pipeline: &self.passes.combine,
            bindings: &self.combine,
            slot: 0,
            workgroups: [self.blocks(), 1, 1],
        };
        self.gpu
            .submit("sum", |recorder| recorder.run("sum", [dispatch]))
            .map(drop)
    }

    /// Multiplies the current inverse by the vector, bank after bank.
    pub(super) fn run_multiply(&mut self) -> Result<(), GpuError> {
        self.set(self.params())?;
        let blocks = self.blocks();
        let dispatches = (0..).zip(&self.banks).map(|(slot, bank)| Dispatch {
            pipeline: &self.passes.multiply,
            bindings: &bank.multiply,
            slot,
            workgroups: [blocks, 1, 1],
        });
        self.gpu
            .submit("product", |recorder| recorder.run("product", dispatches))
            .map(drop)
    }

    pub(super) fn fetch_sums(&mut self, out: &mut [f64]) -> Result<(), GpuError> {
        let (sums, back) = (&self.sums, &self.sums_back);
        self.gpu.submit("sums", |recorder| recorder.read_back(sums, back))?;
        let mut found = vec![0.0f32; out.len()];
        self.sums_back.read(&self.gpu, &mut found)?;
        out.iter_mut().zip(&found).for_each(|(to, from)| *to = f64::from(*from));
        Ok(())
    }

    /// Packs columns into the layout of Y and Z, with zeros beyond the last row and in the padding columns.
    pub(super) fn pack(&self, columns: MatRef<'_, f32>, strips: &mut Vec<f32>) {
        strips.clear();
        strips.resize(self.blocks() as usize * self.stride * SIDE, 0.0);
        for (k, column) in columns.col_iter().enumerate() {
            for (i, value) in column.iter().enumerate() {
                strips[(i / SIDE * self.stride + k) * SIDE + i % SIDE] = *value;
            }
        }
    }

    /// Writes the parameters of each bank to its own slot.
    fn set(&mut self, params: Params) -> Result<(), GpuError> {
        for (slot, bank) in (0..).zip(&self.tiles.banks) {
            let own = Params {
                first_tile: bank.first as u32,
                tiles: bank.tiles as u32,
                // The first bank starts a sum, the others add to it.
                add: params.add | u32::from(slot > 0),
                ..params
            };
            self.parameters.set(slot, &own)?;
        }
        self.parameters.write(&self.gpu)
    }

    /// Number of row blocks.
    fn blocks(&self) -> u32 {
        self.base.size().div_ceil(SIDE) as u32
    }
}

/// Rounds a number of columns up to a multiple of [`DEPTH`].
fn padded(columns: usize) -> u32 {
    columns.next_multiple_of(DEPTH) as u32
}
