//! State of a mass-spring insertion apart from the springs.

use nalgebra::{Isometry3, Point3, Vector3};

use super::bone::Hold;
use crate::mechanics::needle::{CentreLine, Entry};

/// State of the last node of the stack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Body {
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
    /// Element in which the tip was last found.
    pub element: u32,
    /// Whether the event that no node can be moved to the tip has been reported here.
    pub refused: bool,
    pub hold: Option<Hold>,
    /// Whether anything may move: tissue at rest costs nothing.
    pub awake: bool,
    pub seeds: Vec<Point3<f64>>,
}
