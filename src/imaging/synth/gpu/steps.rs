//! Dispatches of a frame: their shaders, linked and compiled, constants and bindings.

use std::borrow::Cow;

use super::GpuExecutor;
use crate::effects::pass::{Band, ParamBlock, Pass};
use crate::fusion::{Bound, Fused, MAX_BUFFERS, Sequence};
use crate::plan::Plan;
use crate::synth::linker::{self, ENTRY, Linked};
use crate::synth::tables::Tables;
use insonify_gpu::{Access, Dispatch, GpuError, Loops, PassSource, Pipeline, StorageBuffer};

/// Every loop of these shaders counts towards a bound that does not change within it, or narrows an interval of
/// integers.
#[allow(unsafe_code, reason = "says that loops end")]
// SAFETY: as above.
const LOOPS: Loops = unsafe { Loops::ending() };

/// A dispatch of a frame.
pub(super) struct Step {
    pub(super) passes: Vec<&'static Pass>,
    pipeline: Pipeline,
    bindings: wgpu::BindGroup,
    pub(super) band: Band,
    /// Start of its blocks of parameters in the uploads, one a frame.
    pub(super) blocks_at: usize,
    /// Workgroups of one frame.
    pub(super) workgroups: [u32; 3],
}

impl GpuExecutor {
    pub(super) fn most_buffers(&self) -> usize {
        // One is taken by the parameters.
        (self.gpu.limits().max_storage_buffers_per_shader_stage as usize - 1).min(MAX_BUFFERS)
    }

    /// Dispatches of passes, with their constants in the uploads.
    pub(super) fn steps(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        fused: Vec<Fused>,
        mut blocks_at: usize,
    ) -> Result<Vec<Step>, GpuError> {
        let all_rows = Band {
            first_row: 0,
            rows: tables.height() as u32,
        };
        let bound = plan.bound();
        let mut steps = Vec::new();
        for fused in fused {
            let linked = linker::link(&bound, &fused);
            // Kept by source: other settings mostly link to the same.
            let pipeline = match self.pipelines.get(&linked.source) {
                Some(pipeline) => pipeline.clone(),
                None => {
                    let pipeline = self.pipeline(&bound, &fused, &linked)?;
                    self.pipelines.insert(linked.source.clone(), pipeline.clone());
                    pipeline
                }
            };
            let passes: Vec<&'static Pass> = numbers_of(&fused).map(|pass| bound[pass].pass).collect();
            // Buffers of the beam fit whole; those of pixels may exceed a binding.
            let bands: Cow<[Band]> = if passes.iter().any(|pass| is_per_pixel(pass)) {
                self.bands.clone().into()
            } else {
                vec![all_rows].into()
            };
            for (part, &band) in bands.iter().enumerate() {
                let extents: Vec<_> = passes.iter().map(|pass| pass.grid.workgroups(tables, band)).collect();
                self.write_constants(blocks_at, &extents, &linked, part);
                steps.push(Step {
                    bindings: self.bind(&pipeline, &linked, part, blocks_at)?,
                    pipeline: pipeline.clone(),
                    band,
                    blocks_at,
                    workgroups: linker::workgroups(&bound, &fused, &extents),
                    passes: passes.clone(),
                });
                blocks_at += self.frames * linker::block_bytes(passes.len());
            }
        }
        Ok(steps)
    }

    /// Writes the extents of the passes and the strides between the frames of each buffer into the blocks of a
    /// dispatch.
    fn write_constants(&mut self, blocks_at: usize, extents: &[[u32; 3]], linked: &Linked, part: usize) {
        let (block, passes) = (linker::block_bytes(extents.len()), extents.len());
        let extents = extents.iter().flat_map(|&[x, y, z]| [x, y, z, 0]);
        let strides = linked.buffers.iter().map(|bound| {
            let per_frame = self
                .uploads
                .per_frame
                .iter()
                .find(|(buffer, ..)| *buffer == bound.buffer);
            let part = if bound.buffer.is_per_pixel { part } else { 0 };
            let bytes = match per_frame {
                Some(&(_, _, bytes)) => bytes as u64,
                None => self.buffers.get(&(bound.buffer, part)).map_or(0, StorageBuffer::bytes) / self.frames as u64,
            };
            bytes as u32 / bound.element
        });
        let constants: Vec<u32> = extents.chain(strides).collect();
        let constants_at = blocks_at + passes * ParamBlock::CAPACITY;
        for frame in 0..self.frames {
            let of_frame = &mut self.uploads.contents[constants_at + frame * block..];
            of_frame[..4 * constants.len()].copy_from_slice(bytemuck::cast_slice(&constants));
        }
    }

    pub(super) fn make_single(&mut self, plan: &Plan, tables: &Tables) -> Result<(), GpuError> {
        if self.single.is_empty() {
            let alone = |pass| {
                vec![Sequence {
                    passes: vec![pass],
                    by_line: false,
                }]
            };
            let alone = (0..plan.passes.len()).map(alone).collect();
            self.single = self.steps(plan, tables, alone, self.uploads.single_at)?;
        }
        Ok(())
    }

    fn pipeline(&self, bound: &[Bound], fused: &Fused, linked: &Linked) -> Result<Pipeline, GpuError> {
        let names: Vec<&str> = numbers_of(fused).map(|pass| bound[pass].pass.name).collect();
        let storage: Vec<Access> = linked.buffers.iter().map(|bound| bound.access).collect();
        let source = PassSource {
            label: &names.join(" + "),
            source: &linked.source,
            entry: ENTRY,
            storage: &storage,
            loops: LOOPS,
        };
        Pipeline::with_block(&self.gpu, &source, linker::block_bytes(linked.passes) as u64)
    }

    fn bind(
        &self,
        pipeline: &Pipeline,
        linked: &Linked,
        part: usize,
        blocks_at: usize,
    ) -> Result<wgpu::BindGroup, GpuError> {
        let uploads = self.uploads_buffer()?;
        let blocks = uploads.part(
            blocks_at as u64,
            (self.frames * linker::block_bytes(linked.passes)) as u64,
        );
        let storage = linked.buffers.iter().map(|bound| {
            let buffer = bound.buffer;
            let per_frame = self.uploads.per_frame.iter().find(|(known, ..)| *known == buffer);
            match per_frame {
                Some(&(_, start, bytes)) => uploads.part(start as u64, (self.frames * bytes) as u64),
                None if buffer.is_packed => uploads.part(0, uploads.bytes()),
                None => self.buffers[&(buffer, if buffer.is_per_pixel { part } else { 0 })].entire(),
            }
        });
        pipeline.bind_parts(&self.gpu, blocks, &storage.collect::<Vec<_>>())
    }
}

/// Dispatches of steps, for a number of frames.
pub(super) fn dispatches(steps: &[Step], frames: usize) -> impl Iterator<Item = Dispatch<'_>> {
    steps.iter().map(move |step| {
        let [x, y, z] = step.workgroups;
        Dispatch {
            pipeline: &step.pipeline,
            bindings: &step.bindings,
            slot: 0,
            workgroups: [x, y, z * frames as u32],
        }
    })
}

/// Numbers of the passes of a dispatch, in the order in which it has them.
pub(super) fn numbers_of(fused: &Fused) -> impl Iterator<Item = usize> + '_ {
    fused.iter().flat_map(|sequence| &sequence.passes).copied()
}

pub(super) fn is_per_pixel(pass: &Pass) -> bool {
    pass.bindings.iter().any(|(buffer, _)| buffer.is_per_pixel)
}
