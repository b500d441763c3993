//! Cases of manufactured solutions and of the order of convergence.

use faer::Mat;
use nalgebra::{Matrix3, Vector3};

use crate::stability::fixtures::{Problem, lattice, shaken};
use crate::stability::record::{Record, Unexpected, largest, relative};
use insonify_mechanics::tissue::factor::Factor;
use insonify_mechanics::tissue::inverse::invert;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::problem::Load;
use insonify_mechanics::tissue::symmetric::Symmetric;
use insonify_mesh::TetMesh;

/// Edge length of the block, mm.
pub(super) const EDGE: f64 = 10.0;

/// Plane displacement wave: a sin(k . x + start).
#[derive(Clone, Copy)]
pub(crate) struct Wave {
    /// Amplitude a, mm.
    pub amplitude: [f64; 3],
    /// Wave vector k, 1/mm.
    pub vector: [f64; 3],
    /// Initial phase, rad.
    pub start: f64,
}

impl Wave {
    fn phase(&self, p: &[f64; 3]) -> f64 {
        self.start + Vector3::from(self.vector).dot(&Vector3::from(*p))
    }

    /// Returns the amplitude of the divergence: volume changes if the wave vector has a component along the amplitude.
    fn divergence_amplitude(&self) -> f64 {
        Vector3::from(self.vector).dot(&Vector3::from(self.amplitude))
    }
}

/// Waves that stretch, shear and change volume.
const WAVES: [Wave; 3] = [
    Wave {
        amplitude: [0.3, 0.0, 0.0],
        vector: [0.25, 0.10, -0.15],
        start: 0.4,
    },
    Wave {
        amplitude: [0.0, 0.2, 0.0],
        vector: [-0.10, 0.20, 0.20],
        start: 1.1,
    },
    Wave {
        amplitude: [0.0, 0.0, 0.4],
        vector: [0.15, -0.20, 0.25],
        start: 2.3,
    },
];

/// Returns the displacement of a sum of waves.
pub(super) fn exact(waves: &[Wave], p: &[f64; 3]) -> [f64; 3] {
    let sum: Vector3<f64> = waves
        .iter()
        .map(|wave| Vector3::from(wave.amplitude) * wave.phase(p).sin())
        .sum();
    sum.into()
}

/// Returns the displacement gradient; row i is the gradient of component i.
fn gradient(waves: &[Wave], p: &[f64; 3]) -> Matrix3<f64> {
    let gradient_of =
        |wave: &Wave| Vector3::from(wave.amplitude) * Vector3::from(wave.vector).transpose() * wave.phase(p).cos();
    waves.iter().map(gradient_of).sum()
}

/// Returns the Lame parameters, N/mm^2.
fn lame(material: &Material) -> [f64; 2] {
    material.lame_kpa().map(|kpa| kpa * 1e-3)
}

/// Returns the body force -(lambda + mu) grad div u - mu laplace u, N/mm^3.
fn body_force(waves: &[Wave], material: &Material, p: &[f64; 3]) -> Vector3<f64> {
    let [lambda, mu] = lame(material);
    let force_of = |wave: &Wave| {
        let (amplitude, vector) = (Vector3::from(wave.amplitude), Vector3::from(wave.vector));
        let squeeze = vector * ((lambda + mu) * wave.divergence_amplitude());
        (squeeze + amplitude * (mu * vector.norm_squared())) * wave.phase(p).sin()
    };
    waves.iter().map(force_of).sum()
}

/// Returns Gauss's four points on [0, 1] with their weights.
fn gauss() -> [(f64, f64); 4] {
    let [inner, outer] = [-1.0, 1.0].map(|sign: f64| 0.5 * (3.0 / 7.0 + sign * 2.0 / 7.0 * 1.2f64.sqrt()).sqrt());
    let [inner_weight, outer_weight] = [1.0, -1.0].map(|sign: f64| 0.25 + sign * 30f64.sqrt() / 72.0);
    [
        (0.5 - outer, outer_weight),
        (0.5 - inner, inner_weight),
        (0.5 + inner, inner_weight),
        (0.5 + outer, outer_weight),
    ]
}

/// Returns barycentric points and weights on a tetrahedron of unit volume: Gauss's points on a cube collapsed onto it.
/// Exact for polynomials of degree five, as the collapse takes two from seven.
pub(super) fn quadrature() -> Vec<([f64; 4], f64)> {
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

/// Calls `visit` with each element's corners, and the position, barycentric coordinates and weight (mm^3) of its
/// quadrature points.
fn integrate(mesh: &TetMesh, mut visit: impl FnMut(&[u32; 4], [f64; 3], &[f64; 4], f64)) {
    let points = quadrature();
    for (corners, volume) in mesh.elements().iter().zip(mesh.volumes(mesh.nodes())) {
        for (bary, weight) in &points {
            let position =
                std::array::from_fn(|axis| (0..4).map(|k| bary[k] * mesh.nodes()[corners[k] as usize][axis]).sum());
            visit(corners, position, bary, weight * volume);
        }
    }
}

/// Returns the gradients of the barycentric coordinates of an element.
fn slopes(nodes: &[[f64; 3]], corners: &[u32; 4]) -> Option<[Vector3<f64>; 4]> {
    let [a, b, c, d] = corners.map(|node| Vector3::from(nodes[node as usize]));
    let inverse = Matrix3::from_columns(&[b - a, c - a, d - a]).try_inverse()?;
    let [x, y, z] = [0, 1, 2].map(|row| inverse.row(row).transpose());
    Some([-(x + y + z), x, y, z])
}

/// Errors in L2 and in energy, relative to the exact solution, and the backward error.
pub(super) struct Errors {
    pub l2: f64,
    pub energy: f64,
    pub residual: f64,
}

/// Solves for waves prescribed on the surface and driven by their body force inside.
pub(super) fn errors(mesh: TetMesh, material: Material, waves: &[Wave]) -> Result<Errors, Unexpected> {
    let mut problem = Problem::new(mesh, material);
    problem.fix_surface(|p| exact(waves, p));
    let mut forces = vec![Vector3::zeros(); problem.mesh.nodes().len()];
    integrate(&problem.mesh, |corners, position, bary, weight| {
        let force = body_force(waves, &material, &position) * weight;
        for (corner, share) in corners.iter().zip(bary) {
            forces[*corner as usize] += force * *share;
        }
    });
    let load = |(node, force): (u32, Vector3<f64>)| Load {
        node,
        force_n: force.into(),
    };
    problem.loads = (0..).zip(forces).map(load).collect();
    let solution = problem.solve()?;
    let displacements = solution.displacement_mm;
    let [lambda, mu] = lame(&material);
    let density = |gradient: &Matrix3<f64>| {
        let strain = 0.5 * (gradient + gradient.transpose());
        0.5 * lambda * strain.trace().powi(2) + mu * strain.norm_squared()
    };
    let nodes = problem.mesh.nodes();
    let mut sums = [0.0; 4];
    // Integrated inside the elements: at nodes errors can be smaller than
    // in between, and fall at a higher order.
    integrate(&problem.mesh, |corners, position, bary, weight| {
        let Some(slopes) = slopes(nodes, corners) else {
            sums[2] = f64::NAN;
            return;
        };
        let values = corners.map(|node| Vector3::from(displacements[node as usize]));
        let slope: Matrix3<f64> = (0..4).map(|k| values[k] * slopes[k].transpose()).sum();
        let interpolated: Vector3<f64> = (0..4).map(|k| values[k] * bary[k]).sum();
        let value = Vector3::from(exact(waves, &position));
        let gradient = gradient(waves, &position);
        sums[0] += weight * (interpolated - value).norm_squared();
        sums[1] += weight * value.norm_squared();
        sums[2] += weight * density(&(slope - gradient));
        sums[3] += weight * density(&gradient);
    });
    Ok(Errors {
        l2: (sums[0] / sums[1]).sqrt(),
        energy: (sums[2] / sums[3]).sqrt(),
        residual: solution.residual,
    })
}

/// Deviation of an order from its limit allowed on meshes of this size.
const SLACK: f64 = 0.15;

/// Measures the orders over five meshes, regular and perturbed.
pub(super) fn orders(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let seed = record.seed();
    let families = [("regular", 0.3, 0.0), ("shaken", 0.45, 0.1), ("regular", -0.3, 0.0)];
    let count = record.effort().pick(2, families.len());
    for (index, (name, poisson, share)) in families.into_iter().take(count).enumerate() {
        record.done(index as f64 / count as f64);
        // Perturbed meshes need the range, as their constants differ.
        let sizes = match share {
            0.0 => record.effort().pick([4, 6, 8, 10, 12], [4, 6, 8, 12, 16]),
            _ => [4, 6, 8, 12, 16],
        };
        let material = Material::new(6.0, poisson)?;
        let mut errors_by_mesh = Vec::new();
        for cells in sizes {
            let mesh = match share {
                0.0 => lattice([cells; 3], [EDGE; 3])?,
                share => shaken([cells; 3], [EDGE; 3], share, seed)?,
            };
            errors_by_mesh.push(errors(mesh, material, &WAVES)?);
        }
        // Each perturbed mesh has its own constant: the order is measured over the full range.
        let finest = errors_by_mesh.len() - 1;
        let spans: Vec<[usize; 2]> = match share {
            0.0 => (0..finest).map(|mesh| [mesh, mesh + 1]).collect(),
            _ => vec![[0, finest]],
        };
        for (norm, expected, error) in [
            ("L2", 2.0, (|errors| errors.l2) as fn(&Errors) -> f64),
            ("energy", 1.0, |errors| errors.energy),
        ] {
            let order = |[coarse, fine]: [usize; 2]| {
                let finer = sizes[fine] as f64 / sizes[coarse] as f64;
                (error(&errors_by_mesh[coarse]) / error(&errors_by_mesh[fine])).log(finer)
            };
            record.under(
                format!("|order in {norm} - {expected}|, {name} meshes, nu {poisson}"),
                largest(spans.iter().map(|span| order(*span) - expected)),
                SLACK,
            );
        }
        record.report(
            format!("error in L2 on the finest, {name}, nu {poisson}"),
            errors_by_mesh[finest].l2,
        );
        record.under(
            format!("backward error, {name} meshes, nu {poisson}"),
            largest(errors_by_mesh.iter().map(|errors| errors.residual)),
            1e-12,
        );
    }
    Ok(())
}

/// Returns the numbers below `count` in a random order.
fn shuffled(record: &Record<'_>, count: usize, salt: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| {
        let key = |index: &usize| record.noise(salt << 32 | *index as u64);
        key(a).total_cmp(&key(b))
    });
    order
}

/// Returns the problem with its elements permuted.
fn elements_permuted(problem: &Problem, order: &[usize]) -> Result<Problem, Unexpected> {
    let mesh = &problem.mesh;
    let elements = order.iter().map(|element| mesh.elements()[*element]).collect();
    let regions = order.iter().map(|element| mesh.regions()[*element]).collect();
    Ok(Problem {
        mesh: TetMesh::new(mesh.nodes().to_vec(), elements, regions)?,
        ..problem.clone()
    })
}

/// Returns the problem with its nodes permuted: node k is node `order[k]` of the original.
fn nodes_permuted(problem: &Problem, order: &[usize]) -> Result<Problem, Unexpected> {
    let mesh = &problem.mesh;
    let mut new_index = vec![0; order.len()];
    order
        .iter()
        .enumerate()
        .for_each(|(index, node)| new_index[*node] = index as u32);
    let elements = mesh
        .elements()
        .iter()
        .map(|corners| corners.map(|node| new_index[node as usize]));
    let nodes = order.iter().map(|node| mesh.nodes()[*node]);
    let mut shuffled_problem = problem.clone();
    shuffled_problem.mesh = TetMesh::new(nodes.collect(), elements.collect(), mesh.regions().to_vec())?;
    shuffled_problem
        .fixes
        .iter_mut()
        .for_each(|fix| fix.node = new_index[fix.node as usize]);
    shuffled_problem
        .loads
        .iter_mut()
        .for_each(|load| load.node = new_index[load.node as usize]);
    Ok(shuffled_problem)
}

/// Solves the same problem in other orders and on more threads.
pub(crate) fn permuted(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let problem = Problem::block(record, 0.45)?;
    let solved = problem.solve()?.displacement_mm;
    for salt in 1..4 {
        let order = shuffled(record, problem.mesh.elements().len(), salt);
        let displacements = elements_permuted(&problem, &order)?.solve()?.displacement_mm;
        record.under(
            format!("difference, elements in order {salt}"),
            relative(displacements.as_flattened(), solved.as_flattened()),
            1e-12,
        );
        let order = shuffled(record, solved.len(), salt);
        let displacements = nodes_permuted(&problem, &order)?.solve()?.displacement_mm;
        let expected: Vec<[f64; 3]> = order.iter().map(|node| solved[*node]).collect();
        record.under(
            format!("difference, nodes in order {salt}"),
            relative(displacements.as_flattened(), expected.as_flattened()),
            1e-12,
        );
    }
    // A new order adds up otherwise and may round otherwise; the number
    // of threads must not change a single bit.
    let alone = on_threads(&problem, 1)?;
    for threads in [2, 3, 8] {
        let threaded = on_threads(&problem, threads)?;
        record.zero(
            format!("solutions that {threads} threads change"),
            f64::from(threaded.0 != alone.0),
        );
        record.zero(
            format!("dense inverses that {threads} threads change"),
            f64::from(threaded.1 != alone.1),
        );
        record.zero(
            format!("updated inverses that {threads} threads change"),
            f64::from(threaded.2 != alone.2),
        );
    }
    Ok(())
}

/// Returns solution, dense inverse, and the inverse after an update of rank 48, on a number of threads.
fn on_threads(problem: &Problem, threads: usize) -> Result<(Vec<u64>, Symmetric<f64>, Symmetric<f64>), Unexpected> {
    let pool = insonify_base::parallel::Pool::new(threads)?;
    pool.install(|| {
        let solution = problem.solve()?;
        let bits = solution.displacement_mm.as_flattened().iter().map(|u| u.to_bits());
        let inverse: Symmetric<f64> = invert(&Factor::new(&problem.stiffness()?)?, &mut |_, _| {})?;
        let y = Mat::from_fn(inverse.size(), 48, |i, j| inverse.get(i, j));
        let c = Mat::from_fn(48, 48, |i, j| if i == j { 0.01 } else { 0.0 });
        let mut updated = inverse.clone();
        updated.rank_update(y.as_ref(), c.as_ref())?;
        Ok((bits.collect(), inverse, updated))
    })
}
