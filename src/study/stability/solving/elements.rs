//! Cases of distorted elements and of extreme materials.

use nalgebra::Vector3;

use super::manufactured::{EDGE, Wave, errors};
use crate::stability::fixtures::{Problem, condition, lattice, moved, shaken, surface, with_regions};
use crate::stability::record::{Record, Unexpected, largest, noise, relative};
use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::dofs::Dofs;
use insonify_mechanics::tissue::element::{DegenerateElement, FLATTEST};
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::factor::Factor;
use insonify_mechanics::tissue::inverse::invert;
use insonify_mechanics::tissue::material::{Material, Materials};
use insonify_mechanics::tissue::problem::Solution;
use insonify_mechanics::tissue::symmetric::Symmetric;
use insonify_mesh::TetMesh;
use insonify_mesh::quality::jacobian_condition;

/// Rounding units of error per unit of the condition number: a backward stable solution has a small multiple of one (N.
/// J. Higham, "Accuracy and Stability of Numerical Algorithms", chapter 7), and the entries of matrix and right-hand
/// side are themselves sums of some tens of rounded numbers.
pub(super) const ROUNDING_UNITS: f64 = 100.0;

fn worst_condition(mesh: &TetMesh) -> f64 {
    let corners = |element: &[u32; 4]| element.map(|node| mesh.nodes()[node as usize]);
    largest(
        mesh.elements()
            .iter()
            .map(|element| jacobian_condition(&corners(element))),
    )
}

/// Returns a displacement linear in the position: stretch, shear and rotation of some per cent.
fn linear(seed: u64) -> impl Fn(&[f64; 3]) -> [f64; 3] {
    move |p| {
        std::array::from_fn(|row| {
            let number = |column: usize| noise(seed, 500_000 + (4 * row + column) as u64);
            number(3) + 0.05 * (number(0) * p[0] + number(1) * p[1] + number(2) * p[2])
        })
    }
}

/// Runs the patch test (B. M. Irons, 1965) on increasingly thin lattices.
pub(super) fn patch(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let seed = record.seed();
    for thin in [1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
        let mesh = shaken([4, 4, 4], [4.0, 4.0, 4.0 * thin], 0.15, seed)?;
        let shape = worst_condition(&mesh);
        let mut problem = Problem::new(mesh, Material::new(8.0, 0.45)?);
        problem.fix_surface(linear(seed));
        let displacements = problem.solve()?.displacement_mm;
        let exact: Vec<[f64; 3]> = problem.mesh.nodes().iter().map(linear(seed)).collect();
        record.under(
            format!("displacement error, Jacobian condition {shape:.0e}"),
            relative(displacements.as_flattened(), exact.as_flattened()),
            ROUNDING_UNITS * f64::EPSILON * problem.condition()?,
        );
    }
    Ok(())
}

/// Creates a lattice with an inner vertex moved to `height` times its height above the opposite face of one of its
/// elements, and returns that element too. The star of a vertex of a regular lattice is convex, so no element is
/// inverted.
fn sliver(height: f64) -> Result<(TetMesh, usize), Unexpected> {
    let mesh = lattice([4, 4, 4], [10.0; 3])?;
    let on_surface = surface(&mesh);
    let is_inner = |node: &u32| !on_surface[*node as usize];
    let candidates = mesh.elements().iter().enumerate();
    let mut choices = candidates.flat_map(|(element, corners)| {
        corners
            .iter()
            .copied()
            .filter(is_inner)
            .map(move |node| (element, node))
    });
    let (element, vertex) = choices
        .next()
        .ok_or_else(|| Unexpected::new("a lattice without inner nodes"))?;
    let others = mesh.elements()[element].iter().filter(|node| **node != vertex);
    let middle = others
        .map(|node| Vector3::from(mesh.nodes()[*node as usize]))
        .sum::<Vector3<f64>>()
        / 3.0;
    let flattened = moved(&mesh, |node, position| {
        if node == vertex as usize {
            (middle + (Vector3::from(*position) - middle) * height).into()
        } else {
            *position
        }
    })?;
    Ok((flattened, element))
}

/// Solves with one increasingly flat element under load.
pub(super) fn slivers(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let problem = |mesh: TetMesh| -> Result<Problem, Unexpected> {
        let mut problem = Problem::new(mesh, Material::new(10.0, 0.45)?);
        problem.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
        problem.load_all(2);
        Ok(problem)
    };
    for height in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8] {
        let solution = problem(sliver(height)?.0)?.solve()?;
        record.under(format!("backward error, height {height:.0e}"), solution.residual, 1e-12);
        record.report(
            format!("largest displacement (mm), height {height:.0e}"),
            largest(solution.displacement_mm.as_flattened().iter().copied()),
        );
    }
    for height in [0.1 * FLATTEST, 0.0] {
        let (mesh, element) = sliver(height)?;
        record.refused(
            format!("solution of an element of height {height:.0e}"),
            problem(mesh)?.solve(),
            |error| {
                names(error, &mut |named, cause| {
                    named == element && matches!(cause, DegenerateElement::Flat { .. })
                })
            },
        );
    }
    Ok(())
}

/// Returns whether the error names, first or among the others, an element for which `is_it` holds.
fn names(error: &LinearError, is_it: &mut dyn FnMut(usize, DegenerateElement) -> bool) -> bool {
    match error {
        LinearError::Element {
            element, cause, others, ..
        } => is_it(*element, *cause) || others.iter().any(|candidate| is_it(*candidate, *cause)),
        _ => false,
    }
}

/// Tests translations and rotations of bodies of several shapes, near and far.
pub(crate) fn rigid_motions(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let seed = record.seed();
    let far = shaken([4, 4, 4], [10.0; 3], 0.15, seed)?;
    let bodies = [
        ("a shaken block", shaken([4, 4, 4], [10.0; 3], 0.15, seed)?),
        (
            "elements thinned to 1e-3",
            shaken([4, 4, 4], [10.0, 10.0, 1e-2], 0.15, seed)?,
        ),
        ("an element of height 1e-6", sliver(1e-6)?.0),
        ("a block 1 m away", moved(&far, |_, p| p.map(|x| x + 1000.0))?),
    ];
    for (name, mesh) in bodies {
        for poisson in [0.45, 0.4999] {
            let materials = vec![Material::new(10.0, poisson)?; mesh.elements().len()];
            let stiffness = Stiffness::assemble(&mesh, &materials, &Dofs::new(mesh.nodes().len(), []))?;
            let mut worst = Vec::new();
            for motion in 0..6 {
                let axis = Vector3::ith(motion % 3, 1.0);
                let moves = |p: &[f64; 3]| {
                    if motion < 3 {
                        axis
                    } else {
                        axis.cross(&Vector3::from(*p))
                    }
                };
                let rigid: Vec<[f64; 3]> = mesh.nodes().iter().map(|p| moves(p).into()).collect();
                let forces = stiffness.nodal_forces(&rigid);
                let [force, size] = [&forces, &rigid].map(|vectors| largest(vectors.as_flattened().iter().copied()));
                // Forces cancel from terms as large as |K| |r| and round by these:
                // so one bound holds near and 1 m away.
                worst.push(force / (stiffness.norm_inf() * size));
            }
            record.under(
                format!("|K r| / (|K| |r|), {name}, nu {poisson}"),
                largest(worst),
                10.0 * f64::EPSILON,
            );
        }
    }
    Ok(())
}

/// Waves with amplitudes normal to their wave vectors, so that volume is preserved everywhere: the exact solution and
/// its body force are the same at any Poisson's ratio, and growth of the error is locking.
const KEEPING_VOLUME: [Wave; 3] = [
    Wave {
        amplitude: [0.3, 0.0, 0.5],
        vector: [0.25, 0.10, -0.15],
        start: 0.4,
    },
    Wave {
        amplitude: [0.2, 0.1, 0.0],
        vector: [-0.10, 0.20, 0.20],
        start: 1.1,
    },
    Wave {
        amplitude: [0.0, 0.25, 0.2],
        vector: [0.15, -0.20, 0.25],
        start: 2.3,
    },
];

/// Tests near incompressibility, where linear tetrahedra lock: the solver must not make it worse, and the report must
/// not hide it.
pub(crate) fn near_incompressible(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let cells = record.effort().pick(6, 12);
    for fine in [cells, 3 * cells / 2] {
        let mesh = shaken([fine; 3], [EDGE; 3], 0.1, record.seed())?;
        let free = errors(mesh.clone(), Material::new(6.0, 0.3)?, &KEEPING_VOLUME)?;
        record.report(format!("error in L2, nu 0.3, {fine} cells an edge"), free.l2);
        for poisson in [0.49, 0.499, 0.4999, 0.49999] {
            let at_poisson = errors(mesh.clone(), Material::new(6.0, poisson)?, &KEEPING_VOLUME)?;
            record.under(
                format!("backward error, nu {poisson}, {fine} cells"),
                at_poisson.residual,
                1e-12,
            );
            record.report(
                format!("locking: error in L2, nu {poisson}, {fine} cells an edge"),
                at_poisson.l2,
            );
            record.report(
                format!("locking: error over that at nu 0.3, nu {poisson}, {fine} cells"),
                at_poisson.l2 / free.l2,
            );
        }
    }
    // Under forces, with only the floor constraining the volume.
    for poisson in [0.49, 0.499, 0.4999, 0.49999] {
        let solution = Problem::block(record, poisson)?.solve()?;
        record.under(
            format!("backward error under forces, nu {poisson}"),
            solution.residual,
            1e-12,
        );
    }
    Ok(())
}

/// Returns the force imbalance along the worst axis, relative to the sum of all given forces.
fn imbalance(problem: &Problem, solution: &Solution) -> f64 {
    let mut sums = [0.0; 3];
    let mut total = 0.0;
    for load in &problem.loads {
        for (axis, force) in load.force_n.iter().enumerate() {
            sums[axis] += force;
            total += force.abs();
        }
    }
    for reaction in &solution.reactions {
        sums[usize::from(reaction.axis)] += reaction.force_n;
    }
    largest(sums) / total
}

/// Tests bodies with one part ten thousand or a hundred million times as stiff as the other.
pub(super) fn contrast(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for ratio in [1e4, 1e8] {
        for (name, is_stiff) in [
            ("stiff base", (|middle| middle[2] < 4.0) as fn([f64; 3]) -> bool),
            ("stiff core", |middle| middle.iter().all(|x| (2.0..8.0).contains(x))),
        ] {
            let mesh = with_regions(&shaken([5, 5, 5], [10.0; 3], 0.15, record.seed())?, |_, middle| {
                i32::from(is_stiff(middle))
            })?;
            let mut problem = Problem::new(mesh, Material::new(1.0, 0.45)?);
            problem.materials = Materials::new(Some(Material::new(1.0, 0.45)?), &[(1, Material::new(ratio, 0.45)?)])?;
            problem.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
            problem.load_all(record.seed());
            let solution = problem.solve()?;
            let subject = format!("{name}, 1:{ratio:.0e}");
            record.under(format!("backward error, {subject}"), solution.residual, 1e-12);
            record.under(
                format!("imbalance of all forces, {subject}"),
                imbalance(&problem, &solution),
                1e-10,
            );
            // Contrast raises the condition number, by which two solves round
            // apart; the backward error does not grow.
            let stiffness = problem.stiffness()?;
            let factor = Factor::new(&stiffness)?;
            let limit = ROUNDING_UNITS * f64::EPSILON * condition(&stiffness, &factor);
            record.under(
                format!("asymmetry of columns of K^-1, {subject}"),
                asymmetry_of_columns(&factor),
                limit,
            );
            let inverse: Symmetric<f64> = invert(&factor, &mut |_, _| {})?;
            let sampled = |i: usize| (0..i).filter(move |j| i.is_multiple_of(7) && j.is_multiple_of(5));
            let pairs = (0..inverse.size()).flat_map(|i| sampled(i).map(move |j| (i, j)));
            let differences = pairs.map(|(i, j)| inverse.get(i, j) - inverse.get(j, i));
            record.zero(
                format!("asymmetry of the dense inverse, {subject}"),
                largest(differences),
            );
        }
        for order in [[1.0, ratio], [ratio, 1.0]] {
            bar(record, order)?;
        }
    }
    Ok(())
}

/// Returns the largest |X_ij - X_ji| relative to the largest |X_ij| among a dozen columns, each solved separately.
fn asymmetry_of_columns(factor: &Factor) -> f64 {
    let size = factor.size();
    let dofs: Vec<usize> = (0..size).step_by(size.div_ceil(12)).collect();
    let column = |dof: &usize| {
        let mut column = vec![0.0; size];
        column[*dof] = 1.0;
        factor.solve_in_place(&mut column);
        dofs.iter().map(|row| column[*row]).collect::<Vec<f64>>()
    };
    let block: Vec<Vec<f64>> = dofs.iter().map(column).collect();
    let pairs = (0..dofs.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let difference = largest(pairs.map(|(i, j)| block[i][j] - block[j][i]));
    difference / largest(block.iter().flatten().copied())
}

/// Stretches two layers, each half of a bar without lateral contraction (nu = 0): displacements add as for springs in
/// series.
fn bar(record: &mut Record<'_>, young_kpa: [f64; 2]) -> Result<(), Unexpected> {
    const EXTENT: [f64; 3] = [8.0, 6.0, 12.0];
    const PULL_MM: f64 = 0.6;
    // The layers meet in a plane of nodes.
    let mesh = with_regions(&lattice([3, 3, 6], EXTENT)?, |_, middle| i32::from(middle[2] > 6.0))?;
    let mut problem = Problem::new(mesh, Material::new(1.0, 0.0)?);
    let layers = [
        (0, Material::new(young_kpa[0], 0.0)?),
        (1, Material::new(young_kpa[1], 0.0)?),
    ];
    problem.materials = Materials::new(None, &layers)?;
    for axis in 0..3u8 {
        problem.fix(&[axis], |p| p[usize::from(axis)] == 0.0, |_| [0.0; 3]);
    }
    problem.fix(&[2], |p| p[2] == EXTENT[2], |_| [0.0, 0.0, PULL_MM]);
    let displacements = problem.solve()?.displacement_mm;
    let stress = PULL_MM / young_kpa.iter().map(|young| 6.0 / young).sum::<f64>();
    let exact = |p: &[f64; 3]| {
        let share = |layer: usize| (p[2] - 6.0 * layer as f64).clamp(0.0, 6.0) / young_kpa[layer];
        [0.0, 0.0, stress * (share(0) + share(1))]
    };
    let exact: Vec<[f64; 3]> = problem.mesh.nodes().iter().map(exact).collect();
    record.under(
        format!("bar of two materials, {:.0e} on {:.0e} kPa", young_kpa[1], young_kpa[0]),
        relative(displacements.as_flattened(), exact.as_flattened()),
        ROUNDING_UNITS * f64::EPSILON * problem.condition()?,
    );
    Ok(())
}
