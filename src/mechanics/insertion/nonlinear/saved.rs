//! Saved states of an insertion into stiffening tissue.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use super::{NeedleLine, Nonlinear};
use crate::insertion::pushing::At;
use crate::insertion::{Saved, StepError};
use crate::needle::CentreLine;

/// Everything that a step depends on.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct State {
    name: String,
    steps: u64,
    time_s: f64,
    behind_s: f64,
    travel_mm: f64,
    region: Option<i32>,
    crushed: usize,
    line: CentreLine,
    seeds: Vec<Point3<f64>>,
    #[serde(rename = "way")]
    axis: Option<NeedleLine>,
    at: At,
    /// State of the body, and its history.
    body: [Vec<f64>; 2],
}

impl<const D: usize, const N: usize> Nonlinear<D, N> {
    pub(super) fn save_state(&mut self) -> Saved {
        let (at, body) = match self.needle.export_state() {
            Ok(state) => state,
            Err(error) => unreachable!("a scalar tangent that was factored before can be again: {error}"),
        };
        let state = State {
            name: self.name.clone(),
            steps: self.steps,
            time_s: self.time_s,
            behind_s: self.behind_s,
            travel_mm: self.travel_mm,
            region: self.region,
            crushed: self.outcome.crushed,
            line: self.line.clone(),
            seeds: self.seeds.clone(),
            axis: self.axis.clone(),
            at,
            body,
        };
        match serde_json::to_value(state) {
            Ok(value) => Saved(value),
            Err(error) => unreachable!("numbers, lists and names: {error}"),
        }
    }

    pub(super) fn take_saved(&mut self, saved: &Saved) -> Result<(), StepError> {
        let state = State::deserialize(&saved.0).map_err(|error| StepError::Foreign(error.to_string()))?;
        if state.name != self.name {
            let (found, expected) = (state.name, &self.name);
            return Err(StepError::Foreign(format!("found `{found}`; expected `{expected}`")));
        }
        let (axis, at) = (std::mem::replace(&mut self.axis, state.axis), self.needle.at());
        self.take_axis();
        let [body, past] = &state.body;
        if let Err(error) = self.needle.import_state(state.at, [body, past]) {
            self.axis = axis;
            self.take_axis();
            self.needle.put_at(at);
            return Err(StepError::Foreign(error.to_string()));
        }
        (self.steps, self.time_s, self.behind_s) = (state.steps, state.time_s, state.behind_s);
        (self.travel_mm, self.region) = (state.travel_mm, state.region);
        (self.line, self.seeds) = (state.line, state.seeds);
        self.outcome.begin();
        self.outcome.crushed = state.crushed;
        Ok(())
    }
}
