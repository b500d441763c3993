//! A static problem: some displacements and forces are given, the rest is sought.

mod balance;

use std::collections::BTreeMap;
use std::time::Instant;

use super::assembly::{AssemblyError, Stiffness};
use super::dofs::Dofs;
use super::factor::{Factor, FactorError};
use super::material::{Materials, MaterialsError};
use super::rigid::{self, RigidError};
use crate::mechanics::mesh::TetMesh;
use balance::Balance;

/// A prescribed displacement of one node along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// The node, from 0.
    pub node: u32,
    /// The axis, 0 to 2 for x to z.
    pub axis: u8,
    /// The displacement, mm.
    pub displacement_mm: f64,
}

/// A force on one node; several on the same node add up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// The node, from 0.
    pub node: u32,
    /// The force, N.
    pub force_n: [f64; 3],
}

/// What is given of a static problem.
#[derive(Clone, Debug)]
pub struct StaticProblem<'a> {
    /// The mesh, in its unloaded state.
    pub mesh: &'a TetMesh,
    /// Materials of its regions.
    pub materials: Materials,
    /// Prescribed displacements; the same one may be given twice.
    pub fixes: Vec<Fix>,
    /// Forces. On a prescribed displacement they change the reaction only.
    pub loads: Vec<Load>,
}

/// The force that holds a prescribed displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reaction {
    /// The node, from 0.
    pub node: u32,
    /// The axis, 0 to 2.
    pub axis: u8,
    /// The force on the node, N.
    pub force_n: f64,
}

/// Wall-clock time by phase.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seconds {
    /// Checking the problem, rigid motions included.
    pub check: f64,
    /// Assembling the stiffness matrix.
    pub assembly: f64,
    /// Ordering and factoring it.
    pub factor: f64,
    /// Solving, residual and refinement included.
    pub solve: f64,
}

/// What a static problem comes to.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Displacement of every node, mm.
    pub displacement_mm: Vec<[f64; 3]>,
    /// Normwise backward error of the solution, see [`Factor::solve_refined`].
    pub residual: f64,
    /// The forces at the prescribed displacements, by node and axis.
    pub reactions: Vec<Reaction>,
    /// Times.
    pub seconds: Seconds,
}

/// Why a static problem has no solution.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// A node that the mesh does not have.
    #[error("{what} names node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node {
        /// "a fix" or "a load".
        what: &'static str,
        /// The node.
        node: u32,
        /// Nodes of the mesh.
        nodes: usize,
    },
    /// An axis beyond z.
    #[error("a fix of node {node} names axis {axis}; axes are 0, 1 and 2")]
    Axis {
        /// The node.
        node: u32,
        /// The axis.
        axis: u8,
    },
    /// A displacement or force is NaN or infinite.
    #[error("{what} of node {node} is {value}; expected a finite number")]
    NotFinite {
        /// "the displacement" or "the force".
        what: &'static str,
        /// The node.
        node: u32,
        /// The number.
        value: f64,
    },
    /// Two different displacements are prescribed.
    #[error("node {node} is fixed at both {} mm and {} mm along {}", .displacements_mm[0], .displacements_mm[1],
        ["x", "y", "z"][*.axis as usize % 3])]
    Contradiction {
        /// The node.
        node: u32,
        /// The axis, 0 to 2.
        axis: u8,
        /// The two displacements, mm.
        displacements_mm: [f64; 2],
    },
    /// The materials do not cover the mesh.
    #[error(transparent)]
    Materials(#[from] MaterialsError),
    /// Rigid motions are free.
    #[error(transparent)]
    Rigid(#[from] RigidError),
    /// The stiffness cannot be assembled.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// The stiffness cannot be factored.
    #[error(transparent)]
    Factor(#[from] FactorError),
    /// Displacements beyond the range of numbers.
    #[error("the displacements are no finite numbers: stiffness, forces or displacements are too large or too small")]
    Overflow,
}

impl SolveError {
    /// Whether memory ran out, rather than the problem being wrong.
    pub fn is_machine(&self) -> bool {
        matches!(self, SolveError::Factor(FactorError::Memory { .. }))
    }
}

impl StaticProblem<'_> {
    /// Checks and solves the problem.
    ///
    /// # Errors
    /// [`SolveError`], with the node, element, region or part that is wrong.
    pub fn solve(&self) -> Result<Solution, SolveError> {
        let mut clock = Clock::start();
        let fixed = self.fixed()?;
        let mut forces = self.forces()?;
        let materials = self.materials.check(self.mesh)?;
        let dofs = Dofs::new(self.mesh.nodes().len(), fixed.keys().copied());
        let mut displacements = vec![[0.0; 3]; dofs.nodes()];
        for (&(node, axis), &displacement) in &fixed {
            displacements[node as usize][axis as usize] = displacement;
        }
        let mut seconds = Seconds {
            check: clock.lap(),
            ..Seconds::default()
        };
        // First, so that a flat or inverted element is named as such.
        let stiffness = Stiffness::assemble(self.mesh, &materials, &dofs)?;
        seconds.assembly = clock.lap();
        rigid::check(self.mesh, &dofs)?;
        seconds.check += clock.lap();
        let factor = Factor::new(&stiffness)?;
        seconds.factor = clock.lap();
        // What the prescribed displacements alone ask of the free ones.
        let prescribed = stiffness.nodal_forces(&displacements);
        let rhs: Vec<f64> = dofs
            .gather(&forces)
            .iter()
            .zip(dofs.gather(&prescribed))
            .map(|(f, k)| f - k)
            .collect();
        let (free, residual) = factor.solve_refined(&stiffness, &rhs);
        if !residual.is_finite() || free.iter().any(|u| !u.is_finite()) {
            return Err(SolveError::Overflow);
        }
        dofs.scatter(&free, &mut displacements);
        let holding = Balance::new(self.mesh, &materials)?.settle(&dofs, &factor, &forces, &mut displacements);
        for (load, holding) in forces.iter_mut().zip(holding) {
            *load = std::array::from_fn(|axis| holding[axis] - load[axis]);
        }
        if displacements.iter().chain(&forces).flatten().any(|x| !x.is_finite()) {
            return Err(SolveError::Overflow);
        }
        let reaction = |(node, axis): (u32, u8)| Reaction {
            node,
            axis,
            force_n: forces[node as usize][axis as usize],
        };
        let reactions = dofs.prescribed().map(reaction).collect();
        seconds.solve = clock.lap();
        Ok(Solution {
            displacement_mm: displacements,
            residual,
            reactions,
            seconds,
        })
    }

    fn check_node(&self, what: &'static str, node: u32) -> Result<(), SolveError> {
        let nodes = self.mesh.nodes().len();
        if (node as usize) < nodes {
            Ok(())
        } else {
            Err(SolveError::Node { what, node, nodes })
        }
    }

    /// Prescribed displacements by node and axis.
    fn fixed(&self) -> Result<BTreeMap<(u32, u8), f64>, SolveError> {
        let mut fixed = BTreeMap::new();
        for &Fix {
            node,
            axis,
            displacement_mm: value,
        } in &self.fixes
        {
            self.check_node("a fix", node)?;
            if axis > 2 {
                return Err(SolveError::Axis { node, axis });
            }
            if !value.is_finite() {
                return Err(SolveError::NotFinite {
                    what: "the displacement",
                    node,
                    value,
                });
            }
            let first = *fixed.entry((node, axis)).or_insert(value);
            if first != value {
                return Err(SolveError::Contradiction {
                    node,
                    axis,
                    displacements_mm: [first, value],
                });
            }
        }
        Ok(fixed)
    }

    /// The given force on every node.
    fn forces(&self) -> Result<Vec<[f64; 3]>, SolveError> {
        let mut forces = vec![[0.0; 3]; self.mesh.nodes().len()];
        for &Load { node, force_n } in &self.loads {
            self.check_node("a load", node)?;
            if let Some(&value) = force_n.iter().find(|value| !value.is_finite()) {
                return Err(SolveError::NotFinite {
                    what: "the force",
                    node,
                    value,
                });
            }
            forces[node as usize]
                .iter_mut()
                .zip(force_n)
                .for_each(|(sum, force)| *sum += force);
        }
        Ok(forces)
    }
}

struct Clock(Instant);

impl Clock {
    fn start() -> Clock {
        Clock(Instant::now())
    }

    /// Seconds since the last lap.
    fn lap(&mut self) -> f64 {
        std::mem::replace(&mut self.0, Instant::now()).elapsed().as_secs_f64()
    }
}

#[cfg(test)]
mod tests;
