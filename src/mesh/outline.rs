//! Triangles of a labelled plane: outlines of its regions, and a constrained Delaunay triangulation between them.
//!
//! Outlines come from marching squares with several labels: the crossings of a grid's edges are located by bisection
//! and joined within each cell, at the point where more than two labels meet. They are thinned (D. Douglas and T.
//! Peucker, 1973) and triangulated with refinement (J. Ruppert, 1995) by the crate `spade`.

use std::collections::{BTreeMap, BTreeSet};

use insonify_base::parallel;
use spade::handles::FixedVertexHandle;
use spade::{AngleLimit, ConstrainedDelaunayTriangulation, Point2, RefinementParameters, Triangulation};

/// Bisections to locate the crossing of a grid's edge, to a thousandth of it.
const HALVINGS: usize = 10;
/// Deviation of a thinned outline as a share of the edge length of triangles: a circle whose diameter is five edges
/// loses less than 1 % of its area.
const THINNED: f64 = 1.0 / 60.0;
/// Least area of a closed outline, in squared spacings of the grid.
const SMALLEST: f64 = 4.0;
/// Least angle that refinement aims at, degrees.
const MIN_DEG: f64 = 25.0;

/// Triangles with their regions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// Node positions, mm.
    pub nodes: Vec<[f64; 2]>,
    /// Corners of each triangle, anticlockwise.
    pub triangles: Vec<[u32; 3]>,
    /// Region of each triangle.
    pub regions: Vec<i32>,
}

/// Triangulates the regions of a plane within a rectangle (mm). `grid_mm` is the spacing of the samples that find the
/// outlines, `edge_mm` the edge length of the triangles. Empty where nothing is labelled.
pub fn triangulate(
    region: impl Fn([f64; 2]) -> Option<i32> + Sync,
    [low, high]: [[f64; 2]; 2],
    grid_mm: f64,
    edge_mm: f64,
) -> Triangles {
    let outlines = Outlines::find(&region, [low, high], grid_mm);
    let mut triangulation = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    for chain in outlines.chains(grid_mm) {
        let chain = thinned(&chain, THINNED * edge_mm);
        let mut handles: Vec<FixedVertexHandle> = Vec::new();
        for &[x, y] in &chain {
            // Only numbers that are not finite or too large are refused; those of a grid are neither.
            handles.extend(triangulation.insert(Point2::new(x, y)).ok());
        }
        for pair in handles.windows(2).filter(|pair| pair[0] != pair[1]) {
            triangulation.add_constraint_and_split(pair[0], pair[1], |index| index);
        }
    }
    // Of an equilateral triangle.
    let area = 3f64.sqrt() / 4.0 * edge_mm * edge_mm;
    let refinement = RefinementParameters::<f64>::new()
        .with_angle_limit(AngleLimit::from_deg(MIN_DEG))
        .with_max_allowed_area(area)
        .with_min_required_area(1e-3 * area)
        .with_max_additional_vertices(100_000);
    triangulation.refine(refinement);
    let mut mesh = Triangles::default();
    let mut numbers: BTreeMap<usize, u32> = BTreeMap::new();
    for face in triangulation.inner_faces() {
        let corners = face.vertices();
        let centre = face.center();
        // The triangulation fills the convex hull: of the parts between regions there is no mesh.
        let Some(region) = region([centre.x, centre.y]) else {
            continue;
        };
        mesh.triangles.push(corners.map(|corner| {
            *numbers.entry(corner.index()).or_insert_with(|| {
                let position = corner.position();
                mesh.nodes.push([position.x, position.y]);
                mesh.nodes.len() as u32 - 1
            })
        }));
        mesh.regions.push(region);
    }
    mesh
}

/// Outlines of regions: points, and the pairs of them that are joined.
#[derive(Default)]
struct Outlines {
    points: Vec<[f64; 2]>,
    joined: Vec<Vec<usize>>,
}

impl Outlines {
    fn find(region: &(impl Fn([f64; 2]) -> Option<i32> + Sync), [low, high]: [[f64; 2]; 2], grid_mm: f64) -> Self {
        // Beyond the rectangle nothing is labelled, so that every outline is closed.
        let [columns, rows] = [0, 1].map(|axis| ((high[axis] - low[axis]) / grid_mm).ceil().max(1.0) as usize + 3);
        let position = |i: usize, j: usize| [low[0] + (i as f64 - 1.0) * grid_mm, low[1] + (j as f64 - 1.0) * grid_mm];
        let label_at = |point: [f64; 2]| {
            let inside = (0..2).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]));
            inside.then(|| region(point)).flatten()
        };
        let labels: Vec<Option<i32>> = parallel::map(0..columns * rows, &|cell| {
            label_at(position(cell % columns, cell / columns))
        });
        let mut outlines = Outlines::default();
        let mut crossings: BTreeMap<[usize; 2], usize> = BTreeMap::new();
        for j in 0..rows - 1 {
            for i in 0..columns - 1 {
                let corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
                let mut meeting = Vec::new();
                for side in 0..4 {
                    let mut ends = [corners[side], corners[(side + 1) % 4]];
                    ends.sort_unstable_by_key(|[i, j]| j * columns + i);
                    let numbers = ends.map(|[i, j]| j * columns + i);
                    let [first, last] = numbers.map(|number| labels[number]);
                    if first == last {
                        continue;
                    }
                    let [from, to] = ends.map(|[i, j]| position(i, j));
                    meeting.push(
                        *crossings
                            .entry(numbers)
                            .or_insert_with(|| outlines.add(crossing(label_at, from, to, first))),
                    );
                }
                match meeting[..] {
                    [a, b] => outlines.join(a, b),
                    [_, _, ..] => {
                        let middle = outlines.add(junction(label_at, position(i, j), grid_mm));
                        meeting.iter().for_each(|&point| outlines.join(point, middle));
                    }
                    _ => {}
                }
            }
        }
        outlines
    }

    fn add(&mut self, point: [f64; 2]) -> usize {
        self.points.push(point);
        self.joined.push(Vec::new());
        self.points.len() - 1
    }

    fn join(&mut self, a: usize, b: usize) {
        self.joined[a].push(b);
        self.joined[b].push(a);
    }

    /// Chains of points between those at which more than two lines meet, and closed outlines that are not tiny.
    fn chains(&self, grid_mm: f64) -> Vec<Vec<[f64; 2]>> {
        let mut used = vec![false; self.points.len()];
        let mut chains = Vec::new();
        let is_inner = |point: usize| self.joined[point].len() == 2;
        for start in (0..self.points.len()).filter(|point| !is_inner(*point)) {
            for &next in &self.joined[start] {
                // A line is walked once, from the end that comes first.
                let walked = if is_inner(next) { used[next] } else { next < start };
                if !walked {
                    chains.push(self.walk(start, next, &mut used));
                }
            }
        }
        for start in 0..self.points.len() {
            if is_inner(start) && !used[start] {
                used[start] = true;
                let chain = self.walk(start, self.joined[start][0], &mut used);
                if area(&chain).abs() >= SMALLEST * grid_mm * grid_mm {
                    chains.push(chain);
                }
            }
        }
        chains
    }

    fn walk(&self, start: usize, next: usize, used: &mut [bool]) -> Vec<[f64; 2]> {
        let mut chain = vec![self.points[start]];
        let (mut before, mut current) = (start, next);
        loop {
            chain.push(self.points[current]);
            if current == start || self.joined[current].len() != 2 {
                return chain;
            }
            used[current] = true;
            let [a, b] = [self.joined[current][0], self.joined[current][1]];
            (before, current) = (current, if a == before { b } else { a });
        }
    }
}

/// Point between two at which the label `first` ends.
fn crossing(
    region: impl Fn([f64; 2]) -> Option<i32>,
    mut from: [f64; 2],
    mut to: [f64; 2],
    first: Option<i32>,
) -> [f64; 2] {
    for _ in 0..HALVINGS {
        let middle = [0, 1].map(|axis: usize| 0.5 * (from[axis] + to[axis]));
        *(if region(middle) == first { &mut from } else { &mut to }) = middle;
    }
    from
}

/// Point of a square cell at which most labels meet: at each bisection the quarter whose corners have most labels is
/// kept. The middle of the cell where only two alternate.
fn junction(region: impl Fn([f64; 2]) -> Option<i32>, mut low: [f64; 2], mut size: f64) -> [f64; 2] {
    let labels = |[x, y]: [f64; 2], size: f64| {
        let corners = [[0.0, 0.0], [size, 0.0], [0.0, size], [size, size]];
        let labels: BTreeSet<Option<i32>> = corners.map(|[right, down]| region([x + right, y + down])).into();
        labels.len()
    };
    for _ in 0..HALVINGS {
        let half = 0.5 * size;
        let quarters = [[0.0, 0.0], [half, 0.0], [0.0, half], [half, half]];
        let quarters = quarters.map(|[right, down]| [low[0] + right, low[1] + down]);
        let best = quarters.into_iter().max_by_key(|&quarter| labels(quarter, half));
        match best.filter(|&quarter| labels(quarter, half) > 2) {
            Some(quarter) => (low, size) = (quarter, half),
            None => break,
        }
    }
    low.map(|coordinate| coordinate + 0.5 * size)
}

/// Area within a closed chain, positive if it runs anticlockwise, mm^2.
fn area(chain: &[[f64; 2]]) -> f64 {
    chain
        .windows(2)
        .map(|pair| 0.5 * (pair[0][0] * pair[1][1] - pair[1][0] * pair[0][1]))
        .sum()
}

/// Chain with the fewest of its points from which no other lies farther than `most_mm`; a closed one is first cut at
/// its farthest point.
fn thinned(chain: &[[f64; 2]], most_mm: f64) -> Vec<[f64; 2]> {
    let last = chain.len() - 1;
    let mut kept = vec![false; chain.len()];
    let mut parts = vec![[0, last]];
    (kept[0], kept[last]) = (true, true);
    while let Some([from, to]) = parts.pop() {
        let (a, b) = (chain[from], chain[to]);
        let along = [b[0] - a[0], b[1] - a[1]];
        let length = along[0].hypot(along[1]);
        let away = |point: &[f64; 2]| {
            let offset = [point[0] - a[0], point[1] - a[1]];
            if length > 0.0 {
                ((along[0] * offset[1] - along[1] * offset[0]) / length).abs()
            } else {
                offset[0].hypot(offset[1])
            }
        };
        let inner = (from + 1..to).map(|index| (index, away(&chain[index])));
        let farthest = inner.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        if let Some((index, _)) = farthest.filter(|(_, away)| *away > most_mm) {
            kept[index] = true;
            parts.extend([[from, index], [index, to]]);
        }
    }
    let points = chain.iter().zip(kept);
    points.filter(|(_, kept)| *kept).map(|(point, _)| *point).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    impl Triangles {
        fn area(&self, of: i32) -> f64 {
            let triangles = self.triangles.iter().zip(&self.regions);
            let triangles = triangles.filter(|(_, region)| **region == of);
            triangles
                .map(|(corners, _)| {
                    let [a, b, c] = corners.map(|node| self.nodes[node as usize]);
                    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
                })
                .inspect(|area| assert!(*area > 0.0))
                .sum()
        }
    }

    /// A disc with an eccentric hole and a disc of another region: areas to a thousandth, the border shared.
    #[test]
    fn areas_are_those_of_circles() {
        let region = |[x, y]: [f64; 2]| match (x.hypot(y), (x - 8.0).hypot(y), (x + 9.0).hypot(y)) {
            (_, hole, _) if hole < 4.0 => None,
            (_, _, vein) if vein < 5.0 => Some(7),
            (all, ..) if all < 20.0 => Some(3),
            _ => None,
        };
        let mesh = triangulate(region, [[-25.0; 2], [25.0; 2]], 0.4, 2.0);
        let error = |of: i32, expected: f64| (mesh.area(of) / expected - 1.0).abs();
        assert!(error(7, 25.0 * PI) < 0.01, "{}", mesh.area(7) / PI);
        assert!(error(3, (400.0 - 16.0 - 25.0) * PI) < 0.004, "{}", mesh.area(3) / PI);
        // Euler's formula for a disc with one hole: the mesh is connected and has no cracks.
        let mut edges: Vec<[u32; 2]> = Vec::new();
        for corners in &mesh.triangles {
            for side in 0..3 {
                let (a, b) = (corners[side], corners[(side + 1) % 3]);
                edges.push([a.min(b), a.max(b)]);
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let euler = mesh.nodes.len() as i64 - edges.len() as i64 + mesh.triangles.len() as i64;
        assert_eq!(euler, 0);
    }

    /// Four squares that meet in a point.
    #[test]
    fn corners_of_many_regions_are_shared() {
        let region = |[x, y]: [f64; 2]| Some(1 + i32::from(x > 0.13) + 2 * i32::from(y > -0.21));
        let mesh = triangulate(region, [[-10.0; 2], [10.0; 2]], 0.5, 3.0);
        let expected = [10.13 * 9.79, 9.87 * 9.79, 10.13 * 10.21, 9.87 * 10.21];
        for (of, expected) in (1..).zip(expected) {
            assert!(
                (mesh.area(of) / expected - 1.0).abs() < 0.01,
                "{of}: {} {expected}",
                mesh.area(of)
            );
        }
        assert!(
            triangulate(|_| None, [[0.0; 2], [1.0; 2]], 0.1, 1.0)
                .triangles
                .is_empty()
        );
    }
}
