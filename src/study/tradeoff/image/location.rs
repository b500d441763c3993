//! Point location in a deforming mesh.

use std::time::Instant;

use super::{ImageError, ImageOptions, Table, factor};
use crate::base::report::statistics::Spread;
use crate::mechanics::mesh::locator::Locator;
use crate::mechanics::mesh::{Displacement, NONE, TetMesh};
use crate::study::tradeoff::{Axis, Goal, SHIFT_MM};

const BOX_MM: [[f64; 3]; 2] = [[-60.0, 0.0, -40.0], [60.0, 100.0, 40.0]];
const FRAMES: usize = 8;
/// Number of points located by exhaustive search.
const EXHAUSTIVE: usize = 200;

/// Returns the nodes of a frame: an indentation that comes and goes, and a swirl.
fn nodes(mesh: &TetMesh, frame: usize) -> Vec<[f64; 3]> {
    let share = (frame as f64 / FRAMES as f64 * std::f64::consts::PI).sin();
    let press = Displacement::Indentation {
        centre_mm: [5.0, 10.0, 0.0],
        direction: [0.1, 1.0, 0.0],
        depth_mm: 12.0 * share,
        radius_mm: 22.0,
    };
    mesh.nodes()
        .iter()
        .map(|&node| {
            let moved = press.apply(node);
            [0, 1, 2].map(|axis| node[axis] + moved[axis])
        })
        .collect()
}

/// Returns the points of a plane through the box, scanline by scanline, shifted slightly in every frame as by a hand.
fn points(count: usize, frame: usize) -> Vec<[f64; 3]> {
    let side = (count as f64).sqrt().ceil() as usize;
    let shift = 0.3 * frame as f64;
    (0..count)
        .map(|at| {
            let (line, sample) = (at / side, at % side);
            let across = -50.0 + 100.0 * (line as f64 + 0.37) / side as f64;
            let down = 2.0 + 96.0 * (sample as f64 + 0.41) / side as f64;
            [across + shift, down, 0.2 * across + 0.1 * down - 9.0 + shift]
        })
        .collect()
}

/// Returns the smallest barycentric coordinate of a point in an element.
fn least(nodes: &[[f64; 3]], corners: [u32; 4], p: [f64; 3]) -> f64 {
    let [a, b, c, d] = corners.map(|corner| nalgebra::Vector3::from(nodes[corner as usize]));
    let p = nalgebra::Vector3::from(p);
    let volume = |a: nalgebra::Vector3<f64>,
                  b: nalgebra::Vector3<f64>,
                  c: nalgebra::Vector3<f64>,
                  d: nalgebra::Vector3<f64>| { (b - a).cross(&(c - a)).dot(&(d - a)) };
    let whole = volume(a, b, c, d);
    let parts = [
        volume(p, b, c, d),
        volume(a, p, c, d),
        volume(a, b, p, d),
        volume(a, b, c, p),
    ];
    parts.map(|part| part / whole).into_iter().fold(f64::INFINITY, f64::min)
}

/// Returns the lowest-numbered element that contains a point, by exhaustive search.
fn exhaustive(mesh: &TetMesh, nodes: &[[f64; 3]], p: [f64; 3]) -> u32 {
    let holding = mesh
        .elements()
        .iter()
        .position(|&corners| least(nodes, corners, p) >= 0.0);
    holding.map_or(NONE, |at| at as u32)
}

/// Results of one method: time per point in each frame, and differences from exhaustive search.
#[derive(Default)]
struct Variant {
    nanoseconds: Vec<f64>,
    differing: usize,
    off_mm: f64,
}

impl Variant {
    fn timed(&mut self, started: Instant, points: usize) {
        self.nanoseconds
            .push(started.elapsed().as_secs_f64() * 1e9 / points as f64);
    }

    /// Counts a different element only if the point is not, within rounding, on a face of the elements found.
    fn judge(&mut self, locator: &Locator<f64>, mesh: &TetMesh, nodes: &[[f64; 3]], p: [f64; 3], answers: [u32; 2]) {
        let [found, exact] = answers;
        if found == exact {
            return;
        }
        let on_a_face = [found, exact]
            .iter()
            .filter(|element| **element != NONE)
            .all(|&element| least(nodes, mesh.elements()[element as usize], p).abs() < 1e-9);
        if !on_a_face {
            self.differing += 1;
        }
        if found != NONE && exact != NONE {
            let [a, b] = [found, exact].map(|element| nalgebra::Vector3::from(locator.to_reference(element, p)));
            self.off_mm = self.off_mm.max((a - b).norm());
        }
    }
}

pub fn location(options: &ImageOptions, _: &mut Vec<String>) -> Result<Vec<Table>, ImageError> {
    let axes = [
        Axis::log("elements", "elements", "elements of the mesh"),
        Axis::log("point_ns", "ns a point", "time of a point (median of frames), ns"),
        Axis::log("p95_ns", "p95 ns", "time of a point (95 of 100 frames), ns"),
        Axis::linear("differing", "differ", "answers that differ from the exhaustive search"),
        Axis::log("off_mm", "mm off", "largest error of a reference position, mm"),
    ];
    let factors = [factor("method", "method"), factor("mesh", "mesh")];
    let title = "Point location in a deforming mesh, double precision, one thread, against trying every element";
    let goal = Goal::new("point_ns", "off_mm", SHIFT_MM).choosing("point location in the mesh");
    let mut table = Table::new("image_location", title, &factors, &axes)
        .against("every element tried")
        .seeking(goal.each(&["mesh"]).beside(&["p95_ns", "differing"]));
    for &count in &options.nodes {
        let mesh = TetMesh::over_box(BOX_MM[0], BOX_MM[1], count)?;
        let mut locator = Locator::<f64>::new(&mesh);
        let [mut walk, mut grid, mut all] = [Variant::default(), Variant::default(), Variant::default()];
        let mut last = vec![NONE; options.points];
        for frame in 0..FRAMES {
            let nodes = nodes(&mesh, frame);
            locator.update(&nodes)?;
            let points = points(options.points, frame);
            let started = Instant::now();
            let mut before = NONE;
            for (element, &p) in last.iter_mut().zip(&points) {
                // As in a frame: start from the element of the last frame, otherwise from the previous sample.
                let start = if *element == NONE { before } else { *element };
                *element = locator.locate(p, start).element;
                before = *element;
            }
            walk.timed(started, points.len());
            let started = Instant::now();
            let from_grid: Vec<u32> = points.iter().map(|&p| locator.locate(p, NONE).element).collect();
            grid.timed(started, points.len());
            let step = (points.len() / EXHAUSTIVE).max(1);
            let tried: Vec<usize> = (0..points.len()).step_by(step).collect();
            let started = Instant::now();
            let exact: Vec<u32> = tried.iter().map(|&at| exhaustive(&mesh, &nodes, points[at])).collect();
            all.timed(started, tried.len());
            for (&at, &exact) in tried.iter().zip(&exact) {
                walk.judge(&locator, &mesh, &nodes, points[at], [last[at], exact]);
                grid.judge(&locator, &mesh, &nodes, points[at], [from_grid[at], exact]);
            }
        }
        // The first frame has no start elements.
        walk.nanoseconds.remove(0);
        for (name, way) in [
            ("walk from the last frame", walk),
            ("search grid", grid),
            ("every element", all),
        ] {
            let spread = Spread::of(way.nanoseconds);
            let flag =
                (way.differing > 0).then(|| format!("{} answers differ from the exhaustive search", way.differing));
            let values = vec![
                Some(mesh.elements().len() as f64),
                spread.map(|spread| spread.median_ms),
                spread.map(|spread| spread.p95_ms),
                Some(way.differing as f64),
                Some(way.off_mm),
            ];
            table.push(
                vec![name.to_owned(), format!("{} nodes", mesh.nodes().len())],
                values,
                flag,
            );
        }
    }
    Ok(vec![table])
}
