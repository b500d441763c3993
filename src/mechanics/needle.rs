//! Needle models: shape of the shaft under the forces of the tissue.
//!
//! Arcs are lengths along the undeformed shaft from its base (0, at the hand) to its tip. The base frame has z along
//! the undeformed shaft towards the tip and x to the side to which a bevel deflects; the roll of the base turns the
//! bevel, for torsion is neglected (Goksel et al. 2011, section III-B).

pub mod beam;
mod chain;
mod flexible;
mod line;
mod model;
mod tangent;

pub use constrained::Constrained;
pub use flexible::{ELEMENT_MM, Flexible, LINK_MM, Stiffness};
pub use line::{CentreLine, ShaftPoint, across};
pub use rigid::Rigid;

use std::fmt::Debug;

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use insonify_base::document::word;
use insonify_base::range::{Kind, OutOfRange, Ranges, check, parameters};

model::needle_models! {
    #[default]
    "rigid" rigid: Rigid(RigidKeys) = "Rigid, straight needle.";
    "constrained" constrained: Constrained(ConstrainedKeys) = "Straight needle that turns from the hand's direction towards its entry direction the deeper it is (Zhu et al. 2007).";
    "springs" springs: Springs(SpringsKeys) = "Rigid links joined by angular springs (Goksel et al. 2011).";
    "beam" elastic: Beam(BeamKeys) = "Beam of Hermite elements that rotate with the needle.";
}

impl Kind for NeedleModel {
    fn stated_as(self) -> String {
        format!("`model = {}`", word(&self))
    }
}

/// A force on the needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Arc of the point of application, mm.
    pub arc_mm: f64,
    /// Force in world axes, N.
    pub force_n: Vector3<f64>,
}

/// Point and direction of insertion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
/// The caller iterates: it requests the shape under the current forces and the flexibility there, solves tissue and
/// needle together, and repeats with the new forces until nothing moves. A needle keeps only buffers between calls:
/// results depend on the arguments alone.
///
/// ```
/// use insonify_mechanics::needle::{CentreLine, Flexible, Load, Needle, Shaft, Stiffness};
/// use nalgebra::{Isometry3, Vector3};
///
/// let shaft = Shaft { length_mm: 100.0, radius_mm: 0.64 };
/// let stiffness = Stiffness::default();
/// let mut needle = Flexible::beam(shaft, stiffness, 10.0, None)?;
///
/// // Held at its base, a needle yields to a force at its tip as a cantilever does: F L^3 / (3 EI).
/// let loads = [Load { arc_mm: 100.0, force_n: Vector3::x() * 0.01 }];
/// let mut line = CentreLine::default();
/// for _ in 0..10 {
///     needle.place(&Isometry3::identity(), None, &loads, &loads, &mut line);
/// }
/// let expected_mm = 0.01 * 100.0_f64.powi(3) / (3.0 * stiffness.bending_nmm2());
/// assert!((line.tip().x / expected_mm - 1.0).abs() < 1e-3, "{} mm", line.tip().x);
/// # Ok::<(), insonify_base::range::OutOfRange>(())
/// ```
pub trait Needle: Send + Debug {
    /// Returns the length from base to tip, mm.
    fn length_mm(&self) -> f64;

    /// Returns the radius of the shaft, mm.
    fn radius_mm(&self) -> f64;

    /// Returns whether forces bend the needle. A rigid one does not yield when it is [linearised](Self::linearise).
    fn is_flexible(&self) -> bool {
        false
    }

    /// Writes the centre line for a base (base frame to world) and the loads on the shaft. `line` holds the shape of
    /// the previous call: a model may make one iteration from there, with its stiffness under the loads `about`,
    /// towards the requested shape, and be called until nothing moves. Without loads the initial content of `line` has
    /// no effect. `entry` is the point of insertion, if the needle is in the body.
    fn place(
        &mut self,
        base: &Isometry3<f64>,
        entry: Option<&Entry>,
        about: &[Load],
        loads: &[Load],
        line: &mut CentreLine,
    );

    /// Linearises [`place`](Self::place) about the shape in `line` under `loads`, with the base fixed. Adds to `out`
    /// (rows x rows, column by column, mm/N) the displacement along row i of the shaft under an additional unit force
    /// along row j: symmetric, and positive semidefinite unless the loads would buckle the unsupported needle. Writes
    /// to `drift` the remaining motion of the rows under unchanged forces, mm. Returns the number of buckling modes:
    /// the negative eigenvalues of the tangent stiffness. Nothing is added for a line that this needle did not place.
    /// The default is that of a rigid needle: nothing moves.
    fn linearise(
        &mut self,
        _line: &CentreLine,
        _loads: &[Load],
        _rows: &[Row],
        drift: &mut [f64],
        _out: &mut [f64],
    ) -> usize {
        drift.fill(0.0);
        0
    }
}

/// Checks a needle's dimensions, and that its unloaded centre line is finite and ends at its length.
pub(crate) fn check_needle(needle: &mut dyn Needle) -> Result<(), OutOfRange> {
    let [length_mm, radius_mm] = [needle.length_mm(), needle.radius_mm()];
    check(
        "length_mm of the needle",
        length_mm,
        length_mm > 0.0,
        "a finite number above 0",
    )?;
    check(
        "radius_mm of the needle",
        radius_mm,
        radius_mm > 0.0,
        "a finite number above 0",
    )?;
    let mut line = CentreLine::default();
    needle.place(&Isometry3::identity(), None, &[], &[], &mut line);
    let mut numbers = line.nodes().iter().flat_map(|(_, point)| point.iter().copied());
    let wrong = numbers.find(|number| !number.is_finite()).unwrap_or_default();
    check("centre line of the needle", wrong, true, "finite points")?;
    let end_mm = line.length_mm();
    let ends_at_tip = (end_mm - length_mm).abs() <= 1e-6 * length_mm;
    check(
        "last arc of the needle's centre line",
        end_mm,
        ends_at_tip,
        format!("its length, {length_mm} mm"),
    )
}

/// The shaft of a needle. The default is a brachytherapy needle: 200 mm long, 0.64 mm in radius (the radius from Goksel
/// et al. 2011, section III-C).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaft {
    /// Length from base to tip, mm (0.1 to 1000).
    pub length_mm: f64,
    /// Radius, mm (0.025 to 5).
    pub radius_mm: f64,
}

impl Default for Shaft {
    fn default() -> Self {
        Self {
            length_mm: 200.0,
            radius_mm: 0.64,
        }
    }
}

impl Shaft {
    /// Checks both numbers against their ranges.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn check(&self) -> Result<(), OutOfRange> {
        let (length, radius) = (self.length_mm, self.radius_mm);
        check("length_mm", length, (0.1..=1000.0).contains(&length), "0.1 to 1000")?;
        check("radius_mm", radius, (0.025..=5.0).contains(&radius), "0.025 to 5")
    }
}

/// Default length of a bevel, mm: with r = 0.6 mm it deflects the tip by the 10.4 mm of Goksel et al. 2011 (figure 10c)
/// in PVC of 20 kPa, 140 mm deep, on cells of 10 mm (9.4 mm on cells of 5 mm).
pub const BEVEL_MM: f64 = 18.0;

parameters! {
    /// The bevel of a needle's tip, as a tilt of the last part of its centre line (Goksel et al. 2011, section III-C).
    ///
    /// Tissue is cut at the edge of the tip, which lies off the centre line. The cut tissue then slides onto the centre
    /// line, so it is pulled to one side, away from the edge; its elastic response pushes the needle the other way,
    /// towards the edge, and a flexible needle follows. The tip is placed `r_mm` off the centre line towards +x of the
    /// frame of the last link, which is the side to which the needle deflects: roll of the base steers it, for the
    /// shaft has no torsion.
    ///
    /// In three dimensions the cut runs around a rim, not through one point, so `r_mm` is not a dimension of the needle
    /// but is fitted: Goksel et al. 2011 find 0.6 mm for a brachytherapy needle of 0.64 mm radius.
    #[derive(Copy)]
    #[schemars(rename = "BevelSpec")]
    pub struct Bevel with required keys {
        /// Distance of the tip from the centre line, less than `length_mm`. With 0 the needle has no bevel.
        r_mm: f64, in 0..=5 "mm";
        /// Length of the tilted part, at most that of the needle. Default 18: fitted to the deflection of 10.4 mm in
        /// Goksel et al. 2011, figure 10c.
        #[serde(default = "usual_length")]
        length_mm: f64, above 0 "mm";
    }
}

fn usual_length() -> f64 {
    BEVEL_MM
}

impl Bevel {
    /// Checks both numbers against their ranges, for a needle.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn check(&self, shaft: &Shaft) -> Result<(), OutOfRange> {
        let (r, length) = (self.r_mm, self.length_mm);
        let checked = self
            .check_ranges()
            .and_then(|()| {
                check(
                    "length_mm",
                    length,
                    length <= shaft.length_mm,
                    "at most the length of the needle",
                )
            })
            .and_then(|()| check("r_mm", r, r < length, "less than the length of the bevel"));
        checked.map_err(|error| OutOfRange {
            key: format!("bevel.{}", error.key),
            ..error
        })
    }

    /// Returns the direction of the tilted part in the frame of its link.
    fn direction(&self) -> Vector3<f64> {
        let sine = self.r_mm / self.length_mm;
        Vector3::new(sine, 0.0, (1.0 - sine * sine).sqrt())
    }
}
