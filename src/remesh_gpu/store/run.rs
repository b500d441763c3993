//! Transfers and dispatches of the device store.

use crate::mechanics::tissue::error::LinearError;
use faer::{Mat, MatRef};

use super::{DEPTH, DeviceStore};
use crate::gpu::{Dispatch, GpuError, Readback};
use crate::mechanics::tissue::remesh::RemeshError;
use crate::remesh_gpu::passes::Params;
use crate::remesh_gpu::tiles::SIDE;

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
        self.gpu.submit("sum", |recorder| recorder.run("sum", [dispatch]))
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
