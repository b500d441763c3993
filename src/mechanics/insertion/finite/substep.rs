//! Subdivision of a step into substeps, in each of which the contacts settle and the tip is followed.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::Finite;
use super::slider::State;

/// Advance of the base below which it counts as resting (rounding), mm.
const STILL_MM: f64 = 1e-9;

impl Finite {
    /// Moves the instruments to their new poses, in substeps short enough that no element is skipped.
    pub(super) fn travel(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        let from = self.base.unwrap_or_else(|| self.beginning(base));
        let probe_from = self.press.as_ref().and_then(|press| press.pose);
        let mut way = farthest(&from, base, self.needle.length_mm());
        if let (Some(from), Some(to), Some(press)) = (&probe_from, probe, &self.press) {
            way = way.max(farthest(from, to, press.length_mm()));
        }
        let parts = (way / self.options.part_mm)
            .ceil()
            .clamp(1.0, self.options.most_parts as f64);
        for part in 1..=parts as usize {
            let share = part as f64 / parts;
            // The last pose is exactly the given one.
            let between = |from: &Isometry3<f64>, to: &Isometry3<f64>| {
                if share < 1.0 { from.lerp_slerp(to, share) } else { *to }
            };
            let probe = probe.map(|to| between(probe_from.as_ref().unwrap_or(to), to));
            self.part(&between(&from, base), probe.as_ref());
            self.outcome.substeps += 1;
        }
        self.base = Some(*base);
    }

    /// Returns the pose of the base before the first step: a needle that begins in the body has been pushed in along its
    /// axis.
    fn beginning(&mut self, base: &Isometry3<f64>) -> Isometry3<f64> {
        self.needle.place(base, None, &[], &[], &mut self.line);
        match self.anatomy.region(&self.line.tip()) {
            Some(_) => base * Translation3::new(0.0, 0.0, -self.needle.length_mm()),
            None => *base,
        }
    }

    fn part(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        self.memory.starts.clear();
        self.memory
            .starts
            .extend(self.contacts.iter().map(|contact| contact.arc));
        self.press(probe);
        let advance = self.advance_of(base);
        self.predict(advance);
        self.settle(base);
        self.note_drift(advance);
        if self.hold_at_bone() {
            self.settle(base);
        }
        if self.release(advance) {
            self.settle(base);
        }
        let was_in_bone = self.tip.in_bone();
        if self.advance(advance) {
            self.settle(base);
            // Only now do the forces across the shaft belong to the changed mesh.
            if self.tip.front.is_some() {
                self.transfer();
            }
        }
        // Bone met in this substep.
        if !was_in_bone && self.hold_at_bone() {
            self.settle(base);
        }
        self.stick_again();
    }

    /// Returns the advance of the base along the shaft, mm.
    fn advance_of(&self, base: &Isometry3<f64>) -> f64 {
        let advance = self.tip.base.map_or(0.0, |before| advance(&before, base));
        if advance.abs() < STILL_MM { 0.0 } else { advance }
    }

    /// Extrapolates the sliding of contacts that slip: a warm start that saves iterations.
    fn predict(&mut self, advance: f64) {
        for contact in &mut self.contacts {
            if matches!(contact.slider.state, State::Slipping(direction) if direction * advance > 0.0) {
                contact.arc += contact.drift * advance;
            }
        }
    }

    /// Records the sliding of the contacts in this substep.
    fn note_drift(&mut self, advance: f64) {
        for (contact, start) in self.contacts.iter_mut().zip(&self.memory.starts) {
            let drift = (contact.arc - start) / advance;
            contact.drift = if drift.is_finite() {
                drift.clamp(-2.0, 0.0)
            } else {
                -1.0
            };
        }
    }

    /// Lets contacts that have slipped stick again at rest, where static friction exceeds sliding friction.
    fn stick_again(&mut self) {
        for contact in &mut self.contacts {
            let slider = &mut contact.slider;
            if slider.holding[1] < slider.sliding[1] {
                slider.state = State::Stuck;
            }
        }
    }

    fn press(&mut self, probe: Option<&Isometry3<f64>>) {
        let Some(press) = &mut self.press else { return };
        let condensed = self.adaptation.remesher().condensed();
        if press.move_to(probe, condensed, &self.memory.contact_forces) {
            self.version += 1;
        }
    }
}

/// Returns the advance of a base along the shaft, mm.
pub(super) fn advance(from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    let axis = to.rotation * Vector3::z();
    axis.dot(&(to.translation.vector - from.translation.vector))
}

/// Returns an upper bound of the displacement of any point of an instrument of this length (mm) along z, mm.
pub(super) fn farthest(from: &Isometry3<f64>, to: &Isometry3<f64>, length: f64) -> f64 {
    let shift = (to.translation.vector - from.translation.vector).norm();
    shift + length * from.rotation.angle_to(&to.rotation)
}
