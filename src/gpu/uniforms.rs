//! The parameters of all passes in one uniform buffer, written once a frame.

use bytemuck::NoUninit;

use super::error::check_limit;
use super::{Gpu, GpuError};

/// Bytes of one slot: the largest `min_uniform_buffer_offset_alignment` that WebGPU lets a device ask for.
pub const SLOT_BYTES: u64 = 256;

/// Slots of [`SLOT_BYTES`] bytes, each the uniform block (binding 0) of one dispatch.
#[derive(Debug)]
pub struct Uniforms {
    label: String,
    buffer: wgpu::Buffer,
    values: Vec<u8>,
}

impl Uniforms {
    /// `slots` blocks of zeros, at least one.
    pub fn new(gpu: &Gpu, label: &str, slots: u32) -> Result<Self, GpuError> {
        let size = u64::from(slots.max(1)) * SLOT_BYTES;
        check_limit(
            || format!("uniforms '{label}'"),
            "max_buffer_size",
            size,
            gpu.limits().max_buffer_size,
        )?;
        let descriptor = wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        let buffer = gpu.scoped(&format!("making uniforms '{label}'"), || {
            Ok(gpu.device().create_buffer(&descriptor))
        })?;
        Ok(Self {
            label: label.to_owned(),
            buffer,
            values: vec![0; size as usize],
        })
    }

    /// Number of slots.
    pub fn slots(&self) -> u32 {
        (self.buffer.size() / SLOT_BYTES) as u32
    }

    /// Sets a slot on the CPU side. `block` is laid out as WGSL's uniform address space asks, at most
    /// [`SLOT_BYTES`] bytes; the rest of the slot keeps its value.
    pub fn set<T: NoUninit>(&mut self, slot: u32, block: &T) -> Result<(), GpuError> {
        let bytes = bytemuck::bytes_of(block);
        let mismatch = |what: &str, expected: u64, found: u64| GpuError::Mismatch {
            what: format!("{what} of uniforms '{}' (at most)", self.label),
            expected,
            found,
        };
        if bytes.len() as u64 > SLOT_BYTES {
            return Err(mismatch("block bytes", SLOT_BYTES, bytes.len() as u64));
        }
        if slot >= self.slots() {
            return Err(mismatch("slot", u64::from(self.slots() - 1), u64::from(slot)));
        }
        let start = u64::from(slot) * SLOT_BYTES;
        self.values[start as usize..][..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    /// Sends all slots, in one write, to be there before the next submission.
    pub fn write(&self, gpu: &Gpu) -> Result<(), GpuError> {
        gpu.scoped(&self.label, || {
            gpu.queue().write_buffer(&self.buffer, 0, &self.values);
            Ok(())
        })
    }

    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.buffer,
            offset: 0,
            size: wgpu::BufferSize::new(SLOT_BYTES),
        })
    }
}
