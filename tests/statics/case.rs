//! Problems to solve, how well conditioned they are, and how near two displacements come.

use std::ops::{Deref, DerefMut};

use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::problem::Solution;
use insonify_mesh::TetMesh;
use insonify_mesh::file::{ReadOptions, read_mesh};
use insonify_study::stability::fixtures::{self, Problem};
use insonify_study::stability::record;

/// Rounding units of error for each unit of the condition: that of a backward stable solution is a small multiple of
/// one (N. J. Higham, "Accuracy and Stability of Numerical Algorithms", chapter 7), and the entries of matrix and
/// right-hand side are themselves sums of some tens of rounded numbers.
const ROUNDING_UNITS: f64 = 100.0;

/// A hash of its arguments in [-1, 1).
pub(super) fn noise(seed: u64, index: usize) -> f64 {
    record::noise(seed, index as u64)
}

pub(super) fn lattice(cells: [usize; 3], extent: [f64; 3]) -> TetMesh {
    fixtures::lattice(cells, extent).unwrap()
}

pub(super) fn shaken(cells: [usize; 3], extent: [f64; 3], share: f64, seed: u64) -> TetMesh {
    let mesh = fixtures::shaken(cells, extent, share, seed).unwrap();
    assert!(mesh.volumes(mesh.nodes()).all(|volume| volume > 0.0));
    mesh
}

pub(super) fn with_regions(mesh: &TetMesh, region: impl Fn(usize, [f64; 3]) -> i32) -> TetMesh {
    fixtures::with_regions(mesh, region).unwrap()
}

/// A mesh of the shared data, if it is there.
pub(super) fn real(name: &str) -> Option<TetMesh> {
    let path = insonify_testing::shared(&format!("meshes/{name}"))?;
    Some(read_mesh(&path, &ReadOptions::default()).unwrap().mesh)
}

pub(super) fn material(young_kpa: f64, poisson: f64) -> Material {
    Material::new(young_kpa, poisson).unwrap()
}

/// A static problem whose solution must be found.
pub(super) struct Case(Problem);

impl Deref for Case {
    type Target = Problem;

    fn deref(&self) -> &Problem {
        &self.0
    }
}

impl DerefMut for Case {
    fn deref_mut(&mut self) -> &mut Problem {
        &mut self.0
    }
}

impl Case {
    /// A mesh of one material, free and unloaded.
    pub(super) fn new(mesh: TetMesh, material: Material) -> Case {
        Case(Problem::new(mesh, material))
    }

    pub(super) fn solve(&self) -> Solution {
        let solution = self.0.solve().unwrap();
        assert!(solution.residual < 1e-12, "backward error {}", solution.residual);
        solution
    }

    /// What rounding may do to the solution, relative to it: the condition of the stiffness in rounding units.
    pub(super) fn tolerance(&self) -> f64 {
        ROUNDING_UNITS * f64::EPSILON * self.condition().unwrap()
    }

    /// Checks a solution against the exact displacement of every node, within rounding.
    pub(super) fn check(&self, computed: &[[f64; 3]], exact: impl Fn(&[f64; 3]) -> [f64; 3]) {
        let exact: Vec<[f64; 3]> = self.mesh.nodes().iter().map(exact).collect();
        let (error, tolerance) = (distance(computed, &exact), self.tolerance());
        assert!(error < tolerance, "error {error:.2e}, tolerance {tolerance:.2e}");
        // A tolerance that lets anything pass is none.
        assert!(tolerance < 1e-4, "tolerance {tolerance:.2e}");
    }
}

/// The greatest difference of two displacements over the greatest displacement.
pub(super) fn distance(computed: &[[f64; 3]], exact: &[[f64; 3]]) -> f64 {
    record::relative(computed.as_flattened(), exact.as_flattened())
}

/// Sum of the reactions along an axis at nodes that `which` picks by position, N.
pub(super) fn reaction(case: &Case, solution: &Solution, axis: u8, which: impl Fn(&[f64; 3]) -> bool) -> f64 {
    let reactions = solution.reactions.iter().filter(|reaction| reaction.axis == axis);
    let reactions = reactions.filter(|reaction| which(&case.mesh.nodes()[reaction.node as usize]));
    reactions.map(|reaction| reaction.force_n).sum()
}
