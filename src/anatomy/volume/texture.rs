//! Solid textures: periodic volumes of echo amplitude multipliers, sampled trilinearly in the tissue's reference state.
//!
//! A texture's mean square is 1, so that a tissue's echogenicity is its mean echo power whatever its texture.

use bytemuck::{Pod, Zeroable};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::VolumeError;
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, map};

/// A periodic volume of amplitude multipliers with mean square 1. The centre of voxel (0, 0, 0) lies at the origin.
///
/// ```
/// use insonify_anatomy::volume::texture::SolidTexture;
///
/// // Bright layers, 2 mm apart.
/// let layers = SolidTexture::new([4, 1, 1], [0.5, 1.0, 1.0], vec![3.0, 1.0, 1.0, 1.0])?;
/// assert_eq!(layers.period_mm(), [2.0, 1.0, 1.0]);
/// let [bright, dark, next] = [0.0, 1.0, 2.0].map(|x| layers.sample([x, 0.0, 0.0]));
/// assert!((bright / dark - 3.0_f64).abs() < 1e-6 && bright == next);
/// # Ok::<(), insonify_anatomy::volume::VolumeError>(())
/// ```
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
        if let Some(voxel) = data.iter().position(|value| !(value.is_finite() && *value >= 0.0)) {
            return Err(wrong_amplitude(voxel, data[voxel]));
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
        if let Some(voxel) = data.iter().position(|value| !value.is_finite()) {
            return Err(wrong_amplitude(voxel, data[voxel]));
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
        trilinear(&self.data, self.size.map(|n| n as u32), &index.map(|x| [x]))[0]
    }
}

fn wrong_amplitude(voxel: usize, value: f32) -> VolumeError {
    VolumeError::new(format!(
        "voxel {voxel} has amplitude {value}: expected finite numbers from 0"
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

/// Periodic trilinear interpolation at fractional voxel indices, axis by axis, in the order of the shader's
/// `sample_texture`.
#[inline(always)]
fn trilinear<T: Real, const N: usize>(data: &[f32], size: [u32; 3], index: &[[T; N]; 3]) -> [T; N] {
    let mut sides = [[[0u32; N]; 2]; 3];
    let mut share = [[T::zero(); N]; 3];
    for (axis, pitch) in [1, size[0], size[0] * size[1]].into_iter().enumerate() {
        for i in 0..N {
            let floor = index[axis][i].floor();
            share[axis][i] = index[axis][i] - floor;
            let near = wrap(floor.integer(), size[axis] as i32);
            let far = if near + 1 == size[axis] { 0 } else { near + 1 };
            sides[axis][0][i] = near * pitch;
            sides[axis][1][i] = far * pitch;
        }
    }
    let mut voxels = [[T::zero(); N]; 8];
    for i in 0..N {
        for (corner, voxel) in voxels.iter_mut().enumerate() {
            let entry = sides[0][corner & 1][i] + sides[1][corner >> 1 & 1][i] + sides[2][corner >> 2][i];
            voxel[i] = T::of(f64::from(data[entry as usize]));
        }
    }
    let mix = |a: T, b: T, t: T| a + t * (b - a);
    let mut values = [T::zero(); N];
    for i in 0..N {
        let edge = |corner: usize| mix(voxels[corner][i], voxels[corner + 1][i], share[0][i]);
        let slab = |corner: usize| mix(edge(corner), edge(corner + 2), share[1][i]);
        values[i] = mix(slab(0), slab(4), share[2][i]);
    }
    values
}

/// Non-negative remainder of a division. A float quotient, off by at most one below 2^22 or so, is several times faster
/// than an integer division, and runs in vector registers.
#[inline(always)]
fn wrap(index: i32, length: i32) -> u32 {
    let quotient = (index as f32 / length as f32).trunc().integer();
    let remainder = index.wrapping_sub(quotient.wrapping_mul(length));
    let remainder = if remainder < 0 {
        remainder.wrapping_add(length)
    } else {
        remainder
    };
    let remainder = if remainder >= length {
        remainder.wrapping_sub(length)
    } else {
        remainder
    };
    // Larger indices give an arbitrary but valid voxel.
    (remainder as u32).min(length as u32 - 1)
}

// Atlas of all textures of a scene in one buffer, as read by the shaders.

/// Placement of a texture in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rows of the rotation from world directions to the texture's axes.
    pub rotation: [[f64; 3]; 3],
    /// Scale of its lengths: 2 makes every structure twice as large.
    pub scale: f64,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            scale: 1.0,
        }
    }
}

/// A placed texture of an [`Atlas`]: 64 bytes, laid out as `TextureEntry` in `shaders/common/texture.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct AtlasEntry {
    /// Rows of the affine map from a position in mm to a fractional voxel index; the fourth number is padding.
    pub to_voxel: [[f32; 4]; 3],
    /// Number of voxels along each axis.
    pub size: [u32; 3],
    /// Index of voxel (0, 0, 0) in the atlas's data.
    pub offset: u32,
}

/// Textures packed into one buffer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atlas {
    /// Amplitude multipliers of all textures, concatenated, each with x fastest.
    pub data: Vec<f32>,
    /// Placed textures, in the order given.
    pub entries: Vec<AtlasEntry>,
}

impl Atlas {
    /// Packs the textures. A texture given several times, by reference to the same memory, is stored once.
    pub fn pack(textures: &[(&SolidTexture, Placement)]) -> Result<Self, VolumeError> {
        let mut atlas = Self::default();
        let mut stored: Vec<(&SolidTexture, u32)> = Vec::new();
        for &(texture, placement) in textures {
            let known = stored.iter().find(|(other, _)| std::ptr::eq(*other, texture));
            let offset = match known {
                Some(&(_, offset)) => offset,
                None => {
                    let voxels = (atlas.data.len() + texture.data.len()) as u64;
                    if voxels > u64::from(u32::MAX) {
                        let limit = "at most 4294967295 fit one atlas";
                        return Err(VolumeError::new(format!(
                            "the textures hold {voxels} voxels together; {limit}"
                        )));
                    }
                    let offset = atlas.data.len() as u32;
                    atlas.data.extend_from_slice(&texture.data);
                    stored.push((texture, offset));
                    offset
                }
            };
            atlas.entries.push(AtlasEntry::new(texture, placement, offset));
        }
        Ok(atlas)
    }

    /// Multiplier of texture `entry` at a position, mm, relative to its voxel (0, 0, 0). `entry` must be below the
    /// number of entries.
    #[inline]
    pub fn sample<T: Real>(&self, entry: usize, position_mm: [T; 3]) -> T {
        let AtlasEntry { to_voxel, size, offset } = self.entries[entry];
        let index = to_voxel.map(|row| {
            let [x, y, z] = [row[0], row[1], row[2]].map(|number| T::of(f64::from(number)));
            x * position_mm[0] + y * position_mm[1] + z * position_mm[2]
        });
        trilinear(&self.data[offset as usize..], size, &index.map(|x| [x]))[0]
    }
}

impl AtlasEntry {
    fn new(texture: &SolidTexture, placement: Placement, offset: u32) -> Self {
        let mut to_voxel = [[0.0; 4]; 3];
        for (axis, row) in to_voxel.iter_mut().enumerate() {
            let per_mm = 1.0 / (texture.spacing_mm[axis] * placement.scale);
            for (number, direction) in row.iter_mut().zip(placement.rotation[axis]) {
                *number = (direction * per_mm) as f32;
            }
        }
        Self {
            to_voxel,
            size: texture.size.map(|n| n as u32),
            offset,
        }
    }
}

/// Number of positions in a batch.
const BLOCK: usize = 32;

impl Atlas {
    /// Multiplies each amplitude by the multiplier of texture `entry` at its position (mm; the fourth component is
    /// ignored), whose deviation from 1 is scaled by `strength`.
    pub fn apply<T: Real>(&self, entry: usize, strength: T, positions: &[[T; 4]], amplitudes: &mut [T]) {
        T::vectorised(Apply {
            atlas: self,
            entry,
            strength,
            positions,
            amplitudes,
        });
    }
}

struct Apply<'a, T> {
    atlas: &'a Atlas,
    entry: usize,
    strength: T,
    positions: &'a [[T; 4]],
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Apply<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let AtlasEntry { to_voxel, size, offset } = self.atlas.entries[self.entry];
        let rows = map(to_voxel, |row| map(row, |number| T::of(f64::from(number))));
        let data = &self.atlas.data[offset as usize..];
        for start in (0..self.positions.len()).step_by(BLOCK) {
            let end = self.positions.len().min(start + BLOCK);
            let (positions, amplitudes) = (&self.positions[start..end], &mut self.amplitudes[start..end]);
            let mut index = [[T::zero(); BLOCK]; 3];
            for axis in 0..3 {
                let [x, y, z, _] = rows[axis];
                for (number, position) in positions.iter().enumerate() {
                    index[axis][number] = x * position[0] + y * position[1] + z * position[2];
                }
            }
            let multipliers: [T; BLOCK] = trilinear(data, size, &index);
            for (amplitude, multiplier) in amplitudes.iter_mut().zip(multipliers) {
                *amplitude *= T::one() + self.strength * (multiplier - T::one());
            }
        }
    }
}

// Conversion of texture files to periodic amplitudes.

/// Options for converting a scalar image to a texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TextureOptions {
    /// Meaning of the voxel values.
    pub values: Values,
    /// Method for making the texture periodic.
    pub seam: Seam,
}

/// Meaning of the voxel values of a texture file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Values {
    /// Echo amplitudes, in any positive scale.
    #[default]
    Amplitude,
    /// Log-compressed grey levels or decibels.
    Log {
        /// Decibels per unit, above 0 to 20: 1 for decibels, 60/255 for 8-bit grey levels over a range of 60 dB.
        db_per_unit: f64,
    },
}

/// Method for making a texture periodic without a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Seam {
    /// The data are already periodic.
    Periodic,
    /// Each axis runs forwards and backwards: exact copies, twice as long, with visible mirror planes.
    Mirror,
    /// The end of each axis is blended into its beginning, which shortens it by the overlap. The blend preserves the
    /// variance of independent halves: plain averaging would leave a band of lower contrast.
    CrossFade {
        /// Overlap as a fraction of the axis, above 0 to 0.5.
        share: f64,
    },
}

impl Default for Seam {
    fn default() -> Self {
        Self::CrossFade { share: 0.2 }
    }
}

impl TextureOptions {
    pub(super) fn check(&self) -> Result<(), VolumeError> {
        let within = |key: &'static str, found: f64, high: f64, expected: &str| {
            if found > 0.0 && found <= high {
                Ok(())
            } else {
                Err(VolumeError::option(
                    key,
                    format!("{key} = {found}, expected {expected}"),
                ))
            }
        };
        if let Values::Log { db_per_unit } = self.values {
            within("db_per_unit", db_per_unit, 20.0, "above 0 to 20 dB")?;
        }
        if let Seam::CrossFade { share } = self.seam {
            within("share", share, 0.5, "above 0 to 0.5")?;
        }
        Ok(())
    }
}

impl Values {
    /// Converts to amplitudes up to a common factor; the largest value of log data becomes 1, so that none
    /// overflows.
    pub(super) fn to_amplitudes(self, mut data: Vec<f32>) -> Vec<f32> {
        if let Self::Log { db_per_unit } = self {
            let loudest = data.iter().copied().fold(f32::MIN, f32::max);
            for value in &mut data {
                let db = (f64::from(*value) - f64::from(loudest)) * db_per_unit;
                *value = 10f64.powf(db / 20.0) as f32;
            }
        }
        data
    }
}

impl Seam {
    /// Makes the data periodic and returns them with their new size.
    pub(super) fn close(self, mut size: [usize; 3], mut data: Vec<f32>) -> ([usize; 3], Vec<f32>) {
        for axis in 0..3 {
            (size, data) = match self {
                Self::Mirror if size[axis] > 1 => mirror(size, &data, axis),
                Self::CrossFade { share } if size[axis] > 1 => cross_fade(size, &data, axis, share),
                _ => (size, data),
            };
        }
        (size, data)
    }
}

/// Rebuilds the data with `length` voxels along `axis`; `value` receives the index along the axis and a reader of the
/// old line.
fn relined(
    size: [usize; 3],
    data: &[f32],
    axis: usize,
    length: usize,
    value: impl Fn(usize, &dyn Fn(usize) -> f32) -> f32,
) -> ([usize; 3], Vec<f32>) {
    let mut new_size = size;
    new_size[axis] = length;
    let mut new = Vec::with_capacity(new_size.iter().product());
    for k in 0..new_size[2] {
        for j in 0..new_size[1] {
            for i in 0..new_size[0] {
                let line = |along: usize| {
                    let mut voxel = [i, j, k];
                    voxel[axis] = along;
                    data[voxel[0] + size[0] * (voxel[1] + size[1] * voxel[2])]
                };
                new.push(value([i, j, k][axis], &line));
            }
        }
    }
    (new_size, new)
}

fn mirror(size: [usize; 3], data: &[f32], axis: usize) -> ([usize; 3], Vec<f32>) {
    let n = size[axis];
    relined(size, data, axis, 2 * n, |layer, line| {
        line(if layer < n { layer } else { 2 * n - 1 - layer })
    })
}

fn cross_fade(size: [usize; 3], data: &[f32], axis: usize, share: f64) -> ([usize; 3], Vec<f32>) {
    let n = size[axis];
    let overlap = ((share * n as f64).round() as usize).clamp(1, n / 2);
    let mean = (data.iter().map(|&x| f64::from(x)).sum::<f64>() / data.len() as f64) as f32;
    relined(size, data, axis, n - overlap, |layer, line| {
        if layer >= overlap {
            return line(layer);
        }
        let weight = layer as f32 / overlap as f32;
        let blend = weight * (line(layer) - mean) + (1.0 - weight) * (line(n - overlap + layer) - mean);
        let deviation = (weight * weight + (1.0 - weight) * (1.0 - weight)).sqrt();
        (mean + blend / deviation).max(0.0)
    })
}

#[cfg(test)]
mod tests;
