//! Segmentations of few voxels, and what they say.

mod doubts;
mod evidence;
mod files;
mod numberings;
mod surround;
mod tables;

use std::fs;
use std::path::PathBuf;

use nalgebra::Matrix4;
use tempfile::TempDir;

use super::*;
use crate::acoustics::TissueTable;
use crate::volume::save;

/// Edge of the grid of [`organs`], voxels of 1 ml.
const SIDE: usize = 18;

/// A volume of unnamed labels, from right to left, each of a number of voxels of 1 ml, clear of the edge of the scan.
fn organs(ml: &[(i64, usize)]) -> LabelVolume {
    let mut voxels = vec![0; SIDE * SIDE * SIDE];
    let inner = |at: &usize| {
        [at % SIDE, at / SIDE % SIDE, at / SIDE / SIDE]
            .iter()
            .all(|n| (1..SIDE - 1).contains(n))
    };
    let mut free: Vec<usize> = (0..voxels.len()).filter(inner).collect();
    free.sort_by_key(|at| at % SIDE);
    let mut free = free.into_iter();
    for (label, (_, count)) in ml.iter().enumerate() {
        free.by_ref().take(*count).for_each(|at| voxels[at] = label as u8 + 1);
    }
    volume([SIDE; 3], voxels, ml, 10.0)
}

/// Organs of a torso as boxes: centre (LPS) and half the edges, mm.
const TORSO: [(&str, [f64; 3], [f64; 3]); 19] = [
    ("liver", [-70.0, -20.0, 40.0], [58.0, 50.0, 50.0]),
    ("spleen", [95.0, 40.0, 45.0], [20.0, 35.0, 40.0]),
    ("kidney_right", [-60.0, 58.0, -25.0], [21.0, 21.0, 52.0]),
    ("kidney_left", [60.0, 55.0, -10.0], [21.0, 21.0, 52.0]),
    ("gallbladder", [-35.0, -55.0, -22.0], [14.0, 14.0, 24.0]),
    ("stomach", [50.0, -35.0, 45.0], [32.0, 32.0, 42.0]),
    ("pancreas", [15.0, -5.0, -20.0], [45.0, 14.0, 14.0]),
    ("adrenal_gland_right", [-35.0, 42.0, 43.0], [8.0, 8.0, 11.0]),
    ("adrenal_gland_left", [39.0, 42.0, 46.0], [8.0, 8.0, 11.0]),
    ("esophagus", [6.0, 6.0, 80.0], [8.0, 8.0, 21.0]),
    ("duodenum", [-12.0, -28.0, -45.0], [21.0, 11.0, 20.0]),
    ("colon", [0.0, -70.0, -62.0], [100.0, 15.0, 18.0]),
    ("urinary_bladder", [0.0, -30.0, -87.0], [30.0, 30.0, 11.0]),
    ("aorta", [10.0, 28.0, 0.0], [8.0, 11.0, 200.0]),
    ("inferior_vena_cava", [-20.0, 25.0, 0.0], [11.0, 8.0, 200.0]),
    ("vertebrae_L2", [0.0, 63.0, -70.0], [18.0, 18.0, 28.0]),
    ("vertebrae_L1", [0.0, 63.0, 0.0], [18.0, 18.0, 28.0]),
    ("vertebrae_T12", [0.0, 63.0, 70.0], [18.0, 18.0, 28.0]),
    ("liver_tumor", [-80.0, -20.0, 50.0], [12.0, 12.0, 12.0]),
];

/// A torso with unnamed labels: of these values, each of the organs whose names begin with that of the value, without a
/// side in it on both.
fn torso(labels: &[(i64, &str)]) -> LabelVolume {
    let label = |organ: &str| {
        let of = |name: &str| organ.starts_with(name) && (name != "liver" || organ == "liver");
        labels.iter().position(|(_, name)| of(name))
    };
    let organs: Vec<_> = TORSO
        .iter()
        .filter_map(|(organ, centre, half)| Some((label(organ)?, *centre, *half)))
        .collect();
    let values: Vec<i64> = labels.iter().map(|(value, _)| *value).collect();
    boxes(&values, &organs)
}

/// 48 x 36 x 30 voxels of 7 mm with unnamed labels of these values, and boxes of labels by centre (LPS) and half the
/// edges, mm; later ones lie above earlier ones.
fn boxes(values: &[i64], organs: &[(usize, [f64; 3], [f64; 3])]) -> LabelVolume {
    let (size, spacing) = ([48, 36, 30], 7.0);
    let origin = size.map(|n| -0.5 * spacing * (n as f64 - 1.0));
    let mut voxels = vec![0; size.iter().product()];
    for (label, centre, half) in organs {
        for (offset, voxel) in voxels.iter_mut().enumerate() {
            let index = [offset % size[0], offset / size[0] % size[1], offset / size[0] / size[1]];
            let inside = |axis: usize| (origin[axis] + spacing * index[axis] as f64 - centre[axis]).abs() < half[axis];
            if (0..3).all(inside) {
                *voxel = *label as u8 + 1;
            }
        }
    }
    let count = |label: usize| voxels.iter().filter(|voxel| usize::from(**voxel) == label + 1).count();
    let labels: Vec<(i64, usize)> = values
        .iter()
        .enumerate()
        .map(|(label, value)| (*value, count(label)))
        .collect();
    let to_world = Matrix4::new_translation(&origin.into()) * Matrix4::new_scaling(spacing);
    moved(volume(size, voxels, &labels, 1.0), to_world)
}

/// The volume at another place.
fn moved(volume: LabelVolume, to_world: Matrix4<f64>) -> LabelVolume {
    LabelVolume::new(
        volume.size(),
        volume.voxels().to_vec(),
        volume.labels().to_vec(),
        to_world,
    )
    .unwrap()
}

/// A torso in the values of a numbering, of the organs that it has.
fn numbered(preset: Preset) -> LabelVolume {
    let is_here = |name: &str| TORSO.iter().any(|(organ, ..)| organ.starts_with(name));
    let labels: Vec<(i64, &str)> = preset
        .classes()
        .iter()
        .map(|class| (class.value, class.name.as_str()))
        .filter(|(_, name)| is_here(name))
        .collect();
    torso(&labels)
}

fn volume(size: [usize; 3], voxels: Vec<u8>, labels: &[(i64, usize)], spacing_mm: f64) -> LabelVolume {
    let label = |&(value, voxels): &(i64, usize)| Label {
        value,
        name: None,
        voxels: voxels as u64,
    };
    let labels = std::iter::once(&(0, 0)).chain(labels).map(label).collect();
    LabelVolume::new(size, voxels, labels, Matrix4::new_scaling(spacing_mm)).unwrap()
}

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Saves a row of four voxels with these values.
    fn row(&self, name: &str, values: [i64; 4], spacing_mm: f64) -> PathBuf {
        let mut labels: Vec<(i64, usize)> = values
            .iter()
            .filter(|value| **value != 0)
            .map(|value| (*value, 1))
            .collect();
        labels.dedup();
        let index = |value: &i64| {
            labels
                .iter()
                .position(|label| label.0 == *value)
                .map_or(0, |at| at as u8 + 1)
        };
        let voxels = values.iter().map(index).collect();
        self.save(name, &volume([4, 1, 1], voxels, &labels, spacing_mm))
    }

    fn save(&self, name: &str, volume: &LabelVolume) -> PathBuf {
        let path = self.path(name);
        save(volume, &path).unwrap();
        path
    }

    fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, text).unwrap();
        path
    }
}

fn opened(path: &Path) -> Segmentation {
    open(path, &Naming::default()).unwrap()
}

fn refused(path: &Path) -> String {
    open(path, &Naming::default()).unwrap_err().to_string()
}

fn names(segmentation: &Segmentation) -> Vec<(i64, &str)> {
    let labels = segmentation.volume.labels().iter().skip(1);
    labels
        .map(|label| (label.value, label.name.as_deref().unwrap_or("-")))
        .collect()
}

fn tissue(segmentation: &Segmentation, index: u8) -> String {
    let (table, _) = TissueTable::resolve(segmentation.volume.labels(), &[], Preset::Auto).unwrap();
    table.tissue(index).name.to_string()
}

/// Opens a volume from a file of this name.
fn named(name: &str, volume: &LabelVolume) -> Segmentation {
    let folder = Folder::new();
    opened(&folder.save(name, volume))
}

fn preset(segmentation: &Segmentation) -> Option<Preset> {
    segmentation.by_value.as_ref().map(|(preset, _)| *preset)
}
