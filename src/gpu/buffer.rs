//! Labelled storage buffers, checked against the limits of the device.

use std::sync::{Arc, PoisonError, Weak};

use bytemuck::NoUninit;

use super::faults::check_limit;
use super::{Gpu, GpuError};

/// A storage buffer that passes read and write, and that can be written from and copied to the CPU.
#[derive(Debug, Clone)]
pub struct StorageBuffer {
    label: String,
    buffer: Arc<wgpu::Buffer>,
}

/// Buffers of a device that are shared, by the hash of their contents.
pub(super) type Shared = Vec<(blake3::Hash, Weak<wgpu::Buffer>)>;

impl StorageBuffer {
    /// Creates a buffer of at least `bytes` zeros; sizes are rounded up to complete 32-bit words, at least one.
    pub fn zeroed(gpu: &Gpu, label: &str, bytes: u64) -> Result<Self, GpuError> {
        gpu.check_storage(&format!("buffer '{label}'"), bytes)?;
        let size = whole_words(bytes.max(1));
        let descriptor = wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        let buffer = gpu.scoped(&format!("making buffer '{label}'"), || {
            Ok(gpu.device().create_buffer(&descriptor))
        })?;
        Ok(Self {
            label: label.to_owned(),
            buffer: buffer.into(),
        })
    }

    /// Creates a buffer that contains `data`.
    pub fn upload<T: NoUninit>(gpu: &Gpu, label: &str, data: &[T]) -> Result<Self, GpuError> {
        let buffer = Self::zeroed(gpu, label, size_of_val(data) as u64)?;
        buffer.write(gpu, 0, data)?;
        Ok(buffer)
    }

    /// Returns a buffer that contains `data` and is never written again: the one that this call made for the same
    /// contents on this device, as long as it is in use.
    pub fn shared(gpu: &Gpu, label: &str, data: &[u8]) -> Result<Self, GpuError> {
        let hash = blake3::hash(data);
        let mut shared = gpu.shared().lock().unwrap_or_else(PoisonError::into_inner);
        shared.retain(|(_, buffer)| buffer.strong_count() > 0);
        let known = shared.iter().find(|(known, _)| *known == hash);
        if let Some(buffer) = known.and_then(|(_, buffer)| buffer.upgrade()) {
            let label = label.to_owned();
            return Ok(Self { label, buffer });
        }
        let buffer = Self::upload(gpu, label, data)?;
        shared.push((hash, Arc::downgrade(&buffer.buffer)));
        Ok(buffer)
    }

    /// Overwrites from `byte_offset`, a multiple of 4, before the next submission. Bytes up to the next word
    /// boundary after `data` become zero.
    pub fn write<T: NoUninit>(&self, gpu: &Gpu, byte_offset: u64, data: &[T]) -> Result<(), GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        if bytes.is_empty() {
            return gpu.check();
        }
        self.check_span("written", byte_offset, bytes.len() as u64)?;
        gpu.counter().sent(whole_words(bytes.len() as u64));
        let (words, tail) = bytes.split_at(bytes.len() - bytes.len() % WORD as usize);
        gpu.scoped(&self.label, || {
            if !words.is_empty() {
                gpu.queue().write_buffer(&self.buffer, byte_offset, words);
            }
            if !tail.is_empty() {
                let mut word = [0; WORD as usize];
                word[..tail.len()].copy_from_slice(tail);
                gpu.queue()
                    .write_buffer(&self.buffer, byte_offset + words.len() as u64, &word);
            }
            Ok(())
        })
    }

    /// Label of the buffer.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Size, bytes, a multiple of 4.
    pub fn bytes(&self) -> u64 {
        self.buffer.size()
    }

    /// All of it, to be bound.
    pub fn entire(&self) -> wgpu::BufferBinding<'_> {
        self.buffer.as_entire_buffer_binding()
    }

    /// Part of it, to be bound: from a multiple of 256 bytes on.
    pub fn part(&self, offset: u64, bytes: u64) -> wgpu::BufferBinding<'_> {
        wgpu::BufferBinding {
            buffer: &self.buffer,
            offset,
            size: wgpu::BufferSize::new(whole_words(bytes)),
        }
    }

    /// Underlying wgpu buffer.
    pub fn raw(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    pub(super) fn check_span(&self, verb: &str, byte_offset: u64, bytes: u64) -> Result<(), GpuError> {
        let end = byte_offset.saturating_add(whole_words(bytes));
        if end <= self.bytes() {
            return Ok(());
        }
        let what = format!("bytes {verb} of buffer '{}'", self.label);
        Err(GpuError::Mismatch {
            what,
            expected: self.bytes(),
            found: end,
        })
    }
}

/// Granularity of copies and writes: 32-bit words.
const WORD: u64 = wgpu::COPY_BUFFER_ALIGNMENT;

pub(super) fn whole_words(bytes: u64) -> u64 {
    bytes.saturating_add(WORD - 1) / WORD * WORD
}

// Parameters of all passes in one storage buffer, written once per frame.
//
// A uniform buffer is avoided: if a uniform decides a branch or ends a loop, software Vulkan (lavapipe of Mesa 22.3)
// recompiles the pass at every dispatch and keeps the result as long as the device exists.

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
        gpu.counter().sent(self.values.len() as u64);
        gpu.scoped(&self.label, || {
            gpu.queue().write_buffer(&self.buffer, 0, &self.values);
            Ok(())
        })
    }

    /// A slot, to be bound with its offset.
    pub fn slot(&self) -> wgpu::BufferBinding<'_> {
        wgpu::BufferBinding {
            buffer: &self.buffer,
            offset: 0,
            size: wgpu::BufferSize::new(SLOT_BYTES),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Readback, testing};

    fn contents(gpu: &Gpu, buffer: &StorageBuffer, bytes: usize) -> Vec<u8> {
        let mut readback = Readback::new(gpu, "contents", buffer.bytes()).unwrap();
        gpu.submit("copy", |recorder| recorder.read_back(buffer, &readback))
            .unwrap();
        let mut out = vec![0xAA; bytes];
        readback.read(gpu, &mut out).unwrap();
        out
    }

    #[test]
    fn odd_sizes_come_back_as_written() {
        let Some(gpu) = testing::open() else { return };
        for length in [0_usize, 1, 2, 3, 4, 5, 7, 255, 256, 257, 4099] {
            let data: Vec<u8> = (0..length).map(|i| (i * 31 + 7) as u8).collect();
            let buffer = StorageBuffer::upload(&gpu, "odd", &data).unwrap();
            assert_eq!(contents(&gpu, &buffer, length), data, "{length} bytes");
        }
    }

    #[test]
    fn a_write_in_the_middle_leaves_the_rest() {
        let Some(gpu) = testing::open() else { return };
        let buffer = StorageBuffer::zeroed(&gpu, "middle", 12).unwrap();
        buffer.write(&gpu, 4, &[0x0403_0201_u32]).unwrap();
        assert_eq!(contents(&gpu, &buffer, 12), [0, 0, 0, 0, 1, 2, 3, 4, 0, 0, 0, 0]);
        assert!(matches!(
            buffer.write(&gpu, 8, &[0_u32; 2]),
            Err(GpuError::Mismatch {
                expected: 12,
                found: 16,
                ..
            })
        ));
        assert!(matches!(
            buffer.write(&gpu, 2, &[0_u32]),
            Err(GpuError::Validation { .. })
        ));
        assert_eq!(gpu.check(), Ok(()), "a caught error is not reported twice");
    }

    #[test]
    fn a_buffer_beyond_the_limit_is_refused_by_name() {
        let Some(gpu) = testing::open() else { return };
        let available = gpu.limits().max_storage_buffer_binding_size;
        assert_eq!(
            testing::exceeded("large", StorageBuffer::zeroed(&gpu, "large", available + 1)),
            ("max_storage_buffer_binding_size", available + 1, available)
        );
    }
}
