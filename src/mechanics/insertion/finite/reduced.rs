//! Reduced tissue compliance at the needle's contacts and at the tip, with the probe eliminated.
//!
//! With F the forces on the tissue at the needle's contacts and g the displacements that the probe prescribes along its
//! rows P,
//!
//! ```text
//! u = (K_nn - K_nP K_PP^-1 K_Pn) F + K_nP K_PP^-1 g
//! ```
//!
//! is computed once for every compliance at the contacts and every placement of the probe's rows.

use faer::MatRef;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::contact::Slider;
use crate::ldl::Ldl;
use insonify_base::simd::{Kernel, vectorised};

/// Maximum dent of the mesh by the force at the tip, as a share of that of the patch: a node of the mesh at the tip must
/// not yield as much, or forces on both would be undetermined.
const MAX_SHARE: f64 = 0.9;

/// A displacement prescribed by the probe: contact and direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ProbeRow {
    /// Index among the contacts of the compliance.
    pub contact: usize,
    pub direction: Vector3<f64>,
}

/// The tissue at the tip: the nodes that share its force, its undeformed position, and the state of its force.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TipRow {
    /// Indices of nodes of the compliance, with their shares; all 0 for bone.
    pub shares: [(usize, f64); 4],
    /// Compliance of bone, or of the patch of tissue at the tip, mm/N.
    pub compliance_mm_per_n: f64,
    /// Whether the tip is on bone, which pins it.
    pub is_bone: bool,
    /// Whether the tip is at the unbroken skin: no part of the needle is in the tissue then, and only the force at the
    /// tip dents it.
    #[serde(default)]
    pub is_alone: bool,
    /// Position in the reference state, and the offset of the dent there, mm.
    pub reference: nalgebra::Point3<f64>,
    pub slider: Slider,
}

/// Compliance at the contacts of the needle and, behind them, at the tip. The memory is kept.
#[derive(Debug, Default)]
pub(super) struct Reduced {
    rows: Vec<ProbeRow>,
    probe: Ldl,
    /// K_Pn: for each row of the probe, all degrees of freedom with room.
    coupling: Vec<f64>,
    /// K_PP^-1 K_Pn, in the layout of `coupling`.
    answer: Vec<f64>,
    /// K_PP^-1 g.
    multipliers: Vec<f64>,
    /// K_nn - K_nP K_PP^-1 K_Pn, column by column.
    compliance: Vec<f64>,
    /// K_nP K_PP^-1 g, and the tissue's own motion.
    offset: Vec<f64>,
    contacts: usize,
    has_tip: bool,
    /// Share of the force at the tip that loads the mesh.
    tip_share: f64,
    /// Buffer for a few columns of K_Pn.
    block: Vec<f64>,
}

impl Reduced {
    /// Takes the compliance at the contacts (`probes` of the probe first, then `contacts` of the needle, then others
    /// that form the tissue at the tip), and eliminates the probe.
    pub(crate) fn condense(&mut self, condensed: MatRef<'_, f64>, probes: usize, contacts: usize, rows: &[ProbeRow]) {
        self.rows.clear();
        self.rows.extend_from_slice(rows);
        // K_PP is factored once for all displacements that the probe prescribes along these rows.
        self.probe.start(rows.len());
        for (j, column) in rows.iter().enumerate() {
            for (i, row) in rows.iter().enumerate().skip(j) {
                let block = Matrix3::from_fn(|a, b| condensed[(3 * row.contact + a, 3 * column.contact + b)]);
                *self.probe.entry(i, j) = row.direction.dot(&(block * column.direction));
            }
        }
        self.probe.factor();
        (self.contacts, self.has_tip) = (contacts, false);
        let (p, room) = (rows.len(), self.room());
        self.coupling.clear();
        self.coupling.resize(p * room, 0.0);
        self.answer.clear();
        self.answer.resize(p * room, 0.0);
        self.compliance.resize(room * room, 0.0);
        let first_column = 3 * probes;
        for column in 0..3 * contacts {
            for (row, coupling) in rows.iter().zip(self.coupling.chunks_exact_mut(room)) {
                let entries = (0..3).map(|axis| condensed[(3 * row.contact + axis, first_column + column)]);
                coupling[column] = entries.zip(row.direction.iter()).map(|(k, d)| k * d).sum();
            }
            for row in 0..=column {
                self.compliance[column * room + row] = condensed[(first_column + row, first_column + column)];
            }
        }
        self.eliminate(0, 3 * contacts);
    }

    /// Places the tissue at the tip behind the contacts, or removes it. The compliance is that of the last
    /// [`condense`](Self::condense).
    ///
    /// The tip is dented as a patch is: its own compliance does not depend on the mesh. The mesh is loaded by the share
    /// of the force that moves it as far there, so that columns and rows of the tip differ by that share.
    pub(crate) fn set_tip(
        &mut self,
        condensed: MatRef<'_, f64>,
        probes: usize,
        tip: Option<&TipRow>,
        tangent: &Vector3<f64>,
    ) {
        self.clear_rest();
        (self.has_tip, self.tip_share) = (tip.is_some(), 1.0);
        let Some(tip) = tip else { return };
        // The tip is no node: its displacement is the mean of the nodes around it by their shares, and a force on it is
        // divided among them by the same, so that the compliance stays symmetric.
        let (room, tip_start) = (self.room(), 3 * self.contacts);
        let shares = || tip.shares.iter().filter(|(_, share)| *share != 0.0);
        for axis in 0..3 {
            let column = tip_start + axis;
            for (row, coupling) in self.rows.iter().zip(self.coupling.chunks_exact_mut(room)) {
                let coupling_of = |node: usize| {
                    let products = (0..3).map(|a| row.direction[a] * condensed[(3 * row.contact + a, 3 * node + axis)]);
                    products.sum::<f64>()
                };
                coupling[column] = shares().map(|(node, share)| share * coupling_of(*node)).sum();
            }
            let (of_contacts, of_tip) = self.compliance[column * room..].split_at_mut(tip_start);
            for (row, entry) in of_contacts.iter_mut().enumerate() {
                let compliance_of = |node: usize| condensed[(3 * probes + row, 3 * node + axis)];
                *entry = shares().map(|(node, share)| share * compliance_of(*node)).sum();
            }
            for (row_axis, entry) in of_tip[..=axis].iter_mut().enumerate() {
                let pairs = shares().flat_map(|row_share| shares().map(move |column_share| (row_share, column_share)));
                *entry = pairs
                    .map(|((i, a), (j, b))| a * b * condensed[(3 * i + row_axis, 3 * j + axis)])
                    .sum();
            }
        }
        self.eliminate(tip_start, tip_start + 3);
        let of_mesh = tangent.dot(&(self.block(self.contacts, self.contacts) * tangent));
        if of_mesh > 0.0 {
            self.tip_share = (MAX_SHARE * tip.compliance_mm_per_n / of_mesh).min(1.0);
        }
        for column in tip_start..tip_start + 3 {
            let column_entries = &mut self.compliance[column * room..column * room + tip_start + 3];
            column_entries[..tip_start]
                .iter_mut()
                .for_each(|entry| *entry *= self.tip_share);
            column_entries[tip_start..].fill(0.0);
            column_entries[column] = tip.compliance_mm_per_n;
        }
        if tip.is_alone {
            let columns = self.compliance.chunks_exact_mut(room).take(tip_start);
            columns.for_each(|column| column[tip_start..tip_start + 3].fill(0.0));
        }
    }

    /// Returns the share of the force at the tip that loads the mesh.
    pub(super) fn tip_share(&self) -> f64 {
        self.tip_share
    }

    /// Clears everything behind the contacts.
    fn clear_rest(&mut self) {
        let (n, room) = (3 * self.contacts, self.room());
        for rows in [&mut self.coupling, &mut self.answer] {
            rows.chunks_exact_mut(room).for_each(|row| row[n..].fill(0.0));
        }
        for column in 0..room {
            let first_row = if column < n { n } else { 0 };
            self.compliance[column * room + first_row..(column + 1) * room].fill(0.0);
        }
    }

    /// Subtracts the probe's constraint from these columns, and copies them to their rows.
    fn eliminate(&mut self, first: usize, end: usize) {
        if first == end {
            return;
        }
        let room = self.room();
        self.block.clear();
        for coupling in self.coupling.chunks_exact(room) {
            self.block.extend_from_slice(&coupling[first..end]);
        }
        self.probe.solve_rows(&mut self.block, end - first);
        let blocks = self.block.chunks_exact(end - first);
        for (answer, block) in self.answer.chunks_exact_mut(room).zip(blocks) {
            answer[first..end].copy_from_slice(block);
        }
        vectorised(Subtract {
            room,
            columns: first..end,
            coupling: &self.coupling,
            answer: &self.answer,
            compliance: &mut self.compliance,
        });
        // `Subtract` computes above the diagonal only.
        for column in first..end {
            for row in 0..column {
                self.compliance[row * room + column] = self.compliance[column * room + row];
            }
        }
    }

    /// Returns the degrees of freedom with room: those behind the tip do not yield.
    fn room(&self) -> usize {
        3 * (self.contacts + 2 + super::joint::MAX_RELEASED)
    }

    /// Returns the number of contacts, plus one for the tissue at the tip.
    pub(crate) fn yielding(&self) -> usize {
        self.contacts + usize::from(self.has_tip)
    }

    /// Returns the compliance between two nodes, mm/N, world axes.
    pub(super) fn block(&self, row: usize, column: usize) -> Matrix3<f64> {
        let room = self.room();
        Matrix3::from_fn(|a, b| self.compliance[(3 * column + b) * room + 3 * row + a])
    }

    /// Sets the displacements that the probe prescribes along its rows, beside the tissue's own motion, and those by that
    /// motion at the contacts and at the tip, mm.
    pub(crate) fn set_probe(&mut self, displacements: impl Iterator<Item = f64>, own: &[Vector3<f64>]) {
        let room = self.room();
        self.multipliers.clear();
        self.multipliers.extend(displacements);
        self.offset.clear();
        self.offset.resize(room, 0.0);
        for (answer, multipliers) in self.answer.chunks_exact(room).zip(&self.multipliers) {
            self.offset
                .iter_mut()
                .zip(answer)
                .for_each(|(sum, a)| *sum += a * multipliers);
        }
        self.probe.solve(&mut self.multipliers);
        let axes = own.iter().flat_map(|own| own.iter());
        self.offset
            .iter_mut()
            .zip(axes)
            .for_each(|(offset, own)| *offset += own);
    }

    /// Returns the displacement of a node by the probe and by its own motion, mm.
    pub(super) fn offset(&self, node: usize) -> Vector3<f64> {
        Vector3::from_column_slice(&self.offset[3 * node..3 * node + 3])
    }

    /// Returns the forces of the probe on the tissue along its rows, N, given those of the needle at its contacts and
    /// at the tip.
    pub(crate) fn probe_forces<'a>(
        &'a self,
        needle: &'a [Vector3<f64>],
    ) -> impl Iterator<Item = (&'a ProbeRow, f64)> + 'a {
        let rows = self
            .rows
            .iter()
            .zip(self.answer.chunks_exact(self.room()))
            .zip(&self.multipliers);
        rows.map(|((row, answer), multipliers)| {
            let answers = needle.iter().zip(answer.as_chunks::<3>().0);
            let answers = answers.map(|(force, [x, y, z])| x * force.x + y * force.y + z * force.z);
            (row, multipliers - answers.sum::<f64>())
        })
    }
}

/// `K_nn -= K_nP (K_PP^-1 K_Pn)` above the diagonal of some columns.
struct Subtract<'a> {
    room: usize,
    columns: std::ops::Range<usize>,
    coupling: &'a [f64],
    answer: &'a [f64],
    compliance: &'a mut [f64],
}

impl Kernel for Subtract<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let room = self.room;
        for column in self.columns {
            let entries = &mut self.compliance[column * room..column * room + column + 1];
            for (coupling, answer) in self.coupling.chunks_exact(room).zip(self.answer.chunks_exact(room)) {
                let factor = answer[column];
                entries
                    .iter_mut()
                    .zip(coupling)
                    .for_each(|(entry, k)| *entry -= factor * k);
            }
        }
    }
}
