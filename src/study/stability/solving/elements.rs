//! Cases of elements of every shape.

use crate::mechanics::tissue::error::LinearError;
use nalgebra::Vector3;

use super::problem::{Problem, lattice, moved, shaken, surface};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::quality::jacobian_condition;
use crate::mechanics::tissue::assembly::Stiffness;
use crate::mechanics::tissue::dofs::Dofs;
use crate::mechanics::tissue::element::{DegenerateElement, FLATTEST};
use crate::mechanics::tissue::material::Material;
use crate::study::stability::record::{Record, Unexpected, largest, noise, relative};

/// Rounding units of error per unit of the condition number: a backward stable solution has a small multiple of one (N. J. Higham,
/// "Accuracy and Stability of Numerical Algorithms", chapter 7), and the entries of matrix and right-hand side are themselves sums of some
/// tens of rounded numbers.
pub const ROUNDING_UNITS: f64 = 100.0;

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
pub fn patch(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let seed = record.seed();
    for thin in [1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
        let mesh = shaken([4, 4, 4], [4.0, 4.0, 4.0 * thin], 0.15, seed)?;
        let shape = worst_condition(&mesh);
        let mut problem = Problem::new(mesh, Material::new(8.0, 0.45)?);
        problem.fix_surface(linear(seed));
        let found = problem.solve()?.displacement_mm;
        let exact: Vec<[f64; 3]> = problem.mesh.nodes().iter().map(linear(seed)).collect();
        record.under(
            format!("displacement error, Jacobian condition {shape:.0e}"),
            relative(found.as_flattened(), exact.as_flattened()),
            ROUNDING_UNITS * f64::EPSILON * problem.condition()?,
        );
    }
    Ok(())
}

/// Creates a lattice with an inner vertex moved to `height` times its height above the opposite face of one of its elements, and returns
/// that element too. The star of a vertex of a regular lattice is convex, so no element is inverted.
fn sliver(height: f64) -> Result<(TetMesh, usize), Unexpected> {
    let mesh = lattice([4, 4, 4], [10.0; 3])?;
    let on_surface = surface(&mesh);
    let inner = |node: &u32| !on_surface[*node as usize];
    let candidates = mesh.elements().iter().enumerate();
    let mut choices = candidates
        .flat_map(|(element, corners)| corners.iter().copied().filter(inner).map(move |node| (element, node)));
    let (element, vertex) = choices
        .next()
        .ok_or_else(|| Unexpected::new("a lattice without inner nodes"))?;
    let others = mesh.elements()[element].iter().filter(|node| **node != vertex);
    let middle = others
        .map(|node| Vector3::from(mesh.nodes()[*node as usize]))
        .sum::<Vector3<f64>>()
        / 3.0;
    let flattened = moved(&mesh, |node, position| match node == vertex as usize {
        true => (middle + (Vector3::from(*position) - middle) * height).into(),
        false => *position,
    })?;
    Ok((flattened, element))
}

/// Solves with one increasingly flat element under load.
pub fn slivers(record: &mut Record<'_>) -> Result<(), Unexpected> {
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
        } => is_it(*element, *cause) || others.iter().any(|other| is_it(*other, *cause)),
        _ => false,
    }
}

/// Tests translations and rotations of bodies of several shapes, near and far.
pub fn rigid_motions(record: &mut Record<'_>) -> Result<(), Unexpected> {
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
                let [force, size] = [&forces, &rigid].map(|all| largest(all.as_flattened().iter().copied()));
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
