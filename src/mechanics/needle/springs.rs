//! Angular springs: a flexible needle of rigid links.

#[cfg(test)]
mod tests;

use std::f64::consts::{FRAC_PI_4, PI};

use faer::Mat;
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Vector3, Vector6};

use super::chain::Chain;
use super::shaft::check;
use super::{Bevel, CentreLine, Entry, InvalidNeedleModel, Load, Needle, Row, Shaft};

/// Length of a link for which the paper states the stiffness of its joint, mm.
pub const LINK_MM: f64 = 10.0;

/// Most links of a needle.
const MAX_LINKS: f64 = 1000.0;

/// A joint turns by at most this, rad.
const MAX_TURN: f64 = FRAC_PI_4;

/// Forces of more than this along an axis count as this, N: so that no product of them overflows.
const MAX_FORCE_N: f64 = 1e60;

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

    fn check(&self) -> Result<(), InvalidNeedleModel> {
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
    /// Angle by torque of a joint, rad/(N mm).
    compliance: f64,
    /// Force and moment about the base of what lies between a joint and the tip.
    beyond: Vec<(Vector3<f64>, Vector3<f64>)>,
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
            compliance: part / stiffness.bending_nmm2(),
            beyond: vec![Default::default(); joints.len()],
            together: vec![Matrix6::zeros(); joints.len()],
            rows: Vec::new(),
        })
    }

    /// Sums up the loads beyond each joint.
    fn gather(&mut self, loads: &[Load], line: &CentreLine) {
        self.beyond.fill(Default::default());
        let base = line.nodes()[0].1;
        for load in loads {
            if let Some(last) = self.chain.joints_before(load.arc_mm).checked_sub(1) {
                let force = load.force_n.map(|part| part.clamp(-MAX_FORCE_N, MAX_FORCE_N));
                self.beyond[last].0 += force;
                self.beyond[last].1 += (line.at(load.arc_mm).point_mm - base).cross(&force);
            }
        }
        for joint in (1..self.beyond.len()).rev() {
            let (force, moment) = self.beyond[joint];
            self.beyond[joint - 1].0 += force;
            self.beyond[joint - 1].1 += moment;
        }
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

/// At most as far as a joint turns.
fn limited(angle: Vector3<f64>) -> Vector3<f64> {
    let turn = angle.norm();
    if turn > MAX_TURN {
        angle * (MAX_TURN / turn)
    } else {
        angle
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

    fn place(&mut self, base: &Isometry3<f64>, _entry: Option<&Entry>, loads: &[Load], line: &mut CentreLine) {
        if !self.chain.fits(line) {
            self.chain.place(base, line, |_, _| Vector3::zeros());
        }
        self.gather(loads, line);
        // Moments about each joint, while the line of the call before is there.
        let nodes = line.nodes();
        for (&node, (force, moment)) in self.chain.joints().iter().zip(&mut self.beyond) {
            *moment -= (nodes[node].1 - nodes[0].1).cross(force);
        }
        let (beyond, compliance) = (&self.beyond, self.compliance);
        self.chain.place(base, line, |joint, along| {
            let torque = beyond[joint].1;
            limited((torque - along * along.dot(&torque)) * compliance)
        });
    }

    fn flexibility(&mut self, line: &CentreLine, rows: &[Row], out: &mut Mat<f64>) {
        if !self.chain.fits(line) {
            return;
        }
        self.yielding(line);
        let base: Point3<f64> = line.nodes()[0].1;
        let (chain, together) = (&self.chain, &self.together);
        self.rows.clear();
        self.rows.extend(rows.iter().map(|row| {
            let joints = chain.joints_before(row.arc_mm);
            let moment = (line.at(row.arc_mm).point_mm - base).cross(&row.direction);
            let [m, n] = [moment, row.direction];
            let row = Vector6::new(m.x, m.y, m.z, n.x, n.y, n.z);
            let moved = joints
                .checked_sub(1)
                .map_or(Vector6::zeros(), |last| together[last] * row);
            Twist { joints, row, moved }
        }));
        // Of two rows the one with fewer joints before it says what both share.
        for (i, a) in self.rows.iter().enumerate() {
            for (j, b) in self.rows[..=i].iter().enumerate() {
                let (near, far) = if a.joints < b.joints { (a, b) } else { (b, a) };
                let share = near.moved.dot(&far.row);
                out[(i, j)] += share;
                if i != j {
                    out[(j, i)] += share;
                }
            }
        }
    }
}
