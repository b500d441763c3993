//! Labelled volume as classes of tissue in an orthonormal frame in millimetres.

use nalgebra::{Matrix3, Vector3};

use super::{GenerateError, LabelGrid};

/// Class of everything that is not to be meshed.
pub(super) const OUTSIDE: u8 = 0;

/// Classes of a labelled volume: class 0 is the outside, class `c` is `regions[c - 1]`.
pub(super) struct Tissue<'a> {
    voxels: &'a [u8],
    size: [usize; 3],
    class_of: [u8; 256],
    /// Rows of the map from the frame (mm) to voxel indices, offset by half a voxel, so that the floor is the nearest
    /// voxel.
    to_index: [[f64; 4]; 3],
    /// Axes of the frame in the world, as columns.
    axes: Matrix3<f64>,
    /// Origin of the frame in the world, mm.
    origin: Vector3<f64>,
    /// Edges of the box around the tissue, mm. Its low corner is the origin of the frame.
    pub extent: [f64; 3],
    /// Volume of the voxels of each class, mm^3; 0 for the outside.
    pub volumes: Vec<f64>,
    /// Volume of a voxel, mm^3.
    pub voxel_mm3: f64,
    /// Least distance between opposite faces of the block of voxels around the tissue, which is sheared if they are,
    /// mm.
    pub thickness: f64,
    /// Region number of each class; 0 for the outside.
    pub regions: Vec<i32>,
}

impl<'a> Tissue<'a> {
    pub(super) fn new(grid: &LabelGrid<'a>) -> Result<Self, GenerateError> {
        let expected = grid.size.iter().try_fold(1usize, |product, &n| product.checked_mul(n));
        if expected != Some(grid.labels.len()) || grid.labels.is_empty() {
            return Err(GenerateError::Size {
                size: grid.size,
                found: grid.labels.len(),
            });
        }
        let (class_of, regions) = classes(grid)?;
        let linear: Matrix3<f64> = grid.index_to_world.fixed_view::<3, 3>(0, 0).into();
        let axes = orthonormal(&linear).ok_or(GenerateError::Transform)?;
        let translation: Vector3<f64> = grid.index_to_world.fixed_view::<3, 1>(0, 3).into();
        let index_to_frame = axes.transpose() * linear;
        let frame_to_index = index_to_frame.try_inverse().ok_or(GenerateError::Transform)?;
        let voxel_mm3 = linear.determinant().abs();
        if !(voxel_mm3 > 0.0 && frame_to_index.iter().chain(translation.iter()).all(|x| x.is_finite())) {
            return Err(GenerateError::Transform);
        }

        let mut tissue = Tissue {
            voxels: grid.labels,
            size: grid.size,
            class_of,
            to_index: [[0.0; 4]; 3],
            axes,
            origin: translation,
            extent: [0.0; 3],
            volumes: Vec::new(),
            voxel_mm3,
            thickness: 0.0,
            regions,
        };
        // The low corner is known only after the voxels are measured; it becomes the origin of the frame.
        let low = tissue.measure(grid, &index_to_frame)?;
        tissue.origin = translation + axes * low;
        let start = frame_to_index * low;
        for row in 0..3 {
            tissue.to_index[row] = [
                frame_to_index[(row, 0)],
                frame_to_index[(row, 1)],
                frame_to_index[(row, 2)],
                start[row] + 0.5,
            ];
        }
        Ok(tissue)
    }

    /// Counts the voxels and finds the box around those of any class but the outside; returns its low corner.
    fn measure(&mut self, grid: &LabelGrid, index_to_frame: &Matrix3<f64>) -> Result<Vector3<f64>, GenerateError> {
        let mut counts = [0u64; 256];
        let (mut first, mut last) = ([usize::MAX; 3], [0usize; 3]);
        for (row, line) in grid.labels.chunks_exact(self.size[0]).enumerate() {
            let (mut begin, mut end) = (usize::MAX, 0);
            for (i, &label) in line.iter().enumerate() {
                counts[usize::from(label)] += 1;
                if self.class_of[usize::from(label)] != OUTSIDE {
                    begin = begin.min(i);
                    end = i;
                }
            }
            if begin == usize::MAX {
                continue;
            }
            let (j, k) = (row % self.size[1], row / self.size[1]);
            first = [first[0].min(begin), first[1].min(j), first[2].min(k)];
            last = [last[0].max(end), last[1].max(j), last[2].max(k)];
        }
        let missing = grid.regions.iter().find(|(label, _)| counts[usize::from(*label)] == 0);
        if let Some(&(label, region)) = missing {
            let present = (0..=u8::MAX).filter(|label| counts[usize::from(*label)] > 0).collect();
            return Err(GenerateError::NoVoxels { label, region, present });
        }
        self.volumes = vec![0.0; self.regions.len()];
        for (label, &count) in counts.iter().enumerate() {
            let class = self.class_of[label];
            if class != OUTSIDE {
                self.volumes[usize::from(class)] += count as f64 * self.voxel_mm3;
            }
        }
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for corner in 0..8 {
            let index = Vector3::from_fn(|axis, _| {
                if corner >> axis & 1 == 0 {
                    first[axis] as f64 - 0.5
                } else {
                    last[axis] as f64 + 0.5
                }
            });
            let point = index_to_frame * index;
            low = low.inf(&point);
            high = high.sup(&point);
        }
        self.extent = (high - low).into();
        let edges = [0, 1, 2].map(|axis| index_to_frame.column(axis) * (last[axis] - first[axis] + 1) as f64);
        // Volume over face area: in a sheared block edges are longer than the distance between its faces.
        let widths = [0, 1, 2].map(|axis| {
            let face = edges[(axis + 1) % 3].cross(&edges[(axis + 2) % 3]);
            edges[axis].dot(&face).abs() / face.norm()
        });
        self.thickness = widths.into_iter().fold(f64::INFINITY, f64::min);
        Ok(low)
    }

    /// Returns the class at a point of the frame.
    #[inline]
    pub(super) fn class_at(&self, point: [f64; 3]) -> u8 {
        let index = self.index_of(point);
        self.class_at_index(index)
    }

    /// Returns the voxel index of a point of the frame, offset by half a voxel: its floor is the nearest voxel. Affine.
    #[inline]
    pub(super) fn index_of(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.to_index.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3])
    }

    /// Returns the class at an index from [`Tissue::index_of`].
    #[inline]
    pub(super) fn class_at_index(&self, index: [f64; 3]) -> u8 {
        let [nx, ny, nz] = self.size;
        // Negative numbers and NaN become 0 when cast, hence the check on the low side.
        let inside = index[0] >= 0.0 && index[1] >= 0.0 && index[2] >= 0.0;
        let [i, j, k] = index.map(|x| x as usize);
        if !inside || i >= nx || j >= ny || k >= nz {
            return OUTSIDE;
        }
        self.class_of[usize::from(self.voxels[i + nx * (j + ny * k)])]
    }

    /// Transforms a point from the world to the frame, mm.
    pub(super) fn to_frame(&self, point: [f64; 3]) -> Vector3<f64> {
        self.axes.transpose() * (Vector3::from(point) - self.origin)
    }

    /// Transforms a point from the frame to the world, mm.
    pub(super) fn to_world(&self, point: [f64; 3]) -> [f64; 3] {
        (self.axes * Vector3::from(point) + self.origin).into()
    }
}

/// Returns the class of each label, and the region number of each class.
fn classes(grid: &LabelGrid) -> Result<([u8; 256], Vec<i32>), GenerateError> {
    let mut class_of = [OUTSIDE; 256];
    let mut regions = vec![0];
    for &(label, region) in grid.regions {
        if class_of[usize::from(label)] != OUTSIDE {
            return Err(GenerateError::RepeatedLabel { label });
        }
        let known = regions[1..].iter().position(|r| *r == region);
        let class = known.map_or(regions.len(), |index| index + 1);
        if known.is_none() {
            regions.push(region);
        }
        class_of[usize::from(label)] = u8::try_from(class).map_err(|_| GenerateError::TooManyRegions)?;
    }
    if regions.len() == 1 {
        return Err(GenerateError::NoLabel);
    }
    Ok((class_of, regions))
}

/// Returns a right-handed orthonormal frame whose first axis is the first column's direction and whose second lies in
/// the plane of the first two (Gram and Schmidt): for a rotation with a scale these are the axes of the volume, up to a
/// sign.
fn orthonormal(linear: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let first = linear.column(0).try_normalize(0.0)?;
    let second = (linear.column(1) - first * first.dot(&linear.column(1))).try_normalize(0.0)?;
    let axes = Matrix3::from_columns(&[first, second, first.cross(&second)]);
    axes.iter().all(|x| x.is_finite()).then_some(axes)
}
