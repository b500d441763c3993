//! Resampling of labels through a registration, and its file.

use std::path::Path;

use nalgebra::{Matrix4, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{Quadratic, bounds};
use crate::volume::{LabelVolume, VolumeError};
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::read;

/// Intervals along an edge of the grid on the faces.
const FACE: usize = 20;
/// Maximum number of voxels of a resampled volume.
const MAX: f64 = 2e9;

/// Volume in the world: the map of a registration applied to all labels, each voxel by the majority of eight points.
/// Voxels are cubes of the same volume as before.
///
/// # Errors
/// [`VolumeError`] if the map cannot be inverted at a corner, or the result is too large.
pub fn resample(volume: &LabelVolume, map: &Quadratic) -> Result<LabelVolume, VolumeError> {
    let folded = || VolumeError::new("the registration cannot be inverted on the faces of the volume");
    let world: Option<Vec<Point3<f64>>> = faces(volume).map(|point| map.inverse(&point)).collect();
    let step = volume.voxel_mm3().cbrt();
    // Between the points, faces bulge by less than a voxel.
    let [low, high] = bounds(world.ok_or_else(folded)?.into_iter());
    let (low, high) = (
        low.map(|coordinate| coordinate - step),
        high.map(|coordinate| coordinate + step),
    );
    let size = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / step).ceil().max(1.0));
    if size.iter().product::<f64>() > MAX {
        return Err(VolumeError::new(format!(
            "a resampled volume of {size:?} voxels; expected at most {MAX:e} in all"
        )));
    }
    let size = size.map(|n| n as usize);
    let mut voxels: Vec<u8> = read::room(size.iter().product(), "the resampled volume")?;
    voxels.resize(size.iter().product(), 0);
    for_each((0.., chunks_mut(&mut voxels, size[0] * size[1])), &|(k, slice)| {
        for (pixel, voxel) in slice.iter_mut().enumerate() {
            let cell = [pixel % size[0], pixel / size[0], k];
            let label = |share: [f64; 3]| {
                let point = [0, 1, 2].map(|axis| low[axis] + step * (cell[axis] as f64 + share[axis]));
                volume.label_index_at(&map.map(&Point3::from(point))).unwrap_or(0)
            };
            let corner = |number: usize| [0, 1, 2].map(|axis| if number >> axis & 1 == 0 { 0.25 } else { 0.75 });
            let labels = [0, 1, 2, 3, 4, 5, 6, 7].map(|number| label(corner(number)));
            *voxel = vote(labels, || label([0.5; 3]));
        }
    });
    let mut index_to_world = Matrix4::new_scaling(step);
    let origin = Vector3::from(low).add_scalar(step / 2.0);
    index_to_world.fixed_view_mut::<3, 1>(0, 3).copy_from(&origin);
    let resampled = LabelVolume::new(size, voxels, volume.labels().to_vec(), index_to_world)?;
    let mut resampled = resampled.with_organs_of(volume);
    if !std::ptr::eq(volume.undivided(), volume) {
        resampled.set_undivided(resample(volume.undivided(), map)?);
    }
    Ok(resampled)
}

/// Points of a grid on the faces of a volume's box, mm.
fn faces(volume: &LabelVolume) -> impl Iterator<Item = Point3<f64>> {
    let size = volume.size();
    let coordinate = move |n: usize, axis: usize| n as f64 / FACE as f64 * size[axis] as f64 - 0.5;
    let grid = (0..=FACE).flat_map(|k| (0..=FACE).flat_map(move |j| (0..=FACE).map(move |i| [i, j, k])));
    let on_face = grid.filter(|cell| cell.iter().any(|n| *n == 0 || *n == FACE));
    on_face.map(move |[i, j, k]| {
        let index = Point3::new(coordinate(i, 0), coordinate(j, 1), coordinate(k, 2));
        volume.index_to_world().transform_point(&index)
    })
}

/// The most frequent of eight labels; of several the one in the middle.
fn vote(labels: [u8; 8], middle: impl Fn() -> u8) -> u8 {
    let count = |wanted: u8| labels.iter().filter(|label| **label == wanted).count();
    let largest_count = labels.iter().map(|label| count(*label)).max().unwrap_or(0);
    let mut leading = labels.iter().filter(|label| count(**label) == largest_count);
    match leading.next() {
        Some(first) if leading.all(|other| other == first) => *first,
        _ => middle(),
    }
}

/// File of a registration.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: u32,
    #[serde(flatten)]
    map: Quadratic,
}

impl Quadratic {
    /// Reads the map of a registration from a TOML file.
    ///
    /// # Errors
    /// [`VolumeError`] if the file cannot be read, or holds something else.
    pub fn read(path: &Path) -> Result<Self, VolumeError> {
        let text = read::text(path, read::TOML).map_err(|cause| VolumeError::read(path, cause))?;
        let wrong = |found: String| VolumeError::new(format!("{}: {found}", path.display()));
        if text.starts_with("#Insight Transform File") {
            let found = "a transform of ITK; expected a file that `insonify register --fit` writes: in 3D Slicer harden the \
                         transform on the segmentation, and export that";
            return Err(wrong(found.to_owned()));
        }
        let file: File =
            toml::from_str(&text).map_err(|error| wrong(format!("no registration: {}", error.message())))?;
        if file.version != 1 {
            return Err(wrong(format!("version {}; expected 1", file.version)));
        }
        file.map.check().map_err(|error| wrong(error.to_string()))?;
        Ok(file.map)
    }

    /// The map as a TOML file.
    pub fn toml(&self) -> String {
        let list = |values: &[f64]| {
            values
                .iter()
                .map(|value| format!("{value:?}"))
                .collect::<Vec<_>>()
                .join(", ")
        };
        let rows = self.coefficients.map(|row| format!("  [{}],\n", list(&row))).concat();
        format!(
            "# Registration by `insonify register`: volume_mm = C q((world_mm - centre_mm) / scale_mm), q = 1, x, y, z, x2, y2, z2, xy, yz, zx\n\
             version = 1\ncoefficients = [\n{rows}]\ncentre_mm = [{}]\nscale_mm = {:?}\n",
            list(&self.centre_mm),
            self.scale_mm
        )
    }
}
