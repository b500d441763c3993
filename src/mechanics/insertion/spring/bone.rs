//! Bone under the tip: a penalty force, and a needle that stays behind the hand.

use nalgebra::{Isometry3, Point3, Translation3, Unit, Vector3};

use crate::mechanics::insertion::Bone;

/// A needle that was moved off bone catches up with the hand by as much in each part of a step, mm.
const CATCH_UP_MM: f64 = 0.1;

/// Bone that the tip has met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hold {
    /// Where the tip of the unloaded needle was when the tip met the bone, mm.
    pub at: Point3<f64>,
    /// The direction of the needle then.
    pub direction: Unit<Vector3<f64>>,
    pub bone: Bone,
}

impl Hold {
    /// How deep the tip would be if nothing held it, mm.
    fn depth(&self, base: &Isometry3<f64>, length_mm: f64) -> f64 {
        (unloaded_tip(base, length_mm) - self.at).dot(&self.direction)
    }

    /// Goes on from where the needle is, where no bone is under its tip any more: the needle catches up with the hand.
    pub fn leave(&mut self, hand: &Isometry3<f64>, length_mm: f64) {
        if self.bone.holds() {
            self.at += self.direction.into_inner() * self.depth(hand, length_mm).min(self.bone.penetration_mm);
            self.bone = Bone::LEFT;
        }
        self.at += self.direction.into_inner() * CATCH_UP_MM;
    }

    /// Whether the needle has been drawn back from it.
    pub fn is_left(&self, base: &Isometry3<f64>, length_mm: f64) -> bool {
        self.depth(base, length_mm) <= 0.0
    }

    /// Where the base of the needle stays while the hand is at `base`: the tip goes no deeper than the bone lets it.
    pub fn hold_back(&self, base: &Isometry3<f64>, length_mm: f64) -> Isometry3<f64> {
        let behind = self.bone.behind_mm(self.depth(base, length_mm));
        Translation3::from(self.direction.into_inner() * -behind) * base
    }

    /// The penalty, at the tip, N.
    pub fn force(&self, base: &Isometry3<f64>, length_mm: f64) -> Vector3<f64> {
        self.direction.into_inner() * -self.bone.force_n(self.depth(base, length_mm))
    }
}

/// The tip of a needle that nothing bends.
pub(super) fn unloaded_tip(base: &Isometry3<f64>, length_mm: f64) -> Point3<f64> {
    base * Point3::new(0.0, 0.0, length_mm)
}
