//! Strain and stress in the elements of a solved problem.

use crate::mechanics::tissue::nonlinear::{Solid, von_mises};

/// Symmetric tensors of each element: xx, yy, zz, xy, yz and xz.
#[derive(Clone, Debug, PartialEq)]
pub struct Fields {
    /// Strain; shear as tensor components, half of the engineering shear strain.
    pub strain: Vec<[f64; 6]>,
    /// Stress, kPa.
    pub stress_kpa: Vec<[f64; 6]>,
}

fn six(m: [[f64; 3]; 3]) -> [f64; 6] {
    [m[0][0], m[1][1], m[2][2], m[0][1], m[1][2], m[0][2]]
}

impl Fields {
    /// Fields of a body displaced by `displacement`, with the stress due to `strained`, both in mm.
    pub(super) fn of(body: &Solid, displacement: &[f64], strained: &[f64]) -> Fields {
        Self::with(body, displacement, &body.stresses_kpa(displacement, strained))
    }

    /// Fields of a displaced body with known stress, kPa.
    pub(super) fn with(body: &Solid, displacement: &[f64], stress_kpa: &[[[f64; 3]; 3]]) -> Fields {
        Fields {
            strain: body.strains(displacement).into_iter().map(six).collect(),
            stress_kpa: stress_kpa.iter().copied().map(six).collect(),
        }
    }

    /// Von Mises stress of each element, kPa.
    pub fn von_mises_kpa(&self) -> Vec<f64> {
        let equivalent = |&[xx, yy, zz, xy, yz, xz]: &[f64; 6]| von_mises(&[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]);
        self.stress_kpa.iter().map(equivalent).collect()
    }
}
