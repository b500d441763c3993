//! A manufactured solution: the body force that a smooth displacement needs is put in, and the displacement must come out,
//! with the second order in L2 and the first in energy (P. G. Ciarlet, "The Finite Element Method for Elliptic Problems").

use insonify::mechanics::mesh::TetMesh;
use insonify::mechanics::tissue::material::Material;
use insonify::mechanics::tissue::problem::Load;
use nalgebra::{Matrix3, Vector3};

use super::case::{Case, lattice, material, shaken};

/// Edge of the block, mm.
const EDGE: f64 = 10.0;

/// Each component is a plane wave of its own: amplitude (mm), wave vector (1/mm) and phase.
const WAVES: [(f64, [f64; 3], f64); 3] = [
    (0.3, [0.25, 0.10, -0.15], 0.4),
    (0.2, [-0.10, 0.20, 0.20], 1.1),
    (0.4, [0.15, -0.20, 0.25], 2.3),
];

fn phase((_, wave, start): (f64, [f64; 3], f64), p: &[f64; 3]) -> f64 {
    start + wave[0] * p[0] + wave[1] * p[1] + wave[2] * p[2]
}

fn exact(p: &[f64; 3]) -> [f64; 3] {
    WAVES.map(|wave| wave.0 * phase(wave, p).sin())
}

/// Row i: the gradient of component i.
fn gradient(p: &[f64; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| WAVES[i].0 * WAVES[i].1[j] * phase(WAVES[i], p).cos())
}

/// The Lame parameters, N/mm^2.
fn lame(material: &Material) -> [f64; 2] {
    material.lame_kpa().map(|kpa| kpa * 1e-3)
}

/// The body force -(lambda + mu) grad div u - mu laplace u, N/mm^3.
fn body_force(material: &Material, p: &[f64; 3]) -> [f64; 3] {
    let [lambda, mu] = lame(material);
    std::array::from_fn(|i| {
        let second = |j: usize, l: usize| {
            let (amplitude, wave, _) = WAVES[j];
            -amplitude * wave[i] * wave[l] * phase(WAVES[j], p).sin()
        };
        let grad_div: f64 = (0..3).map(|j| second(j, j)).sum();
        let (amplitude, wave, _) = WAVES[i];
        let laplace = -amplitude * Vector3::from(wave).norm_squared() * phase(WAVES[i], p).sin();
        -(lambda + mu) * grad_div - mu * laplace
    })
}

/// Gauss's four points on [0, 1] with their weights.
fn gauss() -> [(f64, f64); 4] {
    let [inner, outer] = [-1.0, 1.0].map(|sign: f64| 0.5 * (3.0 / 7.0 + sign * 2.0 / 7.0 * 1.2f64.sqrt()).sqrt());
    let [more, less] = [1.0, -1.0].map(|sign: f64| 0.25 + sign * 30f64.sqrt() / 72.0);
    [
        (0.5 - outer, less),
        (0.5 - inner, more),
        (0.5 + inner, more),
        (0.5 + outer, less),
    ]
}

/// Barycentric points and weights on a tetrahedron of unit volume: Gauss's points on a cube that is collapsed onto it.
fn quadrature() -> Vec<([f64; 4], f64)> {
    let mut points = Vec::new();
    for (a, wa) in gauss() {
        for (b, wb) in gauss() {
            for (c, wc) in gauss() {
                let (x, y, z) = (a, b * (1.0 - a), c * (1.0 - a) * (1.0 - b));
                points.push((
                    [1.0 - x - y - z, x, y, z],
                    6.0 * wa * wb * wc * (1.0 - a).powi(2) * (1.0 - b),
                ));
            }
        }
    }
    points
}

/// Calls `at` with each element's corners, and position, barycentric coordinates and weight (mm^3) of its points.
fn integrate(mesh: &TetMesh, mut at: impl FnMut(&[u32; 4], [f64; 3], &[f64; 4], f64)) {
    let points = quadrature();
    for (corners, volume) in mesh.elements().iter().zip(mesh.volumes(mesh.nodes())) {
        for (bary, weight) in &points {
            let position =
                std::array::from_fn(|axis| (0..4).map(|k| bary[k] * mesh.nodes()[corners[k] as usize][axis]).sum());
            at(corners, position, bary, weight * volume);
        }
    }
}

/// Errors in L2 and in energy, relative to the exact solution.
fn errors(mesh: TetMesh, material: Material) -> [f64; 2] {
    let mut case = Case::new(mesh, material);
    case.fix_surface(exact);
    let mut forces = vec![[0.0; 3]; case.mesh.nodes().len()];
    integrate(&case.mesh, |corners, position, bary, weight| {
        let force = body_force(&material, &position);
        for (corner, share) in corners.iter().zip(bary) {
            for axis in 0..3 {
                forces[*corner as usize][axis] += share * weight * force[axis];
            }
        }
    });
    case.loads = (0..)
        .zip(forces)
        .map(|(node, force_n)| Load { node, force_n })
        .collect();
    let found = case.solve().displacement_mm;
    let [lambda, mu] = lame(&material);
    let density = |gradient: &Matrix3<f64>| {
        let strain = 0.5 * (gradient + gradient.transpose());
        0.5 * lambda * strain.trace().powi(2) + mu * strain.norm_squared()
    };
    let nodes = case.mesh.nodes();
    let mut sums = [0.0; 4];
    integrate(&case.mesh, |corners, position, bary, weight| {
        let edges = |all: &[[f64; 3]]| {
            let [a, b, c, d] = corners.map(|node| Vector3::from(all[node as usize]));
            Matrix3::from_columns(&[b - a, c - a, d - a])
        };
        let slope = edges(&found) * edges(nodes).try_inverse().unwrap();
        let value = Vector3::from(exact(&position));
        let interpolated: Vector3<f64> = (0..4)
            .map(|k| bary[k] * Vector3::from(found[corners[k] as usize]))
            .sum();
        let gradient = gradient(&position);
        sums[0] += weight * (interpolated - value).norm_squared();
        sums[1] += weight * value.norm_squared();
        sums[2] += weight * density(&(slope - gradient));
        sums[3] += weight * density(&gradient);
    });
    [(sums[0] / sums[1]).sqrt(), (sums[2] / sums[3]).sqrt()]
}

/// How far an order may be from its limit on meshes of this size.
const SLACK: f64 = 0.15;

/// Checks the orders between the first and the last of some meshes, by their errors and their cells along an edge.
fn orders(errors: &[[f64; 2]], sizes: &[usize]) {
    let last = errors.len() - 1;
    let finer = sizes[last] as f64 / sizes[0] as f64;
    for (which, (norm, expected)) in [("L2", 2.0), ("energy", 1.0)].into_iter().enumerate() {
        let order = (errors[0][which] / errors[last][which]).log(finer);
        assert!(
            (order - expected).abs() < SLACK,
            "{norm} order {order:.3} over {sizes:?}: {errors:?}"
        );
    }
}

const SIZES: [usize; 5] = [4, 6, 8, 12, 16];

#[test]
fn lattices_converge() {
    for poisson in [0.3, -0.3] {
        let errors = SIZES.map(|cells| errors(lattice([cells; 3], [EDGE; 3]), material(6.0, poisson)));
        for (pair, sizes) in errors.windows(2).zip(SIZES.windows(2)) {
            orders(pair, sizes);
        }
    }
}

/// Each mesh is shaken in its own way, which makes its constant its own: the order is that of the whole range.
#[test]
fn shaken_lattices_converge() {
    let errors = SIZES.map(|cells| errors(shaken([cells; 3], [EDGE; 3], 0.1, 4), material(6.0, 0.45)));
    orders(&errors, &SIZES);
}

/// The quadrature is exact for polynomials of the fifth degree (the collapse takes two from seven): its moments against k! l! m! n! 3! / (k+l+m+n+3)!.
#[test]
fn quadrature_is_exact() {
    let factorial = |n: u32| (1..=n).map(f64::from).product::<f64>();
    for powers in [
        [0, 0, 0, 0],
        [1, 0, 0, 0],
        [0, 2, 1, 0],
        [1, 1, 1, 1],
        [0, 0, 0, 4],
        [3, 0, 1, 1],
    ] {
        let sum: f64 = quadrature()
            .iter()
            .map(|(b, w)| w * (0..4).map(|k| b[k].powi(powers[k] as i32)).product::<f64>())
            .sum();
        let exact = powers.map(factorial).iter().product::<f64>() * 6.0 / factorial(powers.iter().sum::<u32>() + 3);
        assert!((sum / exact - 1.0).abs() < 1e-14, "{powers:?}: {sum} {exact}");
    }
}
