//! Needles: where the shaft is under the forces that tissue puts on it.
//!
//! Arcs are lengths along the undeformed shaft from its base (0, where the hand holds it) to its tip. The base frame has z
//! along the undeformed shaft towards the tip and x to the side that a bevel deflects to; the roll of the base turns the bevel,
//! for torsion is neglected (Goksel et al. 2011, section III-B).

pub mod beam;
mod bending;
mod cantilever;
mod chain;
mod jointed;
mod line;
mod rigid;
mod shaft;
mod springs;
mod tangent;

use std::fmt::Debug;

use faer::Mat;
use nalgebra::{Isometry3, Point3, Unit, Vector3};

pub use bending::BendingConstraint;
pub use cantilever::{Cantilever, ELEMENT_MM};
pub(in crate::mechanics) use line::across;
pub use line::{CentreLine, ShaftPoint};
pub use rigid::{Constrained, Rigid};
pub use shaft::{BEVEL_MM, Bevel, InvalidNeedleModel, Shaft};
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

    /// Whether forces bend it. One that they do not bend does not yield when it is [linearised](Self::linearise).
    fn is_flexible(&self) -> bool;

    /// Writes the centre line for a base (base frame to world) and the loads on the shaft. `line` holds the shape of the call
    /// before: a model may go one step from there, with a stiffness that it has under the loads `about`, towards the shape that is
    /// asked for, and be called until nothing moves. What `line` holds at first is of no matter if there are no loads. `entry`
    /// is where the needle went in, if it is in the body.
    fn place(
        &mut self,
        base: &Isometry3<f64>,
        entry: Option<&Entry>,
        about: &[Load],
        loads: &[Load],
        line: &mut CentreLine,
    );

    /// What [`place`](Self::place) makes of forces, linearised about the shape in `line` under `loads`, base held. Adds to `out` (rows
    /// x rows, mm/N) the displacement along row i of the shaft under a further unit force along row j: symmetric, and positive
    /// semidefinite unless the loads would buckle a needle that nothing else holds. Writes to `drift` how far the rows still move if
    /// no force changes, mm. In how many ways the needle would buckle: the negative eigenvalues of its tangent stiffness. Nothing is
    /// added for a line that this needle did not place.
    fn linearise(
        &mut self,
        line: &CentreLine,
        loads: &[Load],
        rows: &[Row],
        drift: &mut [f64],
        out: &mut Mat<f64>,
    ) -> usize;
}
