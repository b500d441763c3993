//! Tangent stiffness of a chain of links under forces whose levers follow the joints.
//!
//! With theta the turns of all joints, `kappa theta = tau(theta)` at rest, tau_k = sum (x - x_k) x f over the forces
//! beyond joint k. The levers change as joints turn,
//!
//! ```text
//! d tau_j / d theta_k = G_jk = N_max(j,k) - tr(N) I,    N_k = sum (x - x_k) f^T over the forces beyond joint k
//! ```
//!
//! for axes of j, the nearer to the base, and k; transposed for the farther. G is the geometric stiffness: `kappa - G`
//! is singular where the forces buckle the needle.

use nalgebra::{Matrix3, Vector3};

use super::chain::Chain;
use super::flexible::Resistance;
use super::{CentreLine, Load, Row, across};
use crate::ldl::Ldl;
use insonify_base::simd::{Kernel, vectorised};

/// Limit to which a force along an axis is clamped, N, so that no product of forces overflows.
const MAX_FORCE_N: f64 = 1e60;

/// Sums over the forces between a joint and the tip.
#[derive(Clone, Copy, Debug, Default)]
struct Beyond {
    force: Vector3<f64>,
    /// N_k of the module documentation, N mm.
    moments: Matrix3<f64>,
}

impl Beyond {
    /// Returns sum (x - x_k) x f.
    fn torque(&self) -> Vector3<f64> {
        let m = &self.moments;
        Vector3::new(m.m23 - m.m32, m.m31 - m.m13, m.m12 - m.m21)
    }

    /// Returns N - tr(N) I.
    fn geometric(&self) -> Matrix3<f64> {
        self.moments - Matrix3::from_diagonal_element(self.moments.trace())
    }
}

/// Tangent stiffness of the shape of a line under some loads. The memory is kept.
#[derive(Clone, Debug, Default)]
pub(super) struct Tangent {
    beyond: Vec<Beyond>,
    /// The two axes of rotation of each joint, across the link before it.
    axes: Vec<[Vector3<f64>; 2]>,
    /// kappa - G about these axes.
    stiffness: Ldl,
    /// Sums of the loads of the last step.
    under: Vec<Beyond>,
    turns: Vec<f64>,
    /// Displacement of each row by a turn about each axis, mm/rad, row by row of axes.
    moves: Vec<f64>,
}

impl Tangent {
    /// Computes the stiffness for joints of this resistance. Returns the number of modes in which the loads would
    /// buckle the unsupported needle.
    pub(super) fn set(&mut self, chain: &Chain, line: &CentreLine, resistance: &Resistance, loads: &[Load]) -> usize {
        sum_up(chain, line, loads, &mut self.beyond);
        self.axes.clear();
        let links = chain.joints().iter().zip(line.turns());
        self.axes
            .extend(links.map(|(node, turn)| across(&line.before(*node, turn))));
        let count = self.axes.len();
        self.stiffness.start(2 * self.axes.len());
        for (far, (axes, beyond)) in self.axes.iter().zip(&self.beyond).enumerate() {
            let geometric = beyond.geometric();
            for (b, axis) in axes.iter().enumerate() {
                let turned = geometric * axis;
                for (near, others) in self.axes[..far].iter().enumerate() {
                    // Of two joints the farther gives the geometric stiffness, N_max(j, k): only forces beyond both
                    // turn with both.
                    let resisted = axis * resistance.entry(far, near, count) - turned;
                    for (a, row_axis) in others.iter().enumerate() {
                        *self.stiffness.entry(2 * far + b, 2 * near + a) = row_axis.dot(&resisted);
                    }
                }
                let turned = symmetric(&geometric) * axis;
                for (a, row_axis) in axes[..=b].iter().enumerate() {
                    let spring = if a == b { resistance.entry(far, far, count) } else { 0.0 };
                    *self.stiffness.entry(2 * far + b, 2 * far + a) = spring - row_axis.dot(&turned);
                }
            }
        }
        self.stiffness.factor().negative
    }

    /// Makes one Newton step from the shape of the line to that under `loads`.
    pub(super) fn step(&mut self, chain: &Chain, line: &CentreLine, loads: &[Load]) {
        sum_up(chain, line, loads, &mut self.under);
        // (kappa - G) theta = tau - G theta_before: exactly zero without loads.
        let mut carried: Vector3<f64> = line.turns().iter().sum();
        let mut beyond = Vector3::zeros();
        self.turns.clear();
        self.turns.resize(2 * self.axes.len(), 0.0);
        for joint in (0..self.axes.len()).rev() {
            let turn = line.turns()[joint];
            let geometric = self.beyond[joint].geometric();
            carried -= turn;
            let followed = beyond + geometric.tr_mul(&carried) + symmetric(&geometric) * turn;
            beyond += geometric * turn;
            let torque = self.under[joint].torque() - followed;
            for (a, axis) in self.axes[joint].iter().enumerate() {
                self.turns[2 * joint + a] = axis.dot(&torque);
            }
        }
        self.stiffness.solve(&mut self.turns);
    }

    /// Returns the turn of a joint after the last step.
    pub(super) fn turn(&self, joint: usize) -> Vector3<f64> {
        self.axes[joint][0] * self.turns[2 * joint] + self.axes[joint][1] * self.turns[2 * joint + 1]
    }

    /// Writes the displacement of each row by a turn of each joint.
    pub(crate) fn set_moves(&mut self, chain: &Chain, line: &CentreLine, rows: &[Row]) {
        let (nodes, width) = (line.nodes(), rows.len());
        self.moves.clear();
        self.moves.resize(2 * self.axes.len() * width, 0.0);
        for (column, row) in rows.iter().enumerate() {
            let point = line.point_at_arc(row.arc_mm).point_mm;
            let joints = &chain.joints()[..chain.joints_before(row.arc_mm)];
            for (joint, &node) in joints.iter().enumerate() {
                let moved = (point - nodes[node].1).cross(&row.direction);
                for (a, axis) in self.axes[joint].iter().enumerate() {
                    self.moves[(2 * joint + a) * width + column] = axis.dot(&moved);
                }
            }
        }
    }

    /// Writes the linearised displacement of each row by the last step, mm.
    pub(super) fn drift(&self, line: &CentreLine, out: &mut [f64]) {
        out.fill(0.0);
        let before = line.turns().iter().zip(&self.axes);
        let before = before.flat_map(|(turn, axes)| axes.map(|axis| axis.dot(turn)));
        let steps = self.turns.iter().zip(before).map(|(turn, before)| turn - before);
        for (moves, step) in self.moves.chunks_exact(out.len()).zip(steps) {
            out.iter_mut().zip(moves).for_each(|(out, moved)| *out += step * moved);
        }
    }

    /// Adds the rows' flexibility. Consumes their displacements.
    pub(crate) fn add_flexibility(&mut self, width: usize, out: &mut [f64]) {
        self.stiffness.forward(&mut self.moves, width);
        vectorised(AddSquares {
            width,
            rows: &self.moves,
            weights: self.stiffness.reciprocals(),
            out,
        });
    }
}

/// `out += X^T D X` of rows X.
struct AddSquares<'a> {
    width: usize,
    rows: &'a [f64],
    weights: &'a [f64],
    out: &'a mut [f64],
}

impl Kernel for AddSquares<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.width;
        for column in 0..width {
            let out = &mut self.out[column * width..][column..width];
            // Four rows at a time: `out` is read and written less often.
            let fours = self.rows.chunks_exact(4 * width);
            let remaining_rows = fours.remainder().chunks_exact(width);
            let done = self.weights.len() / 4 * 4;
            for (rows, weights) in fours.zip(self.weights.chunks_exact(4)) {
                let row = |index: usize| &rows[index * width + column..(index + 1) * width];
                let factor = |index: usize| rows[index * width + column] * weights[index];
                let ([a, b, c, d], [e, f, g, h]) = ([0, 1, 2, 3].map(row), [0, 1, 2, 3].map(factor));
                for (out, (((a, b), c), d)) in out.iter_mut().zip(a.iter().zip(b).zip(c).zip(d)) {
                    *out += (e * a + f * b) + (g * c + h * d);
                }
            }
            for (row, weight) in remaining_rows.zip(&self.weights[done..]) {
                let factor = row[column] * weight;
                out.iter_mut()
                    .zip(&row[column..])
                    .for_each(|(out, x)| *out += factor * x);
            }
        }
        for column in 0..width {
            for row in 0..column {
                self.out[column * width + row] = self.out[row * width + column];
            }
        }
    }
}

/// Sums the loads beyond each joint.
fn sum_up(chain: &Chain, line: &CentreLine, loads: &[Load], sums: &mut Vec<Beyond>) {
    let (nodes, joints) = (line.nodes(), chain.joints());
    sums.clear();
    sums.resize(joints.len(), Beyond::default());
    for load in loads {
        if let Some(last_joint) = chain.joints_before(load.arc_mm).checked_sub(1) {
            let force = load.force_n.map(|part| part.clamp(-MAX_FORCE_N, MAX_FORCE_N));
            let from_base = line.point_at_arc(load.arc_mm).point_mm - nodes[0].1;
            sums[last_joint].force += force;
            sums[last_joint].moments += from_base * force.transpose();
        }
    }
    for joint in (1..sums.len()).rev() {
        let Beyond { force, moments } = sums[joint];
        sums[joint - 1].force += force;
        sums[joint - 1].moments += moments;
    }
    for (sum, &node) in sums.iter_mut().zip(joints) {
        sum.moments -= (nodes[node].1 - nodes[0].1) * sum.force.transpose();
    }
}

fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    (matrix + matrix.transpose()) * 0.5
}
