//! Tissue, probe and needle solved together at their contacts.
//!
//! With F the forces on the tissue at the needle's contacts and g the displacements that the probe prescribes along its rows P,
//! the tissue answers
//!
//! ```text
//! u = (K_nn - K_nP K_PP^-1 K_Pn) F + K_nP K_PP^-1 g
//! ```
//!
//! so the probe is eliminated once for every compliance at the contacts and every placement of its rows. The needle yields too:
//! its line moves by -C (F - F_before) across itself, C its flexibility. A node across the shaft lies on the line, and along it
//! either holds its place or is pushed with the friction there is:
//!
//! ```text
//! n . (X + u) = n . (x_line - C (F - F_before))
//! ```
//!
//! one positive definite system for the forces across and, of nodes that stick, along. Which nodes stick follows from Coulomb's
//! law with bounds that are known beforehand: a linear complementarity problem of a positive definite matrix, hence with one
//! solution. Nodes whose force passes the bound slip, and those that would slip against their friction stick; if that does not
//! settle, only the lowest such node changes at a time, which must end (Murty, 1974).

use faer::{Mat, MatRef};
use nalgebra::{Matrix3, Vector3};

use super::contact::{Contact, State};
use super::spd::Spd;
use crate::mechanics::needle::CentreLine;

/// A displacement that the probe prescribes: of which contact, along which direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ProbeRow {
    /// Among the contacts of the compliance.
    pub contact: usize,
    pub direction: Vector3<f64>,
}

/// Forces within this share of their bound keep it.
const BOUND: f64 = 1e-11;
/// A slip against friction by less is rounding, mm.
const REST: f64 = 1e-12;
/// Rounds in which all nodes that break Coulomb's law change at once.
const ROUNDS_AT_ONCE: usize = 4;

/// The contacts as a system of equations. The memory is kept.
#[derive(Debug, Default)]
pub(super) struct Joint {
    probe_rows: Vec<ProbeRow>,
    probe: Spd,
    /// K_PP^-1 K_Pn, a column of rows P for each degree of freedom of the needle's contacts.
    answer: Vec<f64>,
    /// K_PP^-1 g.
    held: Vec<f64>,
    /// K_nn - K_nP K_PP^-1 K_Pn, column by column.
    compliance: Vec<f64>,
    /// K_nP K_PP^-1 g.
    offset: Vec<f64>,
    /// K_nP, a column of the needle's degrees of freedom for each row P.
    coupling: Vec<f64>,
    /// The compliance in the frames of the contacts.
    turned: Vec<f64>,
    frames: Vec<Matrix3<f64>>,
    system: Spd,
    rows: Vec<usize>,
    right: Vec<f64>,
    /// Forces on the tissue in the frames of the contacts, N.
    forces: Vec<f64>,
    /// What a solution was linearised about.
    before: Vec<f64>,
}

/// What a solution took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Solved {
    /// Systems solved.
    pub rounds: usize,
    /// Whether Coulomb's law holds everywhere.
    pub settled: bool,
    /// Rows left out because the others determine them already.
    pub dependent: usize,
}

/// Axes of a contact: along the shaft, and two across.
fn frame(tangent: &Vector3<f64>) -> Matrix3<f64> {
    let least = tangent.iamin();
    let mut aside = Vector3::zeros();
    aside[least] = 1.0;
    let across = tangent.cross(&aside).normalize();
    Matrix3::from_columns(&[*tangent, across, tangent.cross(&across)])
}

impl Joint {
    /// Takes the compliance at the contacts (`probes` of the probe first, then those of the needle), and eliminates the probe.
    /// How many of its rows depend on others.
    pub fn condense(&mut self, condensed: MatRef<'_, f64>, probes: usize, rows: &[ProbeRow]) -> usize {
        self.probe_rows.clear();
        self.probe_rows.extend_from_slice(rows);
        let first = 3 * probes;
        let n = condensed.nrows() - first;
        let p = rows.len();
        self.coupling.clear();
        for row in rows {
            let at = 3 * row.contact;
            let entry = |i: usize| {
                (0..3)
                    .map(|axis| condensed[(first + i, at + axis)] * row.direction[axis])
                    .sum::<f64>()
            };
            self.coupling.extend((0..n).map(entry));
        }
        self.probe.start(p);
        for (j, column) in rows.iter().enumerate() {
            for (i, row) in rows.iter().enumerate().skip(j) {
                let block = |a: usize, b: usize| condensed[(3 * row.contact + a, 3 * column.contact + b)];
                let terms = (0..3).flat_map(|a| (0..3).map(move |b| (a, b)));
                *self.probe.entry(i, j) = terms
                    .map(|(a, b)| row.direction[a] * block(a, b) * column.direction[b])
                    .sum();
            }
        }
        let dependent = self.probe.factor();
        self.answer.clear();
        for i in 0..n {
            self.answer.extend((0..p).map(|row| self.coupling[row * n + i]));
            self.probe.solve(&mut self.answer[i * p..]);
        }
        self.compliance.clear();
        for j in 0..n {
            let column = (0..n).map(|i| condensed[(first + i, first + j)]);
            self.compliance.extend(column);
            for row in 0..p {
                let factor = self.answer[j * p + row];
                let coupling = &self.coupling[row * n..(row + 1) * n];
                self.compliance[j * n..]
                    .iter_mut()
                    .zip(coupling)
                    .for_each(|(x, y)| *x -= factor * y);
            }
        }
        dependent
    }

    /// What the probe prescribes along its rows, mm.
    pub fn press(&mut self, displacements: impl Iterator<Item = f64>) {
        self.held.clear();
        self.held.extend(displacements);
        self.probe.solve(&mut self.held);
        let n = if self.probe_rows.is_empty() {
            0
        } else {
            self.coupling.len() / self.probe_rows.len()
        };
        self.offset.clear();
        self.offset.resize(n, 0.0);
        for (force, coupling) in self.held.iter().zip(self.coupling.chunks_exact(n.max(1))) {
            self.offset.iter_mut().zip(coupling).for_each(|(x, y)| *x += force * y);
        }
    }

    fn offset(&self, contact: usize) -> Vector3<f64> {
        let at = 3 * contact;
        self.offset
            .get(at..at + 3)
            .map_or_else(Vector3::zeros, Vector3::from_column_slice)
    }

    /// Turns the contacts into the directions of the shaft at their arcs; forces of contacts that were there before are kept as
    /// the start. The directions along the shaft and across, contact by contact, are in [`frames`](Self::frames).
    pub fn turn(&mut self, contacts: &[Contact], line: &CentreLine, forces: &[Vector3<f64>]) {
        let n = 3 * contacts.len();
        self.frames.clear();
        self.frames
            .extend(contacts.iter().map(|contact| frame(&line.at(contact.arc).tangent)));
        self.before.clear();
        for (frame, force) in self.frames.iter().zip(forces) {
            self.before.extend_from_slice((frame.transpose() * force).as_slice());
        }
        self.turned.clear();
        self.turned.resize(n * n, 0.0);
        for (j, right) in self.frames.iter().enumerate() {
            for (i, left) in self.frames.iter().enumerate() {
                let block = Matrix3::from_fn(|a, b| self.compliance[(3 * j + b) * n + 3 * i + a]);
                let block = left.transpose() * block * right;
                for b in 0..3 {
                    for a in 0..3 {
                        self.turned[(3 * j + b) * n + 3 * i + a] = block[(a, b)];
                    }
                }
            }
        }
    }

    /// Axes of each contact: along the shaft, and two across.
    pub fn frames(&self) -> &[Matrix3<f64>] {
        &self.frames
    }

    /// Solves for the forces with the line as it lies, sets the states, and says how it went. `starts` are the arcs (mm) at the
    /// beginning of this part of the step, where nodes that begin to stick are held; `flexibility` has the needle's (mm/N) for the
    /// directions across, two a contact.
    pub fn solve(
        &mut self,
        contacts: &mut [Contact],
        starts: &[f64],
        line: &CentreLine,
        flexibility: Option<&Mat<f64>>,
    ) -> Solved {
        let mut solved = Solved::default();
        let most = 4 * contacts.len() + ROUNDS_AT_ONCE + 2;
        while solved.rounds < most {
            solved.rounds += 1;
            solved.dependent = self.solve_once(contacts, starts, line, flexibility);
            let all = solved.rounds <= ROUNDS_AT_ONCE;
            let mut changed = false;
            for at in 0..contacts.len() {
                if let Some(state) = self.breaks_the_law(&contacts[at], at, starts[at], line) {
                    contacts[at].state = state;
                    changed = true;
                    if !all {
                        break;
                    }
                }
            }
            if !changed {
                solved.settled = true;
                break;
            }
        }
        solved
    }

    /// The state that a contact must change to.
    fn breaks_the_law(&self, contact: &Contact, at: usize, start: f64, line: &CentreLine) -> Option<State> {
        let force = self.forces[3 * at];
        match contact.state {
            State::Stuck => {
                let direction = if force < 0.0 { -1.0 } else { 1.0 };
                let limit = contact.limit(direction, contact.holding);
                (force.abs() > limit * (1.0 + BOUND) + f64::MIN_POSITIVE).then_some(State::Slipping(direction))
            }
            State::Slipping(direction) => {
                // Pushed towards the tip, it must come nearer to the base.
                let place = line.at(start).point_mm;
                let slip = self.frames[at]
                    .column(0)
                    .dot(&(contact.reference + self.displacement(at) - place));
                (slip * direction > REST).then_some(State::Stuck)
            }
        }
    }

    fn solve_once(
        &mut self,
        contacts: &[Contact],
        starts: &[f64],
        line: &CentreLine,
        flexibility: Option<&Mat<f64>>,
    ) -> usize {
        let n = 3 * contacts.len();
        self.forces.clear();
        self.forces.resize(n, 0.0);
        self.rows.clear();
        self.right.clear();
        for (at, contact) in contacts.iter().enumerate() {
            let mut arc = contact.arc;
            match contact.state {
                State::Stuck => {
                    arc = starts[at];
                    self.rows.push(3 * at);
                }
                State::Slipping(direction) => {
                    self.forces[3 * at] = direction * contact.limit(direction, contact.sliding)
                }
            }
            self.rows.extend([3 * at + 1, 3 * at + 2]);
            let gap = line.at(arc).point_mm - contact.reference - self.offset(at);
            let local = self.frames[at].transpose() * gap;
            let first = if contact.state == State::Stuck { 0 } else { 1 };
            self.right.extend_from_slice(&local.as_slice()[first..]);
        }
        for (right, &row) in self.right.iter_mut().zip(&self.rows) {
            for (at, contact) in contacts.iter().enumerate() {
                if contact.state != State::Stuck {
                    *right -= self.turned[3 * at * n + row] * self.forces[3 * at];
                }
            }
        }
        self.system.start(self.rows.len());
        for (j, &column) in self.rows.iter().enumerate() {
            for (i, &row) in self.rows.iter().enumerate().skip(j) {
                *self.system.entry(i, j) = self.turned[column * n + row];
            }
        }
        if let Some(flexibility) = flexibility {
            self.yield_to(flexibility);
        }
        let dependent = self.system.factor();
        self.system.solve(&mut self.right);
        for (force, &row) in self.right.iter().zip(&self.rows) {
            self.forces[row] = *force;
        }
        dependent
    }

    /// Adds the needle's flexibility to the rows across the shaft, and what it gave way before to their right-hand sides.
    fn yield_to(&mut self, flexibility: &Mat<f64>) {
        let across = |row: usize| (row % 3 != 0).then(|| 2 * (row / 3) + row % 3 - 1);
        for (j, &column) in self.rows.iter().enumerate() {
            let Some(other) = across(column) else { continue };
            for (i, &row) in self.rows.iter().enumerate() {
                let Some(own) = across(row) else { continue };
                let entry = flexibility[(own, other)];
                if i >= j {
                    *self.system.entry(i, j) += entry;
                }
                self.right[i] += entry * self.before[column];
            }
        }
    }

    /// Force on the tissue at a contact of the needle, N, world axes.
    pub fn force(&self, contact: usize) -> Vector3<f64> {
        self.frames[contact] * Vector3::from_column_slice(&self.forces[3 * contact..3 * contact + 3])
    }

    /// Displacement of a contact of the needle, mm, world axes.
    pub fn displacement(&self, contact: usize) -> Vector3<f64> {
        let n = self.forces.len();
        let mut local = Vector3::zeros();
        for (column, force) in self.forces.iter().enumerate() {
            let at = column * n + 3 * contact;
            local += Vector3::from_column_slice(&self.turned[at..at + 3]) * *force;
        }
        self.frames[contact] * local + self.offset(contact)
    }

    /// Forces of the probe on the tissue along its rows, N.
    pub fn probe_forces<'a>(&'a self, needle: &'a [Vector3<f64>]) -> impl Iterator<Item = (&'a ProbeRow, f64)> + 'a {
        let p = self.probe_rows.len();
        self.probe_rows.iter().enumerate().map(move |(row, probe)| {
            let answers = (0..3 * needle.len()).map(|i| self.answer[i * p + row] * needle[i / 3][i % 3]);
            (probe, self.held[row] - answers.sum::<f64>())
        })
    }
}
