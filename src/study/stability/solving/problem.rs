//! Static problems shared by the cases, and their condition numbers.

use crate::mechanics::tissue::error::LinearError;
use nalgebra::Matrix4;

use crate::mechanics::mesh::{NONE, TetMesh};
use crate::mechanics::tissue::assembly::Stiffness;
use crate::mechanics::tissue::dofs::Dofs;
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::material::{Material, Materials};
use crate::mechanics::tissue::problem::{Fix, Load, Solution, StaticProblem};
use crate::study::stability::record::{Record, Unexpected, noise};

/// Creates a lattice of cells over the box from the origin to `extent`, mm.
pub fn lattice(cells: [usize; 3], extent: [f64; 3]) -> Result<TetMesh, Unexpected> {
    let [x, y, z] = extent;
    let to_world = Matrix4::from_diagonal(&[x, y, z, 1.0].into());
    Ok(TetMesh::lattice(cells, &to_world)?)
}

/// Creates a lattice whose inner nodes are randomly moved by up to `share` of a cell along each axis; up to 0.15 no element is inverted.
pub fn shaken(cells: [usize; 3], extent: [f64; 3], share: f64, seed: u64) -> Result<TetMesh, Unexpected> {
    let regular = lattice(cells, extent)?;
    let on_surface = surface(&regular);
    moved(&regular, |node, position| {
        let step = |axis: usize| share * extent[axis] / cells[axis] as f64 * noise(seed, (3 * node + axis) as u64);
        std::array::from_fn(|axis| position[axis] + if on_surface[node] { 0.0 } else { step(axis) })
    })
}

/// Returns the mesh with its nodes moved.
pub fn moved(mesh: &TetMesh, to: impl Fn(usize, &[f64; 3]) -> [f64; 3]) -> Result<TetMesh, Unexpected> {
    let nodes = mesh
        .nodes()
        .iter()
        .enumerate()
        .map(|(node, position)| to(node, position));
    Ok(TetMesh::new(
        nodes.collect(),
        mesh.elements().to_vec(),
        mesh.regions().to_vec(),
    )?)
}

/// Returns the mesh with the region of each element chosen by its centroid.
pub fn with_regions(mesh: &TetMesh, region: impl Fn([f64; 3]) -> i32) -> Result<TetMesh, Unexpected> {
    let middle = |corners: &[u32; 4]| {
        std::array::from_fn(|axis| {
            corners
                .iter()
                .map(|node| mesh.nodes()[*node as usize][axis])
                .sum::<f64>()
                / 4.0
        })
    };
    let regions = mesh.elements().iter().map(|corners| region(middle(corners)));
    Ok(TetMesh::new(
        mesh.nodes().to_vec(),
        mesh.elements().to_vec(),
        regions.collect(),
    )?)
}

/// Creates two adjacent blocks that share no node; the second has the nodes from the returned number on.
pub fn two_parts() -> Result<(TetMesh, u32), Unexpected> {
    let one = lattice([2, 2, 2], [10.0; 3])?;
    let count = one.nodes().len() as u32;
    let mut nodes = one.nodes().to_vec();
    nodes.extend(one.nodes().iter().map(|[x, y, z]| [x + 12.0, *y, *z]));
    let mut elements = one.elements().to_vec();
    elements.extend(one.elements().iter().map(|corners| corners.map(|node| node + count)));
    let regions = [vec![1; one.elements().len()], vec![2; one.elements().len()]].concat();
    Ok((TetMesh::new(nodes, elements, regions)?, count))
}

/// Returns whether each node lies on the surface.
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

/// Static problem that owns its data.
#[derive(Clone)]
pub struct Problem {
    pub mesh: TetMesh,
    pub materials: Materials,
    pub fixes: Vec<Fix>,
    pub loads: Vec<Load>,
}

impl Problem {
    /// Creates a problem of one material, unsupported and unloaded.
    pub fn new(mesh: TetMesh, material: Material) -> Problem {
        Problem {
            mesh,
            materials: Materials::uniform(material),
            fixes: Vec::new(),
            loads: Vec::new(),
        }
    }

    /// Creates the default problem: a perturbed block of soft tissue on a fixed floor, loaded at all nodes.
    pub fn block(record: &Record<'_>, poisson: f64) -> Result<Problem, Unexpected> {
        let mesh = shaken([4, 4, 5], [20.0, 20.0, 25.0], 0.15, record.seed())?;
        let mut problem = Problem::new(mesh, Material::new(10.0, poisson)?);
        problem.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
        problem.load_all(record.seed());
        Ok(problem)
    }

    /// Prescribes displacements along some axes of the nodes selected by position.
    pub fn fix(&mut self, axes: &[u8], which: impl Fn(&[f64; 3]) -> bool, field: impl Fn(&[f64; 3]) -> [f64; 3]) {
        for (node, position) in (0..).zip(self.mesh.nodes()).filter(|(_, position)| which(position)) {
            let displacement = field(position);
            self.fixes.extend(axes.iter().map(|&axis| Fix {
                node,
                axis,
                displacement_mm: displacement[usize::from(axis)],
            }));
        }
    }

    /// Prescribes a displacement field on the entire surface.
    pub fn fix_surface(&mut self, field: impl Fn(&[f64; 3]) -> [f64; 3]) {
        let on_surface = surface(&self.mesh);
        for (node, position) in (0..)
            .zip(self.mesh.nodes())
            .filter(|(node, _)| on_surface[*node as usize])
        {
            let displacement = field(position);
            self.fixes.extend([0, 1, 2].map(|axis| Fix {
                node,
                axis,
                displacement_mm: displacement[usize::from(axis)],
            }));
        }
    }

    /// Applies a random force of up to 1 mN along each axis to every node.
    pub fn load_all(&mut self, seed: u64) {
        let load = |node: u32| Load {
            node,
            force_n: [0, 1, 2].map(|axis| 1e-3 * noise(seed, 1_000_000 + 3 * u64::from(node) + axis)),
        };
        self.loads = (0..self.mesh.nodes().len() as u32).map(load).collect();
    }

    pub fn solve(&self) -> Result<Solution, LinearError> {
        let problem = StaticProblem {
            mesh: &self.mesh,
            materials: self.materials.clone(),
            fixes: self.fixes.clone(),
            loads: self.loads.clone(),
        };
        problem.solve()
    }

    pub fn dofs(&self) -> Dofs {
        let fixed = self.fixes.iter().map(|fix| (fix.node, fix.axis));
        Dofs::new(self.mesh.nodes().len(), fixed)
    }

    pub fn stiffness(&self) -> Result<Stiffness, Unexpected> {
        let materials = self.materials.check(&self.mesh)?;
        Ok(Stiffness::assemble(&self.mesh, &materials, &self.dofs())?)
    }

    /// Returns the condition number of the stiffness, see [`condition`].
    pub fn condition(&self) -> Result<f64, Unexpected> {
        let stiffness = self.stiffness()?;
        Ok(condition(&stiffness, &Factor::new(&stiffness)?))
    }
}

/// Returns the 2-norm condition number of a stiffness, from power iterations, which approach it from below.
pub fn condition(stiffness: &Stiffness, factor: &Factor) -> f64 {
    let largest = dominant(factor.size(), |x, y| stiffness.multiply(x, y));
    let inverse_of_least = dominant(factor.size(), |x, y| {
        y.copy_from_slice(x);
        factor.solve_in_place(y);
    });
    largest * inverse_of_least
}

/// Returns the largest eigenvalue of a symmetric positive definite operator.
fn dominant(size: usize, apply: impl Fn(&[f64], &mut [f64])) -> f64 {
    let mut x: Vec<f64> = (0..size as u64).map(|i| noise(7, i)).collect();
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
