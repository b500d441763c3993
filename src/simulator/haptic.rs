//! The part for the haptic thread.

use std::time::Instant;

use super::Options;
use super::forces::{Easing, Forces, Given};
use super::hand_over::{Publisher, hand_over};
use super::imaging::{Imaging, InvalidImaging};
use super::recording::{Input, Recording, State};
use crate::mechanics::insertion::{Instruments, LevelChange, Model, Outcome, StepError};
use crate::mechanics::tissue::remesh::Level;
use crate::synth::Synthesizer;

/// Steps a model on the caller's thread.
///
/// A step allocates nothing of its own but for the memory of a recording while there is one.
pub struct Haptic {
    model: Box<dyn Model>,
    options: Options,
    time_s: f64,
    easing: Easing,
    publisher: Option<Publisher>,
    recording: Option<Recording>,
}

impl Haptic {
    /// A model that nobody images.
    pub fn new(model: Box<dyn Model>, options: Options) -> Self {
        Self {
            model,
            options,
            time_s: 0.0,
            easing: Easing::default(),
            publisher: None,
            recording: None,
        }
    }

    /// What images this model, from the state that it is in, in place of what imaged it before. See
    /// [`Simulator::new`](super::Simulator::new).
    ///
    /// # Errors
    /// [`InvalidImaging`].
    pub fn imaged(&mut self, synthesizer: Synthesizer, needle_diameter_mm: f64) -> Result<Imaging, InvalidImaging> {
        let (mut publisher, latest) = hand_over();
        let imaging = Imaging::new(synthesizer, self.model.imager(), needle_diameter_mm, latest)?;
        publisher.publish(&mut *self.model);
        self.publisher = Some(publisher);
        Ok(imaging)
    }

    /// Makes one step of `dt_s` simulated seconds to where the instruments are now, and hands the state over to the
    /// image if there is one.
    ///
    /// # Errors
    /// [`StepError`]; then nothing has changed, and the hand keeps what it had.
    pub fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<Forces, StepError> {
        let start = Instant::now();
        let computed = Given::of(self.model.step(instruments, dt_s)?);
        self.time_s += dt_s;
        if let Some(recording) = &mut self.recording {
            recording.inputs.push(Input {
                instruments: *instruments,
                dt_s,
            });
        }
        if let Some(publisher) = &mut self.publisher {
            publisher.publish(&mut *self.model);
        }
        let took = start.elapsed();
        let overrun = took.checked_sub(self.options.budget).filter(|late| !late.is_zero());
        let given = self.easing.next(computed, dt_s, overrun.is_some(), self.options.policy);
        Ok(given.forces(instruments, self.options.probe_points, took, overrun))
    }

    /// Changes the level of remeshing, and tells what that took and by how much the force on the hand jumps. It may take longer than a
    /// step: see [`Model::set_level`]. A recording begins anew, from the state now, as states and inputs do not hold the level.
    ///
    /// # Errors
    /// [`StepError`]; the level is then as before.
    pub fn set_level(&mut self, level: Level) -> Result<LevelChange, StepError> {
        let change = self.model.set_level(level)?;
        if let Some(publisher) = &mut self.publisher {
            publisher.publish(&mut *self.model);
        }
        if self.recording.is_some() {
            self.record();
        }
        Ok(change)
    }

    /// All that the last step found. Its forces are those of the model, which an easing [`Policy`](super::Policy) may
    /// still keep from the hand.
    pub fn outcome(&self) -> &Outcome {
        self.model.outcome()
    }

    /// Simulated time, s.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The state: put back, the same steps give the same outcomes, bit for bit.
    pub fn save(&mut self) -> State {
        State {
            time_s: self.time_s,
            model: self.model.save(),
        }
    }

    /// Goes back to a saved state, and hands it over to the image. The next step gives the forces of the model, eased
    /// by nothing before. A recording begins anew, from this state.
    ///
    /// # Errors
    /// [`StepError::Foreign`]; then nothing has changed.
    pub fn restore(&mut self, state: &State) -> Result<(), StepError> {
        self.model.restore(&state.model)?;
        self.time_s = state.time_s;
        self.easing = Easing::default();
        if let Some(publisher) = &mut self.publisher {
            publisher.publish(&mut *self.model);
        }
        if self.recording.is_some() {
            self.record();
        }
        Ok(())
    }

    /// Records the inputs of steps from here on, in place of what was recorded so far.
    pub fn record(&mut self) {
        self.recording = Some(Recording {
            start: self.save(),
            inputs: Vec::new(),
        });
    }

    /// Ends a recording and gives it.
    pub fn take_recording(&mut self) -> Option<Recording> {
        self.recording.take()
    }

    /// Goes back to where a recording began and makes its steps again; `seen` gets what each of them finds.
    ///
    /// # Errors
    /// [`StepError`]; the steps before it are made.
    pub fn replay(&mut self, recording: &Recording, mut seen: impl FnMut(&Forces, &Outcome)) -> Result<(), StepError> {
        self.restore(&recording.start)?;
        for input in &recording.inputs {
            let forces = self.step(&input.instruments, input.dt_s)?;
            seen(&forces, self.outcome());
        }
        Ok(())
    }
}
