//! Voxels of an organ with their depths below its surface.

use crate::volume::LabelVolume;
use crate::volume::distance::Grid;

/// Labelled voxels in their bounding box.
pub(crate) struct Organ {
    low: [usize; 3],
    /// Distance from the centre of a voxel to that of the nearest one outside the organ, mm; 0 outside. Faces of the
    /// volume that cut an organ do not count as its surface.
    depth_mm: Grid,
}

impl Organ {
    /// Collects the voxels of labels; `None` if there are none.
    pub(crate) fn of(volume: &LabelVolume, labels: impl Fn(u8) -> bool) -> Option<Self> {
        let (low, mut inside, size) = boxed(volume, labels, 1)?;
        inside.iter_mut().for_each(|inside| *inside = !*inside);
        let mut depth_mm = Grid::squared_distances(&inside, size, volume.spacing_mm(), &[0, 1, 2]);
        depth_mm.values.iter_mut().for_each(|value| *value = value.sqrt());
        Some(Self { low, depth_mm })
    }

    /// Collects the voxels of labels and those within a distance of them, mm.
    pub(crate) fn around(volume: &LabelVolume, labels: impl Fn(u8) -> bool, reach_mm: f64) -> Option<Self> {
        let spacing = volume.spacing_mm();
        let least = spacing.iter().copied().fold(f64::INFINITY, f64::min);
        let (low, inside, size) = boxed(volume, labels, (reach_mm / least).ceil() as usize + 1)?;
        let mut depth_mm = Grid::squared_distances(&inside, size, spacing, &[0, 1, 2]);
        let depth = |squared: f32| (reach_mm as f32 - squared.sqrt()).max(0.0);
        depth_mm.values.iter_mut().for_each(|value| *value = depth(*value));
        Some(Self { low, depth_mm })
    }

    /// Voxels with their depths, mm, in order.
    pub(crate) fn voxels(&self) -> impl Iterator<Item = ([usize; 3], f64)> {
        let [nx, ny, _] = self.depth_mm.size;
        let [a, b, c] = self.low;
        let inside = self
            .depth_mm
            .values
            .iter()
            .enumerate()
            .filter(|(_, depth)| **depth > 0.0);
        inside.map(move |(index, &depth)| {
            (
                [a + index % nx, b + index / nx % ny, c + index / (nx * ny)],
                f64::from(depth),
            )
        })
    }

    /// Depth of a voxel of the volume, mm: 0 outside.
    pub(crate) fn depth_mm(&self, voxel: [usize; 3]) -> f64 {
        let mut inside_index = [0; 3];
        for axis in 0..3 {
            match voxel[axis]
                .checked_sub(self.low[axis])
                .filter(|index| *index < self.depth_mm.size[axis])
            {
                Some(inside) => inside_index[axis] = inside,
                None => return 0.0,
            }
        }
        let [nx, ny, _] = self.depth_mm.size;
        f64::from(self.depth_mm.values[inside_index[0] + nx * (inside_index[1] + ny * inside_index[2])])
    }

    pub(crate) fn holds(&self, voxel: [usize; 3]) -> bool {
        self.depth_mm(voxel) > 0.0
    }

    /// Greatest depth, mm.
    pub(crate) fn deepest_mm(&self) -> f64 {
        f64::from(self.depth_mm.values.iter().copied().fold(0.0, f32::max))
    }
}

/// Bounding box of the voxels of labels, with a margin inside the volume: first voxel, mask of the labels, size.
fn boxed(
    volume: &LabelVolume,
    labels: impl Fn(u8) -> bool,
    margin: usize,
) -> Option<([usize; 3], Vec<bool>, [usize; 3])> {
    let [nx, ny, nz] = volume.size();
    let mut wanted = [false; 256];
    (0..=255u8).for_each(|label| wanted[usize::from(label)] = labels(label));
    // Within a row only the ends matter: most rows of a volume hold none of the labels and are passed over at once.
    let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
    for (row, line) in volume.voxels().chunks(nx).enumerate() {
        let is = |label: &u8| wanted[usize::from(*label)];
        let (Some(first), Some(last)) = (line.iter().position(is), line.iter().rposition(is)) else {
            continue;
        };
        for (axis, ends) in [[first, last], [row % ny; 2], [row / ny; 2]].into_iter().enumerate() {
            low[axis] = low[axis].min(ends[0]);
            high[axis] = high[axis].max(ends[1]);
        }
    }
    if low[0] == usize::MAX {
        return None;
    }
    let size = [nx, ny, nz];
    let low = low.map(|index| index.saturating_sub(margin));
    let high = [0, 1, 2].map(|axis| (high[axis] + margin + 1).min(size[axis]));
    let size = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let mut inside = Vec::with_capacity(size.iter().product());
    for k in low[2]..high[2] {
        for j in low[1]..high[1] {
            let row = &volume.voxels()[volume.offset([low[0], j, k])..][..size[0]];
            inside.extend(row.iter().map(|label| wanted[usize::from(*label)]));
        }
    }
    Some((low, inside, size))
}
