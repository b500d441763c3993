//! Outcome of a step.

use nalgebra::{Isometry3, Point3};

use super::Nonlinear;
use crate::mechanics::insertion::pushing::Phase;
use crate::mechanics::insertion::{Event, EventKind, Instruments, Wrench};

impl Nonlinear {
    /// Places the needle at the pose of the hand.
    pub(super) fn place(&mut self, base: &Isometry3<f64>) {
        let length = self.shaft.length_mm;
        let tip = base * Point3::new(0.0, 0.0, length);
        self.line.set([(0.0, base.translation.vector.into()), (length, tip)]);
    }

    /// Sets the wrench on the hand from a force against the direction of insertion, N.
    pub(super) fn feel(&mut self, force_n: f64) {
        let mut on_hand = Wrench::default();
        let (hub, tip) = (self.line.at(0.0), self.line.tip());
        on_hand.add(-force_n * hub.tangent.into_inner(), &tip, &hub.point_mm);
        self.outcome.on_hand = on_hand;
    }

    pub(super) fn note(&mut self, kind: EventKind, region: Option<i32>) {
        self.outcome.events.push(Event {
            kind,
            time_s: self.time_s,
            at_mm: self.line.tip(),
            region,
        });
    }

    /// Fills in the results known at the end of a step.
    pub(super) fn conclude(&mut self, instruments: &Instruments, was_crushed: bool) {
        let tip = self.line.tip();
        let depth = self.needle.depth_mm();
        let inside = self.way.as_ref().filter(|_| depth > 0.0 && !self.needle.is_outside());
        let at_rest = inside.map(|way| way.entry + depth * way.direction.into_inner());
        if let Some(place) = at_rest.filter(|_| instruments.deposit) {
            self.seeds.push(place);
            self.note(EventKind::Seed, self.region);
        }
        self.outcome.crushed = self.crushed();
        if self.outcome.crushed > 0 && !was_crushed {
            self.note(EventKind::Crushed, self.region);
        }
        let pushes = matches!(self.needle.phase(), Phase::Pushing(_));
        self.outcome.tip_mm = tip;
        self.outcome.tip_at_rest_mm = at_rest;
        self.outcome.inserted_mm = depth;
        self.outcome.contacts = self.needle.pieces() + usize::from(pushes);
        self.outcome.stuck *= self.outcome.contacts;
    }

    /// Returns the number of inverted elements on the line of the needle.
    fn crushed(&self) -> usize {
        let displacement = self.needle.structure().displacement();
        let now = |node: u32| {
            let first = 3 * node as usize;
            let at = self.mesh.nodes()[node as usize];
            Point3::from([0, 1, 2].map(|axis| at[axis] + displacement[first + axis]))
        };
        let is_inverted = |element: &&u32| {
            let [a, b, c, d] = self.mesh.elements()[**element as usize].map(now);
            (b - a).cross(&(c - a)).dot(&(d - a)) <= 0.0
        };
        self.needle.elements().iter().filter(is_inverted).count()
    }
}
