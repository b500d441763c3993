//! Material point in simple shear: stress from strain, or strain from stress.
//!
//! A linear [`Rheology`] relates shear strain and shear stress through its memory. A [`Knee`] stiffens it at large
//! strain, after the creep tests of Kobayashi et al. 2010 (figure 8, equation 3), by one of the two laws of the [module
//! above](super) ([`Structure`]). With `s` the stiffness at a strain relative to that below the knee, and `B` the
//! operator of the linear body on a history of strain:
//!
//! - `rate`: `tau(t) = s(gamma(t)) * (B gamma)(t)`, which for a spring-pot is Kobayashi et al.'s
//!   `G(gamma) d^k gamma / dt^k = tau`;
//! - `load-integral`: `tau(t) = (B (s(gamma) gamma))(t)`, for a spring-pot `G(gamma) gamma = I^k tau`.
//!
//! In simple shear the relative strain of a structure is `e_r = sqrt(3)/2 gamma`: a knee at gamma0 is one at `sqrt(3)/2
//! gamma0` there, and the stiffening for e_r is 4/3 of that for gamma.

mod balance;
mod body;
mod respond;

pub use crate::tissue::knee::Knee;
pub use body::Rheology;
pub use respond::{Loading, Method, Response};

use insonify_base::range::OutOfRange;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::HistoryError;

/// Relation of stiffness and memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Structure {
    /// Stiffness times the rate is the stress, as Kobayashi et al. 2010 (equation 4) state the material law.
    #[default]
    Rate,
    /// Stiffness times the strain is the integral of the load, as Kobayashi et al. 2010 (equation 12) solve it.
    LoadIntegral,
}

/// Prescribed quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Control {
    /// Shear stress, kPa.
    Stress,
    /// Shear strain, dimensionless.
    Strain,
}

/// Material point in simple shear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Linear body below the knee.
    pub body: Rheology,
    /// Strain-stiffening law.
    pub knee: Knee,
    /// Relation of stiffening and memory.
    pub structure: Structure,
}

/// Returns an error with the key and the expected values unless `right`.
fn check(key: &'static str, found: f64, right: bool, expected: &'static str) -> Result<(), HistoryError> {
    if right {
        Ok(())
    } else {
        Err(OutOfRange::new(key, found, expected).into())
    }
}

impl Point {
    /// Checks all parameters of the material.
    ///
    /// # Errors
    /// [`HistoryError::Number`] for a parameter that is out of range.
    pub fn check(&self) -> Result<(), HistoryError> {
        self.body.check()?;
        Ok(self.knee.check()?)
    }
}

#[cfg(test)]
mod tests;
