//! A point of tissue in simple shear: stress from strain, or strain from stress.
//!
//! A linear [`Body`] relates shear strain and shear stress by its memory. A [`Knee`] makes it stiffer at large strain, after the
//! creep tests of Kobayashi et al. 2010 (figure 8, equation 3), in one of the two ways that the [module above](super) tells apart
//! ([`Structure`]). With `s` for how much stiffer the tissue is at a strain than below the knee, and `B` for what the linear body
//! makes of a history of strain:
//!
//! - `rate`: `tau(t) = s(gamma(t)) * (B gamma)(t)`, which for a spring-pot is Kobayashi et al.'s `G(gamma) d^k gamma / dt^k = tau`;
//! - `load-integral`: `tau(t) = (B (s(gamma) gamma))(t)`, for a spring-pot `G(gamma) gamma = I^k tau`.
//!
//! In simple shear the relative strain that decides in a structure is `e_r = sqrt(3)/2 gamma`: a knee at gamma0 is one at
//! `sqrt(3)/2 gamma0` there, and the stiffening for e_r is 4/3 of that for gamma.

mod balance;
mod body;
mod respond;

pub use crate::mechanics::tissue::knee::Knee;
pub use body::Body;
pub use respond::{Loading, Method, Response};

use super::HistoryError;

/// Where the stiffness stands beside the memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Structure {
    /// Stiffness times the rate: the material as Kobayashi et al. 2010 (equation 4) write it.
    #[default]
    Rate,
    /// Stiffness times the strain is the integral of the load: as Kobayashi et al. 2010 (equation 12) solve it.
    LoadIntegral,
}

/// Which of stress and strain is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Shear stress, kPa.
    Stress,
    /// Shear strain, 1.
    Strain,
}

/// A material point in simple shear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The linear body below the knee.
    pub body: Body,
    /// Where it stiffens.
    pub knee: Knee,
    /// How stiffening and memory go together.
    pub structure: Structure,
}

/// Why there is no response.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PointError {
    /// A number of the material or of its history is out of range.
    #[error("found {found}; expected {expected}")]
    Number {
        /// The key of the number: as in [`Body`], [`Knee`] and [`Loading`].
        key: &'static str,
        /// Where in a list it stands, from 0.
        at: Option<usize>,
        /// As given.
        found: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// There are not as many values as times, or none.
    #[error("found {values} values at {times} times; expected a value for each, and at least one")]
    Lengths {
        /// Number of times.
        times: usize,
        /// Number of values.
        values: usize,
    },
    /// The rule cannot follow the history.
    #[error(transparent)]
    History(#[from] HistoryError),
    /// Stress or strain has left the range of numbers.
    #[error("the response at {time_s} s is no finite number; expected smaller moduli, strains or stresses")]
    Overflow {
        /// When, s.
        time_s: f64,
    },
}

/// Checks a number, or says by its key what it should be.
fn check(key: &'static str, found: f64, right: bool, expected: &'static str) -> Result<(), PointError> {
    let at = None;
    right.then_some(()).ok_or(PointError::Number {
        key,
        at,
        found,
        expected,
    })
}

impl Point {
    /// Checks every number of the material.
    ///
    /// # Errors
    /// [`PointError::Number`].
    pub fn check(&self) -> Result<(), PointError> {
        self.body.check()?;
        self.knee.check().map_err(|error| PointError::Number {
            key: error.key,
            at: None,
            found: error.found,
            expected: error.expected,
        })
    }
}

#[cfg(test)]
mod tests;
