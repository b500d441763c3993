//! State of a mass-spring insertion apart from the springs.

use nalgebra::{Isometry3, Point3, Translation3, Unit, Vector3};

use serde::{Deserialize, Serialize};

use crate::insertion::Bone;
use crate::needle::{CentreLine, Entry};

/// State of the last node of the stack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum TipNode {
    /// The node is held at the tip.
    Held,
    /// The node has been penetrated: the next one is sought.
    Penetrated,
    /// The tip holds no node: the needle has been withdrawn, or is outside.
    #[default]
    Empty,
}

/// Everything that changes from step to step except the springs, the stack and the last outcome.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct NeedleState {
    pub step: u64,
    pub time_s: f64,
    /// Pose of the needle's base given by the hand; `None` before the first step.
    pub base: Option<Isometry3<f64>>,
    pub line: CentreLine,
    /// Point of entry while the needle is in the body.
    pub entry: Option<Entry>,
    pub tip_node: TipNode,
    /// Whether a surface has been met that is not yet broken.
    pub breaking: bool,
    /// Region of the tip.
    pub region: Option<i32>,
    /// Position of the last crossing of a boundary, in the reference state, mm.
    pub crossed: Vector3<f64>,
    /// Position of the tip in the reference state, mm.
    pub at_rest: Vector3<f64>,
    /// Element in which the tip was last found.
    pub element: u32,
    /// Whether the event that no node can be moved to the tip has been reported here.
    pub refused: bool,
    pub bone_contact: Option<BoneContact>,
    /// Whether anything may move: tissue at rest costs nothing.
    pub active: bool,
    pub seeds: Vec<Point3<f64>>,
}

/// Distance by which a needle that was moved off bone catches up with the hand in each substep, mm.
const CATCH_UP_MM: f64 = 0.1;

/// Bone met by the tip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct BoneContact {
    /// Position of the tip of the unloaded needle when the tip met the bone, mm.
    pub at: Point3<f64>,
    /// Direction of the needle when the tip met the bone.
    pub direction: Unit<Vector3<f64>>,
    pub bone: Bone,
}

impl BoneContact {
    /// Returns the depth that the tip would have if nothing stopped it, mm.
    fn depth(&self, base: &Isometry3<f64>, length_mm: f64) -> f64 {
        (unloaded_tip(base, length_mm) - self.at).dot(&self.direction)
    }

    /// Continues from the current position where no bone is under the tip any more: the needle catches up with the
    /// hand.
    pub(super) fn leave(&mut self, hand: &Isometry3<f64>, length_mm: f64) {
        if self.bone.holds() {
            self.at += self.direction.into_inner() * self.depth(hand, length_mm).min(self.bone.penetration_mm);
            self.bone = Bone::LEFT;
        }
        self.at += self.direction.into_inner() * CATCH_UP_MM;
    }

    /// Returns whether the needle has been withdrawn from the bone.
    pub(crate) fn is_left(&self, base: &Isometry3<f64>, length_mm: f64) -> bool {
        self.depth(base, length_mm) <= 0.0
    }

    /// Returns the pose of the needle's base while the hand is at `base`: the depth of the tip is limited by the bone.
    pub(super) fn stopped(&self, base: &Isometry3<f64>, length_mm: f64) -> Isometry3<f64> {
        let behind = self.bone.behind_mm(self.depth(base, length_mm));
        Translation3::from(self.direction.into_inner() * -behind) * base
    }

    /// Returns the penalty force on the tip, N.
    pub(super) fn force(&self, base: &Isometry3<f64>, length_mm: f64) -> Vector3<f64> {
        self.direction.into_inner() * -self.bone.force_n(self.depth(base, length_mm))
    }
}

/// Returns the tip of a needle without deflection.
pub(super) fn unloaded_tip(base: &Isometry3<f64>, length_mm: f64) -> Point3<f64> {
    base * Point3::new(0.0, 0.0, length_mm)
}
