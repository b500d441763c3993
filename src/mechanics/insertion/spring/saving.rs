//! Saved states of the mass-spring model. JSON keeps every bit of a number, so that a round trip through text changes
//! nothing.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::MassSpring;
use super::body::NeedleState;
use super::contacts::Contact;
use crate::insertion::{Outcome, Saved, StepError};

/// A saved model.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    /// Identity of the model: the version of this format, its parameters and its needle as text.
    model: String,
    needle: NeedleState,
    outcome: Outcome,
    contacts: Vec<Contact>,
    /// Frame of the cylinder to world.
    frame: Isometry3<f64>,
    /// Moved nodes with their rest positions, mm.
    moved: Vec<(u32, Vector3<f64>)>,
    /// Displacements of all nodes, mm; none at rest.
    displacement: Vec<Vector3<f64>>,
    /// Velocities of all nodes, mm/s; none at rest.
    velocity: Vec<Vector3<f64>>,
}

impl State {
    /// Checks that the state fits a model of so many nodes and elements.
    fn check(&self, nodes: usize, elements: usize) -> Result<(), String> {
        let line = self.needle.line.nodes();
        if line.len() == 1 || line.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return Err("the needle's arcs do not rise".into());
        }
        if self.needle.element as usize >= elements {
            let element = self.needle.element;
            return Err(format!("an element is {element}; expected one below {elements}"));
        }
        let named = self.contacts.iter().map(|contact| contact.node);
        let mut named = named.chain(self.moved.iter().map(|(node, _)| *node));
        if let Some(node) = named.find(|node| *node as usize >= nodes) {
            return Err(format!("a node is {node}; expected one below {nodes}"));
        }
        let expected = if self.needle.active { nodes } else { 0 };
        match [&self.displacement, &self.velocity].map(Vec::len) {
            [displacements, velocities] if displacements != expected || velocities != expected => Err(format!(
                "it holds {displacements} displacements and {velocities} velocities; expected {expected} of each"
            )),
            _ => Ok(()),
        }
    }
}

impl MassSpring {
    pub(super) fn to_saved(&self) -> Saved {
        let network = &self.network;
        let rest_positions = (0..).zip(network.reference.iter().zip(&network.original));
        let moved = rest_positions.filter(|(_, (now, original))| now != original);
        let moving = |field: &[Vector3<f64>]| if self.body.active { field.to_vec() } else { Vec::new() };
        let state = State {
            model: self.name.clone(),
            needle: self.body.clone(),
            outcome: self.outcome.clone(),
            contacts: self.contacts.stack.clone(),
            frame: self.frame,
            moved: moved.map(|(node, (now, _))| (node, *now)).collect(),
            displacement: moving(&network.displacement),
            velocity: moving(&network.velocity),
        };
        match serde_json::to_value(state) {
            Ok(value) => Saved(value),
            Err(error) => unreachable!("numbers, lists and names: {error}"),
        }
    }

    pub(super) fn take_saved(&mut self, saved: &Saved) -> Result<(), StepError> {
        let model = &self.name;
        if let Some(saved_model) = saved.0["model"].as_str().filter(|saved_model| **saved_model != *model) {
            return Err(StepError::Foreign(format!("found `{saved_model}`; expected `{model}`")));
        }
        let state = State::deserialize(&saved.0).map_err(|error| StepError::Foreign(error.to_string()))?;
        let network = &mut self.network;
        let checked = state.check(network.original.len(), network.elements.len());
        checked.map_err(StepError::Foreign)?;
        self.frame = state.frame;
        network.place(&state.frame);
        for (node, reference) in state.moved {
            network.reference[node as usize] = reference;
        }
        network.measure_all();
        if state.needle.active {
            network.displacement.copy_from_slice(&state.displacement);
            network.velocity.copy_from_slice(&state.velocity);
        }
        self.contacts.stack.clear();
        self.contacts.stack.extend(state.contacts);
        (self.body, self.outcome) = (state.needle, state.outcome);
        Ok(())
    }
}
