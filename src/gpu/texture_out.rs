//! Grey frame as a GPU texture, for drawing by a host.
//!
//! `R8Unorm` is not a storage format, so passes write packed grey (four pixels per 32-bit word, the leftmost in the
//! lowest byte) into a buffer whose rows are padded, and a copy fills the texture.

use super::faults::check_limit;
use super::{Gpu, GpuError, StorageBuffer};

/// Bytes from one row of packed grey to the next, for rows of `width` pixels: copies into textures require multiples
/// of 256.
pub const fn row_stride(width: u32) -> u64 {
    (width as u64).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as u64)
}

/// An `R8Unorm` texture of one frame, to be sampled or copied by its host.
#[derive(Debug, Clone)]
pub struct TextureOut {
    texture: wgpu::Texture,
}

impl TextureOut {
    /// Creates a black texture of `width` by `height` pixels, both at least 1.
    pub fn new(gpu: &Gpu, width: u32, height: u32) -> Result<Self, GpuError> {
        let largest = u64::from(gpu.limits().max_texture_dimension_2d);
        let longest = u64::from(width.max(height));
        check_limit(
            || format!("a frame of {width} x {height} pixels"),
            "max_texture_dimension_2d",
            longest,
            largest,
        )?;
        let descriptor = wgpu::TextureDescriptor {
            label: Some("frame"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::R8Unorm,
            usage: wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        };
        let texture = gpu.scoped("making the frame's texture", || {
            Ok(gpu.device().create_texture(&descriptor))
        })?;
        Ok(Self { texture })
    }

    /// Underlying texture; its clones share the pixels.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// Records the copy of `pixels`: rows of [`row_stride`] bytes, four grey pixels per word.
    pub fn copy(&self, encoder: &mut wgpu::CommandEncoder, pixels: &StorageBuffer) -> Result<(), GpuError> {
        let size = self.texture.size();
        let stride = row_stride(size.width);
        pixels.check_span("copied to a texture", 0, stride * u64::from(size.height))?;
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(stride as u32),
            rows_per_image: None,
        };
        encoder.copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo {
                buffer: pixels.raw(),
                layout,
            },
            self.texture.as_image_copy(),
            size,
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Readback, testing};

    #[test]
    fn strides_are_whole_multiples_of_256() {
        assert_eq!([1, 256, 257, 640].map(row_stride), [256, 256, 512, 768]);
        assert_eq!(row_stride(u32::MAX), 1 << 32);
    }

    #[test]
    fn pixels_of_odd_widths_arrive_where_they_belong() {
        let Some(gpu) = testing::open() else { return };
        for (width, height) in [(1_u32, 1_u32), (5, 3), (257, 2)] {
            let stride = row_stride(width) as usize;
            let grey = |x: usize, y: usize| (x * 3 + y * 101 + 1) as u8;
            let padded: Vec<u8> = (0..stride * height as usize)
                .map(|i| grey(i % stride, i / stride))
                .collect();
            let pixels = StorageBuffer::upload(&gpu, "pixels", &padded).unwrap();
            let out = TextureOut::new(&gpu, width, height).unwrap();
            let mut readback = Readback::new(&gpu, "texture", padded.len() as u64).unwrap();
            gpu.submit("frame", |recorder| {
                recorder.copy_to_texture(&pixels, &out)?;
                let layout = wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(stride as u32),
                    rows_per_image: None,
                };
                let to = wgpu::TexelCopyBufferInfo {
                    buffer: readback.raw(),
                    layout,
                };
                recorder
                    .encoder()
                    .copy_texture_to_buffer(out.texture().as_image_copy(), to, out.texture().size());
                Ok(())
            })
            .unwrap();
            let (width, height) = (width as usize, height as usize);
            let mut pixels = vec![0; width * height];
            readback.read_rows(&gpu, &mut pixels, width, stride).unwrap();
            let expected: Vec<u8> = (0..width * height).map(|i| grey(i % width, i / width)).collect();
            assert_eq!(pixels, expected, "{width} x {height}");
        }
    }

    #[test]
    fn sizes_out_of_range_are_errors() {
        let Some(gpu) = testing::open() else { return };
        let largest = gpu.limits().max_texture_dimension_2d;
        let (limit, ..) = testing::exceeded("a frame of 1 x", TextureOut::new(&gpu, 1, largest + 1));
        assert_eq!(limit, "max_texture_dimension_2d");
        assert!(matches!(TextureOut::new(&gpu, 0, 1), Err(GpuError::Validation { .. })));
        let out = TextureOut::new(&gpu, 300, 2).unwrap();
        let tight = StorageBuffer::zeroed(&gpu, "tight", 600).unwrap();
        let copied = gpu.submit("frame", |recorder| recorder.copy_to_texture(&tight, &out));
        assert!(
            matches!(
                copied,
                Err(GpuError::Mismatch {
                    expected: 600,
                    found: 1024,
                    ..
                })
            ),
            "{copied:?}"
        );
    }
}
