//! Extents of labels: volume, height, place, and whether the edge of the scan cuts them.

use nalgebra::{Matrix3, Vector3};

use crate::volume::LabelVolume;

/// Extent of a label.
pub(super) struct Extent {
    pub ml: f64,
    /// Whether the edge of the scan cuts the label, so that it may be small.
    pub cut: bool,
    /// Centre (LPS), mm; NaN for a label without voxels.
    pub middle_mm: Vector3<f64>,
    /// Lowest and highest voxel, mm above the scan's lowest.
    height_mm: [f64; 2],
    /// First and last voxel along each index axis.
    pub voxels: [[usize; 2]; 3],
}

/// Extents of the labels of a volume.
pub(super) struct Extents {
    pub labels: Vec<Extent>,
    /// Number of voxels along each index axis, and its direction.
    pub size: [usize; 3],
    pub directions: [Vector3<f64>; 3],
    /// Height of the scan, mm.
    scan_mm: f64,
}

impl Extents {
    pub(super) fn of(volume: &LabelVolume) -> Self {
        Self::turned(volume, &Matrix3::identity())
    }

    /// Extents in other axes than those of the file.
    pub(super) fn turned(volume: &LabelVolume, turn: &Matrix3<f64>) -> Self {
        let count = volume.labels().len();
        let [nx, ny, _] = volume.size();
        let to_world = turn.to_homogeneous() * volume.index_to_world();
        let axis = |axis: usize| to_world.fixed_view::<3, 1>(0, axis).into_owned();
        let up = [0, 1, 2].map(|index| axis(index).z);
        let height = |index: [usize; 3]| -> f64 { (0..3).map(|axis| up[axis] * index[axis] as f64).sum() };
        let mut sums = vec![Vector3::zeros(); count];
        let mut counts = vec![0.0; count];
        let mut heights = vec![[f64::INFINITY, f64::NEG_INFINITY]; count];
        let mut voxels = vec![[[usize::MAX, 0]; 3]; count];
        for (row, line) in volume.voxels().chunks(nx).enumerate() {
            let mut start = 0;
            for run in line.chunk_by(|a, b| a == b) {
                let (label, end) = (usize::from(run[0]), start + run.len() - 1);
                let length = run.len() as f64;
                sums[label] += Vector3::new(0.5 * (start + end) as f64, (row % ny) as f64, (row / ny) as f64) * length;
                counts[label] += length;
                for x in [start, end] {
                    let index = [x, row % ny, row / ny];
                    let z = height(index);
                    heights[label] = [heights[label][0].min(z), heights[label][1].max(z)];
                    for (range, voxel) in voxels[label].iter_mut().zip(index) {
                        *range = [range[0].min(voxel), range[1].max(voxel)];
                    }
                }
                start = end + 1;
            }
        }
        let last = volume.size().map(|n| n - 1);
        let ends = (0..3).map(|axis| up[axis] * last[axis] as f64);
        let (low, high) = ends.fold((0.0, 0.0), |(low, high), end| (low + end.min(0.0), high + end.max(0.0)));
        let areas = cut_mm2(volume);
        let labels = (0..count).map(|label| {
            let mm3 = volume.labels()[label].voxels as f64 * volume.voxel_mm3();
            let middle = (sums[label] / counts[label]).push(1.0);
            Extent {
                ml: mm3 / 1000.0,
                // A tube that leaves the scan is cut across less than a face of the cube of its volume, other truncated
                // organs across more.
                cut: areas[label] >= mm3.powf(2.0 / 3.0),
                middle_mm: (to_world * middle).xyz(),
                height_mm: heights[label].map(|z| z - low),
                voxels: voxels[label],
            }
        });
        Self {
            labels: labels.collect(),
            size: volume.size(),
            directions: [0, 1, 2].map(|index| axis(index).normalize()),
            scan_mm: high - low,
        }
    }

    pub(super) fn tall_mm(&self, label: usize) -> f64 {
        let [low, high] = self.labels[label].height_mm;
        high - low
    }

    /// Length of a label from head to feet by its mean thickness.
    pub(super) fn slenderness(&self, label: usize) -> f64 {
        let (tall, mm3) = (self.tall_mm(label), 1000.0 * self.labels[label].ml);
        tall / (mm3 / tall).sqrt()
    }

    /// Whether a label leaves the scan towards head or feet.
    pub(super) fn leaves(&self, label: usize) -> bool {
        let [low, high] = self.labels[label].height_mm;
        low <= 0.0 || high >= self.scan_mm
    }
}

/// Area of contact of each label with the edge of the scan, mm^2.
fn cut_mm2(volume: &LabelVolume) -> Vec<f64> {
    let (size, to_world) = (volume.size(), volume.index_to_world());
    let step = |axis: usize| to_world.fixed_view::<3, 1>(0, axis).into_owned();
    let mut areas = vec![0.0; volume.labels().len()];
    for axis in 0..3 {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let face = step(u).cross(&step(v)).norm();
        for end in [0, size[axis] - 1] {
            for pixel in 0..size[u] * size[v] {
                let mut index = [0; 3];
                (index[axis], index[u], index[v]) = (end, pixel % size[u], pixel / size[u]);
                areas[usize::from(volume.voxels()[volume.offset(index)])] += face;
            }
        }
    }
    areas
}
