//! A closed surface, and the voxels whose centres lie inside.

use std::collections::{BTreeMap, HashMap};

use insonify_base::parallel;
use insonify_mesh::file::SurfaceFile;
use nalgebra::{Point3, Vector3};

/// Distance within which points are one, as a part of the longest side: formats as text round.
const SAME: f64 = 1e-6;

/// A closed surface of triangles.
#[derive(Debug)]
pub(super) struct Solid {
    /// LPS, mm.
    points: Vec<Point3<f64>>,
    triangles: Vec<[usize; 3]>,
}

impl Solid {
    /// Makes a solid of a surface; an error tells how open it is.
    pub(super) fn new(surface: &SurfaceFile) -> Result<Self, String> {
        let sign = if surface.is_ras == Some(true) { -1.0 } else { 1.0 };
        let step = (SAME * surface.longest_side()).max(f64::MIN_POSITIVE);
        // Formats that repeat the corners of each triangle repeat their positions.
        let mut numbers: HashMap<[i64; 3], usize> = HashMap::new();
        let mut points = Vec::new();
        let merged: Vec<usize> = surface
            .points
            .iter()
            .map(|[x, y, z]| {
                *numbers
                    .entry([x, y, z].map(|x| (x / step).round() as i64))
                    .or_insert_with(|| {
                        points.push(Point3::new(sign * x, sign * y, *z));
                        points.len() - 1
                    })
            })
            .collect();
        let corners = surface
            .triangles
            .iter()
            .map(|corners| corners.map(|corner| merged[corner as usize]));
        let triangles: Vec<[usize; 3]> = corners.filter(|[a, b, c]| a != b && b != c && c != a).collect();
        if triangles.is_empty() {
            return Err("no triangle".to_owned());
        }
        let mut edges: BTreeMap<[usize; 2], usize> = BTreeMap::new();
        for [a, b, c] in &triangles {
            for [a, b] in [[a, b], [b, c], [c, a]] {
                *edges.entry([*a.min(b), *a.max(b)]).or_default() += 1;
            }
        }
        // Where four triangles meet at an edge, two solids touch.
        let open: Vec<&[usize; 2]> = edges
            .iter()
            .filter(|(_, count)| **count % 2 == 1)
            .map(|(edge, _)| edge)
            .collect();
        if let Some([a, _]) = open.first() {
            let length: f64 = open.iter().map(|[a, b]| (points[*a] - points[*b]).norm()).sum();
            let [x, y, z] = points[*a].into();
            return Err(format!(
                "an open surface: {} of {} edges lie at a hole, {length:.1} mm in all, the first at ({x:.1}, {y:.1}, {z:.1}) mm",
                open.len(),
                edges.len()
            ));
        }
        Ok(Self { points, triangles })
    }

    pub(super) fn points(&self) -> impl Iterator<Item = &Point3<f64>> {
        self.points.iter()
    }

    /// Whether the centre of each voxel of a grid (x fastest) lies inside: 1 where a ray along x from outside has
    /// crossed the surface an odd number of times. A centre on the surface belongs to the side of larger coordinates,
    /// so that solids that touch neither overlap nor leave a gap.
    pub(super) fn voxels(&self, first_mm: &Vector3<f64>, voxel_mm: f64, size: [usize; 3]) -> Vec<u8> {
        let points: Vec<Point3<f64>> = self.points.iter().map(|point| (point - first_mm) / voxel_mm).collect();
        let levels: Vec<[f64; 2]> = self
            .triangles
            .iter()
            .map(|corners| {
                let z = corners.map(|corner| points[corner].z);
                [z[0].min(z[1]).min(z[2]), z[0].max(z[1]).max(z[2])]
            })
            .collect();
        let slices: Vec<usize> = (0..size[2]).collect();
        let slices = parallel::map(&slices[..], &|k: &usize| {
            let level = *k as f64;
            let mut rows: Vec<Vec<f64>> = vec![Vec::new(); size[1]];
            for (corners, [low, high]) in self.triangles.iter().zip(&levels) {
                if *low < level
                    && level <= *high
                    && let Some(segment) = cut(&points, corners, level)
                {
                    cross(segment, &mut rows);
                }
            }
            let mut slice = vec![0; size[0] * size[1]];
            for (row, voxels) in rows.iter_mut().zip(slice.chunks_exact_mut(size[0])) {
                row.sort_by(f64::total_cmp);
                for [enter, leave] in row.as_chunks().0 {
                    let [start, end] = [enter, leave].map(|x| (x.ceil().max(0.0) as usize).min(size[0]));
                    voxels[start..end].fill(1);
                }
            }
            slice
        });
        slices.concat()
    }
}

/// Point on an edge at a level of z. The edge runs from the lower number to the higher, so that the triangles on both
/// of its sides have the same point to the last bit.
fn at_level(points: &[Point3<f64>], [a, b]: [usize; 2], level: f64) -> [f64; 2] {
    let (a, b) = (points[a.min(b)], points[a.max(b)]);
    let share = (level - a.z) / (b.z - a.z);
    [a.x + share * (b.x - a.x), a.y + share * (b.y - a.y)]
}

/// Segment (x, y) in which a triangle is cut by a level of z. A corner at the level counts as above it.
fn cut(points: &[Point3<f64>], corners: &[usize; 3], level: f64) -> Option<[[f64; 2]; 2]> {
    let is_above = corners.map(|corner| points[corner].z >= level);
    let [a, b, c] = *corners;
    let edges = [([a, b], [0, 1]), ([b, c], [1, 2]), ([c, a], [2, 0])];
    let mut cut = edges
        .iter()
        .filter(|(_, [from, to])| is_above[*from] != is_above[*to])
        .map(|(edge, _)| at_level(points, *edge, level));
    Some([cut.next()?, cut.next()?])
}

/// Adds the x at which a segment crosses each row.
fn cross([a, b]: [[f64; 2]; 2], rows: &mut [Vec<f64>]) {
    // From the lower y: the same rule as for levels.
    let ([x, low], [other, high]) = if a[1] <= b[1] { (a, b) } else { (b, a) };
    let (start, end) = (low.ceil().max(0.0), high.ceil().min(rows.len() as f64));
    // Row j is crossed if low <= j < high.
    for row in (start as usize)..(end.max(start) as usize) {
        rows[row].push(x + (other - x) * ((row as f64 - low) / (high - low)));
    }
}
