//! The state of an insertion beside the springs.

use nalgebra::{Isometry3, Point3, Vector3};

use super::bone::Hold;
use crate::mechanics::needle::{CentreLine, Entry};

/// What the last node of the stack is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum TipNode {
    /// It is held at the tip.
    Held,
    /// It has been penetrated: the next one is sought.
    Penetrated,
    /// The needle has been drawn back, or there is none: the tip is empty.
    #[default]
    Empty,
}

/// Everything that changes from step to step but the springs, the stack and the last outcome.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Body {
    pub step: u64,
    pub time_s: f64,
    /// Where the hand had the needle's base; none before the first step.
    pub base: Option<Isometry3<f64>>,
    pub line: CentreLine,
    /// Set while the needle is in the body.
    pub entry: Option<Entry>,
    pub tip_node: TipNode,
    /// A surface has been met that is not yet broken.
    pub breaking: bool,
    /// The region that the tip is in.
    pub region: Option<i32>,
    /// Place of the last crossing of a border, in the reference state, mm.
    pub crossed: Vector3<f64>,
    /// The element that the tip was last found in.
    pub element: u32,
    /// It has been told that the tip cannot be made a node here.
    pub refused: bool,
    pub hold: Option<Hold>,
    /// Whether anything may move: tissue that has come to rest costs nothing.
    pub awake: bool,
    pub seeds: Vec<Point3<f64>>,
}
