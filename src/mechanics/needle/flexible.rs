//! Flexible needle: rigid links whose joints resist turning, as angular springs or as a beam.

#[cfg(test)]
mod tests;

use std::f64::consts::{FRAC_PI_4, PI};

use nalgebra::{Isometry3, Vector3};

use super::chain::Chain;
use super::tangent::Tangent;
use super::{Bevel, CentreLine, Entry, Load, Needle, Row, Shaft};
use crate::ldl::Ldl;
use insonify_base::range::{OutOfRange, check};

/// Length of a link for which Goksel et al. 2011 state the stiffness of its joint, mm.
pub const LINK_MM: f64 = 10.0;

/// Default length of an element, mm.
pub const ELEMENT_MM: f64 = 5.0;

/// Maximum number of links or elements of a needle.
const MAX_PARTS: f64 = 1000.0;

/// Bending stiffness of a needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stiffness {
    /// Torque per angle of a joint between links of [`LINK_MM`], N mm per degree (1e-6 to 1e12). Joints of links of
    /// other lengths get the stiffness that gives the needle the same bending stiffness.
    KappaNmmPerDeg(f64),
    /// Bending stiffness EI of the shaft, N mm^2 (1e-6 to 1e12).
    BendingNmm2(f64),
}

impl Default for Stiffness {
    /// Returns the stiffness of a brachytherapy needle: 10.7 N mm per degree (Goksel et al. 2011, section III-B), an EI
    /// of 6.13e3 N mm^2. That is about a quarter of that of a solid steel rod of the same radius.
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

    fn check(&self) -> Result<(), OutOfRange> {
        let (key, found) = match *self {
            Stiffness::KappaNmmPerDeg(kappa) => ("kappa_nmm_per_deg", kappa),
            Stiffness::BendingNmm2(bending) => ("bending_stiffness_nmm2", bending),
        };
        check(key, found, (1e-6..=1e12).contains(&found), "1e-6 to 1e12")
    }
}

/// Maximum rotation of a joint, rad.
pub(super) const MAX_TURN: f64 = FRAC_PI_4;

/// Resistance of the joints to rotation.
#[derive(Clone, Debug)]
pub(super) enum Resistance {
    /// A spring in each joint, with this torque per angle, N mm/rad.
    Springs(f64),
    /// Torques by angles of all joints, N mm/rad: a symmetric matrix, row by row.
    Coupled(Vec<f64>),
}

impl Resistance {
    /// Returns the torque at joint `row` per angle of joint `column`, for `count` joints.
    pub(super) fn entry(&self, row: usize, column: usize, count: usize) -> f64 {
        match self {
            Resistance::Springs(kappa) if row == column => *kappa,
            Resistance::Springs(_) => 0.0,
            Resistance::Coupled(entries) => entries[row * count + column],
        }
    }
}

/// A needle of rigid links with joints between them, each of which turns by at most 45 degrees. [`Flexible::springs`]
/// and [`Flexible::beam`] differ in what resists the turns, which Newton's method finds: its tangent stiffness accounts
/// for the levers following the joints. There is no torsion: frames are carried along the shaft by the turns of the
/// joints alone.
#[derive(Clone, Debug)]
pub struct Flexible {
    chain: Chain,
    radius_mm: f64,
    resistance: Resistance,
    tangent: Tangent,
}

impl Flexible {
    /// Builds a needle of equal links about `link_mm` long (above 0, at most the needle, at most 1000 links), joined by
    /// universal joints with angular springs (Goksel et al. 2011, section III-B).
    ///
    /// Each joint turns by the torque of all forces between it and the tip, without its component along the shaft, over
    /// the stiffness of its spring: `theta_k = P_k sum (x - x_k) x f / kappa`. There is no torsion: frames are carried
    /// along the shaft by these rotations alone.
    ///
    /// Goksel et al. 2011 take the levers x - x_k from the previous shape and damp the result: forces along the shaft
    /// multiply the remaining error by their share of the buckling force, and above it nothing settles. Here the shape
    /// is solved by Newton's method, whose tangent stiffness accounts for the levers following the joints. It converges
    /// to the equation of Goksel et al. in a few steps.
    ///
    /// The shaft is cut into equal parts of `h`, with a joint of stiffness EI / h in the middle of each, so that links
    /// are `h` long except the first and the last, half of it. This is the midpoint rule for the integrals of beam
    /// theory: deflections differ from those of an Euler-Bernoulli beam by O(h^2), at the tip under a force there by
    /// the relative error h^2 / (4 L^2) (0.06 % for the 20 links of 10 mm of Goksel et al.). Joints between the parts,
    /// half as stiff at the base, would be the trapezoidal rule: of the same order, with twice the error.
    ///
    /// A joint turns by at most 45 degrees.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn springs(shaft: Shaft, stiffness: Stiffness, link_mm: f64, bevel: Option<Bevel>) -> Result<Self, OutOfRange> {
        let links = parts(&shaft, &stiffness, ("link_mm", link_mm), bevel.as_ref())?;
        let part = shaft.length_mm / links as f64;
        let joints: Vec<f64> = (0..links).map(|joint| part * (joint as f64 + 0.5)).collect();
        let resistance = Resistance::Springs(stiffness.bending_nmm2() / part);
        Ok(Self::new(&shaft, &joints, bevel.as_ref(), resistance))
    }

    /// A needle as an Euler-Bernoulli beam in space: Hermite cubic elements, each in a frame that moves with its chord.
    ///
    /// An element of length `h` bends by the moments at its ends, `a1 = -(h/6EI) (2 M1 + M2)` and
    /// `a2 = (h/6EI) (M1 + 2 M2)`, the angles of its ends relative to its chord. Moments follow from the loads beyond,
    /// with their levers on the bent shaft. So at a node the chords turn by `(h/6EI) (M_before + 4 M + M_beyond)`, at
    /// the base by `(h/6EI) (2 M + M_beyond)`: nodes lie exactly where beam theory has them for any `h`, as long as
    /// forces act at nodes. Between nodes the shaft is its chord, on which forces there act: that omits at most
    /// `F h^3/(48 EI)`, 0.0004 mm for 1 N and 5 mm. (Springs, whose joints are the midpoint rule of the same integrals,
    /// are off by `h^2/(4 L^2)` of the deflection.)
    ///
    /// Rotations of the beam may be large: frames are carried along, levers are those of the bent needle, and lengths
    /// are preserved. Within an element the chord is as long as the arc, which is off by `a^2/10` of it for ends that
    /// turn by `a`; a node turns by at most 45 degrees. There is no torsion, as in the other models. For a needle on a
    /// hyperelastic foundation of its own see [`beam`](super::beam); here tissue acts through the loads.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn beam(shaft: Shaft, stiffness: Stiffness, element_mm: f64, bevel: Option<Bevel>) -> Result<Self, OutOfRange> {
        let elements = parts(&shaft, &stiffness, ("element_mm", element_mm), bevel.as_ref())?;
        let part = shaft.length_mm / elements as f64;
        // The base is a joint too: it is clamped, but the first chord turns relative to it.
        let nodes: Vec<f64> = (0..elements).map(|node| part * node as f64).collect();
        let resistance = inverse(nodes.len(), part / (6.0 * stiffness.bending_nmm2()));
        Ok(Self::new(
            &shaft,
            &nodes,
            bevel.as_ref(),
            Resistance::Coupled(resistance),
        ))
    }

    fn new(shaft: &Shaft, joints: &[f64], bevel: Option<&Bevel>, resistance: Resistance) -> Self {
        Self {
            chain: Chain::new(shaft.length_mm, joints, bevel),
            radius_mm: shaft.radius_mm,
            resistance,
            tangent: Tangent::default(),
        }
    }
}

/// Checks a needle, and returns the number of equal parts that are nearest to a length (mm).
fn parts(
    shaft: &Shaft,
    stiffness: &Stiffness,
    (key, part_mm): (&'static str, f64),
    bevel: Option<&Bevel>,
) -> Result<usize, OutOfRange> {
    shaft.check()?;
    stiffness.check()?;
    bevel.map_or(Ok(()), |bevel| bevel.check(shaft))?;
    let length = shaft.length_mm;
    let parts = (length / part_mm).round();
    let holds = part_mm <= length && (1.0..=MAX_PARTS).contains(&parts);
    let expected = "above 0, at most the length of the needle, at least a thousandth of it";
    check(key, part_mm, holds, expected)?;
    Ok(parts as usize)
}

/// Returns the inverse of the rotations of the chords by moments at the nodes: `compliance` times 2 and 1 at the base,
/// and 1, 4, 1 beyond.
fn inverse(nodes: usize, compliance: f64) -> Vec<f64> {
    let mut ldl = Ldl::default();
    ldl.start(nodes);
    for node in 0..nodes {
        *ldl.entry(node, node) = compliance * if node == 0 { 2.0 } else { 4.0 };
        if node > 0 {
            *ldl.entry(node, node - 1) = compliance;
        }
    }
    ldl.factor();
    let mut inverse = vec![0.0; nodes * nodes];
    (0..nodes).for_each(|node| inverse[node * nodes + node] = 1.0);
    ldl.solve_rows(&mut inverse, nodes);
    inverse
}

impl Needle for Flexible {
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
        self.tangent.set(&self.chain, line, &self.resistance, about);
        self.tangent.step(&self.chain, line, loads);
        let tangent = &self.tangent;
        self.chain.place(base, line, |joint, along| {
            let turn = tangent.turn(joint);
            limited(turn - along * along.dot(&turn))
        });
    }

    fn linearise(
        &mut self,
        line: &CentreLine,
        loads: &[Load],
        rows: &[Row],
        drift: &mut [f64],
        out: &mut [f64],
    ) -> usize {
        if !self.chain.fits(line) {
            return 0;
        }
        let modes = self.tangent.set(&self.chain, line, &self.resistance, loads);
        self.tangent.set_moves(&self.chain, line, rows);
        self.tangent.step(&self.chain, line, loads);
        self.tangent.drift(line, drift);
        self.tangent.add_flexibility(rows.len(), out);
        modes
    }
}

/// Limits a rotation to [`MAX_TURN`].
fn limited(angle: Vector3<f64>) -> Vector3<f64> {
    let turn = angle.norm();
    if turn > MAX_TURN {
        angle * (MAX_TURN / turn)
    } else {
        angle
    }
}
