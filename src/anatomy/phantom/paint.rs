//! Voxelisation of shapes, slice by slice in parallel: later layers paint over earlier ones where allowed.

use nalgebra::{Matrix4, Vector3};

use super::geometry::{Bounds, Point, Shape, step};
use crate::volume::{Label, LabelVolume, VolumeError};
use insonify_base::cache::cached;
use insonify_base::memory;
use insonify_base::parallel::{chunks_mut, for_each};

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

    /// Paints a box of the world at a resolution. `table` lists value and name of each label, values 1, 2, 3, ...;
    /// `key` is that of the painting in the cache.
    pub(super) fn volume(
        &self,
        world: &Bounds,
        resolution_mm: f64,
        table: &'static [(u8, &'static str)],
        key: &str,
    ) -> Result<LabelVolume, VolumeError> {
        let extent = world.max - world.min;
        let size = [0, 1, 2].map(|axis| (extent[axis] / resolution_mm).round().max(1.0) as usize);
        let count: usize = size.iter().product();
        if count > super::MAX_VOXELS {
            let limit = format!("at most {} are made: choose a coarser resolution", super::MAX_VOXELS);
            let text = format!("{count} voxels at {resolution_mm} mm; {limit}");
            return Err(VolumeError::option("resolution_mm", text));
        }
        memory::check(
            count as u64,
            &format!("a phantom of {} x {} x {} voxels", size[0], size[1], size[2]),
        )?;
        let grid = Grid {
            size,
            // Half a voxel inside the box: the anatomy must not shift with the resolution.
            first: world.min.add_scalar(resolution_mm / 2.0),
            spacing: resolution_mm,
        };
        let voxels = cached(&format!("phantom {key} {resolution_mm}"), count, || {
            let mut voxels = vec![0u8; count];
            for_each((0.., chunks_mut(&mut voxels, size[0] * size[1])), &|(k, slice)| {
                self.paint_slice(&grid, k, slice)
            });
            voxels
        });
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
            .map(|pixel| {
                let p = grid.centre([pixel % grid.size[0], pixel / grid.size[0], k]);
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
                    let pixel = i + grid.size[0] * j;
                    if layer.over.allows(slice[pixel]) && layer.shape.distance(&bent[pixel]) <= layer.grow_mm {
                        slice[pixel] = layer.label;
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

// Indentation of the skin by a convex probe: the body is painted as deformed by the probe of the default pose.

/// Depth below the probe's face at which the displacement vanishes, mm.
const REACH_MM: f64 = 70.0;
/// Half thickness of the probe's face in the elevational direction, mm.
const FACE_HALF_MM: f64 = 9.0;
/// Elevational distance at which the skin is undeformed, mm.
const FADE_MM: f64 = 34.0;

/// Tissue indented by a convex array so that the skin is in contact with its complete face.
pub(super) struct Dent {
    origin: Point,
    lateral: Point,
    axial: Point,
    across: Point,
    radius_mm: f64,
    depth_mm: f64,
    bounds: Bounds,
    skin_depth: fn(&Point) -> f64,
}

impl Dent {
    /// Creates an indentation of at most `depth_mm` by an array of radius `radius_mm` at a pose (probe to world), in
    /// a body whose undeformed depth below the skin (positive inside) is `skin_depth`.
    pub(super) fn new(pose: &Matrix4<f64>, radius_mm: f64, depth_mm: f64, skin_depth: fn(&Point) -> f64) -> Self {
        let column = |i: usize| -> Vector3<f64> { pose.fixed_view::<3, 1>(0, i).into_owned() };
        let origin = column(3);
        Self {
            origin,
            lateral: column(0),
            axial: column(1),
            across: column(2),
            radius_mm,
            depth_mm,
            bounds: Bounds {
                min: origin,
                max: origin,
            }
            .grown(REACH_MM + radius_mm),
            skin_depth,
        }
    }

    /// Box that holds the deformed positions of every point of a box: displacements are along the axis of the probe, by
    /// at most the depth.
    pub(super) fn displaced(&self, bounds: &Bounds) -> Bounds {
        let deepest = self.axial * self.depth_mm;
        let swept = Bounds {
            min: bounds.min.inf(&(bounds.min + deepest)),
            max: bounds.max.sup(&(bounds.max + deepest)),
        };
        if swept.meets(&self.bounds) { swept } else { *bounds }
    }

    /// Maps a point of the deformed body to its undeformed position.
    pub(super) fn undo(&self, p: &Point) -> Point {
        let offset = p - self.origin;
        let (l, a, e) = (
            offset.dot(&self.lateral),
            offset.dot(&self.axial),
            offset.dot(&self.across),
        );
        if l.abs() >= 0.95 * self.radius_mm || e.abs() >= FADE_MM || a.abs() >= REACH_MM {
            return *p;
        }
        let face = (self.radius_mm.powi(2) - l * l).sqrt() - self.radius_mm;
        let below = a - face;
        if below >= REACH_MM {
            return *p;
        }
        let on_face = self.origin + self.lateral * l + self.axial * face + self.across * e;
        let pressed = (self.skin_depth)(&on_face).clamp(0.0, self.depth_mm);
        let fade = (1.0 - below.max(0.0) / REACH_MM).powi(2) * (1.0 - step(FACE_HALF_MM, FADE_MM, e.abs()));
        p - self.axial * (pressed * fade)
    }
}
