//! Parameters of all passes in one storage buffer, written once per frame.
//!
//! A uniform buffer is avoided: if a uniform decides a branch or ends a loop, software Vulkan (lavapipe of Mesa 22.3) recompiles
//! the pass at every dispatch and keeps the result as long as the device exists.

use bytemuck::NoUninit;

use super::error::check_limit;
use super::{Gpu, GpuError};

/// Size of one slot, bytes: the largest `min_storage_buffer_offset_alignment` that WebGPU allows a device to
/// require.
pub const SLOT_BYTES: u64 = 256;

/// Slots of [`SLOT_BYTES`] bytes, each the parameter block (binding 0) of one dispatch.
#[derive(Debug)]
pub struct Parameters {
    label: String,
    buffer: wgpu::Buffer,
    values: Vec<u8>,
}

impl Parameters {
    /// Creates `slots` blocks of zeros, at least one.
    pub fn new(gpu: &Gpu, label: &str, slots: u32) -> Result<Self, GpuError> {
        let size = u64::from(slots.max(1)) * SLOT_BYTES;
        check_limit(
            || format!("parameters '{label}'"),
            "max_buffer_size",
            size,
            gpu.limits().max_buffer_size,
        )?;
        let descriptor = wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        let buffer = gpu.scoped(&format!("making parameters '{label}'"), || {
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

    /// Sets a slot on the CPU side. `block` is laid out as its struct in WGSL, at most [`SLOT_BYTES`] bytes; the
    /// rest of the slot is unchanged.
    pub fn set<T: NoUninit>(&mut self, slot: u32, block: &T) -> Result<(), GpuError> {
        let bytes = bytemuck::bytes_of(block);
        let mismatch = |what: &str, expected: u64, found: u64| GpuError::Mismatch {
            what: format!("{what} of parameters '{}' (at most)", self.label),
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

    /// Uploads all slots in one write, effective before the next submission.
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
