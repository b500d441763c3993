//! The needle with its pose and shape, and its response where forces act.

use nalgebra::{Isometry3, Matrix3, Point3};

use super::contacts::Contacts;
use super::joint::NeedleCompliance;
use super::tip::Tip;
use crate::needle::{CentreLine, Entry, Load, Needle, Row, ShaftPoint};

/// A needle and its centre line. Buffers are kept from step to step, to avoid allocation.
pub(super) struct PlacedNeedle {
    pub model: Box<dyn Needle>,
    /// Pose of the base: that of the hand, or behind it while bone stops the tip.
    pub base: Option<Isometry3<f64>>,
    pub line: CentreLine,
    pub entry: Option<Entry>,
    /// Guide hole, mm.
    pub guide: Option<Point3<f64>>,
    /// Linearised response where forces act.
    pub yielding: NeedleCompliance,
    loads: Vec<Load>,
    /// Loads about which the needle was linearised.
    about: Vec<Load>,
    rows: Vec<Row>,
}

impl PlacedNeedle {
    pub(super) fn new(model: Box<dyn Needle>) -> PlacedNeedle {
        PlacedNeedle {
            model,
            base: None,
            line: CentreLine::default(),
            entry: None,
            guide: None,
            yielding: NeedleCompliance::default(),
            loads: Vec::new(),
            about: Vec::new(),
            rows: Vec::new(),
        }
    }

    pub(crate) fn is_flexible(&self) -> bool {
        self.model.is_flexible()
    }

    pub(super) fn length_mm(&self) -> f64 {
        self.model.length_mm()
    }

    pub(super) fn radius_mm(&self) -> f64 {
        self.model.radius_mm()
    }

    /// Returns the end of the centre line.
    pub(super) fn tip(&self) -> ShaftPoint {
        self.line.point_at_arc(self.line.length_mm())
    }

    /// Returns the guide hole, if the needle is flexible.
    pub(super) fn guide(&self) -> Option<Point3<f64>> {
        self.guide.filter(|_| self.is_flexible())
    }

    /// Moves the needle to a base, in its bent shape.
    pub(crate) fn move_to(&mut self, base: &Isometry3<f64>) {
        match self.base.replace(*base) {
            Some(before) if self.is_flexible() => self.line.transform(&(base * before.inverse())),
            _ => self.model.place(base, self.entry.as_ref(), &[], &[], &mut self.line),
        }
    }

    /// Writes the current forces as loads.
    fn write_loads(&mut self, contacts: &Contacts, tip: &Tip) {
        self.loads.clear();
        let pairs = contacts.arcs.iter().zip(&contacts.forces);
        self.loads.extend(pairs.map(|(arc_mm, force)| Load {
            arc_mm: *arc_mm,
            force_n: -force,
        }));
        if tip.in_bone() && !tip.force.is_on_bone() {
            self.loads.push(Load {
                arc_mm: self.model.length_mm(),
                force_n: tip.bone_force(&self.line),
            });
        }
    }

    /// Takes one iteration of the needle's own solver towards the current forces, from the line about which it was
    /// linearised.
    pub(super) fn bend(&mut self, contacts: &Contacts, tip: &Tip) {
        self.write_loads(contacts, tip);
        let Some(base) = &self.base else { return };
        self.model
            .place(base, self.entry.as_ref(), &self.about, &self.loads, &mut self.line);
    }

    /// Writes the linearised response along and across the shaft, in the `frames` where forces act. Returns in how many
    /// modes the needle would buckle if unsupported, or `None` if it is rigid.
    pub(super) fn linearise(&mut self, contacts: &Contacts, tip: &Tip, frames: &[Matrix3<f64>]) -> Option<usize> {
        if !self.is_flexible() {
            return None;
        }
        self.write_loads(contacts, tip);
        std::mem::swap(&mut self.loads, &mut self.about);
        if contacts.arcs.is_empty() {
            return Some(0);
        }
        self.rows.clear();
        for (arc_mm, frame) in contacts.arcs.iter().zip(frames) {
            self.rows.extend([0, 1, 2].map(|axis| Row {
                arc_mm: *arc_mm,
                direction: frame.column(axis).into_owned(),
            }));
        }
        let NeedleCompliance { flexibility, drift } = &mut self.yielding;
        let count = self.rows.len();
        drift.resize(count, 0.0);
        flexibility.clear();
        flexibility.resize(count * count, 0.0);
        let modes = self
            .model
            .linearise(&self.line, &self.about, &self.rows, drift, flexibility);
        Some(modes)
    }
}
