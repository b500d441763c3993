//! Problems to solve, how well conditioned they are, and how near two displacements come.

use std::path::Path;

use insonify::mechanics::mesh::NONE;
use insonify::mechanics::mesh::TetMesh;
use insonify::mechanics::mesh::file::{ReadOptions, read_mesh};
use insonify::mechanics::tissue::assembly::Stiffness;
use insonify::mechanics::tissue::dofs::Dofs;
use insonify::mechanics::tissue::factor::Factor;
use insonify::mechanics::tissue::material::{Material, Materials};
use insonify::mechanics::tissue::problem::{Fix, Load, Solution, StaticProblem};
use nalgebra::Matrix4;

/// Rounding units of error for each unit of the condition: that of a backward stable solution is a small multiple of one
/// (N. J. Higham, "Accuracy and Stability of Numerical Algorithms", chapter 7), and the entries of matrix and right-hand
/// side are themselves sums of some tens of rounded numbers.
const ROUNDING_UNITS: f64 = 100.0;

/// A hash of its arguments in [-1, 1).
pub fn noise(seed: u64, index: usize) -> f64 {
    let mut x = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ x >> 31) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// A lattice of cells over the box from the origin to `extent`, mm.
pub fn lattice(cells: [usize; 3], extent: [f64; 3]) -> TetMesh {
    let [x, y, z] = extent;
    let to_world = Matrix4::from_diagonal(&[x, y, z, 1.0].into());
    TetMesh::lattice(cells, &to_world).unwrap()
}

/// A lattice whose inner nodes are shaken by up to `share` of a cell along each axis; up to 0.15 no element is inverted.
pub fn shaken(cells: [usize; 3], extent: [f64; 3], share: f64, seed: u64) -> TetMesh {
    let regular = lattice(cells, extent);
    let surface = surface(&regular);
    let moved = regular.nodes().iter().enumerate().map(|(node, position)| {
        let step = |axis: usize| share * extent[axis] / cells[axis] as f64 * noise(seed, 3 * node + axis);
        std::array::from_fn(|axis| position[axis] + if surface[node] { 0.0 } else { step(axis) })
    });
    let mesh = TetMesh::new(moved.collect(), regular.elements().to_vec(), regular.regions().to_vec()).unwrap();
    assert!(mesh.volumes(mesh.nodes()).all(|volume| volume > 0.0));
    mesh
}

/// The mesh with the region of each element chosen by the middle of it.
pub fn with_regions(mesh: &TetMesh, region: impl Fn(usize, [f64; 3]) -> i32) -> TetMesh {
    let middle = |corners: &[u32; 4]| {
        std::array::from_fn(|axis| {
            corners
                .iter()
                .map(|node| mesh.nodes()[*node as usize][axis])
                .sum::<f64>()
                / 4.0
        })
    };
    let regions = mesh.elements().iter().enumerate();
    let regions = regions.map(|(element, corners)| region(element, middle(corners)));
    TetMesh::new(mesh.nodes().to_vec(), mesh.elements().to_vec(), regions.collect()).unwrap()
}

/// A mesh of the shared data; none, said aloud, where this checkout has no such folder.
pub fn real(name: &str) -> Option<TetMesh> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/meshes"));
    if !folder.is_dir() {
        println!("SKIPPED: {name} needs {}", folder.display());
        return None;
    }
    Some(read_mesh(&folder.join(name), &ReadOptions::default()).unwrap().mesh)
}

/// Whether each node lies on the surface.
pub fn surface(mesh: &TetMesh) -> Vec<bool> {
    let mut on = vec![false; mesh.nodes().len()];
    for (corners, neighbours) in mesh.elements().iter().zip(mesh.neighbours()) {
        for opposite in (0..4).filter(|corner| neighbours[*corner] == NONE) {
            for corner in (0..4).filter(|corner| *corner != opposite) {
                on[corners[corner] as usize] = true;
            }
        }
    }
    on
}

pub fn material(young_kpa: f64, poisson: f64) -> Material {
    Material::new(young_kpa, poisson).unwrap()
}

/// A static problem, owned.
pub struct Case {
    pub mesh: TetMesh,
    pub materials: Materials,
    pub fixes: Vec<Fix>,
    pub loads: Vec<Load>,
}

impl Case {
    /// A mesh of one material, free and unloaded.
    pub fn new(mesh: TetMesh, material: Material) -> Case {
        Case {
            mesh,
            materials: Materials::uniform(material),
            fixes: Vec::new(),
            loads: Vec::new(),
        }
    }

    /// Prescribes displacements along some axes of the nodes that `which` picks by position.
    pub fn fix(&mut self, axes: &[u8], which: impl Fn(&[f64; 3]) -> bool, field: impl Fn(&[f64; 3]) -> [f64; 3]) {
        for (node, position) in (0..).zip(self.mesh.nodes()).filter(|(_, position)| which(position)) {
            let displacement = field(position);
            self.fixes.extend(axes.iter().map(|&axis| Fix {
                node,
                axis,
                displacement_mm: displacement[axis as usize],
            }));
        }
    }

    /// Prescribes a field on all of the surface.
    pub fn fix_surface(&mut self, field: impl Fn(&[f64; 3]) -> [f64; 3]) {
        let surface = surface(&self.mesh);
        for (node, position) in self.mesh.nodes().iter().enumerate().filter(|(node, _)| surface[*node]) {
            let displacement = field(position);
            self.fixes.extend([0, 1, 2].map(|axis| Fix {
                node: node as u32,
                axis,
                displacement_mm: displacement[axis as usize],
            }));
        }
    }

    pub fn solve(&self) -> Solution {
        let problem = StaticProblem {
            mesh: &self.mesh,
            materials: self.materials.clone(),
            fixes: self.fixes.clone(),
            loads: self.loads.clone(),
        };
        let solution = problem.solve().unwrap();
        assert!(solution.residual < 1e-12, "backward error {}", solution.residual);
        solution
    }

    /// What rounding may do to the solution, relative to it: the condition of the stiffness in rounding units. The condition
    /// comes from power iterations, which approach it from below.
    pub fn tolerance(&self) -> f64 {
        let fixed = self.fixes.iter().map(|fix| (fix.node, fix.axis));
        let dofs = Dofs::new(self.mesh.nodes().len(), fixed);
        let materials = self.materials.check(&self.mesh).unwrap();
        let stiffness = Stiffness::assemble(&self.mesh, &materials, &dofs).unwrap();
        let factor = Factor::new(&stiffness).unwrap();
        let largest = dominant(dofs.free(), |x, y| stiffness.multiply(x, y));
        let inverse_of_least = dominant(dofs.free(), |x, y| {
            y.copy_from_slice(x);
            factor.solve_in_place(y);
        });
        ROUNDING_UNITS * f64::EPSILON * largest * inverse_of_least
    }

    /// Checks a solution against the exact displacement of every node, within rounding.
    pub fn check(&self, found: &[[f64; 3]], exact: impl Fn(&[f64; 3]) -> [f64; 3]) {
        let exact: Vec<[f64; 3]> = self.mesh.nodes().iter().map(exact).collect();
        let (error, tolerance) = (distance(found, &exact), self.tolerance());
        assert!(error < tolerance, "error {error:.2e}, tolerance {tolerance:.2e}");
        // A tolerance that lets anything pass is none.
        assert!(tolerance < 1e-4, "tolerance {tolerance:.2e}");
    }
}

/// The largest eigenvalue of a symmetric positive definite operator.
fn dominant(size: usize, apply: impl Fn(&[f64], &mut [f64])) -> f64 {
    let mut x: Vec<f64> = (0..size).map(|i| noise(7, i)).collect();
    let mut y = vec![0.0; size];
    let mut value = 0.0;
    for _ in 0..40 {
        let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt();
        x.iter_mut().for_each(|x| *x /= norm);
        apply(&x, &mut y);
        value = x.iter().zip(&y).map(|(x, y)| x * y).sum();
        std::mem::swap(&mut x, &mut y);
    }
    value
}

/// The greatest difference of two displacements over the greatest displacement.
pub fn distance(found: &[[f64; 3]], exact: &[[f64; 3]]) -> f64 {
    let largest = |all: &mut dyn Iterator<Item = f64>| {
        all.fold(0.0, |a: f64, x| if x.is_nan() { f64::NAN } else { a.max(x.abs()) })
    };
    let pairs = found.as_flattened().iter().zip(exact.as_flattened());
    largest(&mut pairs.map(|(a, b)| a - b)) / largest(&mut exact.as_flattened().iter().copied())
}

/// Sum of the reactions along an axis at nodes that `which` picks by position, N.
pub fn reaction(case: &Case, solution: &Solution, axis: u8, which: impl Fn(&[f64; 3]) -> bool) -> f64 {
    let held = solution.reactions.iter().filter(|reaction| reaction.axis == axis);
    let held = held.filter(|reaction| which(&case.mesh.nodes()[reaction.node as usize]));
    held.map(|reaction| reaction.force_n).sum()
}
