//! What a problem file says of models with a history: the model, how it is solved, and how loads go over time.

mod check;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::mechanics::tissue::nonlinear::creep::Memory;
use crate::mechanics::tissue::nonlinear::{Options, Scheme, Slope};
use crate::mechanics::tissue::viscoelastic::{Rule, Span};

/// Steps of a history at most.
pub const MOST_STEPS: usize = 100_000;

/// How tissue answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Linear elastic: one solution for all loads.
    #[default]
    Linear,
    /// Stiffer above a knee of strain: `knee_strain` and `stiffening` of a material, and loads in increments.
    Nonlinear,
    /// As `nonlinear`, and viscous of a fractional order.
    Viscoelastic,
}

/// How a nonlinear problem is solved.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolverSpec {
    /// Default `newton`.
    pub scheme: SchemeName,
    /// The largest force out of balance over the largest force, above 0 and below 1. Euler steps have none. Default 1e-9.
    pub tolerance: f64,
    /// Iterations of a step at most (1 to 1000). Default 60.
    pub iterations: u32,
}

impl Default for SolverSpec {
    fn default() -> Self {
        SolverSpec {
            scheme: SchemeName::default(),
            tolerance: Options::default().tolerance,
            iterations: Options::default().iterations as u32,
        }
    }
}

/// Schemes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SchemeName {
    /// One solve a step with Kobayashi et al.'s scalar tangent; no iterations: the error falls with `step_s`.
    Euler,
    /// Iterations with a factor that is kept as long as it serves.
    ModifiedNewton,
    /// Iterations with the consistent tangent, factored at each.
    #[default]
    Newton,
}

/// The viscosity of tissue.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ViscositySpec {
    /// Order k of the derivative, 0 (elastic) to 1 (viscous); moduli are in kPa s^k. Default 0.1, porcine liver's.
    pub order: f64,
    /// What remembers. Default `load-integral`.
    #[serde(alias = "law")]
    pub memory: MemoryName,
    /// How the history is summed up. Default `exponentials`.
    pub rule: RuleName,
}

impl Default for ViscositySpec {
    fn default() -> Self {
        ViscositySpec {
            order: 0.1,
            memory: MemoryName::default(),
            rule: RuleName::default(),
        }
    }
}

/// What viscoelastic tissue remembers; the two part above the knee.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MemoryName {
    /// The loads: K(U) U is their integral of order k, that of Kobayashi et al. 2010.
    #[default]
    LoadIntegral,
    /// The rates: K(U) times the derivative of order k of U is the loads.
    Rate,
}

/// Rules of histories.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RuleName {
    /// Product rectangle, first order, that of Kobayashi et al. 2010.
    Rectangle,
    /// Product trapezoid, second order.
    Trapezoid,
    /// Gruenwald and Letnikov's, for equal steps only.
    GruenwaldLetnikov,
    /// The trapezoid with a sum of exponentials, within 1e-9: a step costs the same however long the history.
    #[default]
    Exponentials,
}

/// How loads and prescribed displacements go over time.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HistorySpec {
    /// Times, s: the first 0, ascending.
    pub time_s: Vec<f64>,
    /// What every load and displacement is multiplied by at these times, linear between. A `[[load]]` or `[[fix]]` may have its own.
    pub factor: Vec<f64>,
    /// The longest step, s (above 0).
    pub step_s: f64,
}

/// Without a history loads grow from nothing in ten steps.
impl Default for HistorySpec {
    fn default() -> Self {
        HistorySpec {
            time_s: vec![0.0, 1.0],
            factor: vec![0.0, 1.0],
            step_s: 0.1,
        }
    }
}

/// A moment of a history: its time, and where it lies between the times given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Moment {
    pub time_s: f64,
    pub after: usize,
    pub share: f64,
}

impl Moment {
    /// A factor now.
    pub fn of(&self, factors: &[f64]) -> f64 {
        let (low, high) = (factors[self.after], factors[self.after + 1]);
        low + self.share * (high - low)
    }
}

impl HistorySpec {
    /// The start, and the end of each step.
    pub(super) fn moments(&self) -> Vec<Moment> {
        let mut moments = vec![Moment {
            time_s: self.time_s[0],
            after: 0,
            share: 0.0,
        }];
        for (after, pair) in self.time_s.windows(2).enumerate() {
            let length = pair[1] - pair[0];
            let steps = self.steps(length);
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                let time_s = if step == steps {
                    pair[1]
                } else {
                    pair[0] + share * length
                };
                moments.push(Moment { time_s, after, share });
            }
        }
        moments
    }

    fn steps(&self, length: f64) -> usize {
        // A length that is a whole number of steps but for rounding takes that number.
        ((length / self.step_s * (1.0 - 1e-12)).ceil() as usize).max(1)
    }
}

impl SolverSpec {
    pub(super) fn options(&self) -> Options {
        Options {
            scheme: self.scheme.into(),
            tolerance: self.tolerance,
            iterations: self.iterations as usize,
        }
    }
}

impl From<SchemeName> for Scheme {
    fn from(name: SchemeName) -> Scheme {
        match name {
            SchemeName::Euler => Scheme::Euler {
                slope: Slope::Scalar,
                corrected: false,
            },
            SchemeName::ModifiedNewton => Scheme::MODIFIED,
            SchemeName::Newton => Scheme::Newton,
        }
    }
}

impl From<MemoryName> for Memory {
    fn from(name: MemoryName) -> Memory {
        match name {
            MemoryName::LoadIntegral => Memory::LoadIntegral,
            MemoryName::Rate => Memory::Rate,
        }
    }
}

impl ViscositySpec {
    /// The rule, for steps of these moments.
    pub(super) fn rule(&self, moments: &[Moment]) -> Rule {
        match self.rule {
            RuleName::Rectangle => Rule::Rectangle,
            RuleName::Trapezoid => Rule::Trapezoid,
            RuleName::GruenwaldLetnikov => Rule::GruenwaldLetnikov,
            RuleName::Exponentials => {
                let steps = moments.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
                Rule::Exponentials(Span {
                    // A hair of slack, for what rounding does to times.
                    shortest_s: 0.999 * steps.fold(f64::INFINITY, f64::min),
                    longest_s: 1.001 * moments[moments.len() - 1].time_s,
                    ..Span::default()
                })
            }
        }
    }
}

impl Model {
    /// As it is written.
    pub const fn name(self) -> &'static str {
        match self {
            Model::Linear => "linear",
            Model::Nonlinear => "nonlinear",
            Model::Viscoelastic => "viscoelastic",
        }
    }
}
