//! Coupled contact solve of tissue, probe and needle.
//!
//! With F the forces on the tissue and u its displacement under them and the probe (see [`Reduced`]), the needle yields
//! too: its line moves by d - C (F - F_before), with C its flexibility and d the remaining change of its shape under
//! the previous forces. Across the shaft a node lies on the line; along it, the node either keeps its place or is
//! pushed with the available friction:
//!
//! ```text
//! n . (X + u) = n . (x_line + d - C (F - F_before))
//! ```
//!
//! This is one symmetric system for the forces across the shaft and, of nodes that stick, along it. It is positive
//! definite unless forces along the needle would buckle it: then C is indefinite, and whether tissue supports the
//! needle is seen from the signs of the factors ([`Solved::signs`]). The force at the tip acts on the tissue there,
//! distributed among the corners of its element by the barycentric coordinates of the tip. While the tip sticks its
//! force is eliminated first, as the patch of tissue that it dents is not that of the mesh
//! ([`Reduced::set_tip`]). Which nodes stick follows from Coulomb's law with bounds known beforehand: a linear complementarity problem
//! with a positive definite matrix, hence with one solution. Nodes whose force exceeds a bound slip, and those that
//! would slip in the direction of their friction stick; if that does not settle, only the lowest such node changes at a
//! time, which must terminate (Murty, 1974).

use nalgebra::{Matrix3, Point3, Vector3};

use super::contact::Contact;
use super::reduced::{Reduced, TipRow};
use super::tissue::Tissue;
use crate::ldl::{Ldl, Signs};
use crate::needle::{CentreLine, across};

/// Maximum number of released loads.
pub(super) const MAX_RELEASED: usize = 4;
/// Rounds in which all nodes that violate Coulomb's law change at once.
const ROUNDS_AT_ONCE: usize = 4;

/// System of contact equations: the contacts of the needle, each with three degrees of freedom, then the tissue at the
/// tip, and last a guide that does not yield. The memory is kept.
#[derive(Debug, Default)]
pub(super) struct Joint {
    pub tissue: Reduced,
    /// Version of the compliance that `tissue` holds.
    version: Option<u64>,
    /// Guide hole of the needle, mm.
    guide: Option<Point3<f64>>,
    /// Number of loads of released nodes: the line still lies under them, the solution excludes them.
    released: usize,
    /// Compliance in the frames of the contacts.
    turned: Vec<f64>,
    frames: Vec<Matrix3<f64>>,
    system: Ldl,
    rows: Vec<usize>,
    right: Vec<f64>,
    /// Gap between line and tissue at a tip that sticks, less the displacement under known forces, mm.
    tip_gap: Option<f64>,
    /// Response of the unknown forces to that at the tip.
    tip_answer: Vec<f64>,
    /// Forces on the tissue in the frames of the contacts, N.
    forces: Vec<f64>,
    /// Forces about which the solution was linearised, N.
    before: Vec<f64>,
}

/// Linearised response of the needle along the three directions of each frame.
#[derive(Debug, Default)]
pub(super) struct NeedleCompliance {
    /// Response to additional forces, column by column, mm/N.
    pub flexibility: Vec<f64>,
    /// Displacement under unchanged forces, mm.
    pub drift: Vec<f64>,
}

impl NeedleCompliance {
    fn entry(&self, row: usize, column: usize) -> f64 {
        self.flexibility[column * self.drift.len() + row]
    }
}

/// Effort and outcome of a contact solve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Solved {
    /// Number of systems solved.
    pub rounds: usize,
    /// Whether Coulomb's law holds everywhere.
    pub settled: bool,
    /// Signs of the last system's factors. With as many negative ones as the tangent stiffness of the needle has,
    /// tissue supports it; with fewer it buckles.
    pub signs: Signs,
}

/// Returns the axes of a contact: along the shaft, and two across.
fn frame(tangent: &Vector3<f64>) -> Matrix3<f64> {
    let [first, second] = across(tangent);
    Matrix3::from_columns(&[*tangent, first, second])
}

impl Joint {
    /// Takes the compliance at the contacts, if it has changed, the tissue at the tip, the guide behind it, if any, and
    /// the number of released loads behind that.
    pub(crate) fn take_compliance(
        &mut self,
        tissue: &Tissue,
        contacts: usize,
        tip: Option<&TipRow>,
        guide: Option<Point3<f64>>,
        released: usize,
        tangent: &Vector3<f64>,
    ) {
        let (probes, rows) = match &tissue.probe {
            None => (0, &[][..]),
            Some(probe) => (probe.nodes().len(), probe.rows()),
        };
        let condensed = tissue.adaptation.remesher().condensed();
        if self.version != Some(tissue.version) {
            self.tissue.condense(condensed, probes, contacts, rows);
            self.version = Some(tissue.version);
        }
        self.tissue.set_tip(condensed, probes, tip, tangent);
        (self.guide, self.released) = (guide, released);
        self.tissue
            .set_probe(tissue.probe.iter().flat_map(|probe| probe.displacements()), &tissue.own);
    }

    /// Returns the number of blocks: contacts, the tissue at the tip, a guide, and released loads.
    pub(super) fn nodes(&self) -> usize {
        self.tissue.yielding() + usize::from(self.guide.is_some()) + self.released
    }

    /// Rotates everything into the directions of the shaft at these arcs (mm): contacts, tip, guide. `forces` are those
    /// on the tissue under which the line was bent.
    pub(super) fn turn(&mut self, arcs: &[f64], line: &CentreLine, forces: &[Vector3<f64>]) {
        self.frames.clear();
        self.frames
            .extend(arcs.iter().map(|arc| frame(&line.point_at_arc(*arc).tangent)));
        let n = 3 * self.frames.len();
        self.before.clear();
        for (frame, force) in self.frames.iter().zip(forces) {
            self.before.extend_from_slice((frame.transpose() * force).as_slice());
        }
        // In the frames, a state of stick or slip adds or removes one row instead of a combination of three.
        self.turned.clear();
        self.turned.resize(n * n, 0.0);
        for (j, right) in self.frames.iter().enumerate() {
            for (i, left) in self.frames.iter().enumerate() {
                let block = left.transpose() * self.tissue.block(i, j) * right;
                for b in 0..3 {
                    for a in 0..3 {
                        self.turned[(3 * j + b) * n + 3 * i + a] = block[(a, b)];
                    }
                }
            }
        }
    }

    /// Returns the axes of each contact: along the shaft, and two across.
    pub(super) fn frames(&self) -> &[Matrix3<f64>] {
        &self.frames
    }

    /// Solves for the forces with the line as it lies, sets the states, and returns the outcome. `starts` are the arcs
    /// (mm) at the beginning of this substep, where nodes that begin to stick are fixed; `yields` is the response of
    /// the needle in the three directions of each of the [frames](Self::frames).
    pub(super) fn solve(
        &mut self,
        contacts: &mut [Contact],
        mut tip: Option<&mut TipRow>,
        starts: &[f64],
        line: &CentreLine,
        yields: Option<&NeedleCompliance>,
    ) -> Solved {
        let mut solved = Solved::default();
        let max_rounds = 4 * contacts.len() + ROUNDS_AT_ONCE + 4;
        while solved.rounds < max_rounds {
            solved.rounds += 1;
            solved.signs = self.solve_once(contacts, tip.as_deref(), starts, line, yields);
            // All at once settles most problems in two rounds but may repeat itself; one at a time cannot.
            let at_once = solved.rounds <= ROUNDS_AT_ONCE;
            let mut changed = false;
            let sliders = contacts
                .iter_mut()
                .map(|contact| (contact.reference + contact.aside, &mut contact.slider));
            let tip_slider = tip.as_deref_mut().map(|tip| (tip.reference, &mut tip.slider));
            for (index, (reference, slider)) in sliders.chain(tip_slider).enumerate() {
                let position = line
                    .point_at_arc(starts.get(index).copied().unwrap_or(line.length_mm()))
                    .point_mm;
                let gap = reference + self.displacement(index) - position;
                let slip = self.frames[index].column(0).dot(&gap) + self.needle_displacement(3 * index, yields);
                if let Some(state) = slider.violated(self.forces[3 * index], slip) {
                    slider.state = state;
                    changed = true;
                    if !at_once {
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

    /// Returns how far the needle yields along a row, by the change of forces and by its drift under unchanged forces,
    /// mm.
    fn needle_displacement(&self, row: usize, yields: Option<&NeedleCompliance>) -> f64 {
        let Some(yields) = yields else { return 0.0 };
        let changes = self
            .forces
            .iter()
            .zip(&self.before)
            .map(|(force, before)| force - before);
        let products = changes
            .enumerate()
            .map(|(column, change)| yields.entry(row, column) * change);
        products.sum::<f64>() - yields.drift[row]
    }

    /// Writes the known forces, and for the unknown ones the rows and their right-hand sides: the gap between line and
    /// tissue.
    fn write_rows(&mut self, contacts: &[Contact], tip: Option<&TipRow>, starts: &[f64], line: &CentreLine) {
        self.forces.clear();
        self.forces.resize(3 * self.nodes(), 0.0);
        self.rows.clear();
        self.right.clear();
        self.tip_gap = None;
        for (index, contact) in contacts.iter().enumerate() {
            let stuck = contact.slider.is_stuck();
            let arc = if stuck { starts[index] } else { contact.arc };
            let gap = line.point_at_arc(arc).point_mm - contact.reference - contact.aside - self.tissue.offset(index);
            let local = self.frames[index].transpose() * gap;
            if stuck {
                self.rows.push(3 * index);
                self.right.push(local.x);
            }
            self.rows.extend([3 * index + 1, 3 * index + 2]);
            self.right.extend([local.y, local.z]);
            self.forces[3 * index] = contact.slider.force().unwrap_or_default();
        }
        if let Some(tip) = tip {
            let tip_index = contacts.len();
            if tip.slider.is_stuck() {
                let gap = line.tip() - tip.reference - self.tissue.offset(tip_index);
                let local = self.frames[tip_index].transpose() * gap;
                // Bone pins the tip; tissue does not constrain it across the shaft.
                if tip.is_bone {
                    self.rows.extend(3 * tip_index..3 * tip_index + 3);
                    self.right.extend(local.iter());
                } else {
                    self.tip_gap = Some(local.x);
                }
            }
            self.forces[3 * tip_index] = tip.slider.force().unwrap_or_default();
        }
        if let Some(guide) = self.guide {
            let guide_index = self.tissue.yielding();
            let gap = line.point_at_arc(line.nearest(&guide)).point_mm - guide;
            let local = self.frames[guide_index].transpose() * gap;
            self.rows.extend([3 * guide_index + 1, 3 * guide_index + 2]);
            self.right.extend([local.y, local.z]);
        }
    }

    fn solve_once(
        &mut self,
        contacts: &[Contact],
        tip: Option<&TipRow>,
        starts: &[f64],
        line: &CentreLine,
        yields: Option<&NeedleCompliance>,
    ) -> Signs {
        self.write_rows(contacts, tip, starts, line);
        let n = self.forces.len();
        let tip_row = 3 * contacts.len();
        for component in (0..n).filter(|component| self.forces[*component] != 0.0) {
            let force = self.forces[component];
            let column = &self.turned[component * n..(component + 1) * n];
            if let Some(gap) = &mut self.tip_gap {
                *gap -= column[tip_row] * force;
            }
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
        for (j, row) in self.rows.iter().enumerate() {
            if let Some(contact) = contacts.get(row / 3).filter(|_| row % 3 > 0) {
                *self.system.entry(j, j) += contact.softness_mm_per_n;
            }
        }
        if let Some(yields) = yields {
            for (j, &column) in self.rows.iter().enumerate() {
                for (i, &row) in self.rows.iter().enumerate().skip(j) {
                    *self.system.entry(i, j) += yields.entry(row, column);
                }
                // Unknown forces are still zero: known forces have changed, and the previous ones are removed.
                self.right[j] -= self.needle_displacement(column, Some(yields));
            }
        }
        let mut signs = self.system.factor();
        self.system.solve(&mut self.right);
        if let Some(gap) = self.tip_gap {
            let drift = self.needle_displacement(tip_row, yields);
            signs.negative += usize::from(self.solve_tip(tip_row, gap - drift, yields) < 0.0);
        }
        for (force, &row) in self.right.iter().zip(&self.rows) {
            self.forces[row] = *force;
        }
        signs
    }

    /// Solves for the force at a tip that sticks, and adds the answers of the unknown forces to it. Returns how far the
    /// tip yields to its force, mm/N.
    fn solve_tip(&mut self, tip_row: usize, gap: f64, yields: Option<&NeedleCompliance>) -> f64 {
        let n = self.forces.len();
        let entry = |row: usize, column: usize| {
            self.turned[column * n + row] + yields.map_or(0.0, |yields| yields.entry(row, column))
        };
        self.tip_answer.clear();
        self.tip_answer.extend(self.rows.iter().map(|row| entry(*row, tip_row)));
        self.system.solve(&mut self.tip_answer);
        let product = |forces: &[f64]| {
            let pairs = self.rows.iter().zip(forces);
            pairs
                .map(|(column, force)| entry(tip_row, *column) * force)
                .sum::<f64>()
        };
        let yielding = entry(tip_row, tip_row) - product(&self.tip_answer);
        let force = (gap - product(&self.right)) / yielding;
        let answers = self.right.iter_mut().zip(&self.tip_answer);
        answers.for_each(|(right, answer)| *right -= answer * force);
        self.forces[tip_row] = force;
        yielding
    }

    /// Returns the force on the tissue at a contact of the needle, or, behind them, at the tip or on the guide, N,
    /// world axes.
    pub(super) fn force(&self, node: usize) -> Vector3<f64> {
        self.frames[node] * Vector3::from_column_slice(&self.forces[3 * node..3 * node + 3])
    }

    /// Returns the displacement of a contact or of the tissue at the tip, mm, world axes.
    pub(super) fn displacement(&self, node: usize) -> Vector3<f64> {
        let n = self.forces.len();
        let mut local = Vector3::zeros();
        for (column, force) in self.forces.iter().enumerate() {
            let entry = column * n + 3 * node;
            local += Vector3::from_column_slice(&self.turned[entry..entry + 3]) * *force;
        }
        self.frames[node] * local + self.tissue.offset(node)
    }
}
