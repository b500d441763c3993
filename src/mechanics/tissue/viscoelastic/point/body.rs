//! Linear bodies of springs and spring-pots.

use std::f64::consts::FRAC_PI_2;

use super::{Control, check};
use crate::tissue::viscoelastic::{History, HistoryError, Operator, Rule};

/// Linear viscoelastic body in shear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rheology {
    /// Spring-pot: `modulus D^k strain = stress`. Creeps as `t^k / (G Gamma(1+k))`, relaxes as `G t^-k / Gamma(1-k)`.
    SpringPot {
        /// Order k, 0 to 1.
        order: f64,
        /// Modulus G, kPa s^k, above 0.
        modulus_kpa: f64,
    },
    /// Spring parallel to a branch of a spring in series with a spring-pot: relaxes as `G_inf + G E_k(-(t/tau)^k)`,
    /// with the Mittag-Leffler function.
    Zener {
        /// Order k, 0 to 1.
        order: f64,
        /// Modulus G of the branch, kPa, above 0.
        modulus_kpa: f64,
        /// Modulus G_inf of the parallel spring, kPa, 0 or more.
        modulus_inf_kpa: f64,
        /// Relaxation time tau of the spring-pot, whose modulus is G tau^k, s, above 0.
        tau_s: f64,
    },
}

impl Rheology {
    pub(super) fn check(&self) -> Result<(), HistoryError> {
        let (Rheology::SpringPot { order, modulus_kpa } | Rheology::Zener { order, modulus_kpa, .. }) = *self;
        let right = (0.0..=1.0).contains(&order);
        check("order", order, right, "a number from 0 (a spring) to 1 (a dashpot)")?;
        check(
            "modulus_kpa",
            modulus_kpa,
            modulus_kpa > 0.0 && modulus_kpa.is_finite(),
            "a finite number of kPa above 0",
        )?;
        if let Rheology::Zener {
            modulus_inf_kpa, tau_s, ..
        } = *self
        {
            let right = modulus_inf_kpa >= 0.0 && modulus_inf_kpa.is_finite();
            check(
                "modulus_inf_kpa",
                modulus_inf_kpa,
                right,
                "a finite number of kPa, 0 or more",
            )?;
            let right = tau_s > 0.0 && tau_s.is_finite();
            check("tau_s", tau_s, right, "a finite number of seconds above 0")?;
        }
        Ok(())
    }

    /// Returns storage and loss modulus `[G', G'']` at an angular frequency (rad/s), kPa.
    pub fn dynamic_kpa(&self, frequency: f64) -> [f64; 2] {
        match *self {
            Rheology::SpringPot { order, modulus_kpa } => {
                let (sin, cos) = (FRAC_PI_2 * order).sin_cos();
                let size = modulus_kpa * frequency.powf(order);
                [size * cos, size * sin]
            }
            Rheology::Zener {
                order,
                modulus_kpa,
                modulus_inf_kpa,
                tau_s,
            } => {
                // z / (1 + z) with z = (i w tau)^k.
                let size = (frequency * tau_s).powf(order);
                let (sin, cos) = (FRAC_PI_2 * order).sin_cos();
                let [re, im] = [size * cos, size * sin];
                let square = (1.0 + re).powi(2) + im * im;
                let share = [(re * (1.0 + re) + im * im) / square, im / square];
                [modulus_inf_kpa + modulus_kpa * share[0], modulus_kpa * share[1]]
            }
        }
    }

    /// Returns the response at the very start, when strain jumps.
    pub(super) fn at_start(&self) -> Line {
        let slope = match *self {
            Rheology::SpringPot { order, modulus_kpa } => {
                if order == 0.0 {
                    1.0 / modulus_kpa
                } else {
                    0.0
                }
            }
            Rheology::Zener {
                order,
                modulus_kpa,
                modulus_inf_kpa,
                ..
            } => {
                // A spring-pot of order 0 is a spring as stiff as the one in series with it.
                let branch = if order == 0.0 { 0.5 * modulus_kpa } else { modulus_kpa };
                1.0 / (modulus_inf_kpa + branch)
            }
        };
        Line { slope, offset: 0.0 }
    }
}

/// Line of admissible strain and stress of a body at some time: `strain = slope * stress + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    /// Slope, 1/kPa, 0 or more.
    pub slope: f64,
    pub offset: f64,
}

impl Line {
    pub(super) fn strain(&self, stress: f64) -> f64 {
        self.slope * stress + self.offset
    }

    /// Returns the stress; infinite where strain jumps and the body cannot.
    pub(super) fn stress(&self, strain: f64) -> f64 {
        let elastic = strain - self.offset;
        if elastic == 0.0 { 0.0 } else { elastic / self.slope }
    }
}

/// State of a linear body during a history.
#[derive(Debug)]
pub(super) enum Memory {
    /// Spring-pot with prescribed stress, of which it keeps the integral.
    Creep { modulus: f64, integral: Box<dyn History> },
    /// Spring-pot with prescribed strain, of which it keeps the derivative.
    Relaxation { modulus: f64, derivative: Box<dyn History> },
    /// Zener body, which keeps the integral of the branch's stress.
    Branch {
        modulus: f64,
        modulus_inf: f64,
        /// Rate 1 / tau^k.
        rate: f64,
        integral: Box<dyn History>,
    },
}

impl Memory {
    /// Starts with this strain and stress; the one that is not prescribed may be infinite.
    pub(super) fn start(
        body: &Rheology,
        rule: &Rule,
        control: Control,
        strain: f64,
        stress: f64,
    ) -> Result<Memory, HistoryError> {
        Ok(match (*body, control) {
            (Rheology::SpringPot { order, modulus_kpa }, Control::Stress) => Memory::Creep {
                modulus: modulus_kpa,
                integral: rule.start(Operator::Integral(order), &[stress])?,
            },
            (Rheology::SpringPot { order, modulus_kpa }, Control::Strain) => Memory::Relaxation {
                modulus: modulus_kpa,
                derivative: rule.start(Operator::Derivative(order), &[strain])?,
            },
            (
                Rheology::Zener {
                    order,
                    modulus_kpa,
                    modulus_inf_kpa,
                    tau_s,
                },
                _,
            ) => Memory::Branch {
                modulus: modulus_kpa,
                modulus_inf: modulus_inf_kpa,
                rate: tau_s.powf(-order),
                integral: rule.start(Operator::Integral(order), &[stress - modulus_inf_kpa * strain])?,
            },
        })
    }

    /// Returns the line of admissible strain and stress after a step.
    pub(super) fn predict(&mut self, step_s: f64) -> Result<Line, HistoryError> {
        let mut past = [0.0];
        Ok(match self {
            Memory::Creep { modulus, integral } => {
                let weight = integral.predict(step_s, &mut past)?;
                Line {
                    slope: weight / *modulus,
                    offset: past[0] / *modulus,
                }
            }
            Memory::Relaxation { modulus, derivative } => {
                let weight = derivative.predict(step_s, &mut past)?;
                Line {
                    slope: 1.0 / (*modulus * weight),
                    offset: -past[0] / weight,
                }
            }
            Memory::Branch {
                modulus,
                modulus_inf,
                rate,
                integral,
            } => {
                // The branch's stress q satisfies G strain = q + rate * I^k q.
                let one = 1.0 + *rate * integral.predict(step_s, &mut past)?;
                let stiffness = *modulus + *modulus_inf * one;
                Line {
                    slope: one / stiffness,
                    offset: *rate * past[0] / stiffness,
                }
            }
        })
    }

    /// Commits strain and stress after a step.
    pub(super) fn commit(&mut self, step_s: f64, strain: f64, stress: f64) -> Result<(), HistoryError> {
        match self {
            Memory::Creep { integral, .. } => integral.commit(step_s, &[stress]),
            Memory::Relaxation { derivative, .. } => derivative.commit(step_s, &[strain]),
            Memory::Branch {
                modulus_inf, integral, ..
            } => integral.commit(step_s, &[stress - *modulus_inf * strain]),
        }
    }
}
