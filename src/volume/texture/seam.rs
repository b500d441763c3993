//! Conversion of texture files to periodic amplitudes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::volume::VolumeError;

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
    relined(size, data, axis, 2 * n, |at, line| {
        line(if at < n { at } else { 2 * n - 1 - at })
    })
}

fn cross_fade(size: [usize; 3], data: &[f32], axis: usize, share: f64) -> ([usize; 3], Vec<f32>) {
    let n = size[axis];
    let overlap = ((share * n as f64).round() as usize).clamp(1, n / 2);
    let mean = (data.iter().map(|&x| f64::from(x)).sum::<f64>() / data.len() as f64) as f32;
    relined(size, data, axis, n - overlap, |at, line| {
        if at >= overlap {
            return line(at);
        }
        let weight = at as f32 / overlap as f32;
        let blend = weight * (line(at) - mean) + (1.0 - weight) * (line(n - overlap + at) - mean);
        let deviation = (weight * weight + (1.0 - weight) * (1.0 - weight)).sqrt();
        (mean + blend / deviation).max(0.0)
    })
}
