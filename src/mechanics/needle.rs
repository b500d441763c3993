//! Needles: where the shaft is under the forces that tissue puts on it.
//!
//! Arcs are lengths along the undeformed shaft from its base (0, where the hand holds it) to its tip. The base frame has z
//! along the undeformed shaft towards the tip and x to the side that a bevel deflects to; the roll of the base turns the bevel,
//! for torsion is neglected (haptic simulator paper, section III-B).

mod bending;
mod chain;
mod line;
mod rigid;
mod shaft;
mod springs;

use std::fmt::Debug;

use faer::Mat;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

pub use bending::BendingConstraint;
pub use line::{CentreLine, ShaftPoint};
pub use rigid::{Constrained, Rigid};
pub use shaft::{Bevel, InvalidNeedleModel, Shaft};
pub use springs::{LINK_MM, Springs, Stiffness};

/// A force on the needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Where along the shaft, mm.
    pub arc_mm: f64,
    /// In world axes, N.
    pub force_n: Vector3<f64>,
}

/// Where and how the needle went in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// The point of the skin, mm.
    pub point_mm: Point3<f64>,
    /// The direction of the shaft then.
    pub direction: Unit<Vector3<f64>>,
}

/// A point of the shaft and a direction there: a row of a flexibility.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Where along the shaft, mm.
    pub arc_mm: f64,
    /// Of unit length, world axes.
    pub direction: Vector3<f64>,
}

/// A model of a needle.
///
/// The caller iterates: it asks for the shape under the forces at hand and for the flexibility there, solves tissue and needle
/// together, and asks again with the forces found, until nothing moves. What a needle keeps between calls is memory to reuse:
/// answers depend on the arguments alone.
pub trait Needle: Send + Debug {
    /// Length from base to tip, mm.
    fn length_mm(&self) -> f64;

    /// Radius of the shaft, mm.
    fn radius_mm(&self) -> f64;

    /// Whether forces bend it. Of one that does not, [`flexibility`](Self::flexibility) is zero.
    fn is_flexible(&self) -> bool;

    /// Writes the centre line for a base (base frame to world) and the loads on the shaft. `line` holds the shape of the call
    /// before, which the levers of the forces may be taken from; what it holds at first is of no matter if there are no loads.
    /// `entry` is where the needle went in, if it is in the body.
    fn place(&mut self, base: &Isometry3<f64>, entry: Option<&Entry>, loads: &[Load], line: &mut CentreLine);

    /// Adds to `out` (rows x rows, mm/N) the displacement along row i of the shaft that lies as `line` says, base held, under a
    /// unit force along row j. Symmetric, positive semidefinite. Nothing is added for a line that this needle did not place.
    fn flexibility(&mut self, line: &CentreLine, rows: &[Row], out: &mut Mat<f64>);
}
