//! Refinement of a static solution to equilibrium of the entire body.
//!
//! The entries of an assembled stiffness are rounded, so rigid motions cause small forces, of the size of the rounding
//! of its largest entries. A stiff inclusion in something a hundred million times softer moves nearly rigidly, and
//! these spurious forces are then no longer small against the loads: the body is out of balance, and the inclusion
//! slightly misplaced. Forces summed element by element from differences of displacements do not have that error: the
//! forces of an element sum to zero for any displacements. Iterative refinement with the residual from these forces (N.
//! J. Higham, "Accuracy and Stability of Numerical Algorithms", chapter 12) corrects it.

use super::super::dofs::Dofs;
use super::super::element::Shape;
use super::super::factor::Factor;
use super::super::material::Material;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::error::LinearError;

/// Largest sum of all forces, relative to the sum of their magnitudes, that is not refined.
const BALANCED: f64 = 1e-13;

/// Largest number of refinement steps. Each multiplies the error by about rounding times the contrast of stiffness; two
/// reduce it to rounding at a contrast of 1e8.
const STEPS: usize = 2;

/// Elements of a mesh, prepared to compute forces from displacements.
pub(super) struct Balance<'a> {
    elements: &'a [[u32; 4]],
    shapes: Vec<(Shape, [f64; 2])>,
}

impl<'a> Balance<'a> {
    /// Prepares the elements; `materials` has one entry per element.
    pub fn new(mesh: &'a TetMesh, materials: &[Material]) -> Result<Balance<'a>, LinearError> {
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
            let own = shape.forces(*weights, &corners.map(|node| displacement_mm[node as usize]));
            for (node, force) in corners.iter().zip(own) {
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
    pub fn settle(
        &self,
        dofs: &Dofs,
        factor: &Factor,
        loads: &[[f64; 3]],
        displacement_mm: &mut Vec<[f64; 3]>,
    ) -> Vec<[f64; 3]> {
        let mut holding = self.forces(displacement_mm);
        let mut off = imbalance(dofs, loads, &holding);
        for _ in 0..STEPS {
            if off <= BALANCED {
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
            if left.is_nan() || left >= off {
                break;
            }
            (*displacement_mm, holding, off) = (refined, next, left);
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
            let force = if dof == super::super::dofs::NONE {
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
