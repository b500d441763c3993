//! Voxelisation of shapes, slice by slice in parallel: later layers paint over earlier ones where allowed.

use nalgebra::{Matrix4, Vector3};
use rayon::prelude::*;

use super::dent::Dent;
use super::geometry::{Bounds, Point, Shape};
use crate::memory;
use crate::volume::{Label, LabelVolume, VolumeError};

/// Set of labels that a layer may paint over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Over(u64);

impl Over {
    /// All labels except the outside of the body (label 0).
    pub(super) const BODY: Self = Self(!1);
    /// Returns the set of the listed labels.
    pub(super) fn only(labels: &[u8]) -> Self {
        Self(labels.iter().fold(0, |set, &label| set | 1 << label))
    }

    fn allows(self, label: u8) -> bool {
        self.0 >> label & 1 == 1
    }
}

/// A shape with its label.
pub(super) struct Layer {
    shape: Box<dyn Shape>,
    grow_mm: f64,
    label: u8,
    over: Over,
}

/// A base that labels every voxel, and layers over it in order.
pub(super) struct Painting<B> {
    base: B,
    layers: Vec<Layer>,
    dent: Option<Dent>,
}

impl<B: Fn(&Point) -> u8 + Sync> Painting<B> {
    /// Creates a painting with a base only.
    pub(super) fn new(base: B, dent: Option<Dent>) -> Self {
        Self {
            base,
            layers: Vec::new(),
            dent,
        }
    }

    /// Adds a shape, enlarged by `grow_mm`, with a label, over the labels that `over` allows.
    pub(super) fn add(&mut self, shape: impl Shape + 'static, grow_mm: f64, label: u8, over: Over) {
        self.layers.push(Layer {
            shape: Box::new(shape),
            grow_mm,
            label,
            over,
        });
    }

    /// Adds every shape of a list.
    pub(super) fn add_all<S: Shape + Copy + 'static>(&mut self, shapes: &[S], grow_mm: f64, label: u8, over: Over) {
        for &shape in shapes {
            self.add(shape, grow_mm, label, over);
        }
    }

    /// Paints a box of the world at a resolution. `table` lists value and name of each label, values 1, 2, 3, ...
    pub(super) fn volume(
        &self,
        world: &Bounds,
        resolution_mm: f64,
        table: &'static [(u8, &'static str)],
    ) -> Result<LabelVolume, VolumeError> {
        let extent = world.max - world.min;
        let size = [0, 1, 2].map(|axis| (extent[axis] / resolution_mm).round().max(1.0) as usize);
        let count: usize = size.iter().product();
        if count > super::MAX_VOXELS {
            let most = format!("at most {} are made: choose a coarser resolution", super::MAX_VOXELS);
            let text = format!("{count} voxels at {resolution_mm} mm; {most}");
            return Err(VolumeError::option("resolution_mm", text));
        }
        memory::check(
            count as u64,
            &format!("a phantom of {} x {} x {} voxels", size[0], size[1], size[2]),
        )?;
        let grid = Grid {
            size,
            first: world.min.add_scalar(resolution_mm / 2.0),
            spacing: resolution_mm,
        };
        let mut voxels = vec![0u8; count];
        voxels
            .par_chunks_mut(size[0] * size[1])
            .enumerate()
            .for_each(|(k, slice)| self.paint_slice(&grid, k, slice));
        let mut counts = [0u64; 256];
        for &voxel in &voxels {
            counts[usize::from(voxel)] += 1;
        }
        let labels = std::iter::once((0, "background"))
            .chain(table.iter().copied())
            .map(|(value, name)| Label {
                value: i64::from(value),
                name: Some(name.to_owned()),
                voxels: counts[usize::from(value)],
            })
            .collect();
        let index_to_world = Matrix4::new_translation(&grid.first) * Matrix4::new_scaling(resolution_mm);
        LabelVolume::new(size, voxels, labels, index_to_world)
    }

    fn paint_slice(&self, grid: &Grid, k: usize, slice: &mut [u8]) {
        let bent: Vec<Point> = (0..slice.len())
            .map(|at| {
                let p = grid.centre([at % grid.size[0], at / grid.size[0], k]);
                self.dent.as_ref().map_or(p, |dent| dent.undo(&p))
            })
            .collect();
        for (voxel, p) in slice.iter_mut().zip(&bent) {
            *voxel = (self.base)(p);
        }
        for layer in &self.layers {
            let mut bounds = layer.shape.bounds().grown(layer.grow_mm);
            if let Some(dent) = &self.dent {
                bounds = dent.displaced(&bounds);
            }
            let Some([xs, ys]) = grid.window(&bounds, k) else {
                continue;
            };
            for j in ys {
                for i in xs.clone() {
                    let at = i + grid.size[0] * j;
                    if layer.over.allows(slice[at]) && layer.shape.distance(&bent[at]) <= layer.grow_mm {
                        slice[at] = layer.label;
                    }
                }
            }
        }
    }
}

/// An axis-aligned grid of voxel centres.
struct Grid {
    size: [usize; 3],
    first: Vector3<f64>,
    spacing: f64,
}

impl Grid {
    fn centre(&self, index: [usize; 3]) -> Point {
        self.first + Vector3::from(index.map(|i| i as f64)) * self.spacing
    }

    /// Ranges of x and y indices inside a box on slice `k`, if any.
    fn window(&self, bounds: &Bounds, k: usize) -> Option<[std::ops::Range<usize>; 2]> {
        let z = self.first.z + k as f64 * self.spacing;
        if z < bounds.min.z || z > bounds.max.z {
            return None;
        }
        let range = |axis: usize| {
            let low = ((bounds.min[axis] - self.first[axis]) / self.spacing).ceil().max(0.0);
            let high = ((bounds.max[axis] - self.first[axis]) / self.spacing).floor() + 1.0;
            (low as usize).min(self.size[axis])..(high.max(0.0) as usize).min(self.size[axis])
        };
        Some([range(0), range(1)])
    }
}
