//! Blocks and sheets that several tests load.

use std::sync::Arc;

use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::{
    NonlinearBody, Scheme, Sheet, Solid, Solver, SolverOptions, Stiffening, Supports, Target,
};
use insonify_mesh::TetMesh;
use nalgebra::Matrix4;

/// 10 kPa that stiffens above a relative strain of 0.1.
pub(super) fn law(poisson: f64) -> Stiffening {
    Stiffening::new(Material::new(10.0, poisson).unwrap(), 0.1, 20.0).unwrap()
}

/// A value in -1..1 that depends on its place alone.
pub(super) fn shake(i: usize, axis: usize) -> f64 {
    let x = (i as f64 * 12.9898 + axis as f64 * 78.233 + 1.0).sin() * 43_758.545_3;
    2.0 * (x - x.floor()) - 1.0
}

/// A lattice of cells of `edge` mm from the origin, its inner nodes moved by up to `shaken` edges.
pub(super) fn block_mesh(cells: [usize; 3], edge: f64, shaken: f64) -> TetMesh {
    let [x, y, z] = cells.map(|count| count as f64 * edge);
    let regular = TetMesh::lattice(cells, &Matrix4::from_diagonal(&[x, y, z, 1.0].into())).unwrap();
    let extent = [x, y, z];
    let nodes = regular.nodes().iter().enumerate().map(|(i, p)| {
        let inside = (0..3).all(|axis| p[axis] > 1e-9 && p[axis] < extent[axis] - 1e-9);
        std::array::from_fn(|axis| p[axis] + if inside { shaken * edge * shake(i, axis) } else { 0.0 })
    });
    TetMesh::new(nodes.collect(), regular.elements().to_vec(), regular.regions().to_vec()).unwrap()
}

pub(super) fn block(cells: [usize; 3], edge: f64, shaken: f64, law: impl Copy + Into<AnyLaw>) -> Arc<Solid> {
    let mesh = block_mesh(cells, edge, shaken);
    Arc::new(NonlinearBody::tetrahedra(&mesh, &vec![law; mesh.elements().len()]).unwrap())
}

/// Squares of `edge` mm split in two, the inner nodes moved by up to `shaken` edges.
pub(super) fn sheet(cells: [usize; 2], edge: f64, shaken: f64, thickness: f64, law: Stiffening) -> Arc<Sheet> {
    let [columns, rows] = cells;
    let mut nodes = Vec::new();
    for j in 0..=rows {
        for i in 0..=columns {
            let inside = i > 0 && i < columns && j > 0 && j < rows;
            let by = |axis| {
                if inside {
                    shaken * edge * shake(nodes.len(), axis)
                } else {
                    0.0
                }
            };
            nodes.push([i as f64 * edge + by(0), j as f64 * edge + by(1)]);
        }
    }
    let at = |i: usize, j: usize| (j * (columns + 1) + i) as u32;
    let mut triangles = Vec::new();
    for j in 0..rows {
        for i in 0..columns {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    let laws = vec![law; triangles.len()];
    Arc::new(Sheet::plane_strain(nodes, triangles, &laws, thickness).unwrap())
}

pub(super) fn options(scheme: Scheme) -> SolverOptions {
    SolverOptions {
        scheme,
        tolerance: 1e-12,
        iterations: 30,
    }
}

/// Prescribed displacements: (node, axis, displacement).
pub(super) type Held = Vec<(u32, u8, f64)>;

/// A solver with its supports and how far they are driven.
pub(super) fn held<const D: usize, const N: usize>(
    body: &Arc<NonlinearBody<D, N>>,
    held: &Held,
    options: SolverOptions,
) -> (Solver<D, N>, Vec<f64>) {
    let supports = Supports::new(body.nodes().len(), held.iter().map(|&(node, axis, _)| (node, axis)));
    let mut values = vec![0.0; supports.all()];
    for &(node, axis, value) in held {
        values[D * node as usize + axis as usize] = value;
    }
    let prescribed = supports.prescribed().iter().map(|&dof| values[dof as usize]).collect();
    (Solver::new(Arc::clone(body), supports, options).unwrap(), prescribed)
}

/// Loads and prescribed displacements alone.
pub(super) fn target<'a>(loads: &'a [f64], prescribed: &'a [f64]) -> Target<'a> {
    Target {
        loads,
        prescribed,
        contact: None,
        offset: None,
    }
}

/// The nodes at a coordinate.
pub(super) fn at<const D: usize, const N: usize>(body: &NonlinearBody<D, N>, axis: usize, place: f64) -> Vec<u32> {
    let nodes = (0..).zip(body.nodes());
    nodes
        .filter(|(_, p)| (p[axis] - place).abs() < 1e-9)
        .map(|(node, _)| node)
        .collect()
}

/// A block of `edge` mm whose three lower faces slide in their planes, and the forces on the nodes of its upper x face
/// that make a uniform pull of 1 kPa there: uniaxial stress, whatever the mesh. Each triangle of the face shares its
/// third out.
pub(super) fn pulled(cells: usize, edge: f64, law: impl Copy + Into<AnyLaw>) -> (Arc<Solid>, Held, Vec<f64>) {
    let body = block([cells; 3], edge / cells as f64, 0.2, law);
    let held = (0..3u8).flat_map(|axis| {
        at(&body, axis as usize, 0.0)
            .into_iter()
            .map(move |node| (node, axis, 0.0))
    });
    let held = held.collect();
    let mut loads = vec![0.0; 3 * body.nodes().len()];
    let face = |node: u32| (body.nodes()[node as usize][0] - edge).abs() < 1e-9;
    for corners in body.elements() {
        let on: Vec<u32> = corners.iter().copied().filter(|node| face(*node)).collect();
        if let [a, b, c] = on[..] {
            let [a, b, c] = [a, b, c].map(|node| body.nodes()[node as usize]);
            let area = 0.5 * ((b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])).abs();
            on.iter()
                .for_each(|node| loads[3 * *node as usize] += 1e-3 * area / 3.0);
        }
    }
    (body, held, loads)
}

pub(super) fn largest(all: &[f64]) -> f64 {
    all.iter().fold(0.0, |a: f64, x| a.max(x.abs()))
}

pub(super) fn difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
}

/// A block held from below whose top is moved by `near` mm where x is small and by `far` elsewhere.
pub(super) fn pressed(body: &Solid, top: f64, [near, far]: [f64; 2]) -> Held {
    let below = at(body, 2, 0.0).into_iter();
    let mut driven: Held = below
        .flat_map(|node| (0..3).map(move |axis| (node, axis, 0.0)))
        .collect();
    driven.extend(at(body, 2, top).into_iter().map(|node| {
        let by = if body.nodes()[node as usize][0] < 4.1 {
            near
        } else {
            far
        };
        (node, 2, by)
    }));
    driven
}

/// Orders of convergence of Newton's method for a block pressed unevenly, iteration by iteration, and its residuals.
pub(super) fn newton_orders(law: impl Copy + Into<AnyLaw>) -> (Vec<f64>, Vec<f64>) {
    let body = block([4, 4, 4], 2.0, 0.2, law);
    let driven = pressed(&body, 8.0, [-1.6, 0.2]);
    let (mut solver, prescribed) = held(&body, &driven, options(Scheme::Newton));
    let loads = vec![0.0; 3 * body.nodes().len()];
    let residuals = solver.step(&target(&loads, &prescribed)).unwrap().residuals.clone();
    // Pairs that are near enough for the square to tell, and above rounding.
    let orders = residuals
        .windows(3)
        .filter(|r| r[1] < 1e-2 && r[2] > 1e-13)
        .map(|r| (r[2] / r[1]).ln() / (r[1] / r[0]).ln());
    (orders.collect(), residuals)
}
