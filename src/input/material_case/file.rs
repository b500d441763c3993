//! Serde types of a case file, and its errors.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::base::document::{self, Source, Version};
use crate::base::range::parameters;
use crate::input::{Cause, InputError};
use crate::mechanics::tissue::viscoelastic::HistoryError;
use crate::mechanics::tissue::viscoelastic::point::{Loading, Method, Structure};

parameters! {
    /// A test of a material: one point in simple shear.
    pub struct CaseFile with required keys {
        /// Version of the format: 1, which is the default.
        version: Option<Version>;
        /// Constitutive law.
        law: Law;
        /// k of the spring-pot: 0 for a spring, 1 for a dashpot; about 0.1 for liver.
        order: f64, in 0..=1;
        /// Modulus G: of the spring-pot, kPa s^k; of the Zener body's branch, kPa.
        modulus_kpa: f64, above 0;
        /// Zener: modulus G_inf of the spring in parallel with the branch.
        modulus_inf_kpa: Option<f64>, in 0 "kPa";
        /// Zener: relaxation time of the spring-pot in the branch.
        tau_s: Option<f64>, above 0 "s";
        /// Shear strain at which the material begins to stiffen: 2/sqrt(3) of the relative strain in `solve` and `insert`. Default: no
        /// stiffening.
        #[serde(alias = "knee_strain")]
        knee_shear: Option<f64>;
        /// Stiffening coefficient a in G0 (1 + a (shear - knee_shear)^2). Requires `knee_shear`.
        stiffening: Option<f64>, in 0;
        /// Position of the stiffness relative to the memory; the two differ only beyond the knee.
        #[serde(default, alias = "structure")]
        memory: Structure;
        /// Quadrature of the history.
        #[serde(default)]
        rule: Method;
        /// Load history.
        history: Loading;
        /// Source text, for errors that point into it.
        #[serde(skip)]
        source: Option<Arc<Source>>;
    }
}

document::input_file!(CaseFile, Cause);

/// Constitutive law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// Spring-pot: modulus_kpa d^k strain / dt^k = stress.
    SpringPot,
    /// A spring in parallel with a branch of a spring in series with a spring-pot.
    Zener,
}

impl CaseFile {
    /// Attaches the key concerned to an error.
    pub(super) fn blame(&self, error: HistoryError) -> InputError {
        let key = match &error {
            HistoryError::Number(error) => match error.key.as_str() {
                // In a case file the knee refers to the shear strain.
                "knee_strain" => "knee_shear".to_owned(),
                key if key.starts_with("time_s") || key.starts_with("value") => format!("history.{key}"),
                key => key.to_owned(),
            },
            HistoryError::Lengths { .. } => "history.value".to_owned(),
            HistoryError::Overflow { .. } => "history.value".to_owned(),
            _ => "history.time_s".to_owned(),
        };
        InputError::new(error).at_key(key, self.source.as_ref())
    }
}
