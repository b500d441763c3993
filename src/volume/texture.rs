//! Solid textures: periodic volumes of echo amplitude multipliers, sampled trilinearly in the tissue's reference state.
//!
//! A texture's mean square is 1, so that a tissue's echogenicity is its mean echo power whatever its texture.

mod atlas;
mod run;
mod seam;

#[cfg(feature = "internals")]
pub use atlas::AtlasEntry;
pub use atlas::{Atlas, Placement};
pub use seam::{Seam, TextureOptions, Values};

use super::VolumeError;
use crate::real::Real;

/// A periodic volume of amplitude multipliers with mean square 1. The centre of voxel (0, 0, 0) lies at the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct SolidTexture {
    size: [usize; 3],
    spacing_mm: [f64; 3],
    data: Vec<f32>,
}

/// Longest axis, voxels: the product of three such axes is far from overflowing.
const LONGEST_AXIS: usize = 16_384;

impl SolidTexture {
    /// Creates a texture that repeats every `size` times `spacing_mm`, from amplitudes with x fastest, and scales it to
    /// mean square 1. The data are assumed periodic; [`Self::from_scalar`] makes other data periodic.
    pub fn new(size: [usize; 3], spacing_mm: [f64; 3], mut data: Vec<f32>) -> Result<Self, VolumeError> {
        check_frame(size, spacing_mm, data.len())?;
        if let Some(at) = data.iter().position(|value| !(value.is_finite() && *value >= 0.0)) {
            return Err(wrong_amplitude(at, data[at]));
        }
        let square = data.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>() / data.len() as f64;
        if square == 0.0 {
            return Err(VolumeError::new("every voxel is 0: a texture needs at least one echo"));
        }
        let factor = 1.0 / square.sqrt();
        for value in &mut data {
            *value = (f64::from(*value) * factor) as f32;
        }
        Ok(Self { size, spacing_mm, data })
    }

    /// Creates a texture from the voxels of any scalar image: converts them to amplitudes and closes the seam according
    /// to `options`. The size may change: see [`Seam`].
    pub fn from_scalar(
        size: [usize; 3],
        spacing_mm: [f64; 3],
        data: Vec<f32>,
        options: &TextureOptions,
    ) -> Result<Self, VolumeError> {
        check_frame(size, spacing_mm, data.len())?;
        options.check()?;
        if let Some(at) = data.iter().position(|value| !value.is_finite()) {
            return Err(wrong_amplitude(at, data[at]));
        }
        let amplitudes = options.values.to_amplitudes(data);
        let (size, amplitudes) = options.seam.close(size, amplitudes);
        Self::new(size, spacing_mm, amplitudes)
    }

    /// Number of voxels along each axis.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Distance between neighbouring voxel centres along each axis, mm.
    pub fn spacing_mm(&self) -> [f64; 3] {
        self.spacing_mm
    }

    /// Period along each axis, mm.
    pub fn period_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.size[axis] as f64 * self.spacing_mm[axis])
    }

    /// Amplitude multipliers, x fastest.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Multiplier at a position in the texture's own frame, mm.
    pub fn sample<T: Real>(&self, position_mm: [T; 3]) -> T {
        let index = [0, 1, 2].map(|axis| position_mm[axis] / T::of(self.spacing_mm[axis]));
        trilinear(&self.data, self.size.map(|n| n as u32), index)
    }
}

fn wrong_amplitude(at: usize, value: f32) -> VolumeError {
    VolumeError::new(format!(
        "voxel {at} has amplitude {value}: expected finite numbers from 0"
    ))
}

fn check_frame(size: [usize; 3], spacing_mm: [f64; 3], found: usize) -> Result<(), VolumeError> {
    if !size.iter().all(|n| (1..=LONGEST_AXIS).contains(n)) {
        return Err(VolumeError::new(format!(
            "size {size:?}: expected 1 to 16384 voxels along each axis"
        )));
    }
    if !spacing_mm.iter().all(|&length| length.is_finite() && length > 0.0) {
        let text = format!("spacing {spacing_mm:?} mm: expected finite numbers above 0");
        return Err(VolumeError::option("spacing_mm", text));
    }
    let expected = size.iter().product();
    if found != expected {
        return Err(VolumeError::wrong_count(found, expected));
    }
    Ok(())
}

/// Periodic trilinear interpolation at a fractional voxel index.
#[inline]
fn trilinear<T: Real>(data: &[f32], size: [u32; 3], index: [T; 3]) -> T {
    let mut at = Corners::default();
    for axis in 0..3 {
        at.place(axis, index[axis], size[axis]);
    }
    at.mix(data, size)
}

/// The eight voxels around a fractional index, and the fractions between them.
#[derive(Clone, Copy, Default)]
struct Corners<T> {
    near: [u32; 3],
    far: [u32; 3],
    share: [T; 3],
}

impl<T: Real> Corners<T> {
    #[inline(always)]
    fn place(&mut self, axis: usize, index: T, length: u32) {
        let cut = index.truncate();
        let floor = cut.wrapping_sub(i32::from(index < T::from_signed(cut)));
        self.share[axis] = index - T::from_signed(floor);
        self.near[axis] = wrap(floor, length as i32);
        let next = self.near[axis] + 1;
        self.far[axis] = if next == length { 0 } else { next };
    }

    /// Eight loads and seven linear interpolations, in the order of the shader's `sample_texture`.
    #[inline(always)]
    fn mix(&self, data: &[f32], size: [u32; 3]) -> T {
        let Self { near, far, share } = self;
        let (row, slab) = (size[0], size[0] * size[1]);
        let at = |i: u32, j: u32, k: u32| T::of(f64::from(data[(i + row * j + slab * k) as usize]));
        let mix = |a: T, b: T, t: T| a + t * (b - a);
        let edge = |j: u32, k: u32| mix(at(near[0], j, k), at(far[0], j, k), share[0]);
        let lower = mix(edge(near[1], near[2]), edge(far[1], near[2]), share[1]);
        let upper = mix(edge(near[1], far[2]), edge(far[1], far[2]), share[1]);
        mix(lower, upper, share[2])
    }
}

/// Non-negative remainder of a division. A float quotient, off by at most one below 2^22 or so, is several times faster
/// than an integer division, and runs in vector registers.
#[inline(always)]
fn wrap(index: i32, length: i32) -> u32 {
    let quotient = (index as f32 / length as f32) as i32;
    let rest = index.wrapping_sub(quotient.wrapping_mul(length));
    let rest = if rest < 0 { rest.wrapping_add(length) } else { rest };
    let rest = if rest >= length {
        rest.wrapping_sub(length)
    } else {
        rest
    };
    // Larger indices give an arbitrary but valid voxel.
    (rest as u32).min(length as u32 - 1)
}

#[cfg(test)]
mod tests;
