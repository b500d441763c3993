//! Needle models: shape of the shaft under the forces of the tissue.
//!
//! Arcs are lengths along the undeformed shaft from its base (0, at the hand) to its tip. The base frame has z along the
//! undeformed shaft towards the tip and x to the side to which a bevel deflects; the roll of the base turns the bevel, for
//! torsion is neglected (Goksel et al. 2011, section III-B).

pub mod beam;
mod chain;
mod flexible;
mod line;
mod rigid;
mod shaft;
mod tangent;

use std::fmt::Debug;

use nalgebra::{Isometry3, Point3, Unit, Vector3};

pub use flexible::{ELEMENT_MM, Flexible, LINK_MM, Stiffness};
pub(crate) use line::across;
pub use line::{CentreLine, ShaftPoint};
pub use rigid::{BendingConstraint, Constrained, Rigid};
pub use shaft::{BEVEL_MM, Bevel, Shaft};

/// A force on the needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Arc of the point of application, mm.
    pub arc_mm: f64,
    /// Force in world axes, N.
    pub force_n: Vector3<f64>,
}

/// Point and direction of insertion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// Point on the skin, mm.
    pub point_mm: Point3<f64>,
    /// Direction of the shaft at insertion.
    pub direction: Unit<Vector3<f64>>,
}

/// A point of the shaft and a direction there: one row of a flexibility matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Arc of the point, mm.
    pub arc_mm: f64,
    /// Unit direction, world axes.
    pub direction: Vector3<f64>,
}

/// Model of a needle.
///
/// The caller iterates: it requests the shape under the current forces and the flexibility there, solves tissue and needle
/// together, and repeats with the new forces until nothing moves. A needle keeps only buffers between calls: results depend
/// on the arguments alone.
pub trait Needle: Send + Debug {
    /// Returns the length from base to tip, mm.
    fn length_mm(&self) -> f64;

    /// Returns the radius of the shaft, mm.
    fn radius_mm(&self) -> f64;

    /// Returns whether forces bend the needle. A rigid one does not yield when it is [linearised](Self::linearise).
    fn is_flexible(&self) -> bool;

    /// Writes the centre line for a base (base frame to world) and the loads on the shaft. `line` holds the shape of the
    /// previous call: a model may make one iteration from there, with its stiffness under the loads `about`, towards the
    /// requested shape, and be called until nothing moves. Without loads the initial content of `line` has no effect.
    /// `entry` is the point of insertion, if the needle is in the body.
    fn place(
        &mut self,
        base: &Isometry3<f64>,
        entry: Option<&Entry>,
        about: &[Load],
        loads: &[Load],
        line: &mut CentreLine,
    );

    /// Linearises [`place`](Self::place) about the shape in `line` under `loads`, with the base fixed. Adds to `out` (rows x
    /// rows, column by column, mm/N) the displacement along row i of the shaft under an additional unit force along row j: symmetric, and
    /// positive semidefinite unless the loads would buckle the unsupported needle. Writes to `drift` the remaining motion of
    /// the rows under unchanged forces, mm. Returns the number of buckling modes: the negative eigenvalues of the tangent
    /// stiffness. Nothing is added for a line that this needle did not place.
    fn linearise(
        &mut self,
        line: &CentreLine,
        loads: &[Load],
        rows: &[Row],
        drift: &mut [f64],
        out: &mut [f64],
    ) -> usize;
}
