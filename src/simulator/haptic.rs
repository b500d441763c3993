//! Stepping part of the simulator, for the haptic thread.

use std::sync::{Arc, Weak};
use std::time::Instant;

use nalgebra::Isometry3;

use super::forces::{Easing, Forces, Wrenches};
use super::imaging::Imaging;
use super::{SimulatorError, SimulatorOptions};
use insonify_imaging::synth::Synthesizer;
use insonify_mechanics::insertion::{
    Instruments, LevelChange, Model, Outcome, RecordedInput, Recording, SimulatorState, Snapshot, StepError, check_pose,
};
use insonify_mechanics::tissue::remesh::Level;

/// Steps a model on the caller's thread.
///
/// A step allocates nothing of its own except the memory of a recording in progress.
///
/// ```
/// use std::sync::Arc;
///
/// use insonify::{
///     Haptic, Instruments, Interaction, MassSpring, MassSpringParameters, MeshRegions, Rigid, Shaft, SimulatorOptions,
///     TetMesh,
/// };
/// use nalgebra::Isometry3;
///
/// let mesh = Arc::new(TetMesh::over_box([-30.0, -30.0, 0.0], [30.0, 30.0, 60.0], 64)?);
/// let tissue = Interaction { friction_n_per_mm: 0.02, cutting_n: 0.5, puncture_n: 1.0, ..Interaction::default() };
/// let regions = MeshRegions::new(&mesh, &[(0, tissue)])?;
/// let parameters = MassSpringParameters { length_mm: Some(50.0), ..MassSpringParameters::default() };
/// let needle = Rigid::new(Shaft::default(), None)?;
/// let model = MassSpring::new(parameters, Box::new(regions), Box::new(needle))?;
///
/// let mut haptic = Haptic::new(Box::new(model), SimulatorOptions::default());
/// haptic.record();
/// let mut rendered = Vec::new();
/// for step in 0..60 {
///     // In a simulator, the pose that a device measures.
///     let base = Isometry3::translation(0.0, 0.0, 0.4 * f64::from(step) - 201.0);
///     let forces = haptic.step(&Instruments::new(base), 1e-3)?;
///     rendered.push(forces.axial_n());
/// }
/// assert!(rendered[59] < -0.1, "{} N", rendered[59]);
///
/// // The same steps give the same forces, bit for bit.
/// let recording = haptic.take_recording().ok_or("no recording")?;
/// let mut repeated = Vec::new();
/// haptic.replay(&recording, |forces, _| repeated.push(forces.axial_n()))?;
/// assert_eq!(repeated, rendered);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Haptic {
    model: Box<dyn Model>,
    options: SimulatorOptions,
    time_s: f64,
    easing: Easing,
    publisher: Option<Publisher>,
    recording: Option<Recording>,
    view: Option<Isometry3<f64>>,
}

impl Haptic {
    /// Takes a model that is not imaged.
    pub fn new(model: Box<dyn Model>, options: SimulatorOptions) -> Self {
        Self {
            model,
            options,
            time_s: 0.0,
            easing: Easing::default(),
            publisher: None,
            recording: None,
            view: None,
        }
    }

    /// Returns an imaging of this model from its current state, in place of any previous one. See
    /// [`Simulator::new`](super::Simulator::new).
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn imaged(&mut self, synthesizer: Synthesizer, needle_diameter_mm: f64) -> Result<Imaging, SimulatorError> {
        let (mut publisher, latest) = hand_over();
        publisher.publish(&mut *self.model);
        let imaging = Imaging::new(synthesizer, self.model.imager(), needle_diameter_mm, latest)?;
        self.publisher = Some(publisher);
        Ok(imaging)
    }

    /// Makes one step of `dt_s` simulated seconds to the given poses, and publishes the state to the image if there is
    /// one.
    ///
    /// # Errors
    /// [`StepError`]; the hand keeps its previous forces. Nothing has changed, except with [`StepError::Outcome`], where
    /// the model has made the step.
    pub fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<Forces, StepError> {
        let start = Instant::now();
        let outcome = self.model.step(instruments, dt_s)?;
        outcome.check()?;
        let computed = Wrenches::of(outcome);
        self.time_s += dt_s;
        if let Some(recording) = &mut self.recording {
            recording.inputs.push(RecordedInput {
                instruments: *instruments,
                dt_s,
                view: self.view,
            });
        }
        if let Some(publisher) = &mut self.publisher {
            publisher.publish(&mut *self.model);
        }
        let took = start.elapsed();
        let overrun = took.checked_sub(self.options.budget).filter(|late| !late.is_zero());
        let shown = self.easing.next(computed, dt_s, overrun.is_some(), self.options.policy);
        Ok(shown.forces(instruments, self.options.probe_points, took, overrun))
    }

    /// Changes the remeshing level, and returns the duration of the change and the jump of the force on the hand. It
    /// may take longer than a step: see [`Model::set_level`]. A recording restarts from the current state, since states
    /// and inputs do not contain the level.
    ///
    /// # Errors
    /// [`StepError`]; the level is then unchanged.
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

    /// Returns the outcome of the last step. Its forces are those of the model, which an easing
    /// [`Policy`](super::Policy) may still be blending.
    pub fn outcome(&self) -> &Outcome {
        self.model.outcome()
    }

    /// Returns the simulated time, s.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Returns the state: after a restore, the same steps give the same outcomes, bit for bit. Saving may change the
    /// last bits of later steps of this model, too, as it goes on as one restored to the state does ([`Model::save`]):
    /// runs that are compared bit for bit save, and [record](Self::record), at the same steps, and compare
    /// [`Self::outcome`]: forces that [`Policy::Ease`](super::Policy::Ease) blends depend on the clock.
    pub fn save(&mut self) -> SimulatorState {
        SimulatorState {
            time_s: self.time_s,
            model: self.model.save(),
        }
    }

    /// Restores a saved state, and publishes it to the image. The next step returns the forces of the model, without
    /// any earlier blend; from then on [`Self::outcome`] repeats, as for [`Self::save`]. A recording restarts from this
    /// state.
    ///
    /// # Errors
    /// [`StepError::Foreign`]; then nothing has changed.
    pub fn restore(&mut self, state: &SimulatorState) -> Result<(), StepError> {
        if !state.time_s.is_finite() {
            return Err(StepError::Foreign(format!("its time is {}", state.time_s)));
        }
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

    /// Starts recording the inputs of steps, in place of any previous recording. It begins with a [save](Self::save).
    pub fn record(&mut self) {
        self.recording = Some(Recording {
            start: self.save(),
            inputs: Vec::new(),
        });
    }

    /// Sets the pose of the imaging probe (probe frame to world) that is recorded with later steps: a score needs it.
    ///
    /// # Errors
    /// [`StepError`] if it is not rigid; it is then unchanged.
    pub fn record_view(&mut self, probe_to_world: Isometry3<f64>) -> Result<(), StepError> {
        check_pose("the pose of the view", &probe_to_world)?;
        self.view = Some(probe_to_world);
        Ok(())
    }

    /// Ends a recording and returns it.
    pub fn take_recording(&mut self) -> Option<Recording> {
        self.recording.take()
    }

    /// Restores the start of a recording and repeats its steps; `seen` receives the results of each.
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

// Lock-free hand-over of complete states between threads.

/// Writing end.
pub(super) struct Publisher {
    buffers: triple_buffer::Input<Snapshot>,
    reader: Weak<()>,
}

/// Reading end.
pub(super) struct Latest {
    buffers: triple_buffer::Output<Snapshot>,
    _alive: Arc<()>,
}

/// Returns the two ends of a hand-over.
pub(super) fn hand_over() -> (Publisher, Latest) {
    let (input, output) = triple_buffer::triple_buffer(&Snapshot::default());
    let alive = Arc::new(());
    let publisher = Publisher {
        buffers: input,
        reader: Arc::downgrade(&alive),
    };
    let latest = Latest {
        buffers: output,
        _alive: alive,
    };
    (publisher, latest)
}

impl Publisher {
    /// Publishes the state of a model in place of the previous one, without waiting. Does nothing, not even request the
    /// state, once the reader is gone.
    pub(super) fn publish(&mut self, model: &mut dyn Model) {
        if self.reader.strong_count() > 0 {
            model.snapshot(self.buffers.input_buffer_mut());
            self.buffers.publish();
        }
    }
}

impl Latest {
    /// Takes the latest state; returns whether it is new.
    pub(super) fn take(&mut self) -> bool {
        self.buffers.update()
    }

    /// Returns the state taken last.
    pub(super) fn state(&self) -> &Snapshot {
        self.buffers.output_buffer()
    }
}
