//! Error bounds of the warp: the reference position of every sample. A twin may choose another element only if the
//! sample provably lies within rounding of it, and the other side of the mesh surface only within rounding of that
//! surface.

use insonify_mesh::{NO_ELEMENT, TetMesh};
use nalgebra::{Matrix3, Vector3};

use crate::parity::rounding::ULP;
use crate::parity::{Slack, Step};

/// Rounding error of one term of the map, in ULP: gradient stored (1/2), product (1), three sums (3).
const TERM: f64 = 4.5;

/// Tolerances of point location: for a barycentric coordinate in ULP per unit of (1 + aspect), and for the point in ULP
/// of the largest coordinate over the least height. They are the locator's constants of 16 and 2 epsilons, derived
/// there (an epsilon is 1 ULP), doubled for the rounding of the tested coordinate.
const COORDINATE: f64 = 2.0 * 16.0;
const POINT: f64 = 2.0 * 2.0;

/// A vector (mm, world) that a sample's element maps to the reference state, with the bound of each coordinate: the
/// difference between the elements of reference and twin, and the rounding of the map.
pub(crate) fn carried(step: &Step, index: usize, vector: Vector3<f64>) -> (Vector3<f64>, [f64; 3]) {
    let Some(mesh) = step.tables.mesh.as_deref() else {
        return (vector, [0.0; 3]);
    };
    let nodes = current(step, mesh);
    let [exact, twin] = [step.before, step.twin].map(|beam| {
        let element = beam.element[index];
        (element != NO_ELEMENT).then(|| Tetrahedron::new(mesh, nodes, reference(step, mesh), element))
    });
    let carried = |element: &Option<Tetrahedron>| element.as_ref().map_or(vector, |element| element.gradient * vector);
    let differing = carried(&exact) - carried(&twin);
    let off = std::array::from_fn(|row| {
        let rounding = twin.as_ref().map_or(0.0, |element| {
            // Nodes are stored in single precision: each edge is off by at most ULP times the largest coordinate, and
            // the map by itself times that over the least height. Then gradient stored (1/2), product (1), two sums
            // (2).
            let stored = 3.0 * 3f64.sqrt() * ULP * element.largest / element.least_height;
            (stored + 3.5 * ULP) * element.gradient.row(row).norm() * vector.norm()
        });
        differing[row].abs() + rounding
    });
    (carried(&exact), off)
}

/// Tetrahedron in its reference and deformed states.
struct Tetrahedron {
    corner: Vector3<f64>,
    /// Map from world offset to the last three barycentric coordinates.
    to_bary: Matrix3<f64>,
    /// Map from world offset to reference offset.
    gradient: Matrix3<f64>,
    reference: Vector3<f64>,
    diameter: f64,
    least_height: f64,
    largest: f64,
}

impl Tetrahedron {
    fn new(mesh: &TetMesh, current: &[[f64; 3]], reference: &[[f64; 3]], element: u32) -> Self {
        let corners = mesh.elements()[element as usize].map(|node| node as usize);
        let edges = |nodes: &[[f64; 3]]| {
            let [a, b, c, d] = corners.map(|node| Vector3::from(nodes[node]));
            Matrix3::from_columns(&[b - a, c - a, d - a])
        };
        let (now, then) = (edges(current), edges(reference));
        let to_bary = now.try_inverse().unwrap_or(Matrix3::repeat(f64::NAN));
        let points = corners.map(|node| Vector3::from(current[node]));
        let mut diameter = 0.0f64;
        for a in points {
            for b in points {
                diameter = diameter.max((a - b).norm());
            }
        }
        // The gradient of a barycentric coordinate has the length 1 / height.
        let rows = [0, 1, 2].map(|row| to_bary.row(row).transpose());
        let first = -(rows[0] + rows[1] + rows[2]);
        let steepest = rows.iter().chain([&first]).fold(0.0f64, |a, row| a.max(row.norm()));
        Self {
            corner: points[0],
            to_bary,
            gradient: then * to_bary,
            reference: Vector3::from(reference[corners[0]]),
            diameter,
            least_height: 1.0 / steepest,
            largest: points
                .iter()
                .flat_map(|point| point.iter().copied())
                .fold(0.0f64, |a, x| a.max(x.abs())),
        }
    }

    fn least_coordinate(&self, p: Vector3<f64>) -> f64 {
        let b = self.to_bary * (p - self.corner);
        b.min().min(1.0 - b.sum())
    }

    fn map(&self, p: Vector3<f64>) -> Vector3<f64> {
        self.reference + self.gradient * (p - self.corner)
    }

    /// Returns how far below zero the least barycentric coordinate may be, in a twin that knows the point to `off` mm,
    /// with the point still accepted.
    fn coordinate_slack(&self, off: f64) -> f64 {
        let aspect = 1.0 + self.diameter / self.least_height;
        (COORDINATE * aspect + POINT * self.largest / self.least_height) * ULP + off / self.least_height
    }

    /// Bounds each coordinate of the mapped position of a point known to `off` mm.
    fn map_slack(&self, p: Vector3<f64>, off: [f64; 3]) -> [f64; 3] {
        let d = p - self.corner;
        std::array::from_fn(|row| {
            let g = |c: usize| self.gradient[(row, c)].abs();
            // Nodes are stored in single precision; a point inside moves with their weighted mean.
            let moved: f64 = (0..3)
                .map(|c| g(c) * (off[c] + 0.5 * ULP * self.largest + ULP * d[c].abs()))
                .sum();
            let rounded: f64 = (0..3).map(|c| TERM * ULP * g(c) * d[c].abs()).sum();
            moved + rounded + 1.5 * ULP * self.reference[row].abs()
        })
    }
}

fn current<'a>(step: &'a Step, mesh: &'a TetMesh) -> &'a [[f64; 3]] {
    step.state.nodes.as_deref().unwrap_or(mesh.nodes())
}

fn reference<'a>(step: &'a Step, mesh: &'a TetMesh) -> &'a [[f64; 3]] {
    step.state.reference.as_deref().unwrap_or(mesh.nodes())
}

fn place(position: [f64; 4]) -> Vector3<f64> {
    Vector3::new(position[0], position[1], position[2])
}

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let Some(mesh) = step.tables.mesh.as_deref() else {
        return slack.fault("a warp pass without a mesh");
    };
    let (current, reference) = (current(step, mesh), reference(step, mesh));
    for index in 0..step.after.position.len() {
        let (exact, twin) = (step.after.element[index], step.twin.element[index]);
        let world = place(step.before.position[index]);
        let off = slack.position[index];
        let reach = off.iter().fold(0.0f64, |a, &b| a.max(b)) * 3f64.sqrt();
        let flags = [step.after, step.twin].map(|beam| beam.position[index][3]);
        let whole = || {
            let (line, sample) = step.place(index);
            format!("line {line}, sample {sample} at {world:?}")
        };
        if exact != NO_ELEMENT && twin != NO_ELEMENT {
            // The elements may differ, as both of two neighbours hold their common face.
            let [exact, twin] = [exact, twin].map(|element| Tetrahedron::new(mesh, current, reference, element));
            let least = twin.least_coordinate(world);
            let allowed = twin.coordinate_slack(reach);
            if least < -allowed || least.is_nan() {
                slack.fault(format!(
                    "{}: outside the element by {least}, at most {allowed} by rounding",
                    whole()
                ));
            }
            let (chosen, other) = (twin.map(world), exact.map(world));
            let rounding = twin.map_slack(world, off);
            slack.position[index] = std::array::from_fn(|axis| (chosen[axis] - other[axis]).abs() + rounding[axis]);
        } else if exact != twin {
            // Only one lies in the mesh, which rounding explains at its surface alone. The positions behind
            // then have no common bound.
            let surface = Surface::of(mesh, current);
            let (far, allowed) = (surface.distance(world), surface.slack(world, reach));
            if far > allowed || allowed.is_nan() {
                slack.fault(format!(
                    "{}: {far} mm from the surface, at most {allowed} by rounding",
                    whole()
                ));
            }
            slack.torn[index] = true;
        } else if flags[0] != flags[1] {
            let surface = Surface::of(mesh, reference);
            let (far, allowed) = (surface.distance(world), surface.slack(world, reach));
            if far > allowed || allowed.is_nan() {
                slack.fault(format!(
                    "{}: {far} mm from the reference surface, at most {allowed}",
                    whole()
                ));
            }
            slack.torn[index] = true;
        }
    }
}

/// Elements of a mesh at some positions of its nodes, and its boundary faces.
struct Surface {
    elements: Vec<Tetrahedron>,
    faces: Vec<[Vector3<f64>; 3]>,
}

impl Surface {
    fn of(mesh: &TetMesh, nodes: &[[f64; 3]]) -> Self {
        let elements = (0..mesh.elements().len() as u32).map(|element| Tetrahedron::new(mesh, nodes, nodes, element));
        let mut faces = Vec::new();
        for (corners, neighbours) in mesh.elements().iter().zip(mesh.neighbours()) {
            for opposite in (0..4).filter(|&corner| neighbours[corner] == NO_ELEMENT) {
                let of_face = [0, 1, 2].map(|corner| corner + usize::from(corner >= opposite));
                faces.push(of_face.map(|corner| Vector3::from(nodes[corners[corner] as usize])));
            }
        }
        Self {
            elements: elements.collect(),
            faces,
        }
    }

    /// Returns the distance from a point to the boundary faces, mm.
    fn distance(&self, p: Vector3<f64>) -> f64 {
        let distances = self.faces.iter().map(|&face| triangle_distance(face, p));
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Returns the largest distance at which rounding decides: the slack of a coordinate times the height, in the worst
    /// element.
    fn slack(&self, p: Vector3<f64>, off: f64) -> f64 {
        let near = self
            .elements
            .iter()
            .filter(|element| (element.corner - p).norm() <= 2.0 * element.diameter);
        let worst = near
            .map(|element| (element.coordinate_slack(off) * element.diameter, element.largest))
            .fold((0.0f64, 0.0f64), |a, b| (a.0.max(b.0), a.1.max(b.1)));
        worst.0 + 0.5 * ULP * worst.1
    }
}

/// Returns the distance from a point to a triangle: to its plane if the point projects inside, otherwise to its nearest
/// edge.
fn triangle_distance([a, b, c]: [Vector3<f64>; 3], p: Vector3<f64>) -> f64 {
    let normal = (b - a).cross(&(c - a)).normalize();
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|(from, to)| (to - from).cross(&(p - from)).dot(&normal) >= 0.0);
    if inside {
        return (p - a).dot(&normal).abs();
    }
    let edge = |from: Vector3<f64>, to: Vector3<f64>| {
        let along = ((p - from).dot(&(to - from)) / (to - from).norm_squared()).clamp(0.0, 1.0);
        (from + along * (to - from) - p).norm()
    };
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}
