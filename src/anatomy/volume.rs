//! Labelled volumes and their file formats.
//!
//! A [`LabelVolume`] holds one byte a voxel: an index into its list of [`Label`]s. Index 0 is always the background
//! (value 0: unlabelled). World coordinates are LPS millimetres; voxel centres lie at integer indices.

mod channels;
pub mod complete;
mod data;
#[cfg(feature = "dicom")]
mod dicom;
pub mod distance;
pub mod element;
mod error;
mod extent;
pub(crate) mod foreign;
mod format;
pub mod header;
mod labels;
mod load;
mod names;
mod organs;
pub(crate) mod overlap;
mod save;
mod several;
pub mod structures;
mod text;
pub mod texture;
mod unit;
mod values;

use std::sync::Arc;

use insonify_base::matrix::affine;
use nalgebra::{Matrix4, Point3, Vector3};

pub use data::read as read_data;
pub use error::{At, VolumeError};
pub(crate) use format::{ending, header_beside};
pub use format::{names as format_names, written};
pub use load::{Loaded, ScalarImage, load, load_scalar, numbers, read_header};
pub use save::save;

format::formats! {
    nifti;
    nrrd;
    metaimage;
}

/// One label of a volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// Label value in the file.
    pub value: i64,
    /// Name from the file, or one assigned later.
    pub name: Option<String>,
    /// Voxels that carried the value in the file (before any completion); of overlapping segments, only those on top.
    pub voxels: u64,
}

/// A labelled volume with its position in the world.
///
/// ```
/// use insonify_anatomy::volume::{Label, LabelVolume};
/// use nalgebra::{Matrix4, Point3};
///
/// let label = |value, name: &str| Label { value, name: Some(name.into()), voxels: 0 };
/// let labels = vec![label(0, "background"), label(5, "liver")];
/// let place = Matrix4::new_translation(&[10.0, 20.0, 30.0].into()) * Matrix4::new_scaling(2.0);
/// let volume = LabelVolume::new([3, 1, 1], vec![0, 1, 1], labels.clone(), place)?;
///
/// assert_eq!(volume.spacing_mm(), [2.0; 3]);
/// assert_eq!(volume.label_index_at(&Point3::new(12.5, 20.0, 30.0)), Some(1));
/// assert_eq!(volume.label_index_at(&Point3::new(15.5, 20.0, 30.0)), None, "more than half a voxel past the last");
///
/// let error = LabelVolume::new([3, 1, 1], vec![0, 1, 2], labels, place).unwrap_err();
/// println!("{error}"); // names the voxel
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LabelVolume {
    size: [usize; 3],
    /// Shared with moved copies of the volume.
    voxels: Arc<Vec<u8>>,
    labels: Vec<Label>,
    /// Whether any voxel has each label.
    occurs: Vec<bool>,
    /// Organs that labels were drawn into; empty if nothing was drawn.
    drawn_into: Vec<Option<i64>>,
    /// The volume before structures were drawn into its organs, if there are any.
    undivided: Option<Arc<Self>>,
    index_to_world: Matrix4<f64>,
    world_to_index: Matrix4<f64>,
}

impl LabelVolume {
    /// Makes a volume of `size` voxels (x fastest) whose bytes index `labels`; `index_to_world` maps voxel indices to
    /// LPS millimetres. `labels[0]` must be the background with value 0.
    pub fn new(
        size: [usize; 3],
        voxels: Vec<u8>,
        labels: Vec<Label>,
        index_to_world: Matrix4<f64>,
    ) -> Result<Self, VolumeError> {
        let expected = size
            .iter()
            .try_fold(1usize, |product, &n| product.checked_mul(n))
            .filter(|&n| n > 0)
            .ok_or_else(|| {
                let expected = "every axis needs at least one voxel and the product must fit in memory";
                VolumeError::new(format!("size {size:?}: {expected}"))
            })?;
        if voxels.len() != expected {
            return Err(VolumeError::wrong_count(voxels.len(), expected));
        }
        VolumeError::check_labels(labels.len())?;
        if labels.first().is_none_or(|label| label.value != 0) {
            return Err(VolumeError::new("label index 0 must be the background (value 0)"));
        }
        // Indices are checked once here, so that every later look-up of a label may trust them.
        let mut occurs = vec![false; labels.len()];
        for (voxel, &index) in voxels.iter().enumerate() {
            let Some(occurs) = occurs.get_mut(usize::from(index)) else {
                let labels = labels.len();
                let text = format!("voxel {voxel} has label index {index}, but there are only {labels} labels");
                return Err(VolumeError::new(text));
            };
            *occurs = true;
        }
        let world_to_index = inverse(&index_to_world)?;
        affine(&index_to_world).map_err(|why| VolumeError::new(format!("the index-to-world transform: {why}")))?;
        Ok(Self {
            size,
            voxels: Arc::new(voxels),
            undivided: None,
            drawn_into: Vec::new(),
            labels,
            occurs,
            world_to_index,
            index_to_world,
        })
    }

    /// Returns the volume translated in the world by a vector, mm. The voxels are shared, not copied.
    ///
    /// # Errors
    /// [`VolumeError::Value`] if the new position is not finite.
    pub fn moved(&self, by_mm: Vector3<f64>) -> Result<Self, VolumeError> {
        let mut index_to_world = self.index_to_world;
        let translation = index_to_world.fixed_view::<3, 1>(0, 3) + by_mm;
        index_to_world.fixed_view_mut::<3, 1>(0, 3).copy_from(&translation);
        Ok(Self {
            world_to_index: inverse(&index_to_world)?,
            index_to_world,
            undivided: match &self.undivided {
                Some(undivided) => Some(Arc::new(undivided.moved(by_mm)?)),
                None => None,
            },
            ..self.clone()
        })
    }

    /// Voxels along each index axis.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Label indices, x fastest.
    pub fn voxels(&self) -> &[u8] {
        &self.voxels
    }

    /// Labels that the voxels index; the first is the background.
    pub fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// Whether any voxel has a label index. [`Label::voxels`] is no substitute: it counts voxels of the file.
    pub fn holds(&self, label_index: usize) -> bool {
        self.occurs.get(label_index).is_some_and(|&occurs| occurs)
    }

    /// Returns the volume with undivided organs, before structures such as vessels were drawn into them; itself if
    /// there are none. Meshes and needles use only this one.
    pub fn undivided(&self) -> &Self {
        self.undivided.as_deref().unwrap_or(self)
    }

    /// Stores the volume as it was before structures were drawn.
    pub(crate) fn set_undivided(&mut self, undivided: Self) {
        self.undivided = Some(Arc::new(undivided));
    }

    /// Names a label.
    pub fn name(&mut self, label_index: usize, name: String) {
        self.labels[label_index].name = Some(name);
    }

    /// Transform from voxel index to LPS millimetres.
    pub fn index_to_world(&self) -> &Matrix4<f64> {
        &self.index_to_world
    }

    /// Transform from LPS millimetres to voxel index.
    pub fn world_to_index(&self) -> &Matrix4<f64> {
        &self.world_to_index
    }

    /// Distance between neighbouring voxel centres along each index axis, mm.
    pub fn spacing_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.index_to_world.fixed_view::<3, 1>(0, axis).norm())
    }

    /// Volume of one voxel, cubic millimetres.
    pub fn voxel_mm3(&self) -> f64 {
        self.index_to_world.fixed_view::<3, 3>(0, 0).determinant().abs()
    }

    /// Centre of the voxel box in the world, mm.
    pub fn centre_mm(&self) -> Point3<f64> {
        let middle = Point3::from(self.size.map(|n| (n as f64 - 1.0) / 2.0));
        self.index_to_world.transform_point(&middle)
    }

    /// Linear index of a voxel.
    pub fn offset(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.size[0] * (j + self.size[1] * k)
    }

    /// Label index of the voxel nearest to a world point; `None` outside the volume.
    pub fn label_index_at(&self, world: &Point3<f64>) -> Option<u8> {
        self.label_at_index(self.world_to_index.transform_point(world).coords.into())
    }

    /// Label of the voxel nearest to an index; `None` outside the volume.
    #[inline]
    pub fn label_at_index(&self, index: [f64; 3]) -> Option<u8> {
        let mut voxel = [0usize; 3];
        for axis in 0..3 {
            let nearest = index[axis] + 0.5;
            if !(nearest >= 0.0 && nearest < self.size[axis] as f64) {
                return None;
            }
            // Truncation is the floor here, without a call.
            voxel[axis] = nearest as usize;
        }
        Some(self.voxels[self.offset(voxel)])
    }

    /// Label of a point (world, mm) by the weights of cubic B-splines on its 64 nearest voxels: 0 if labels that are
    /// not `wanted` have half of the weight, otherwise the label with the largest weight, the lowest of equals. Its
    /// boundaries are smooth where those of the nearest voxels are stairs, and a layer of one voxel has no holes.
    /// `None` outside the volume.
    pub fn smoothed_label_at(&self, world: &Point3<f64>, wanted: impl Fn(u8) -> bool) -> Option<u8> {
        let index = self.world_to_index.transform_point(world);
        let mut taps = [[(0, 0.0); 4]; 3];
        for axis in 0..3 {
            let last = self.size[axis] as f64 - 1.0;
            if !(index[axis] >= -0.5 && index[axis] < last + 0.5) {
                return None;
            }
            let (low, t) = (index[axis].floor(), index[axis] - index[axis].floor());
            let weights = [
                (1.0 - t).powi(3),
                4.0 + 3.0 * t * t * (t - 2.0),
                1.0 + 3.0 * t * (1.0 + t * (1.0 - t)),
                t.powi(3),
            ];
            for (tap, weight) in weights.into_iter().enumerate() {
                let index = (low + tap as f64 - 1.0).clamp(0.0, last) as usize;
                taps[axis][tap] = (index, weight / 6.0);
            }
        }
        let [x, y, z] = taps;
        // At most one label for each of the 64 taps, the background first.
        let (mut weights, mut count) = ([(0u8, 0.0f64); 64], 1);
        for (k, wz) in z {
            for (j, wy) in y {
                for (i, wx) in x {
                    let label = self.voxels[self.offset([i, j, k])];
                    let label = if wanted(label) { label } else { 0 };
                    let entry = weights[..count]
                        .iter()
                        .position(|candidate| candidate.0 == label)
                        .unwrap_or(count);
                    (weights[entry].0, count) = (label, count.max(entry + 1));
                    weights[entry].1 += wx * wy * wz;
                }
            }
        }
        if weights[0].1 >= 0.5 {
            return Some(0);
        }
        let more = |a: &(u8, f64), b: &(u8, f64)| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0));
        weights[1..count]
            .iter()
            .copied()
            .max_by(more)
            .map(|candidate| candidate.0)
    }
}

/// Inverts an index-to-world transform; an error unless both are finite.
fn inverse(index_to_world: &Matrix4<f64>) -> Result<Matrix4<f64>, VolumeError> {
    let finite = |matrix: &Matrix4<f64>| matrix.iter().all(|x| x.is_finite());
    finite(index_to_world)
        .then(|| index_to_world.try_inverse())
        .flatten()
        .filter(finite)
        .ok_or_else(|| VolumeError::new("the index-to-world transform is singular or not finite"))
}
