//! Points of force application, and the response of tissue and needle.

use faer::Mat;
use nalgebra::{Point3, Vector3};

use super::joint::Yielding;
use super::{Finite, Memory};
use crate::mechanics::needle::{Load, Row};

impl Finite {
    /// Writes the arcs at which forces act: contacts, tip, guide.
    pub(super) fn write_arcs(&mut self) {
        let guide = self.guide().map(|guide| self.line.nearest(&guide));
        let arcs = &mut self.memory.arcs;
        arcs.clear();
        arcs.extend(self.contacts.iter().map(|contact| contact.arc));
        arcs.extend(self.tip.row.as_ref().map(|_| self.line.length_mm()));
        arcs.extend(guide);
        arcs.extend_from_slice(&self.fading);
    }

    /// Returns the guide hole, if the needle is flexible.
    fn guide(&self) -> Option<Point3<f64>> {
        self.guide.filter(|_| self.needle.is_flexible())
    }

    /// Writes the current forces as loads on the needle.
    fn write_loads(&mut self) {
        let loads = &mut self.memory.loads;
        loads.clear();
        let pairs = self.memory.arcs.iter().zip(&self.forces);
        loads.extend(pairs.map(|(arc_mm, force)| Load {
            arc_mm: *arc_mm,
            force_n: -force,
        }));
        if self.tip.in_bone() && !self.tip.is_pinned() {
            loads.push(Load {
                arc_mm: self.needle.length_mm(),
                force_n: self.tip.bone_force(&self.line),
            });
        }
    }

    /// Takes one iteration of the needle's own solver towards the current forces, from the line about which it was
    /// linearised.
    pub(super) fn bend(&mut self) {
        self.write_loads();
        let Some(base) = &self.tip.base else { return };
        let Memory { loads, about, .. } = &self.memory;
        self.needle
            .place(base, self.entry.as_ref(), about, loads, &mut self.line);
    }

    /// Writes the linearised response of the needle along and across the shaft wherever forces act. Returns in how many
    /// modes it would buckle if unsupported, or `None` if it is rigid.
    pub(super) fn linearise(&mut self) -> Option<usize> {
        if !self.needle.is_flexible() {
            return None;
        }
        self.write_loads();
        let memory = &mut self.memory;
        std::mem::swap(&mut memory.loads, &mut memory.about);
        if memory.arcs.is_empty() {
            return Some(0);
        }
        memory.rows.clear();
        for (arc_mm, frame) in memory.arcs.iter().zip(self.joint.frames()) {
            memory.rows.extend([0, 1, 2].map(|axis| Row {
                arc_mm: *arc_mm,
                direction: frame.column(axis).into_owned(),
            }));
        }
        let Yielding { flexibility, drift } = &mut self.yielding;
        let count = memory.rows.len();
        drift.resize(count, 0.0);
        if flexibility.nrows() == count {
            flexibility.fill(0.0);
        } else {
            *flexibility = Mat::zeros(count, count);
        }
        Some(
            self.needle
                .linearise(&self.line, &memory.about, &memory.rows, drift, flexibility),
        )
    }

    /// Updates the compliance at the contacts, if it has changed, and the tissue at the tip.
    pub(super) fn take_compliance(&mut self) {
        let (probes, rows) = match &self.press {
            None => (0, &[][..]),
            Some(press) => (press.nodes().len(), press.rows()),
        };
        let condensed = self.adaptation.remesher().condensed();
        if self.condensed != Some(self.version) {
            self.joint.tissue.condense(condensed, probes, self.contacts.len(), rows);
            self.condensed = Some(self.version);
        }
        let guide = self.guide();
        let fading = self.fading.len();
        self.joint.tissue.set_tip(condensed, probes, self.tip.row.as_ref());
        self.joint.set_others(guide, fading);
        self.joint
            .tissue
            .press(self.press.iter().flat_map(|press| press.displacements()));
        self.lay_forces();
    }

    /// Makes room for the forces at the tip and on the guide behind those at the contacts; existing ones are kept.
    fn lay_forces(&mut self) {
        let [had_tip, had_guide] = self.laid;
        let [has_tip, has_guide] = [self.tip.row.is_some(), self.guide().is_some()];
        let at = self.contacts.len();
        // The cutting force passes between the tip and the node that was made there.
        if has_tip && !had_tip {
            let cutting = self.cutting();
            let mut share = Vector3::zeros();
            if let Some(last) = self.forces[..at].last_mut() {
                let tangent = self.line.at(self.line.length_mm()).tangent;
                share = tangent.into_inner() * tangent.dot(last).clamp(0.0, cutting);
                *last -= share;
            }
            self.forces.insert(at, share);
        } else if had_tip && !has_tip {
            let force = self.forces.remove(at);
            if let Some(last) = self.forces[..at].last_mut() {
                *last += force;
            }
        }
        let at = at + usize::from(has_tip);
        if has_guide && !had_guide {
            self.forces.insert(at, Vector3::zeros());
        } else if had_guide && !has_guide {
            self.forces.remove(at);
        }
        self.laid = [has_tip, has_guide];
    }
}
