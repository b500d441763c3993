//! Skin of a label volume: points with outward normals, and a search for the nearest.

use std::collections::VecDeque;

use nalgebra::{Point3, Vector3};
use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::volume::{LabelVolume, VolumeError};

/// Least spacing of the grid on which the surface is found, mm.
const GRID_MM: f64 = 1.5;
/// Tangential offset at which a point lies beyond the end of the skin, mm.
const BEYOND_MM: f64 = 10.0;
/// Maximum number of points; more are thinned evenly.
const MAX: usize = 150_000;

/// A surface as points with normals.
pub struct Skin {
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    tree: RTree<GeomWithData<[f64; 3], usize>>,
}

impl Skin {
    /// Makes a surface from points (mm) and outward unit normals.
    pub fn new(points: Vec<Point3<f64>>, normals: Vec<Vector3<f64>>) -> Self {
        let items = points
            .iter()
            .enumerate()
            .map(|(index, point)| GeomWithData::new((*point).into(), index));
        let tree = RTree::bulk_load(items.collect());
        Self { points, normals, tree }
    }

    /// Finds the border between the body and what is outside it, where both lie in the volume: cavities and cut faces
    /// are left out. The share of body in blocks of voxels is interpolated, so that the surface is smooth.
    ///
    /// # Errors
    /// [`VolumeError`] if there is no such border.
    pub fn of(volume: &LabelVolume, is_body: impl Fn(u8) -> bool) -> Result<Self, VolumeError> {
        let spacing = volume.spacing_mm();
        let block = spacing.map(|mm| ((GRID_MM / mm).round() as usize).max(1));
        let size = [0, 1, 2].map(|axis| volume.size()[axis] / block[axis]);
        if size.iter().any(|n| *n < 3) {
            return Err(VolumeError::new(format!(
                "a volume of {:?} voxels is too small for a surface",
                volume.size()
            )));
        }
        let count = (block[0] * block[1] * block[2]) as f32;
        let offset = |[i, j, k]: [usize; 3]| i + size[0] * (j + size[1] * k);
        let mut share = vec![0.0_f32; size.iter().product()];
        for k in 0..size[2] * block[2] {
            for j in 0..size[1] * block[1] {
                for i in 0..size[0] * block[0] {
                    if is_body(volume.voxels()[volume.offset([i, j, k])]) {
                        share[offset([i / block[0], j / block[1], k / block[2]])] += 1.0 / count;
                    }
                }
            }
        }
        let outside = outside(&share, size);
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        let index = |position: [f64; 3]| {
            // Centre of a block in voxels.
            let voxel = [0, 1, 2].map(|axis| (position[axis] + 0.5) * block[axis] as f64 - 0.5);
            volume.index_to_world().transform_point(&Point3::from(voxel))
        };
        for k in 1..size[2] - 1 {
            for j in 1..size[1] - 1 {
                for i in 1..size[0] - 1 {
                    let cell = [i, j, k];
                    for axis in 0..3 {
                        let mut next = cell;
                        next[axis] += 1;
                        if next[axis] + 1 >= size[axis] {
                            continue;
                        }
                        let [a, b] = [offset(cell), offset(next)];
                        if outside[a] == outside[b] || (share[a] < 0.5) == (share[b] < 0.5) {
                            continue;
                        }
                        let t = f64::from((0.5 - share[a]) / (share[b] - share[a]));
                        let mut crossing = cell.map(|n| n as f64);
                        crossing[axis] += t;
                        let slope = |cell: [usize; 3], along: usize| {
                            let (mut low, mut high) = (cell, cell);
                            low[along] -= 1;
                            high[along] += 1;
                            f64::from(share[offset(high)] - share[offset(low)]) / (block[along] as f64 * spacing[along])
                        };
                        let gradient = [0, 1, 2].map(|along| (1.0 - t) * slope(cell, along) + t * slope(next, along));
                        // Gradients along the index axes, which are perpendicular.
                        let mut normal = Vector3::zeros();
                        for along in 0..3 {
                            normal -=
                                volume.index_to_world().fixed_view::<3, 1>(0, along) / spacing[along] * gradient[along];
                        }
                        if let Some(normal) = normal.try_normalize(1e-9) {
                            points.push(index(crossing));
                            normals.push(normal);
                        }
                    }
                }
            }
        }
        if points.len() < 100 {
            return Err(VolumeError::new(
                "the volume shows no skin: the body fills it, or nothing is labelled; leave unlabelled space around the body",
            ));
        }
        let step = 1 + points.len() / MAX;
        let points = points.into_iter().step_by(step).collect();
        Ok(Self::new(points, normals.into_iter().step_by(step).collect()))
    }

    /// Points of the surface, mm.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Nearest point of the skin.
    pub(crate) fn foot(&self, point: &Point3<f64>) -> Foot {
        let nearest = self
            .tree
            .nearest_neighbor([point.x, point.y, point.z])
            .map_or(0, |item| item.data);
        let (away, normal) = (point - self.points[nearest], self.normals[nearest]);
        let height_mm = normal.dot(&away);
        Foot {
            normal,
            height_mm,
            beyond: (away - normal * height_mm).norm() > BEYOND_MM,
            distance_mm: away.norm(),
        }
    }

    /// Share of the points within a distance (mm) of others.
    pub fn covered(&self, by: &[Point3<f64>], within_mm: f64) -> f64 {
        let tree: RTree<[f64; 3]> = RTree::bulk_load(by.iter().map(|point| (*point).into()).collect());
        let step = 1 + self.points.len() / 5000;
        let tried = self.points.iter().step_by(step);
        let near = |point: &&Point3<f64>| {
            let nearest = tree.nearest_neighbor([point.x, point.y, point.z]);
            nearest.is_some_and(|nearest| (Point3::from(*nearest) - **point).norm() <= within_mm)
        };
        tried.clone().filter(near).count() as f64 / tried.count() as f64
    }
}

/// Relation of a point to the nearest point of the skin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Foot {
    /// Outward normal of the skin.
    pub normal: Vector3<f64>,
    /// Distance along the normal, mm: positive outside.
    pub height_mm: f64,
    /// True beyond the end of the skin, such as a cut through the body: the point lies more than 10 mm aside of the
    /// normal.
    pub beyond: bool,
    distance_mm: f64,
}

impl Foot {
    /// Distance from the skin, mm: along the normal, which points between samples of the skin do not change, or in
    /// space beyond its end.
    pub(crate) fn distance_mm(&self) -> f64 {
        if self.beyond {
            self.distance_mm
        } else {
            self.height_mm.abs()
        }
    }
}

/// Cells outside the body that are connected with the border of the grid.
fn outside(share: &[f32], size: [usize; 3]) -> Vec<bool> {
    let mut outside = vec![false; share.len()];
    let strides = [1, size[0], size[0] * size[1]];
    let mut queue = VecDeque::new();
    for voxel in 0..share.len() {
        let index = [voxel % size[0], voxel / size[0] % size[1], voxel / strides[2]];
        let border = (0..3).any(|axis| index[axis] == 0 || index[axis] + 1 == size[axis]);
        if border && share[voxel] < 0.5 {
            outside[voxel] = true;
            queue.push_back(voxel);
        }
    }
    while let Some(voxel) = queue.pop_front() {
        let index = [voxel % size[0], voxel / size[0] % size[1], voxel / strides[2]];
        for axis in 0..3 {
            let lower = (index[axis] > 0).then(|| voxel - strides[axis]);
            let upper = (index[axis] + 1 < size[axis]).then(|| voxel + strides[axis]);
            for next in [lower, upper].into_iter().flatten() {
                if !outside[next] && share[next] < 0.5 {
                    outside[next] = true;
                    queue.push_back(next);
                }
            }
        }
    }
    outside
}
