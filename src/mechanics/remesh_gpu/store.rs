//! Dense inverse in f32 on a GPU.

use std::sync::Arc;

use faer::{Mat, MatRef};

use super::strips::{BankBindings, Shared, Strips};
use super::tiles::{MAX_RANK, Passes, SIDE, TileParams, Tiles};
use crate::tissue::compliance::Compliance;
use crate::tissue::error::LinearError;
use crate::tissue::remesh::levels::{Store, Which};
use crate::tissue::remesh::{Precision, RemeshError};
use crate::tissue::symmetric::{PANEL_ROWS, Symmetric};
use insonify_base::memory;
use insonify_gpu::{Dispatch, Gpu, GpuError, Parameters, Pipeline, Readback, StorageBuffer, Timer};

/// Columns of Y that the shader processes at once; their number is padded to a multiple of this.
const DEPTH: usize = 16;
/// Most entries fetched by one request, after the one value that precedes them; larger blocks are split.
const ENTRIES: usize = (1 << 16) - 1;

/// Inverse on a device, and its base there, too, unless memory does not suffice. In the steady state no buffer is
/// allocated: results are read back through staging buffers, one for each power of two of values.
pub struct DeviceStore {
    gpu: Gpu,
    base: Arc<Symmetric<f32>>,
    tiles: Tiles,
    base_tiles: Option<Tiles>,
    passes: Passes,
    shared: Shared,
    strips: Strips,
    sums_back: Readback,
    /// Staging buffers by log2 of their capacity in values.
    blocks_back: Vec<Option<Readback>>,
    /// Columns for the following update or restart.
    taken_columns: Vec<usize>,
    timer: Option<Timer>,
    update_ms: Option<f64>,
}

/// Step before Z = Y C in an update.
#[derive(Clone, Copy)]
enum Lead {
    /// Nothing: Y and C are there.
    None,
    /// Y, and C unless the reciprocal condition is below this limit.
    Solve(f64),
    /// The base, and Y from it.
    Restart,
}

impl DeviceStore {
    /// Uploads `base` to a device in banks of at most `bank_bytes`, and allocates room for updates of rank `rank`. A
    /// copy for rebuilds stays on the device; where memory does not suffice for both, rebuilds upload the base again.
    ///
    /// # Errors
    /// [`GpuError`] where the inverse does not fit the device, or the device fails.
    pub fn new(gpu: &Gpu, base: Arc<Symmetric<f32>>, rank: usize, bank_bytes: u64) -> Result<Self, GpuError> {
        let size = base.size();
        let tiles = Tiles::new(gpu, size, bank_bytes)?;
        // Memory of a software device is allocated page by page, so that its lack would not be seen here.
        let tight = gpu.report().software && memory::available().is_some_and(|left| left as u64 <= 2 * tiles.bytes());
        let base_tiles = if tight {
            None
        } else {
            match Tiles::new(gpu, size, bank_bytes) {
                Err(GpuError::OutOfMemory { .. }) => None,
                tiles => Some(tiles?),
            }
        };
        let floats = |label: &str, count: usize| StorageBuffer::zeroed(gpu, label, (count * size_of::<f32>()) as u64);
        let stride = rank.max(1).next_multiple_of(DEPTH);
        let shared = Shared {
            lists: floats("lists", 3 * size.max(stride))?,
            vector: floats("vector", size.max(stride))?,
            sums: floats("sums", size)?,
            block: floats("entries", ENTRIES + 1)?,
            parameters: Parameters::new(gpu, "remeshing", 2 * tiles.banks.len() as u32)?,
        };
        let passes = Passes::new(gpu)?;
        let store = DeviceStore {
            strips: Strips::new(gpu, &passes, &tiles, size, stride, &shared)?,
            sums_back: Readback::new(gpu, "sums", shared.sums.bytes())?,
            blocks_back: (0..=(ENTRIES + 1).ilog2()).map(|_| None).collect(),
            gpu: gpu.clone(),
            taken_columns: Vec::new(),
            timer: None,
            update_ms: None,
            base,
            tiles,
            base_tiles,
            passes,
            shared,
        };
        store
            .base_tiles
            .as_ref()
            .unwrap_or(&store.tiles)
            .send(gpu, &store.base)?;
        if let Some(base) = &store.base_tiles {
            gpu.submit("the inverse", |recorder| {
                base.copy_to(&store.tiles, recorder);
                Ok(())
            })?;
        }
        Ok(store)
    }

    /// Device that stores the inverse.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Number of buffers that the inverse is spread over.
    pub fn bank_count(&self) -> usize {
        self.tiles.banks.len()
    }

    /// Frees the device's copy of the base, so that rebuilds upload it again, as where memory does not suffice.
    pub fn free_base(&mut self) {
        self.base_tiles = None;
    }

    /// Turns timing of updates on or off, where the device supports it. The time covers the update of the inverse, not
    /// what precedes it; each timed update waits for the device.
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

    fn params(&self) -> TileParams {
        TileParams {
            size: self.base.size() as u32,
            stride: self.strips.stride as u32,
            ..TileParams::default()
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
        let Shared {
            lists,
            vector,
            sums,
            block,
            ..
        } = &self.shared;
        let work: u64 = [lists, vector, sums, block].map(StorageBuffer::bytes).iter().sum();
        let base = self.base_tiles.as_ref().map_or(0, Tiles::bytes);
        self.base.bytes() + (base + self.tiles.bytes() + self.strips.bytes() + work) as usize
    }

    fn take(&mut self, which: Which, columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        self.taken_columns = columns.to_vec();
        if which == Which::Base {
            // A restart takes the columns on the device.
            return Ok(Arc::clone(&self.base).entries(columns, columns)?);
        }
        self.make_room(columns.len())?;
        self.entries_and(columns, columns, true)
    }

    fn update(&mut self, c: MatRef<'_, f64>, rows: Option<&[usize]>, block: &[usize]) -> Result<Mat<f64>, RemeshError> {
        let columns = std::mem::take(&mut self.taken_columns);
        let near = if block.len().pow(2) <= ENTRIES { block } else { &[] };
        if !columns.is_empty() {
            self.send_capacitance(c)?;
            let (_, block_values) = self.advance(Lead::None, &columns, rows, near)?;
            if near.len() == block.len() {
                return Ok(block_values);
            }
        }
        self.entries(block, block)
    }

    fn apply(
        &mut self,
        columns: &[usize],
        change: MatRef<'_, f64>,
        limit: f64,
        rows: Option<&[usize]>,
        block: &[usize],
    ) -> Result<Option<(f64, Mat<f64>)>, RemeshError> {
        let fits = (1..=MAX_RANK.min(self.strips.stride)).contains(&columns.len()) && block.len().pow(2) <= ENTRIES;
        if self.passes.capacitance.is_none() || !fits {
            return Ok(None);
        }
        let values: Vec<f64> = change.col_iter().flat_map(|column| column.iter().copied()).collect();
        self.strips.change.write(&self.gpu, 0, &values)?;
        let (condition, block_values) = self.advance(Lead::Solve(limit), columns, rows, block)?;
        // Negative below the limit: C was zero, and nothing has changed.
        Ok((condition >= 0.0).then_some((condition, block_values)))
    }

    fn restart(&mut self, c: MatRef<'_, f64>) -> Result<(), RemeshError> {
        let columns = std::mem::take(&mut self.taken_columns);
        self.make_room(columns.len())?;
        if self.base_tiles.is_none() {
            self.tiles.send(&self.gpu, &self.base)?;
        }
        self.send_capacitance(c)?;
        self.advance(Lead::Restart, &columns, None, &[])?;
        Ok(())
    }

    fn entries(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        self.entries_and(rows, columns, false)
    }

    fn combine(&mut self, columns: &[usize], weights: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        self.check_length(out.len())?;
        let stride = self.strips.stride;
        let mut submission = None;
        for (chunk, (columns, weights)) in columns.chunks(stride).zip(weights.chunks(stride)).enumerate() {
            let weights: Vec<f32> = weights.iter().map(|weight| *weight as f32).collect();
            self.shared.vector.write(&self.gpu, 0, &weights)?;
            submission = Some(self.run_combine(columns, chunk > 0)?);
        }
        match submission {
            Some(submission) => self.read_sums(submission, out),
            None => {
                out.fill(0.0);
                Ok(())
            }
        }
    }

    fn multiply(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        self.check_length(x.len())?;
        self.check_length(out.len())?;
        let x: Vec<f32> = x.iter().map(|x| *x as f32).collect();
        self.shared.vector.write(&self.gpu, 0, &x)?;
        self.set(self.params(), self.params())?;
        let dispatches = self.of_banks(&self.passes.multiply, |bank| &bank.multiply, 0, [self.blocks(), 1, 1]);
        let submission = self.gpu.submit("product", |recorder| {
            recorder.run("product", dispatches)?;
            recorder.read_back(&self.shared.sums, &self.sums_back)
        })?;
        self.read_sums(submission, out)
    }
}

const _: () = assert!(PANEL_ROWS == SIDE && SIDE == 128, "the shader's own constant");

// Transfers and dispatches of the device store.

impl DeviceStore {
    fn check_length(&self, found: usize) -> Result<(), RemeshError> {
        let expected = self.base.size();
        if found == expected {
            return Ok(());
        }
        let what = "values of a vector";
        Err(LinearError::Shape { what, found, expected }.into())
    }

    /// Makes room for updates of a rank; a rebuild's exceeds that of a move.
    fn make_room(&mut self, rank: usize) -> Result<(), GpuError> {
        if rank > self.strips.stride {
            let stride = rank.next_multiple_of(SIDE);
            let size = self.base.size();
            self.strips = Strips::new(&self.gpu, &self.passes, &self.tiles, size, stride, &self.shared)?;
        }
        Ok(())
    }

    fn send_capacitance(&self, c: MatRef<'_, f64>) -> Result<(), GpuError> {
        let padding = vec![0.0; padded(c.nrows()) as usize - c.nrows()];
        let values = c.col_iter().flat_map(|column| column.iter().chain(&padding));
        let values: Vec<f32> = values.map(|x| *x as f32).collect();
        self.strips.c.write(&self.gpu, 0, &values)
    }

    fn send_lists(&self, lists: &[&[usize]]) -> Result<(), GpuError> {
        let values: Vec<u32> = lists.iter().copied().flatten().map(|dof| *dof as u32).collect();
        self.shared.lists.write(&self.gpu, 0, &values)
    }

    /// Subtracts Y Z^T, Z = Y C, from all entries or from some rows and columns. Returns the reciprocal condition,
    /// negative below the limit, and the resulting entries at the rows and columns `block`. These are computed and
    /// copied before the update of all entries, which nobody waits for; it is a submission of its own, as bytes arrive
    /// with the end of theirs.
    fn advance(
        &mut self,
        lead: Lead,
        columns: &[usize],
        rows: Option<&[usize]>,
        block: &[usize],
    ) -> Result<(f64, Mat<f64>), GpuError> {
        let mut named = rows.unwrap_or_default().to_vec();
        named.sort_unstable();
        named.dedup();
        self.send_lists(&[columns, block, &named])?;
        let limit = match lead {
            // Rounded up, so that the device accepts nothing that the CPU would refuse.
            Lead::Solve(limit) => (limit as f32).next_up(),
            _ => 0.0,
        };
        let whole = TileParams {
            rank: columns.len() as u32,
            rows: named.len() as u32,
            rows_from: (columns.len() + block.len()) as u32,
            limit,
            ..self.params()
        };
        let near = TileParams {
            // Rows and columns are updated before they are read.
            rank: if rows.is_none() { whole.rank } else { 0 },
            rows: block.len() as u32,
            columns: block.len() as u32,
            rows_from: whole.rank,
            columns_from: whole.rank,
            ..self.params()
        };
        self.set(whole, near)?;
        let wanted = matches!(lead, Lead::Solve(_)) || !block.is_empty();
        let back = self.staging(block.len().pow(2))?;
        let submission = self.gpu.submit("change", |recorder| {
            if let (Lead::Restart, Some(base)) = (lead, &self.base_tiles) {
                base.copy_to(&self.tiles, recorder);
            }
            recorder.run("change", self.preparation(lead, whole, near))?;
            match &self.blocks_back[back] {
                Some(readback) if wanted => recorder.read_back(&self.shared.block, readback),
                _ => Ok(()),
            }
        })?;
        if rows.is_none() {
            self.update_all()?;
        }
        let mut values = vec![0.0; 1 + block.len().pow(2)];
        if wanted {
            self.read_block(back, submission, &mut values)?;
        }
        let entry = |i, j| f64::from(values[1 + i * block.len() + j]);
        Ok((f64::from(values[0]), Mat::from_fn(block.len(), block.len(), entry)))
    }

    /// Dispatches of an update up to the entries to be read.
    fn preparation(&self, lead: Lead, whole: TileParams, near: TileParams) -> impl Iterator<Item = Dispatch<'_>> {
        let dispatch = |pipeline, bindings, workgroups| Dispatch {
            pipeline,
            bindings,
            slot: 0,
            workgroups,
        };
        let solve = match (lead, &self.passes.capacitance, &self.strips.capacitance) {
            (Lead::Solve(_), Some(pass), Some(bindings)) => Some(dispatch(pass, bindings, [1, 1, 1])),
            _ => None,
        };
        let rank = whole.rank as usize;
        let take = (!matches!(lead, Lead::None)).then(|| self.take_columns(rank));
        let width = [self.blocks(), padded(rank) / DEPTH as u32, 1];
        let product = dispatch(&self.passes.product, &self.strips.product, width);
        let height = [self.blocks(), whole.rows, 1];
        let rows = self.of_banks(&self.passes.update_rows, |bank| &bank.update_rows, 0, height);
        let rows = (whole.rows > 0).then_some(rows);
        let entries = (near.rows > 0).then(|| self.read_entries(near));
        let leading = take.into_iter().flatten().chain(solve).chain([product]);
        leading
            .chain(rows.into_iter().flatten())
            .chain(entries.into_iter().flatten())
    }

    /// Subtracts Y Z^T from all entries.
    fn update_all(&mut self) -> Result<(), GpuError> {
        let banks = (0..).zip(self.strips.banks.iter().zip(&self.tiles.banks));
        let dispatches = banks.map(|(slot, (bindings, bank))| Dispatch {
            pipeline: &self.passes.update_all,
            bindings: &bindings.update_all,
            slot,
            workgroups: [bank.tiles as u32, 1, 1],
        });
        self.gpu.submit("update", |recorder| match &self.timer {
            Some(timer) => recorder.run_timed_whole(timer, dispatches),
            None => recorder.run("update", dispatches),
        })?;
        if let Some(timer) = &mut self.timer {
            self.update_ms = Some(timer.read(&self.gpu)?.frame_ms);
        }
        Ok(())
    }

    /// Fetches a block of the current inverse; with `take`, the columns are set aside, too.
    fn entries_and(&mut self, rows: &[usize], columns: &[usize], take: bool) -> Result<Mat<f64>, RemeshError> {
        if rows.len() > columns.len() {
            // Few long rows are cheaper to fetch than many short ones, and the inverse is symmetric.
            return Ok(self.entries_and(columns, rows, take)?.transpose().to_owned());
        }
        let mut block = Mat::zeros(rows.len(), columns.len());
        let wide = columns.len().min(self.size()).clamp(1, ENTRIES);
        let high = (ENTRIES / wide).min(self.size()).max(1);
        for (left, columns) in columns.chunks(wide).enumerate() {
            for (top, rows) in rows.chunks(high).enumerate() {
                let values = self.fetch(rows, columns, take)?;
                for (index, value) in values[1..].iter().enumerate() {
                    let (i, j) = (index / columns.len(), index % columns.len());
                    block[(top * high + i, left * wide + j)] = f64::from(*value);
                }
            }
        }
        Ok(block)
    }

    /// Fetches entries in one request, row by row after a first value without meaning.
    fn fetch(&mut self, rows: &[usize], columns: &[usize], take: bool) -> Result<Vec<f32>, GpuError> {
        self.send_lists(&[columns, rows])?;
        let params = TileParams {
            rows: rows.len() as u32,
            columns: columns.len() as u32,
            rows_from: columns.len() as u32,
            ..self.params()
        };
        let whole = TileParams {
            rank: if take { params.columns } else { 0 },
            ..params
        };
        self.set(whole, params)?;
        let back = self.staging(rows.len() * columns.len())?;
        let copies = take.then(|| self.take_columns(columns.len()));
        let dispatches = copies.into_iter().flatten().chain(self.read_entries(params));
        let submission = self.gpu.submit("entries", |recorder| {
            recorder.run("entries", dispatches)?;
            match &self.blocks_back[back] {
                Some(readback) => recorder.read_back(&self.shared.block, readback),
                None => Ok(()),
            }
        })?;
        let mut values = vec![0.0; 1 + rows.len() * columns.len()];
        self.read_block(back, submission, &mut values)?;
        Ok(values)
    }

    /// Index of a staging buffer for this many entries and the value before them.
    fn staging(&mut self, entries: usize) -> Result<usize, GpuError> {
        let power = (entries + 1).next_power_of_two();
        let bucket = power.ilog2() as usize;
        if self.blocks_back[bucket].is_none() {
            let bytes = (power * size_of::<f32>()) as u64;
            self.blocks_back[bucket] = Some(Readback::new(&self.gpu, "entries", bytes)?);
        }
        Ok(bucket)
    }

    fn read_block(
        &mut self,
        back: usize,
        submission: wgpu::SubmissionIndex,
        values: &mut [f32],
    ) -> Result<(), GpuError> {
        match &mut self.blocks_back[back] {
            Some(readback) => readback.read_after(&self.gpu, submission, values),
            None => Ok(()),
        }
    }

    /// Sums columns weighted by the vector; with `add`, on top of the existing sums.
    fn run_combine(&mut self, columns: &[usize], add: bool) -> Result<wgpu::SubmissionIndex, GpuError> {
        self.send_lists(&[columns])?;
        let params = TileParams {
            rank: columns.len() as u32,
            add: u32::from(add),
            ..self.params()
        };
        self.set(params, params)?;
        let sum = Dispatch {
            pipeline: &self.passes.combine,
            bindings: &self.strips.combine,
            slot: 0,
            workgroups: [self.blocks(), 1, 1],
        };
        self.gpu.submit("sum", |recorder| {
            recorder.run("sum", self.take_columns(columns.len()).chain([sum]))?;
            recorder.read_back(&self.shared.sums, &self.sums_back)
        })
    }

    fn read_sums(&mut self, submission: wgpu::SubmissionIndex, out: &mut [f64]) -> Result<(), RemeshError> {
        let mut sums = vec![0.0f32; out.len()];
        self.sums_back.read_after(&self.gpu, submission, &mut sums)?;
        out.iter_mut().zip(&sums).for_each(|(to, from)| *to = f64::from(*from));
        Ok(())
    }

    /// Dispatches that copy listed columns of the current inverse to Y.
    fn take_columns(&self, rank: usize) -> impl Iterator<Item = Dispatch<'_>> {
        let workgroups = [self.blocks(), padded(rank), 1];
        self.of_banks(&self.passes.take, |bank| &bank.take, 0, workgroups)
    }

    /// Dispatches that copy entries to the block.
    fn read_entries(&self, params: TileParams) -> impl Iterator<Item = Dispatch<'_>> {
        let workgroups = [params.columns.div_ceil(64), params.rows, 1];
        let slot = self.tiles.banks.len() as u32;
        self.of_banks(&self.passes.entries, |bank| &bank.entries, slot, workgroups)
    }

    /// Dispatches of a pass over all banks, with parameters from `slot` on.
    fn of_banks<'a>(
        &'a self,
        pipeline: &'a Pipeline,
        bindings: fn(&BankBindings) -> &wgpu::BindGroup,
        slot: u32,
        workgroups: [u32; 3],
    ) -> impl Iterator<Item = Dispatch<'a>> {
        (slot..).zip(&self.strips.banks).map(move |(slot, bank)| Dispatch {
            pipeline,
            bindings: bindings(bank),
            slot,
            workgroups,
        })
    }

    /// Writes the parameters of each bank, those of entries in slots after all others.
    fn set(&mut self, params: TileParams, entries: TileParams) -> Result<(), GpuError> {
        let banks = self.tiles.banks.len() as u32;
        for (slot, bank) in (0..).zip(&self.tiles.banks) {
            for (slot, params) in [(slot, params), (banks + slot, entries)] {
                let with_slot = TileParams {
                    first_tile: bank.first as u32,
                    tiles: bank.tiles as u32,
                    // The first bank starts a sum, the others add to it.
                    add: params.add | u32::from(bank.first > 0),
                    ..params
                };
                self.shared.parameters.set(slot, &with_slot)?;
            }
        }
        self.shared.parameters.write(&self.gpu)
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
