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
//! its line moves by d - C (F - F_before), C its flexibility and d what the forces before still make of its shape. A node across the shaft lies on the line, and along it either holds its
//! place or is pushed with the friction there is:
//!
//! ```text
//! n . (X + u) = n . (x_line + d - C (F - F_before))
//! ```
//!
//! one symmetric system for the forces across and, of nodes that stick, along. It is positive definite unless forces along the needle
//! would buckle it: then C is not, and what holds the needle is told from the signs of the factors (see [`Solved::signs`]). What the tip cuts acts on the tissue at
//! the tip: shared among the corners of its element by the tip's coordinates there, a node of its own with one force. Which
//! nodes stick follows from Coulomb's law with bounds that are known beforehand: a linear complementarity problem of a positive
//! definite matrix, hence with one solution. Nodes whose force passes a bound slip, and those that would slip along with their
//! friction stick; if that does not settle, only the lowest such node changes at a time, which must end (Murty, 1974).

use faer::{Mat, MatRef};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::contact::Contact;
use super::slider::Slider;
use crate::mechanics::ldl::{Ldl, Signs};
use crate::mechanics::needle::{CentreLine, across};

/// A displacement that the probe prescribes: of which contact, along which direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ProbeRow {
    /// Among the contacts of the compliance.
    pub contact: usize,
    pub direction: Vector3<f64>,
}

/// Loads that fade at most.
pub(super) const MOST_FADING: usize = 4;
/// Rounds in which all nodes that break Coulomb's law change at once.
const ROUNDS_AT_ONCE: usize = 4;

/// The tissue at the tip: what it is made of, where it was before deformation, and what it does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TipRow {
    /// Nodes of the compliance, and their shares.
    pub shares: [(usize, f64); 4],
    /// In the reference state, mm.
    pub reference: Point3<f64>,
    pub slider: Slider,
}

/// The contacts as a system of equations: the needle's, each with three degrees of freedom, behind them the tissue at the tip, and
/// last a guide that does not yield. The memory is kept.
#[derive(Debug, Default)]
pub(super) struct Joint {
    probe_rows: Vec<ProbeRow>,
    probe: Ldl,
    /// K_Pn, a column of rows P for each degree of freedom.
    coupling: Vec<f64>,
    /// K_PP^-1 K_Pn, likewise.
    answer: Vec<f64>,
    /// K_PP^-1 g.
    held: Vec<f64>,
    /// K_nn - K_nP K_PP^-1 K_Pn, column by column.
    compliance: Vec<f64>,
    /// K_nP K_PP^-1 g.
    offset: Vec<f64>,
    /// Contacts of the needle before the tissue at the tip.
    contacts: usize,
    has_tip: bool,
    /// A hole that the needle runs through, mm.
    guide: Option<Point3<f64>>,
    /// Loads of nodes that have come off: the line still lies under them, the solution does without.
    fading: usize,
    /// The compliance in the frames of the contacts.
    turned: Vec<f64>,
    frames: Vec<Matrix3<f64>>,
    system: Ldl,
    rows: Vec<usize>,
    right: Vec<f64>,
    /// Forces on the tissue in the frames of the contacts, N.
    forces: Vec<f64>,
    /// What a solution was linearised about.
    before: Vec<f64>,
}

/// How the needle yields along the three directions of each frame.
#[derive(Debug)]
pub(super) struct Yielding {
    /// To further forces, mm/N.
    pub flexibility: Mat<f64>,
    /// If no force changes, mm.
    pub drift: Vec<f64>,
}

/// What a solution took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Solved {
    /// Systems solved.
    pub rounds: usize,
    /// Whether Coulomb's law holds everywhere.
    pub settled: bool,
    /// Of the last system. With as many negative ones as the tangent stiffness of the needle has, tissue holds it; with fewer it
    /// buckles.
    pub signs: Signs,
}

/// Axes of a contact: along the shaft, and two across.
fn frame(tangent: &Vector3<f64>) -> Matrix3<f64> {
    let [first, second] = across(tangent);
    Matrix3::from_columns(&[*tangent, first, second])
}

/// The nodes of the compliance at the contacts that a degree of freedom of the system stands for, with their shares.
struct Members<'a> {
    condensed: MatRef<'a, f64>,
    probes: usize,
    contacts: usize,
    tip: Option<&'a TipRow>,
}

impl Members<'_> {
    /// Those of a node of the system.
    fn of(&self, node: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let contact = (node < self.contacts).then_some((self.probes + node, 1.0));
        let tip = self.tip.filter(|_| node == self.contacts);
        let shares = tip
            .into_iter()
            .flat_map(|tip| tip.shares)
            .filter(|(_, share)| *share != 0.0);
        contact.into_iter().chain(shares)
    }

    fn entry(&self, row: usize, column: usize) -> f64 {
        let pairs = self
            .of(row / 3)
            .flat_map(|row| self.of(column / 3).map(move |column| (row, column)));
        let entry = |((i, a), (j, b)): ((usize, f64), (usize, f64))| {
            a * b * self.condensed[(3 * i + row % 3, 3 * j + column % 3)]
        };
        pairs.map(entry).sum()
    }

    fn along(&self, row: &ProbeRow, column: usize) -> f64 {
        let entry = |(node, share): (usize, f64)| {
            let axes = (0..3)
                .map(|axis| row.direction[axis] * self.condensed[(3 * row.contact + axis, 3 * node + column % 3)]);
            share * axes.sum::<f64>()
        };
        self.of(column / 3).map(entry).sum()
    }
}

impl Joint {
    /// Takes the compliance at the contacts (`probes` of the probe first, then `contacts` of the needle, then others that the tissue
    /// at the tip is made of), and eliminates the probe.
    pub fn condense(&mut self, condensed: MatRef<'_, f64>, probes: usize, contacts: usize, rows: &[ProbeRow]) {
        self.probe_rows.clear();
        self.probe_rows.extend_from_slice(rows);
        self.probe.start(rows.len());
        for (j, column) in rows.iter().enumerate() {
            for (i, row) in rows.iter().enumerate().skip(j) {
                let block = |a: usize, b: usize| condensed[(3 * row.contact + a, 3 * column.contact + b)];
                let terms = (0..3).flat_map(|a| (0..3).map(move |b| (a, b)));
                *self.probe.entry(i, j) = terms
                    .map(|(a, b)| row.direction[a] * block(a, b) * column.direction[b])
                    .sum();
            }
        }
        self.probe.factor();
        (self.contacts, self.has_tip) = (contacts, false);
        let (p, room) = (rows.len(), self.room());
        self.coupling.resize(room * p, 0.0);
        self.answer.resize(room * p, 0.0);
        self.compliance.resize(room * room, 0.0);
        let members = Members {
            condensed,
            probes,
            contacts,
            tip: None,
        };
        (0..3 * contacts).for_each(|column| self.fill(&members, column));
    }

    /// Puts the tissue at the tip behind the contacts, and a guide behind that, or takes them away. The compliance is that of the
    /// last [`condense`](Self::condense).
    pub fn set_tip(
        &mut self,
        condensed: MatRef<'_, f64>,
        probes: usize,
        tip: Option<&TipRow>,
        guide: Option<Point3<f64>>,
        fading: usize,
    ) {
        (self.has_tip, self.guide, self.fading) = (tip.is_some(), guide, fading);
        self.clear_rest();
        let members = Members {
            condensed,
            probes,
            contacts: self.contacts,
            tip,
        };
        (3 * self.contacts..3 * self.yielding()).for_each(|column| self.fill(&members, column));
    }

    /// Nothing behind the contacts yields.
    fn clear_rest(&mut self) {
        let (n, p, room) = (3 * self.contacts, self.probe_rows.len(), self.room());
        self.coupling[n * p..].fill(0.0);
        self.answer[n * p..].fill(0.0);
        for column in 0..room {
            let from = if column < n { n } else { 0 };
            self.compliance[column * room + from..(column + 1) * room].fill(0.0);
        }
    }

    /// Computes a column, and its row, up to the diagonal.
    fn fill(&mut self, members: &Members<'_>, column: usize) {
        let (p, room) = (self.probe_rows.len(), self.room());
        let own = column * p..(column + 1) * p;
        for (row, at) in self.probe_rows.iter().zip(own.clone()) {
            self.coupling[at] = members.along(row, column);
        }
        self.answer[own.clone()].copy_from_slice(&self.coupling[own.clone()]);
        self.probe.solve(&mut self.answer[own.clone()]);
        for row in 0..=column {
            let pairs = self.coupling[row * p..(row + 1) * p]
                .iter()
                .zip(&self.answer[own.clone()]);
            let entry = members.entry(row, column) - pairs.map(|(a, b)| a * b).sum::<f64>();
            self.compliance[column * room + row] = entry;
            self.compliance[row * room + column] = entry;
        }
    }

    /// Rows that there is room for.
    fn room(&self) -> usize {
        3 * (self.contacts + 2 + MOST_FADING)
    }

    /// Contacts, and the tissue at the tip.
    fn yielding(&self) -> usize {
        self.contacts + usize::from(self.has_tip)
    }

    /// These, a guide, and loads that fade.
    pub fn nodes(&self) -> usize {
        self.yielding() + usize::from(self.guide.is_some()) + self.fading
    }

    /// What the probe prescribes along its rows, mm.
    pub fn press(&mut self, displacements: impl Iterator<Item = f64>) {
        self.held.clear();
        self.held.extend(displacements);
        self.offset.clear();
        let p = self.held.len();
        self.offset.extend((0..3 * self.nodes()).map(|i| {
            let answer = &self.answer[i * p..(i + 1) * p];
            answer.iter().zip(&self.held).map(|(a, g)| a * g).sum::<f64>()
        }));
        self.probe.solve(&mut self.held);
    }

    fn offset(&self, node: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.offset[3 * node..3 * node + 3])
    }

    /// Turns everything into the directions of the shaft at these arcs (mm): contacts, tip, guide. `forces` are those on the tissue
    /// that the line was bent by.
    pub fn turn(&mut self, arcs: &[f64], line: &CentreLine, forces: &[Vector3<f64>]) {
        self.frames.clear();
        self.frames.extend(arcs.iter().map(|arc| frame(&line.at(*arc).tangent)));
        let (n, room) = (3 * self.frames.len(), self.room());
        self.before.clear();
        for (frame, force) in self.frames.iter().zip(forces) {
            self.before.extend_from_slice((frame.transpose() * force).as_slice());
        }
        self.turned.clear();
        self.turned.resize(n * n, 0.0);
        for (j, right) in self.frames.iter().enumerate() {
            for (i, left) in self.frames.iter().enumerate() {
                let block = Matrix3::from_fn(|a, b| self.compliance[(3 * j + b) * room + 3 * i + a]);
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
    /// beginning of this part of the step, where nodes that begin to stick are held; `yields` is the needle's for the three directions
    /// of each of the [frames](Self::frames).
    pub fn solve(
        &mut self,
        contacts: &mut [Contact],
        mut tip: Option<&mut TipRow>,
        starts: &[f64],
        line: &CentreLine,
        yields: Option<&Yielding>,
    ) -> Solved {
        let mut solved = Solved::default();
        let most = 4 * contacts.len() + ROUNDS_AT_ONCE + 4;
        while solved.rounds < most {
            solved.rounds += 1;
            solved.signs = self.solve_once(contacts, tip.as_deref(), starts, line, yields);
            let all = solved.rounds <= ROUNDS_AT_ONCE;
            let mut changed = false;
            let sliders = contacts
                .iter_mut()
                .map(|contact| (contact.reference, &mut contact.slider));
            let last = tip.as_deref_mut().map(|tip| (tip.reference, &mut tip.slider));
            for (at, (reference, slider)) in sliders.chain(last).enumerate() {
                let place = line.at(starts.get(at).copied().unwrap_or(line.length_mm())).point_mm;
                let gap = reference + self.displacement(at) - place;
                let slip = self.frames[at].column(0).dot(&gap) + self.gives(3 * at, yields);
                if let Some(state) = slider.breaks(self.forces[3 * at], slip) {
                    slider.state = state;
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

    /// How far the needle gives way along a row by what the forces have changed and by what they still make of it, mm.
    fn gives(&self, row: usize, yields: Option<&Yielding>) -> f64 {
        let Some(yields) = yields else { return 0.0 };
        let changes = self
            .forces
            .iter()
            .zip(&self.before)
            .map(|(force, before)| force - before);
        let given = changes
            .enumerate()
            .map(|(column, change)| yields.flexibility[(row, column)] * change);
        given.sum::<f64>() - yields.drift[row]
    }

    /// Writes the known forces, and the rows of the unknown ones with how far the line is from where they would have it.
    fn write_rows(&mut self, contacts: &[Contact], tip: Option<&TipRow>, starts: &[f64], line: &CentreLine) {
        self.forces.clear();
        self.forces.resize(3 * self.nodes(), 0.0);
        self.rows.clear();
        self.right.clear();
        for (at, contact) in contacts.iter().enumerate() {
            let stuck = contact.slider.is_stuck();
            let arc = if stuck { starts[at] } else { contact.arc };
            let gap = line.at(arc).point_mm - contact.reference - self.offset(at);
            let local = self.frames[at].transpose() * gap;
            if stuck {
                self.rows.push(3 * at);
                self.right.push(local.x);
            }
            self.rows.extend([3 * at + 1, 3 * at + 2]);
            self.right.extend([local.y, local.z]);
            self.forces[3 * at] = contact.slider.force().unwrap_or_default();
        }
        if let Some(tip) = tip {
            let at = contacts.len();
            if tip.slider.is_stuck() {
                let gap = line.tip() - tip.reference - self.offset(at);
                self.rows.push(3 * at);
                self.right.push(self.frames[at].column(0).dot(&gap));
            }
            self.forces[3 * at] = tip.slider.force().unwrap_or_default();
        }
        if let Some(guide) = self.guide {
            let at = self.yielding();
            let gap = line.at(line.nearest(&guide)).point_mm - guide;
            let local = self.frames[at].transpose() * gap;
            self.rows.extend([3 * at + 1, 3 * at + 2]);
            self.right.extend([local.y, local.z]);
        }
    }

    fn solve_once(
        &mut self,
        contacts: &[Contact],
        tip: Option<&TipRow>,
        starts: &[f64],
        line: &CentreLine,
        yields: Option<&Yielding>,
    ) -> Signs {
        self.write_rows(contacts, tip, starts, line);
        let n = self.forces.len();
        for at in (0..n).filter(|at| self.forces[*at] != 0.0) {
            let force = self.forces[at];
            let column = &self.turned[at * n..(at + 1) * n];
            self.right
                .iter_mut()
                .zip(&self.rows)
                .for_each(|(right, row)| *right -= column[*row] * force);
        }
        self.system.start(self.rows.len());
        for (j, &column) in self.rows.iter().enumerate() {
            for (i, &row) in self.rows.iter().enumerate().skip(j) {
                *self.system.entry(i, j) = self.turned[column * n + row];
            }
        }
        if let Some(yields) = yields {
            for (j, &column) in self.rows.iter().enumerate() {
                for (i, &row) in self.rows.iter().enumerate().skip(j) {
                    *self.system.entry(i, j) += yields.flexibility[(row, column)];
                }
                // Unknown forces are zero so far: what is known has changed, and what was there before is gone.
                self.right[j] -= self.gives(column, Some(yields));
            }
        }
        let signs = self.system.factor();
        self.system.solve(&mut self.right);
        for (force, &row) in self.right.iter().zip(&self.rows) {
            self.forces[row] = *force;
        }
        signs
    }

    /// Force on the tissue at a contact of the needle, or, behind them, at the tip or on the guide, N, world axes.
    pub fn force(&self, node: usize) -> Vector3<f64> {
        self.frames[node] * Vector3::from_column_slice(&self.forces[3 * node..3 * node + 3])
    }

    /// Displacement there, mm, world axes.
    pub fn displacement(&self, node: usize) -> Vector3<f64> {
        let n = self.forces.len();
        let mut local = Vector3::zeros();
        for (column, force) in self.forces.iter().enumerate() {
            let at = column * n + 3 * node;
            local += Vector3::from_column_slice(&self.turned[at..at + 3]) * *force;
        }
        self.frames[node] * local + self.offset(node)
    }

    /// Forces of the probe on the tissue along its rows, N, with those of the needle at its contacts and at the tip.
    pub fn probe_forces<'a>(&'a self, needle: &'a [Vector3<f64>]) -> impl Iterator<Item = (&'a ProbeRow, f64)> + 'a {
        let p = self.probe_rows.len();
        self.probe_rows.iter().enumerate().map(move |(row, probe)| {
            let answers = (0..3 * needle.len()).map(|i| self.answer[i * p + row] * needle[i / 3][i % 3]);
            (probe, self.held[row] - answers.sum::<f64>())
        })
    }
}
