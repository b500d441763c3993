//! A case file as it is written.

use std::path::Path;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use super::error::MaterialCaseError;
use crate::document::{self, Source, Version};

/// A test of a material: one point in simple shear.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// What the material is made of.
    pub law: Law,
    /// k of the spring-pot, 0 (a spring) to 1 (a dashpot); about 0.1 for liver.
    pub order: f64,
    /// G, above 0: of the spring-pot, kPa s^k; of the Zener body's branch, kPa.
    pub modulus_kpa: f64,
    /// Zener: G_inf of the spring beside the branch, kPa, 0 or more.
    pub modulus_inf_kpa: Option<f64>,
    /// Zener: time of the spring-pot in the branch, s, above 0.
    pub tau_s: Option<f64>,
    /// Shear strain at which the material begins to stiffen: 2/sqrt(3) of the relative strain that `solve` and `insert` take. Default:
    /// it never does.
    #[serde(alias = "knee_strain")]
    pub knee_shear: Option<f64>,
    /// a in G0 (1 + a (shear - knee_shear)^2), 0 or more. Goes with `knee_shear`.
    pub stiffening: Option<f64>,
    /// Where the stiffness stands beside the memory; they part beyond the knee only.
    #[serde(default, alias = "structure")]
    pub memory: MemoryName,
    /// How the past is summed up.
    #[serde(default)]
    pub rule: RuleName,
    /// What is done to it.
    pub history: HistorySpec,
    /// The text that it was read from, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

/// What a material is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// modulus_kpa d^k strain / dt^k = stress.
    SpringPot,
    /// A spring beside a branch of a spring in series with a spring-pot.
    Zener,
}

/// Where the stiffness stands beside the memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MemoryName {
    /// G(strain) d^k strain / dt^k = stress, as the material is measured.
    #[default]
    Rate,
    /// G(strain) strain = integral of order k of the stress, as Kobayashi et al. 2010 solve structures.
    LoadIntegral,
}

/// How the past is summed up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RuleName {
    /// Constant over a step: order 1.
    Rectangle,
    /// Linear over a step: order 2.
    Trapezoid,
    /// Gruenwald and Letnikov's difference quotient, order 1: `time_s` must be equally spaced.
    GruenwaldLetnikov,
    /// As the trapezoid, with the kernel as a sum of exponentials within 1e-10: long histories at little cost.
    #[default]
    Exponentials,
}

/// What is done to a material.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HistorySpec {
    /// Which of the two is given; the other is answered.
    pub control: ControlName,
    /// When, s, ascending; the first is the start.
    pub time_s: Vec<f64>,
    /// Stress (kPa) or strain (1) at those times, linear between them; it may jump at the start, from 0 to the first value.
    pub value: Vec<f64>,
}

/// Which of stress and strain is given.
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
    /// [`MaterialCaseError`] for a file that cannot be read or is no case.
    pub fn read(path: &Path) -> Result<Self, MaterialCaseError> {
        Self::parse(&document::read(path)?, &path.display().to_string())
    }

    /// Parses the text of a case file; `name` names it in errors.
    ///
    /// # Errors
    /// [`MaterialCaseError`] that points at what is no TOML, at a key that no case has, or at a value of the wrong type.
    pub fn parse(text: &str, name: &str) -> Result<Self, MaterialCaseError> {
        let (mut file, source): (Self, _) = document::parse(text, name)?;
        file.source = Some(source);
        Ok(file)
    }
}
