//! Needle with resisting joints: the solver common to the flexible models.

use std::f64::consts::FRAC_PI_4;

use faer::Mat;
use nalgebra::{Isometry3, Vector3};

use super::chain::Chain;
use super::tangent::Tangent;
use super::{CentreLine, Load, Row};

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
    pub fn entry(&self, row: usize, column: usize, count: usize) -> f64 {
        match self {
            Resistance::Springs(kappa) if row == column => *kappa,
            Resistance::Springs(_) => 0.0,
            Resistance::Coupled(entries) => entries[row * count + column],
        }
    }
}

/// Links with joints between them. See [`Tangent`] for the solution of the joint rotations.
#[derive(Clone, Debug)]
pub(super) struct Jointed {
    pub chain: Chain,
    radius_mm: f64,
    resistance: Resistance,
    tangent: Tangent,
}

impl Jointed {
    pub fn new(chain: Chain, radius_mm: f64, resistance: Resistance) -> Self {
        Self {
            chain,
            radius_mm,
            resistance,
            tangent: Tangent::default(),
        }
    }

    pub fn length_mm(&self) -> f64 {
        self.chain.length_mm()
    }

    pub fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// Places the centre line; see [`Needle::place`](super::Needle::place).
    pub fn place(&mut self, base: &Isometry3<f64>, about: &[Load], loads: &[Load], line: &mut CentreLine) {
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

    /// Linearises the shape; see [`Needle::linearise`](super::Needle::linearise).
    pub fn linearise(
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
        let ways = self.tangent.set(&self.chain, line, &self.resistance, loads);
        self.tangent.set_moves(&self.chain, line, rows);
        self.tangent.step(&self.chain, line, loads);
        self.tangent.drift(line, drift);
        self.tangent.add_flexibility(out);
        ways
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
