//! Folders of binary masks, one per file, named by their files.

use std::fs;
use std::path::{Path, PathBuf};

use insonify_base::parallel;
use nalgebra::{Matrix4, Point3};

use super::{Segmentation, stem};
use crate::acoustics::Preset;
use crate::volume::complete::is_body;
use crate::volume::overlap::{Overlaps, precedence};
use crate::volume::{self, At, Label, LabelVolume, Loaded, VolumeError, load};

/// Value of the first label whose name is not a class of TotalSegmentator.
const FREE: i64 = 301;

/// Names of the image beside the masks in public data sets.
const IMAGES: [&str; 2] = ["ct", "mri"];

/// Largest distance between the corners of two equal grids, mm.
const SAME_MM: f64 = 0.01;

/// File of a mask and its stem, the name of the label.
pub(super) struct Mask {
    pub path: PathBuf,
    pub name: String,
}

impl Mask {
    fn is_image(&self) -> bool {
        IMAGES.contains(&self.name.to_lowercase().as_str())
    }

    /// Loads the volume of the file; its values are not yet checked.
    fn load(&self) -> Result<Loaded, VolumeError> {
        load(&self.path).map_err(|error| match error {
            VolumeError::Fractional { value, .. } => no_mask(&self.path, format!("the value {value:?}")),
            VolumeError::Volume { cause, .. } if let VolumeError::TooManyLabels(count) = *cause => {
                no_mask(&self.path, format!("{count} or more values"))
            }
            other => other,
        })
    }
}

/// Error of a file that is not a mask.
fn no_mask(path: &Path, found: impl Into<String>) -> VolumeError {
    let expected = "a binary mask, as all files of a folder are: move another file, such as the CT, out of the folder";
    VolumeError::malformed(path, At::Voxels, found, expected)
}

/// Lists the files of a folder that hold volumes.
fn volumes(folder: &Path) -> Result<Vec<Mask>, VolumeError> {
    let fail = |cause| VolumeError::read(folder, cause);
    let mut masks = Vec::new();
    for entry in fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let data_of_header = volume::header_beside(&path).is_some();
        if let Some(name) = stem(&path)
            && !name.starts_with('.')
            && !data_of_header
            && path.is_file()
        {
            masks.push(Mask { path, name });
        }
    }
    Ok(masks)
}

/// Lists the masks of a folder by name, those of the entire body first.
fn masks(folder: &Path) -> Result<Vec<Mask>, VolumeError> {
    let mut masks = volumes(folder)?;
    if masks.iter().all(Mask::is_image) {
        let mut expected = format!("masks such as liver.nii.gz, in {}", volume::format_names("or"));
        let inner = folder.join("segmentations");
        if volumes(&inner).is_ok_and(|inner| !inner.is_empty()) {
            expected.push_str(&format!("; there are some in {}: give that folder", inner.display()));
        } else if let Some(error) = volume::foreign::in_folder(folder).filter(|_| masks.is_empty()) {
            return Err(error);
        }
        return Err(VolumeError::malformed(folder, At::Folder, "no mask", expected));
    }
    if let Some(image) = masks.iter().find(|mask| mask.is_image()) {
        return Err(no_mask(&image.path, "an image, by its name"));
    }
    if let Some(recording) = masks.iter().find(|mask| mask.name.to_lowercase().ends_with(".igs")) {
        let found = format!("{}, a recording of tracked frames", file_name(&recording.path));
        let expected = "masks or surfaces: `insonify info` tells what is in a recording, `[motion.sequence]` of a scene moves the probe by it";
        return Err(VolumeError::malformed(folder, At::Folder, found, expected));
    }
    masks.sort_by_cached_key(|mask| (!is_body(&mask.name), mask.name.clone(), mask.path.clone()));
    if let Some([one, two]) = masks.array_windows().find(|[one, two]| one.name == two.name) {
        let found = format!("{} and {}", file_name(&one.path), file_name(&two.path));
        return Err(VolumeError::malformed(folder, At::Folder, found, "one file a name"));
    }
    Ok(masks)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Reads the masks of a folder as one volume. Labels have the values of TotalSegmentator's classes, or free ones; empty
/// masks give no label.
pub(super) fn read(folder: &Path) -> Result<Segmentation, VolumeError> {
    let masks = masks(folder)?;
    let first = masks[0].load()?;
    let mut union = Union::new(first.volume.size());
    union.add(&masks[0], &first.volume)?;
    for some in masks[1..].chunks(parallel::threads()) {
        let loaded = parallel::map(some, &Mask::load);
        for (mask, loaded) in some.iter().zip(loaded) {
            let volume = loaded?.volume;
            same_grid(&masks[0].path, &first.volume, &mask.path, &volume)?;
            union.add(mask, &volume)?;
        }
    }
    let labels = union.labels.len();
    let overlaps = union.covered("masks");
    let volume = union
        .volume(first.volume.size(), *first.volume.index_to_world())
        .map_err(|error| error.in_file(folder))?;
    let mut segmentation = Segmentation::from(volume);
    segmentation.notes = first.notes;
    segmentation.warnings = first.warnings;
    segmentation.notes.push(format!(
        "{} holds {} masks, {} of them empty; each is the label of its file's name",
        folder.display(),
        masks.len(),
        masks.len() - labels
    ));
    segmentation.warnings.extend(overlaps);
    Ok(segmentation)
}

/// Union of masks.
pub(super) struct Union {
    voxels: Vec<u8>,
    /// Labels in the order of their masks, without values, with all voxels of the mask.
    labels: Vec<Label>,
    overlaps: Overlaps,
}

impl Union {
    /// A union without masks on a grid.
    pub(super) fn new(size: [usize; 3]) -> Self {
        Self {
            voxels: vec![0; size.iter().product()],
            labels: Vec::new(),
            overlaps: Overlaps::default(),
        }
    }

    /// Tells which labels are covered by others.
    pub(super) fn covered(&self, kind: &str) -> Option<String> {
        self.overlaps.warning(kind, |label| {
            let label = &self.labels[label];
            (label.name.clone().unwrap_or_default(), label.voxels)
        })
    }

    /// Adds a mask; an empty one gives no label.
    pub(super) fn add(&mut self, mask: &Mask, volume: &LabelVolume) -> Result<(), VolumeError> {
        if let [_, one, two, ..] = volume.labels() {
            let found = format!("values {} and {}", one.value, two.value);
            return Err(no_mask(&mask.path, found));
        }
        if !volume.holds(1) {
            return Ok(());
        }
        self.labels.push(Label {
            value: 0,
            name: Some(mask.name.clone()),
            voxels: volume.labels()[1].voxels,
        });
        let new = self.labels.len() - 1;
        let rank = |label: &Label| precedence(label.name.as_deref(), label.voxels);
        let ranks: Vec<_> = self.labels.iter().map(rank).collect();
        let masked = volume.voxels().iter().map(|&masked| masked > 0);
        for (voxel, _) in self.voxels.iter_mut().zip(masked).filter(|(_, masked)| *masked) {
            // Past 255 the volume is refused below; only the count of labels still matters.
            let Some(old) = usize::from(*voxel).checked_sub(1) else {
                *voxel = new.wrapping_add(1) as u8;
                continue;
            };
            let (below, above) = if ranks[new] >= ranks[old] {
                (old, new)
            } else {
                (new, old)
            };
            self.overlaps.add(below, above, 1);
            *voxel = above.wrapping_add(1) as u8;
        }
        Ok(())
    }

    /// Returns the volume on a grid, its labels by ascending value.
    pub(super) fn volume(mut self, size: [usize; 3], index_to_world: Matrix4<f64>) -> Result<LabelVolume, VolumeError> {
        if self.labels.len() > 255 {
            return Err(VolumeError::TooManyLabels(self.labels.len() + 1));
        }
        let mut kept = [0; 256];
        for &voxel in &self.voxels {
            kept[usize::from(voxel)] += 1;
        }
        let mut free = FREE;
        for (index, label) in self.labels.iter_mut().enumerate() {
            label.voxels = kept[index + 1];
            let classes = Preset::TotalSegmentator.classes();
            let class = classes.iter().find(|class| Some(&class.name) == label.name.as_ref());
            label.value = class.map_or(free, |class| class.value);
            free += i64::from(class.is_none());
        }
        let mut order: Vec<usize> = (0..self.labels.len()).collect();
        order.sort_by_key(|&label| self.labels[label].value);
        let mut new_index = [0; 256];
        let mut labels = vec![Label {
            value: 0,
            name: None,
            voxels: kept[0],
        }];
        for label in order {
            new_index[label + 1] = labels.len() as u8;
            labels.push(self.labels[label].clone());
        }
        for voxel in &mut self.voxels {
            *voxel = new_index[usize::from(*voxel)];
        }
        LabelVolume::new(size, self.voxels, labels, index_to_world)
    }
}

/// Checks that a mask lies on the grid of the first.
fn same_grid(first: &Path, grid: &LabelVolume, path: &Path, mask: &LabelVolume) -> Result<(), VolumeError> {
    let (size, other) = (grid.size(), mask.size());
    let first = first.display();
    if size != other {
        let found = format!("{other:?} voxels");
        let expected = format!("the {size:?} voxels of {first}: the masks of a folder share a grid");
        return Err(VolumeError::malformed(path, At::Header, found, expected));
    }
    let corner = |volume: &LabelVolume, number: usize| {
        let index = [0, 1, 2].map(|axis| (number >> axis & 1) as f64 * (size[axis] - 1) as f64);
        volume.index_to_world().transform_point(&Point3::from(index))
    };
    let distances = (0..8).map(|number| (number, (corner(grid, number) - corner(mask, number)).norm()));
    let (number, distance) = distances.fold((0, 0.0), |worst, next| if next.1 > worst.1 { next } else { worst });
    if distance > SAME_MM {
        let corner_text = |volume| {
            let [x, y, z] = corner(volume, number).into();
            format!("{x:.3}, {y:.3}, {z:.3} mm")
        };
        let found = format!("a corner at {} (LPS)", corner_text(mask));
        let expected = format!(
            "{} as in {first}: the masks of a folder share a grid",
            corner_text(grid)
        );
        return Err(VolumeError::malformed(path, At::Header, found, expected));
    }
    Ok(())
}
