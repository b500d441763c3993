//! Flexible needle of rigid links with angular springs.

#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use faer::Mat;
use nalgebra::Isometry3;

use super::chain::Chain;
use super::jointed::{Jointed, Resistance};
use super::shaft::check;
use super::{Bevel, CentreLine, Entry, InvalidNeedleModel, Load, Needle, Row, Shaft};

/// Length of a link for which Goksel et al. 2011 state the stiffness of its joint, mm.
pub const LINK_MM: f64 = 10.0;

/// Maximum number of links of a needle.
const MAX_LINKS: f64 = 1000.0;

/// Bending stiffness of a needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// Torque per angle of a joint between links of [`LINK_MM`], N mm per degree (1e-6 to 1e12). Joints of links of other
    /// lengths get the stiffness that gives the needle the same bending stiffness.
    KappaNmmPerDeg(f64),
    /// Bending stiffness EI of the shaft, N mm^2 (1e-6 to 1e12).
    BendingNmm2(f64),
}

impl Default for Stiffness {
    /// Returns the stiffness of a brachytherapy needle: 10.7 N mm per degree (Goksel et al. 2011, section III-B), an EI of
    /// 6.13e3 N mm^2. That is about a quarter of that of a solid steel rod of the same radius.
    fn default() -> Self {
        Stiffness::KappaNmmPerDeg(10.7)
    }
}

impl Stiffness {
    /// Returns EI, N mm^2.
    pub fn bending_nmm2(&self) -> f64 {
        match *self {
            Stiffness::KappaNmmPerDeg(kappa) => kappa * 180.0 / PI * LINK_MM,
            Stiffness::BendingNmm2(bending) => bending,
        }
    }

    pub(super) fn check(&self) -> Result<(), InvalidNeedleModel> {
        let (key, found) = match *self {
            Stiffness::KappaNmmPerDeg(kappa) => ("kappa_nmm_per_deg", kappa),
            Stiffness::BendingNmm2(bending) => ("bending_stiffness_nmm2", bending),
        };
        check(key, found, (1e-6..=1e12).contains(&found), "1e-6 to 1e12")
    }
}

/// A needle of rigid links joined by universal joints with angular springs (Goksel et al. 2011, section III-B).
///
/// Each joint turns by the torque of all forces between it and the tip, without its component along the shaft, over the
/// stiffness of its spring: `theta_k = P_k sum (x - x_k) x f / kappa`. There is no torsion: frames are carried along the
/// shaft by these rotations alone.
///
/// Goksel et al. 2011 take the levers x - x_k from the previous shape and damp the result: forces along the shaft multiply
/// the remaining error by their share of the buckling force, and above it nothing settles. Here the shape is solved by
/// Newton's method, whose tangent stiffness accounts for the levers following the joints. It converges to the equation of
/// Goksel et al. in a few steps.
///
/// The shaft is cut into equal parts of `h`, with a joint of stiffness EI / h in the middle of each, so that links are `h`
/// long except the first and the last, half of it. This is the midpoint rule for the integrals of beam theory: deflections
/// differ from those of an Euler-Bernoulli beam by O(h^2), at the tip under a force there by the relative error h^2 / (4
/// L^2) (0.06 % for the 20 links of 10 mm of Goksel et al.). Joints between the parts, half as stiff at the base, would be
/// the trapezoidal rule: of the same order, with twice the error.
///
/// A joint turns by at most 45 degrees.
#[derive(Clone, Debug)]
pub struct Springs {
    jointed: Jointed,
}

impl Springs {
    /// Builds a needle of equal links about `link_mm` long (above 0, at most the needle, at most 1000 links).
    ///
    /// # Errors
    /// [`InvalidNeedleModel`].
    pub fn new(
        shaft: Shaft,
        stiffness: Stiffness,
        link_mm: f64,
        bevel: Option<Bevel>,
    ) -> Result<Self, InvalidNeedleModel> {
        shaft.check()?;
        stiffness.check()?;
        bevel.map_or(Ok(()), |bevel| bevel.check(&shaft))?;
        let length = shaft.length_mm;
        let links = (length / link_mm).round();
        let expected = "above 0, at most the length of the needle, at least a thousandth of it";
        check(
            "link_mm",
            link_mm,
            link_mm <= length && (1.0..=MAX_LINKS).contains(&links),
            expected,
        )?;
        let part = length / links;
        let joints: Vec<f64> = (0..links as usize).map(|joint| part * (joint as f64 + 0.5)).collect();
        let chain = Chain::new(length, &joints, bevel.as_ref());
        let resistance = Resistance::Springs(stiffness.bending_nmm2() / part);
        Ok(Self {
            jointed: Jointed::new(chain, shaft.radius_mm, resistance),
        })
    }
}

impl Needle for Springs {
    fn length_mm(&self) -> f64 {
        self.jointed.length_mm()
    }

    fn radius_mm(&self) -> f64 {
        self.jointed.radius_mm()
    }

    fn is_flexible(&self) -> bool {
        true
    }

    fn place(
        &mut self,
        base: &Isometry3<f64>,
        _entry: Option<&Entry>,
        about: &[Load],
        loads: &[Load],
        line: &mut CentreLine,
    ) {
        self.jointed.place(base, about, loads, line);
    }

    fn linearise(
        &mut self,
        line: &CentreLine,
        loads: &[Load],
        rows: &[Row],
        drift: &mut [f64],
        out: &mut Mat<f64>,
    ) -> usize {
        self.jointed.linearise(line, loads, rows, drift, out)
    }
}
