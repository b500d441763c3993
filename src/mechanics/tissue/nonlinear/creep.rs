//! Fractional viscosity of a stiffening body, with two memory laws.
//!
//! A material point obeys E(e_r) d^k epsilon / dt^k = sigma (Kobayashi et al. 2010, equation 7), a structure K(U) D^k U
//! = F (their equation 9). Moduli are then in kPa s^k. There are two methods:
//!
//! - [`Memory::Rate`] solves it as stated: stress is E(e_r(U)) times the elasticity of the strain's rate of order k.
//!   With the rates V = D^k U and their history, U_n = w_0 V_n + H_n, so that K(U_n) (U_n - H_n) = w_0 F_n.
//! - [`Memory::LoadIntegral`] is that of Kobayashi et al. (equation 12): K(U) U = F' with F' = I^k F, the loads
//!   integrated one by one. Where displacements are prescribed the reaction is unknown and part of F: K(U_n) U_n = w_0
//!   F_n + H_n.
//!
//! They agree while K is constant. Above the knee they differ, as the second divides all past loads by the current
//! stiffness, as if tissue had always been as stiff: under a constant load it creeps as t^k over the current stiffness,
//! while the first yields according to the stiffness of each moment.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::NonlinearError;
use super::solver::{Contact, Progress, Solver, Target};
use crate::tissue::viscoelastic::{History, Operator, Rule};

/// Quantity whose history is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Memory {
    /// History of the loads: K(U) U = I^k F, as Kobayashi et al. 2010 solve it.
    #[default]
    LoadIntegral,
    /// History of the rates: K(U) D^k U = F, as the material law is stated.
    Rate,
}

/// Body with memory, and its current state. Before the start it is at rest and unloaded.
#[derive(Clone, Debug)]
pub struct Creep<const D: usize, const N: usize> {
    solver: Solver<D, N>,
    memory: Memory,
    /// Integral of order k of the remembered quantity.
    history: Box<dyn History>,
    past: Vec<f64>,
    loads: Vec<f64>,
    /// Current value of the remembered quantity: forces or rates.
    value: Vec<f64>,
    forces: Vec<f64>,
    contact: f64,
    stress: Option<Stresses<D>>,
}

/// Stress of each element, kPa. Where loads are remembered, so is stress: E(e_r) D epsilon is its integral, element by
/// element.
#[derive(Clone, Debug)]
struct Stresses<const D: usize> {
    now: Vec<[[f64; D]; D]>,
    history: Option<Box<dyn History>>,
    past: Vec<f64>,
}

impl<const D: usize, const N: usize> Creep<D, N> {
    /// Starts a history of order `order` (0, elastic, to 1, viscous) with `loads` (N on each degree of freedom), which
    /// may jump there. Prescribed displacements cannot jump: the force would be unbounded.
    ///
    /// # Errors
    /// [`NonlinearError`] for a displaced body, a law without a secant, an invalid order or rule, or a wrong number of
    /// loads.
    pub fn new(
        mut solver: Solver<D, N>,
        memory: Memory,
        order: f64,
        rule: Rule,
        loads: &[f64],
    ) -> Result<Self, NonlinearError> {
        if solver.displacement().iter().any(|u| *u != 0.0) {
            return Err(NonlinearError::Displaced);
        }
        if !solver.body().has_secants() {
            return Err(NonlinearError::NoSecant);
        }
        // At the start nothing is strained, and the body responds as below the knee.
        let (rate, forces) = solver.at_rest(loads)?;
        let value = match memory {
            Memory::LoadIntegral => forces.clone(),
            Memory::Rate => rate,
        };
        let history = rule.start(Operator::Integral(order), &value)?;
        Ok(Creep {
            memory,
            history,
            past: vec![0.0; loads.len()],
            loads: loads.to_vec(),
            value,
            forces,
            contact: 0.0,
            stress: None,
            solver,
        })
    }

    /// Tracks the stress in elements as well, from the start, with the rule and the order of the history; where loads
    /// are remembered, its history takes D^2 numbers per element.
    ///
    /// # Errors
    /// [`NonlinearError`] after the start, or for an invalid order or rule.
    pub fn follow_stress(&mut self, order: f64, rule: Rule) -> Result<(), NonlinearError> {
        if self.time_s() > 0.0 {
            return Err(NonlinearError::Displaced);
        }
        let rate = self.solver.at_rest(&self.loads)?.0;
        let at_rest = vec![0.0; rate.len()];
        let now = self.solver.body().stresses_kpa(&at_rest, &rate);
        let initial = now.as_flattened().as_flattened();
        let history = match self.memory {
            Memory::LoadIntegral => Some(rule.start(Operator::Integral(order), initial)?),
            Memory::Rate => None,
        };
        let past = vec![0.0; initial.len()];
        self.stress = Some(Stresses { now, history, past });
        Ok(())
    }

    /// Stress of each element, kPa, where it is [tracked](Self::follow_stress).
    pub fn stress_kpa(&self) -> Option<&[[[f64; D]; D]]> {
        self.stress.as_ref().map(|stress| &stress.now[..])
    }

    /// Displacements, mm.
    pub fn displacement(&self) -> &[f64] {
        self.solver.displacement()
    }

    /// Forces on all degrees of freedom, N: loads at free ones, loads plus reactions at prescribed ones.
    pub fn forces(&self) -> &[f64] {
        &self.forces
    }

    /// Contact force along its direction, N.
    pub fn contact_force(&self) -> f64 {
        self.contact
    }

    /// Time since the start, s.
    pub fn time_s(&self) -> f64 {
        self.history.time_s()
    }

    /// Solver with the state of the last step; its forces are those of its virtual loads.
    pub fn solver(&self) -> &Solver<D, N> {
        &self.solver
    }

    /// Exports the state as numbers, with the history, for a body of the same kind to [import](Self::import_state).
    /// Cached data are recomputed, so that both bodies continue identically.
    ///
    /// # Errors
    /// [`NonlinearError`] where the stiffness cannot be factored.
    pub(crate) fn export_state(&mut self) -> Result<[Vec<f64>; 2], NonlinearError> {
        let state = self.solver.export_state(self.memory == Memory::Rate)?;
        Ok([state, self.history.remembered()])
    }

    /// Imports a state: the same steps then give the same bits. [`forces`](Self::forces) and
    /// [`contact_force`](Self::contact_force) are valid only after the next step. Stress is no longer tracked.
    ///
    /// # Errors
    /// [`NonlinearError`] for numbers that do not fit such a body.
    pub(crate) fn import_state(&mut self, [state, past]: [&[f64]; 2]) -> Result<(), NonlinearError> {
        let before = self.history.clone();
        self.history.recall(past)?;
        if let Err(error) = self.solver.import_state(state, self.memory == Memory::Rate) {
            self.history = before;
            return Err(error);
        }
        // The state has no history of the stress.
        self.stress = None;
        Ok(())
    }

    /// Size of the history, bytes.
    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        self.history.bytes()
    }

    /// Advances by `step_s` seconds to the loads, prescribed displacements (as in [`Target`]) and contact at the end of
    /// the step.
    ///
    /// # Errors
    /// [`NonlinearError`]; the body is then unchanged.
    pub fn step(
        &mut self,
        step_s: f64,
        loads: &[f64],
        prescribed: &[f64],
        contact: Option<&Contact>,
    ) -> Result<&Progress, NonlinearError> {
        let plain = Target {
            loads,
            prescribed,
            contact,
            offset: None,
        };
        plain.check(self.solver.supports())?;
        let weight = self.history.predict(step_s, &mut self.past)?;
        let remembers_loads = self.memory == Memory::LoadIntegral;
        for ((sum, load), past) in self.loads.iter_mut().zip(loads).zip(&self.past) {
            *sum = weight * load + if remembers_loads { *past } else { 0.0 };
        }
        self.solver.step(&Target {
            loads: &self.loads,
            offset: (!remembers_loads).then_some(&self.past[..]),
            ..plain
        })?;
        self.contact = self.solver.contact_force() / weight;
        self.forces.copy_from_slice(loads);
        if let Some(contact) = contact {
            contact.add(self.contact, &mut self.forces);
        }
        // Loads are known at free degrees of freedom; the forces at others follow from the balance.
        for &dof in self.solver.supports().prescribed() {
            let dof = dof as usize;
            let past = if remembers_loads { self.past[dof] } else { 0.0 };
            self.forces[dof] = (self.solver.forces()[dof] - past) / weight;
        }
        if remembers_loads {
            self.value.copy_from_slice(&self.forces);
        } else {
            let unknowns = self.solver.displacement().iter().zip(&self.past);
            self.value
                .iter_mut()
                .zip(unknowns)
                .for_each(|(rate, (u, past))| *rate = (u - past) / weight);
        }
        self.history.commit(step_s, &self.value)?;
        self.step_stress(step_s)?;
        Ok(self.solver.progress())
    }

    fn step_stress(&mut self, step_s: f64) -> Result<(), NonlinearError> {
        let Some(Stresses { now, history, past }) = &mut self.stress else {
            return Ok(());
        };
        let (body, displacement) = (self.solver.body(), self.solver.displacement());
        let Some(history) = history else {
            *now = body.stresses_kpa(displacement, &self.value);
            return Ok(());
        };
        *now = body.stresses_kpa(displacement, displacement);
        let weight = history.predict(step_s, past)?;
        let values = now.as_flattened_mut().as_flattened_mut();
        for (value, past) in values.iter_mut().zip(past) {
            *value = (*value - *past) / weight;
        }
        history.commit(step_s, values)?;
        Ok(())
    }
}
