//! Atlas of all textures of a scene in one buffer, as read by the shaders.

use bytemuck::{Pod, Zeroable};

use super::{SolidTexture, trilinear};
use crate::real::Real;
use crate::volume::VolumeError;

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
                        let most = "at most 4294967295 fit one atlas";
                        return Err(VolumeError::new(format!(
                            "the textures hold {voxels} voxels together; {most}"
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

    /// Multiplier of texture `entry` at a position, mm, relative to its voxel (0, 0, 0). `entry` must be below the number of entries.
    #[inline]
    pub fn sample<T: Real>(&self, entry: usize, position_mm: [T; 3]) -> T {
        let AtlasEntry { to_voxel, size, offset } = self.entries[entry];
        let index = to_voxel.map(|row| {
            let [x, y, z] = [row[0], row[1], row[2]].map(|number| T::of(f64::from(number)));
            x * position_mm[0] + y * position_mm[1] + z * position_mm[2]
        });
        trilinear(&self.data[offset as usize..], size, index)
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
