//! Static problem: displacements and reactions for given displacements and forces.

use std::collections::BTreeMap;
use std::time::Instant;

use super::assembly::Stiffness;
use super::dofs::Dofs;
use super::element::Shape;
use super::factor::Factor;
use super::material::{Material, Materials};
use super::rigid;
use crate::tissue::error::LinearError;
use insonify_mesh::TetMesh;

/// Prescribed displacement of one node along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Node index, from 0.
    pub node: u32,
    /// Axis, 0 to 2 for x to z.
    pub axis: u8,
    /// Displacement, mm.
    pub displacement_mm: f64,
}

/// Force on one node; several on the same node add up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Node index, from 0.
    pub node: u32,
    /// Force, N.
    pub force_n: [f64; 3],
}

/// Input of a static problem.
#[derive(Clone, Debug)]
pub struct StaticProblem<'a> {
    /// Mesh in its unloaded state.
    pub mesh: &'a TetMesh,
    /// Materials of the mesh regions.
    pub materials: Materials,
    /// Prescribed displacements; equal duplicates are allowed.
    pub fixes: Vec<Fix>,
    /// Forces. At a prescribed displacement they change only the reaction.
    pub loads: Vec<Load>,
}

/// Reaction force at a prescribed displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reaction {
    /// Node index, from 0.
    pub node: u32,
    /// Axis, 0 to 2.
    pub axis: u8,
    /// Force on the node, N.
    pub force_n: f64,
}

/// Wall-clock time by phase, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seconds {
    /// Checking the problem, rigid motions included.
    pub check: f64,
    /// Assembling the stiffness matrix.
    pub assembly: f64,
    /// Ordering and factoring the stiffness matrix.
    pub factor: f64,
    /// Solving, residual and refinement included.
    pub solve: f64,
}

/// Solution of a static problem.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Displacement of every node, mm.
    pub displacement_mm: Vec<[f64; 3]>,
    /// Normwise backward error of the solution, see [`Factor::solve_refined`].
    pub residual: f64,
    /// Reaction forces at the prescribed displacements, by node and axis.
    pub reactions: Vec<Reaction>,
    /// Wall-clock times of the phases.
    pub seconds: Seconds,
}

impl StaticProblem<'_> {
    /// Checks and solves the problem.
    ///
    /// # Errors
    /// [`LinearError`] with the node, element, region or part at fault.
    pub fn solve(&self) -> Result<Solution, LinearError> {
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
        // First, so that a flat or inverted element is reported as such.
        let stiffness = Stiffness::assemble(self.mesh, &materials, &dofs)?;
        seconds.assembly = clock.lap();
        rigid::check(self.mesh, &dofs)?;
        seconds.check += clock.lap();
        let factor = Factor::new(&stiffness)?;
        seconds.factor = clock.lap();
        // Forces due to the prescribed displacements alone.
        let prescribed = stiffness.nodal_forces(&displacements);
        let rhs: Vec<f64> = dofs
            .gather(&forces)
            .iter()
            .zip(dofs.gather(&prescribed))
            .map(|(f, k)| f - k)
            .collect();
        let (free, residual) = factor.solve_refined(&stiffness, &rhs);
        if !residual.is_finite() || free.iter().any(|u| !u.is_finite()) {
            return Err(LinearError::Overflow);
        }
        dofs.scatter(&free, &mut displacements);
        // A contrast of stiffness leaves the sum of all forces off by that many times rounding; refined, they balance.
        let holding = Balance::new(self.mesh, &materials)?.settle(&dofs, &factor, &forces, &mut displacements);
        for (load, holding) in forces.iter_mut().zip(holding) {
            *load = std::array::from_fn(|axis| holding[axis] - load[axis]);
        }
        if displacements.iter().chain(&forces).flatten().any(|x| !x.is_finite()) {
            return Err(LinearError::Overflow);
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

    fn check_node(&self, what: &'static str, node: u32) -> Result<(), LinearError> {
        let nodes = self.mesh.nodes().len();
        if (node as usize) < nodes {
            Ok(())
        } else {
            Err(LinearError::Node { what, node, nodes })
        }
    }

    /// Returns the prescribed displacements by node and axis.
    fn fixed(&self) -> Result<BTreeMap<(u32, u8), f64>, LinearError> {
        let mut fixed = BTreeMap::new();
        for &Fix {
            node,
            axis,
            displacement_mm: value,
        } in &self.fixes
        {
            self.check_node("a fix", node)?;
            if axis > 2 {
                return Err(LinearError::Axis { node, axis });
            }
            if !value.is_finite() {
                return Err(LinearError::NotFinite {
                    what: "the displacement",
                    node,
                    value,
                });
            }
            let first_mm = *fixed.entry((node, axis)).or_insert(value);
            if first_mm != value {
                return Err(LinearError::Contradiction {
                    node,
                    axis,
                    displacements_mm: [first_mm, value],
                });
            }
        }
        Ok(fixed)
    }

    /// Returns the given force on every node.
    fn forces(&self) -> Result<Vec<[f64; 3]>, LinearError> {
        let mut forces = vec![[0.0; 3]; self.mesh.nodes().len()];
        for &Load { node, force_n } in &self.loads {
            self.check_node("a load", node)?;
            if let Some(&value) = force_n.iter().find(|value| !value.is_finite()) {
                return Err(LinearError::NotFinite {
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

    /// Returns the seconds since the last lap.
    fn lap(&mut self) -> f64 {
        std::mem::replace(&mut self.0, Instant::now()).elapsed().as_secs_f64()
    }
}

/// Largest sum of all forces, relative to the sum of their magnitudes, that is not refined.
const BALANCED: f64 = 1e-13;

/// Largest number of refinement steps. Each multiplies the error by about rounding times the contrast of stiffness; two
/// reduce it to rounding at a contrast of 1e8.
const STEPS: usize = 2;

/// Elements of a mesh, prepared to compute forces from displacements.
struct Balance<'a> {
    elements: &'a [[u32; 4]],
    shapes: Vec<(Shape, [f64; 2])>,
}

impl<'a> Balance<'a> {
    /// Prepares the elements; `materials` has one entry per element.
    pub(crate) fn new(mesh: &'a TetMesh, materials: &[Material]) -> Result<Balance<'a>, LinearError> {
        let elements = mesh.elements();
        let shape = |(element, (corners, material)): (usize, (&[u32; 4], &Material))| {
            let shape = Shape::of(&corners.map(|node| mesh.nodes()[node as usize]));
            let shape = shape.map_err(|cause| LinearError::Element {
                element,
                corners: *corners,
                cause,
                others: Vec::new(),
            })?;
            Ok((shape, shape.weights(material)))
        };
        let shapes = elements.iter().zip(materials).enumerate().map(shape);
        Ok(Balance {
            elements,
            shapes: shapes.collect::<Result<_, LinearError>>()?,
        })
    }

    /// Returns the forces on all nodes (N) that balance the displacements of all nodes (mm).
    fn forces(&self, displacement_mm: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut forces = vec![[0.0; 3]; displacement_mm.len()];
        for (corners, (shape, weights)) in self.elements.iter().zip(&self.shapes) {
            let element_forces = shape.forces(*weights, &corners.map(|node| displacement_mm[node as usize]));
            for (node, force) in corners.iter().zip(element_forces) {
                forces[*node as usize]
                    .iter_mut()
                    .zip(force)
                    .for_each(|(sum, force)| *sum += force);
            }
        }
        forces
    }

    /// Refines displacements (mm) until all forces (N) balance; `loads` are those given on all nodes. Returns the
    /// forces on all nodes that balance the displacements, loads plus reactions.
    pub(crate) fn settle(
        &self,
        dofs: &Dofs,
        factor: &Factor,
        loads: &[[f64; 3]],
        displacement_mm: &mut Vec<[f64; 3]>,
    ) -> Vec<[f64; 3]> {
        let mut holding = self.forces(displacement_mm);
        let mut residual = imbalance(dofs, loads, &holding);
        for _ in 0..STEPS {
            if residual <= BALANCED {
                break;
            }
            let defect = |force: &[[f64; 3]]| dofs.gather(force);
            let mut correction: Vec<f64> = defect(loads).iter().zip(defect(&holding)).map(|(f, h)| f - h).collect();
            factor.solve_in_place(&mut correction);
            let free = dofs.gather(displacement_mm);
            correction.iter_mut().zip(free).for_each(|(change, u)| *change += u);
            let mut refined = displacement_mm.clone();
            dofs.scatter(&correction, &mut refined);
            let next = self.forces(&refined);
            let left = imbalance(dofs, loads, &next);
            // Stops where the imbalance grows or is NaN.
            if left.is_nan() || left >= residual {
                break;
            }
            (*displacement_mm, holding, residual) = (refined, next, left);
        }
        holding
    }
}

/// Returns the sum of given forces and reactions along the worst axis, relative to the sum of their magnitudes.
fn imbalance(dofs: &Dofs, loads: &[[f64; 3]], holding: &[[f64; 3]]) -> f64 {
    let (mut sums, mut size) = ([0.0f64; 3], 0.0);
    for (node, (load, holding)) in (0..).zip(loads.iter().zip(holding)) {
        for (axis, dof) in dofs.of(node).into_iter().enumerate() {
            // At a prescribed displacement, the balancing force is load plus reaction.
            let force = if dof == super::dofs::NO_DOF {
                holding[axis]
            } else {
                load[axis]
            };
            sums[axis] += force;
            size += force.abs();
        }
    }
    let worst = sums.into_iter().fold(0.0, |a: f64, sum| a.max(sum.abs()));
    if worst == 0.0 { 0.0 } else { worst / size }
}

#[cfg(test)]
mod tests;
