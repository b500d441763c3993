//! Angular springs: a flexible needle of rigid links.

mod tangent;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use faer::Mat;
use nalgebra::{Isometry3, Vector3};

use super::chain::{Beyond, Chain, limited};
use super::shaft::check;
use super::{Bevel, CentreLine, Entry, InvalidNeedleModel, Load, Needle, Row, Shaft};
use tangent::Tangent;

/// Length of a link for which the paper states the stiffness of its joint, mm.
pub const LINK_MM: f64 = 10.0;

/// Most links of a needle.
const MAX_LINKS: f64 = 1000.0;

/// A joint turns by at most this, rad.
const MAX_TURN: f64 = FRAC_PI_4;

/// How hard a needle is to bend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// Torque by angle of a joint between links of [`LINK_MM`], N mm per degree (1e-6 to 1e12). Joints of links of other
    /// lengths get the stiffness that bends the needle alike.
    KappaNmmPerDeg(f64),
    /// Bending stiffness EI of the shaft, N mm^2 (1e-6 to 1e12).
    BendingNmm2(f64),
}

impl Default for Stiffness {
    /// A brachytherapy needle: 10.7 N mm per degree (haptic simulator paper, section III-B), an EI of 6.13e3 N mm^2.
    /// That is about a quarter of what a solid steel rod of the same radius has.
    fn default() -> Self {
        Stiffness::KappaNmmPerDeg(10.7)
    }
}

impl Stiffness {
    /// EI, N mm^2.
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

/// A needle of rigid links joined by universal joints with angular springs (haptic simulator paper, section III-B).
///
/// Each joint turns by the torque of all forces between it and the tip, without its part along the shaft, over the
/// stiffness of its spring: `theta_k = P_k sum (x - x_k) x f / kappa`. There is no torsion: frames are carried along
/// the shaft by these rotations alone.
///
/// The paper takes the levers x - x_k from the shape before and damps what comes out: forces along the shaft multiply what is left
/// by their share of the one that buckles the needle, and above it nothing settles. Here the shape goes by Newton's method, whose
/// tangent stiffness knows that levers follow the joints. It ends at the paper's equation, in a few steps.
///
/// The shaft is cut into equal parts of `h`, with a joint of stiffness EI / h in the middle of each, so that links are
/// `h` long but the first and the last, half of it. This is the midpoint rule for the integrals of beam theory:
/// deflections differ from those of an Euler-Bernoulli beam by O(h^2), at the tip under a force there by h^2 / (4 L^2)
/// of the whole (0.06 % for the paper's 20 links of 10 mm). Joints between the parts, half as stiff at the base, would
/// be the trapezoidal rule: of the same order, with twice the error.
///
/// A joint turns by at most 45 degrees.
#[derive(Clone, Debug)]
pub struct Springs {
    chain: Chain,
    radius_mm: f64,
    /// Torque by angle of a joint, N mm/rad.
    stiffness: f64,
    tangent: Tangent,
    /// Angle by torque of a joint, rad/(N mm).
    compliance: f64,
    beyond: Vec<Beyond>,
    /// For the first joints together, the flexibility by moment about the base and direction.
    together: Vec<Matrix6<f64>>,
    rows: Vec<Twist>,
}

/// A row of a flexibility, on its way.
#[derive(Clone, Copy, Debug)]
struct Twist {
    /// Joints before it.
    joints: usize,
    /// Moment about the base, and direction.
    row: Vector6<f64>,
    /// What the joints before it make of that.
    moved: Vector6<f64>,
}

impl Springs {
    /// A needle of links about `link_mm` long (above 0, at most the needle, at most 1000 links): as many as make up its
    /// length.
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
        Ok(Self {
            chain: Chain::new(length, &joints, bevel.as_ref()),
            radius_mm: shaft.radius_mm,
            stiffness: stiffness.bending_nmm2() / part,
            tangent: Tangent::default(),
        })
    }
            compliance: part / stiffness.bending_nmm2(),
            beyond: Vec::new(),
            together: vec![Matrix6::zeros(); joints.len()],
            rows: Vec::new(),
        })
    }

    /// Sums up what the joints before each joint, and it, yield.
    fn yielding(&mut self, line: &CentreLine) {
        let (nodes, mut sum) = (line.nodes(), Matrix6::zeros());
        for (&node, together) in self.chain.joints().iter().zip(&mut self.together) {
            let along = (nodes[node].1 - nodes[node - 1].1).normalize();
            // Torque (m - x n) of a row (m, n), across the shaft.
            let across = (Matrix3::identity() - along * along.transpose()) * self.compliance;
            let lever = (nodes[node].1 - nodes[0].1).cross_matrix();
            let mixed = across * lever;
            let view = |sum: &mut Matrix6<f64>, at: (usize, usize), part: Matrix3<f64>| {
                let mut block = sum.fixed_view_mut::<3, 3>(at.0, at.1);
                block += part;
            };
            view(&mut sum, (0, 0), across);
            view(&mut sum, (0, 3), -mixed);
            view(&mut sum, (3, 0), -mixed.transpose());
            view(&mut sum, (3, 3), lever.transpose() * mixed);
            *together = sum;
        }
    }
}

impl Needle for Springs {
    fn length_mm(&self) -> f64 {
        self.chain.length_mm()
    }

    fn radius_mm(&self) -> f64 {
        self.radius_mm
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
        if !self.chain.fits(line) {
            self.chain.place(base, line, |_, _| Vector3::zeros());
        }
        self.tangent.set(&self.chain, line, self.stiffness, about);
        self.tangent.step(&self.chain, line, loads);
        let tangent = &self.tangent;
        self.chain.place(base, line, |joint, along| {
            let turn = tangent.turn(joint);
            limited(turn - along * along.dot(&turn))
        self.chain.gather(loads, line, &mut self.beyond);
        let (beyond, compliance) = (&self.beyond, self.compliance);
        self.chain.place(base, line, |joint, along| {
            let torque = beyond[joint + 1].1;
            limited((torque - along * along.dot(&torque)) * compliance)
        });
    }

    fn linearise(
        &mut self,
        line: &CentreLine,
        loads: &[Load],
        rows: &[Row],
        drift: &mut [f64],
        out: &mut Mat<f64>,
    ) -> usize {
        if !self.chain.fits(line) {
            return 0;
        }
        let ways = self.tangent.set(&self.chain, line, self.stiffness, loads);
        self.tangent.set_moves(&self.chain, line, rows);
        self.tangent.step(&self.chain, line, loads);
        self.tangent.drift(line, drift);
        self.tangent.add_flexibility(out);
        ways
    }
}
