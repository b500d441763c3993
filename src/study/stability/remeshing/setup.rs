//! Mesh, backends and reference inverse shared by the remeshing cases.

use std::sync::Arc;

use crate::mechanics::tissue::dofs::NONE;
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::inverse::invert;
use crate::mechanics::tissue::material::Material;
use crate::mechanics::tissue::remesh::{
    Adaptation, AdaptedMesh, Level, Options, Precision, RemeshError, RemeshReport, Source,
};
use crate::mechanics::tissue::symmetric::Symmetric;
use crate::study::stability::record::{Unexpected, largest, noise};
use crate::study::stability::solving::problem::{Problem, condition, shaken};

/// Edge length of the lattice cells, mm.
const CELL: f64 = 5.0;

/// Relative error of K^-1 allowed in f64 at Poisson's ratio 0.45.
pub const PROMISED: f64 = 1e-11;

/// Remesher backends. A backend added here runs in every case of levels.
pub const BACKENDS: &[Backend] = &[
    Backend {
        name: "cpu f64",
        precision: Precision::Double,
        follow: |start, level, options| {
            let source = Source::Double(Arc::clone(&start.double));
            Adaptation::new(start.mesh.clone(), source, level, Precision::Double, options)
        },
    },
    Backend {
        name: "cpu f32",
        precision: Precision::Single,
        follow: |start, level, options| {
            let source = Source::Single(Arc::clone(&start.single));
            Adaptation::new(start.mesh.clone(), source, level, Precision::Single, options)
        },
    },
];

/// Remesher backend in one precision.
pub struct Backend {
    pub name: &'static str,
    pub precision: Precision,
    follow: fn(&Start, Level, Options) -> Result<Adaptation, RemeshError>,
}

impl Backend {
    /// Creates a remesher for a mesh at its base, with its contacts set.
    pub fn follow(&self, start: &Start, level: Level, options: Options) -> Result<Adaptation, RemeshError> {
        let mut adaptation = (self.follow)(start, level, options)?;
        adaptation.parts().1.set_contacts(&start.contacts)?;
        Ok(adaptation)
    }

    /// Returns the rounding unit of its entries relative to f64.
    pub fn coarseness(&self) -> f64 {
        match self.precision {
            Precision::Single => f64::from(f32::EPSILON) / f64::EPSILON,
            Precision::Double => 1.0,
        }
    }
}

/// Randomly perturbed block of 6 x 5 x 5 nodes on a fixed floor, with its inverse stiffness.
pub struct Start {
    pub mesh: AdaptedMesh,
    pub double: Arc<Symmetric<f64>>,
    pub single: Arc<Symmetric<f32>>,
    /// Nodes without prescribed displacements.
    pub free: Vec<u32>,
    /// Degrees of freedom of ten of the free nodes.
    pub contacts: Vec<usize>,
    /// Condition number of the stiffness at Poisson's ratio 0.45.
    usual_condition: f64,
    seed: u64,
}

impl Start {
    pub fn new(seed: u64, poisson: f64) -> Result<Start, Unexpected> {
        let cells = [5, 4, 4];
        let mesh = shaken(cells, cells.map(|n| n as f64 * CELL), 0.12, seed)?;
        let problem = |poisson: f64| -> Result<Problem, Unexpected> {
            let mut problem = Problem::new(mesh.clone(), Material::new(10.0, poisson)?);
            problem.fix(&[0, 1, 2], |p| p[2] == 0.0, |_| [0.0; 3]);
            Ok(problem)
        };
        let (usual, own) = (problem(0.45)?, problem(poisson)?);
        let mesh = AdaptedMesh::new(&mesh, &own.materials.check(&mesh)?, &own.dofs())?;
        let double: Symmetric<f64> = invert(&Factor::new(mesh.stiffness())?, |_, _| {})?;
        let free: Vec<u32> = (0..mesh.nodes().len() as u32)
            .filter(|node| !mesh.dofs().of(*node).contains(&NONE))
            .collect();
        let some = free.iter().step_by(free.len() / 10).take(10);
        let contacts = some
            .flat_map(|node| mesh.dofs().of(*node))
            .map(|dof| dof as usize)
            .collect();
        Ok(Start {
            single: Arc::new(double.cast()),
            double: Arc::new(double),
            free,
            contacts,
            usual_condition: usual.condition()?,
            mesh,
            seed,
        })
    }

    /// Returns the allowed error of K^-1 for the current mesh: [`PROMISED`] at the usual condition number, growing in proportion to it.
    pub fn allowed(&self, now: &Now, backend: &Backend) -> f64 {
        PROMISED * (now.condition / self.usual_condition).max(1.0) * backend.coarseness()
    }

    /// Returns the `n`th move of a sequence: a node of `nodes` and its target, up to a quarter of a cell from its base along each axis.
    pub fn nth_move(&self, nodes: &[u32], n: u64) -> (u32, [f64; 3]) {
        let at = |index: u64| noise(self.seed, 8 * n + index);
        let place = (0.5 * (at(3) + 1.0) * nodes.len() as f64) as usize;
        let node = nodes[place.min(nodes.len() - 1)];
        let base = self.mesh.base()[node as usize];
        (
            node,
            std::array::from_fn(|axis| base[axis] + 0.25 * CELL * at(axis as u64)),
        )
    }

    /// Makes the moves `span` of the sequence, skipping those that would spoil an element.
    pub fn go(
        &self,
        adaptation: &mut Adaptation,
        nodes: &[u32],
        span: std::ops::Range<u64>,
        mut after: impl FnMut(&mut Adaptation, RemeshReport) -> Result<(), Unexpected>,
    ) -> Result<(), Unexpected> {
        for n in span {
            let (node, position) = self.nth_move(nodes, n);
            if adaptation.mesh().assess(node, position).is_ok() {
                let report = adaptation.move_node(node, position)?;
                after(adaptation, report)?;
            }
        }
        Ok(())
    }
}

/// Inverse of the current stiffness, computed from scratch in f64.
pub struct Now {
    pub inverse: Symmetric<f64>,
    pub condition: f64,
}

impl Now {
    pub fn of(mesh: &AdaptedMesh) -> Result<Now, Unexpected> {
        let stiffness = mesh.stiffness().at_nodes(mesh.nodes())?;
        let factor = Factor::new(&stiffness)?;
        Ok(Now {
            inverse: invert(&factor, |_, _| {})?,
            condition: condition(&stiffness, &factor),
        })
    }

    /// Returns the largest error of K^c relative to its largest entry.
    pub fn error_of_contacts(&self, adaptation: &Adaptation) -> f64 {
        let contacts = adaptation.remesher().contacts();
        let found = adaptation.remesher().condensed();
        let pairs = (0..contacts.len()).flat_map(|i| (0..contacts.len()).map(move |j| (i, j)));
        let gold = |(i, j): (usize, usize)| self.inverse.get(contacts[i], contacts[j]);
        let difference = largest(pairs.clone().map(|at| found[at] - gold(at)));
        difference / largest(pairs.map(gold))
    }

    /// Returns the largest error of K^-1 relative to its largest entry.
    pub fn error_of_all(&self, adaptation: &mut Adaptation) -> Result<f64, Unexpected> {
        let all: Vec<usize> = (0..self.inverse.size()).collect();
        let found = adaptation.parts().1.compliance(&all, &all)?;
        let pairs = all.iter().flat_map(|i| all.iter().map(move |j| (*i, *j)));
        let difference = largest(pairs.clone().map(|(i, j)| found[(i, j)] - self.inverse.get(i, j)));
        Ok(difference / largest(pairs.map(|(i, j)| self.inverse.get(i, j))))
    }
}

/// Returns the state that a refused move must leave unchanged, bit for bit.
pub fn state(adaptation: &Adaptation) -> (Vec<u64>, u64, Vec<u64>) {
    let mesh = adaptation.mesh();
    let nodes = mesh.nodes().as_flattened().iter().map(|x| x.to_bits());
    (nodes.collect(), mesh.step(), bits(adaptation))
}

/// Returns the bits of K^c.
pub fn bits(adaptation: &Adaptation) -> Vec<u64> {
    let condensed = adaptation.remesher().condensed();
    let entries = condensed
        .col_iter()
        .flat_map(|column| column.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
    entries.collect()
}
