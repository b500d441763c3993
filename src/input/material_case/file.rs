//! Serde types of a case file.

use std::path::Path;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use super::error::MaterialCaseError;
use crate::base::document::{self, Source, Version};

/// A test of a material: one point in simple shear.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// Constitutive law.
    pub law: Law,
    /// k of the spring-pot, 0 (a spring) to 1 (a dashpot); about 0.1 for liver.
    pub order: f64,
    /// Modulus G, above 0: of the spring-pot, kPa s^k; of the Zener body's branch, kPa.
    pub modulus_kpa: f64,
    /// Zener: modulus G_inf of the spring in parallel with the branch, kPa, 0 or more.
    pub modulus_inf_kpa: Option<f64>,
    /// Zener: relaxation time of the spring-pot in the branch, s, above 0.
    pub tau_s: Option<f64>,
    /// Shear strain at which the material begins to stiffen: 2/sqrt(3) of the relative strain in `solve` and `insert`. Default: no
    /// stiffening.
    #[serde(alias = "knee_strain")]
    pub knee_shear: Option<f64>,
    /// Stiffening coefficient a in G0 (1 + a (shear - knee_shear)^2), 0 or more. Requires `knee_shear`.
    pub stiffening: Option<f64>,
    /// Position of the stiffness relative to the memory; the two differ only beyond the knee.
    #[serde(default, alias = "structure")]
    pub memory: MemoryName,
    /// Quadrature of the history.
    #[serde(default)]
    pub rule: RuleName,
    /// Load history.
    pub history: HistorySpec,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

/// Constitutive law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// Spring-pot: modulus_kpa d^k strain / dt^k = stress.
    SpringPot,
    /// A spring in parallel with a branch of a spring in series with a spring-pot.
    Zener,
}

/// Position of the stiffness relative to the memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MemoryName {
    /// G(strain) d^k strain / dt^k = stress, as in measurements of the material.
    #[default]
    Rate,
    /// G(strain) strain = integral of order k of the stress, as in the structural analysis of Kobayashi et al.
    /// 2010.
    LoadIntegral,
}

/// Quadrature of the history.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RuleName {
    /// Integrand constant over a step: order 1.
    Rectangle,
    /// Integrand linear over a step: order 2.
    Trapezoid,
    /// Gruenwald-Letnikov difference quotient, order 1: `time_s` must be equally spaced.
    GruenwaldLetnikov,
    /// Trapezoid with the kernel as a sum of exponentials within 1e-10: long histories at little cost.
    #[default]
    Exponentials,
}

/// Load history of a material.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HistorySpec {
    /// Prescribed quantity; the other one is computed.
    pub control: ControlName,
    /// Times, s, ascending; the first is the start.
    pub time_s: Vec<f64>,
    /// Stress (kPa) or strain (1) at these times, linear between them; it may jump at the start, from 0 to the first value.
    pub value: Vec<f64>,
}

/// Prescribed quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ControlName {
    /// Shear stress, kPa.
    Stress,
    /// Shear strain, 1.
    Strain,
}

impl CaseFile {
    /// Reads a case file.
    ///
    /// # Errors
    /// [`MaterialCaseError`] if the file cannot be read or is not a case.
    pub fn read(path: &Path) -> Result<Self, MaterialCaseError> {
        Self::parse(&document::read(path)?, &path.display().to_string())
    }

    /// Parses the text of a case file; `name` is the file name shown in errors.
    ///
    /// # Errors
    /// [`MaterialCaseError`] that points at a syntax error, an unknown key, or a value of the wrong type.
    pub fn parse(text: &str, name: &str) -> Result<Self, MaterialCaseError> {
        let (mut file, source): (Self, _) = document::parse(text, name)?;
        file.source = Some(source);
        Ok(file)
    }
}
