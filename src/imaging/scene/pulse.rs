//! Pulsation: arteries that widen with every beat of the heart, as displacements of the nodes of a mesh.
//!
//! The volume shows the end of diastole, at time 0. An artery widens within 0.3 of a beat and narrows in the rest of
//! it, each by half a wave of a sine. Within it the displacement grows from the middle in proportion, from its wall on
//! it falls as around a round tube in tissue that keeps its volume, as 1 / r, and tapers to nothing at four radii. Bone
//! and skin rest.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};

use super::deform::Nodes;
use super::paths::PulseSpec;
use super::target::Body;
use insonify_anatomy::volume::LabelVolume;
use insonify_anatomy::volume::distance::Grid;
use insonify_mesh::TetMesh;

/// Parts of the names of arteries.
const ARTERIES: [&str; 3] = ["aorta", "artery", "carotid"];

/// Share of its radius by which an artery widens: carotid arteries by 12 to 14 % of their diameter in the young and by
/// 5 % in the old (Hansen et al. 1995), the middle of both.
const USUAL_SHARE: f64 = 0.09;

/// Stiffness of an artery, whose blood is under pressure, kPa: the modulus of Peterson et al. 1960, pulse pressure (40
/// mmHg) over the share by which the diameter grows.
pub(super) const ARTERY_KPA: f64 = 5.33 / USUAL_SHARE;

/// Widest displacement, as a share of the radius.
pub(super) const WIDEST_SHARE: f64 = 0.5;

/// Widest displacement, mm.
pub(super) const WIDEST_MM: f64 = 5.0;

/// Distance from the middle at which tissue rests, in radii.
const REACH_RADII: f64 = 4.0;

/// Part of a beat in which an artery widens.
const RISE: f64 = 0.3;

impl PulseSpec {
    /// Duration of a beat, s.
    pub(super) fn period_s(&self) -> f64 {
        60.0 / self.rate_per_min
    }

    /// Share of the displacement at a time (s): 0 at the end of diastole, 1 where arteries are widest.
    pub(super) fn share_at(&self, time_s: f64) -> f64 {
        let phase = (time_s / self.period_s()).rem_euclid(1.0);
        let of_half_wave = if phase < RISE {
            phase / RISE
        } else {
            (1.0 - phase) / (1.0 - RISE)
        };
        (0.5 * PI * of_half_wave).sin().powi(2)
    }
}

/// Displacements where arteries are widest.
pub(super) struct Widened {
    /// Displacement of each node, mm.
    pub displacements: Nodes,
    /// Arteries that widen.
    pub arteries: Vec<Artery>,
    /// Arteries that are stated and are not in the volume.
    pub absent: Vec<String>,
}

/// An artery and how far its wall moves.
pub(super) struct Artery {
    pub name: String,
    pub radius_mm: f64,
    pub radial_mm: f64,
    /// Whether a node of the mesh lies in it.
    pub has_node: bool,
}

/// Labels that are named as arteries.
pub(super) fn arteries(body: &Body<'_>) -> impl Iterator<Item = u8> {
    ARTERIES.iter().flat_map(|name| body.matching(name))
}

/// Computes the displacements of a mesh's nodes where arteries are widest.
pub(super) fn widened(spec: &PulseSpec, mesh: &TetMesh, body: &Body<'_>) -> Widened {
    let volume = body.volume.undivided();
    let (mut radial_of, mut absent) = (BTreeMap::new(), Vec::new());
    match &spec.radial_mm {
        None => radial_of.extend(arteries(body).map(|label| (label, None))),
        Some(stated) => {
            for (name, radial_mm) in stated {
                let labels = body.matching(name);
                if labels.is_empty() {
                    absent.push(name.clone());
                }
                radial_of.extend(labels.into_iter().map(|label| (label, Some(*radial_mm))));
            }
        }
    }
    let mut displacements = vec![[0.0; 3]; mesh.nodes().len()];
    let mut arteries = Vec::new();
    for (label, stated_mm) in radial_of {
        let Some(tube) = Tube::of_label(volume, label) else {
            continue;
        };
        let radial_mm = stated_mm.unwrap_or(USUAL_SHARE * tube.radius_mm);
        let mut has_node = false;
        for (node, sum) in mesh.nodes().iter().zip(&mut displacements) {
            let index = volume.world_to_index().transform_point(&Point3::from(*node));
            let Some((from_wall_mm, outwards)) = tube.wall_from(volume, index) else {
                continue;
            };
            has_node |= from_wall_mm < 0.0;
            let label = volume.label_at_index(index.coords.into()).unwrap_or(0);
            if !(body.is_bone(label) || body.tissues.tissue(label).name == "skin") {
                let by_mm = radial_mm * tube.share(from_wall_mm);
                *sum = [0, 1, 2].map(|axis| sum[axis] + by_mm * outwards[axis]);
            }
        }
        arteries.push(Artery {
            name: body.name(label),
            radius_mm: tube.radius_mm,
            radial_mm,
            has_node,
        });
    }
    Widened {
        displacements,
        arteries,
        absent,
    }
}

/// An artery of voxels.
struct Tube {
    /// Mean radius, mm: three times the mean depth of a round tube.
    radius_mm: f64,
    /// Distance from the wall (mm), negative inside.
    from_wall: Grid,
    /// Voxel of the volume at the first cell of the grid.
    first: [usize; 3],
}

impl Tube {
    /// Collects the voxels of a label; `None` if there are none.
    fn of_label(volume: &LabelVolume, label: u8) -> Option<Self> {
        let [nx, ny, _] = volume.size();
        let voxels = || {
            let of_label = (0..).zip(volume.voxels()).filter(move |(_, voxel)| **voxel == label);
            of_label.map(move |(offset, _): (usize, _)| [offset % nx, offset / nx % ny, offset / (nx * ny)])
        };
        let (mut low, mut high) = (voxels().next()?, [0; 3]);
        for voxel in voxels() {
            for axis in 0..3 {
                low[axis] = low[axis].min(voxel[axis]);
                high[axis] = high[axis].max(voxel[axis]);
            }
        }
        // Two boxes: the radius that the second one needs follows from the first.
        let boxed = |margin_mm: f64| {
            let margin = volume.spacing_mm().map(|mm| (margin_mm / mm).ceil() as usize + 1);
            let first = [0, 1, 2].map(|axis| low[axis].saturating_sub(margin[axis]));
            let size = [0, 1, 2].map(|axis| (high[axis] + margin[axis] + 1).min(volume.size()[axis]) - first[axis]);
            let cells = (0..size.iter().product()).map(|cell: usize| {
                let steps = [cell % size[0], cell / size[0] % size[1], cell / (size[0] * size[1])];
                volume.voxels()[volume.offset([0, 1, 2].map(|axis| first[axis] + steps[axis]))] == label
            });
            (first, size, cells.collect::<Vec<bool>>())
        };
        let (_, size, inside) = boxed(0.0);
        let radius_mm = radius_mm(&inside, size, volume.spacing_mm())?;
        let (first, size, inside) = boxed(REACH_RADII * radius_mm);
        let mut from_wall = from_wall(&inside, size, volume.spacing_mm());
        // Directions away from single voxels would point along the axes of the grid.
        from_wall.smooth(volume.spacing_mm().into_iter().fold(0.0, f64::max));
        Some(Self {
            radius_mm,
            from_wall,
            first,
        })
    }

    /// Distance from the wall to a voxel index (mm), negative inside, and the direction in the world away from the
    /// artery; `None` beyond its reach.
    fn wall_from(&self, volume: &LabelVolume, index: Point3<f64>) -> Option<(f64, Vector3<f64>)> {
        let cell = [0, 1, 2].map(|axis| index[axis] - self.first[axis] as f64);
        let is_inside = |axis: usize| (-0.5..self.from_wall.size[axis] as f64 - 0.5).contains(&cell[axis]);
        if !(0..3).all(is_inside) {
            return None;
        }
        let slope = [0, 1, 2].map(|axis| {
            let [mut before, mut after] = [cell; 2];
            before[axis] -= 1.0;
            after[axis] += 1.0;
            interpolated(&self.from_wall, after) - interpolated(&self.from_wall, before)
        });
        let to_index = volume.world_to_index().fixed_view::<3, 3>(0, 0).into_owned();
        let outwards = (to_index.transpose() * Vector3::from(slope)).try_normalize(0.0);
        Some((interpolated(&self.from_wall, cell), outwards.unwrap_or_default()))
    }

    /// Displacement at a distance from the wall (mm, negative inside), over that of the wall.
    fn share(&self, from_wall_mm: f64) -> f64 {
        let radii = 1.0 + from_wall_mm / self.radius_mm;
        if radii < 1.0 {
            return radii.max(0.0);
        }
        ((REACH_RADII - radii) / (REACH_RADII - 1.0)).max(0.0) / radii
    }
}

/// Radius of a round tube with the mean depth of a set of voxels, mm.
fn radius_mm(inside: &[bool], size: [usize; 3], spacing: [f64; 3]) -> Option<f64> {
    let depths = from_wall(inside, size, spacing).values;
    let depths = depths.iter().zip(inside).filter(|(_, inside)| **inside);
    let (sum, count) = depths.fold((0.0, 0_u32), |(sum, count), (depth, _)| {
        (sum - f64::from(*depth), count + 1)
    });
    Some(3.0 * sum / f64::from(count)).filter(|radius_mm| *radius_mm > 0.0)
}

/// Distances from the wall of a set of voxels to their centres, mm, negative inside.
fn from_wall(inside: &[bool], size: [usize; 3], spacing: [f64; 3]) -> Grid {
    let outside: Vec<bool> = inside.iter().map(|inside| !inside).collect();
    let mut distances = Grid::squared_distances(inside, size, spacing, &[0, 1, 2]);
    let depths = Grid::squared_distances(&outside, size, spacing, &[0, 1, 2]);
    // The wall is half a voxel from the centres on both sides of it.
    let half = 0.5 * spacing.iter().copied().fold(f64::INFINITY, f64::min) as f32;
    for (distance, depth) in distances.values.iter_mut().zip(&depths.values) {
        let is_inside = *depth > 0.0;
        *distance = if is_inside {
            half - depth.sqrt()
        } else {
            distance.sqrt() - half
        };
    }
    distances
}

/// Interpolates a grid between its cells; beyond its ends the value is that of the last cell.
fn interpolated(grid: &Grid, cell: [f64; 3]) -> f64 {
    let [nx, ny, _] = grid.size;
    let ends = [0, 1, 2].map(|axis| {
        let inside = cell[axis].clamp(0.0, (grid.size[axis] - 1) as f64);
        let low = inside as usize;
        let share = inside - low as f64;
        [(low, 1.0 - share), ((low + 1).min(grid.size[axis] - 1), share)]
    });
    let mut sum = 0.0;
    for (i, x) in ends[0] {
        for (j, y) in ends[1] {
            for (k, z) in ends[2] {
                sum += x * y * z * f64::from(grid.values[i + nx * (j + ny * k)]);
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beat_is_short_in_systole_and_begins_at_the_end_of_diastole() {
        let spec = PulseSpec {
            rate_per_min: 60.0,
            ..PulseSpec::default()
        };
        for (time_s, share) in [(0.0, 0.0), (0.15, 0.5), (0.3, 1.0), (0.65, 0.5), (1.0, 0.0), (2.3, 1.0)] {
            assert!(
                (spec.share_at(time_s) - share).abs() < 1e-9,
                "{time_s} s: {}",
                spec.share_at(time_s)
            );
        }
    }

    /// A tube of 8 mm along z, of voxels of 0.5 x 0.5 x 1 mm.
    #[test]
    fn a_tube_has_its_radius_and_widens_in_proportion() {
        let (size, spacing) = ([80, 80, 20], [0.5, 0.5, 1.0]);
        let centred = |i: usize| 0.5 * i as f64 - 19.75;
        let cells = (0..size.iter().product()).map(|cell: usize| [cell % 80, cell / 80 % 80]);
        let inside: Vec<bool> = cells.map(|[i, j]| centred(i).hypot(centred(j)) < 8.0).collect();
        let radius = radius_mm(&inside, size, spacing).expect("a radius");
        assert!((radius - 8.0).abs() < 0.4, "{radius}");
        let tube = Tube {
            radius_mm: radius,
            from_wall: from_wall(&inside, size, spacing),
            first: [0; 3],
        };
        for (x_mm, share) in [(4.0, 0.5), (8.0, 1.0), (16.0, 0.5 * 2.0 / 3.0)] {
            let from_wall_mm = interpolated(&tube.from_wall, [(x_mm + 19.75) / 0.5, 39.5, 10.0]);
            let found = tube.share(from_wall_mm);
            assert!((found - share).abs() < 0.06, "{x_mm} mm: {found}");
        }
        assert_eq!(tube.share(3.1 * radius), 0.0);
    }
}
