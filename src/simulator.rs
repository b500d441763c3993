//! Embedding: tissue, needle and probe at the rate of the hand, images at their own.
//!
//! A [`Haptic`] steps a [`Model`] on the caller's thread and answers with forces.
//! An [`Imaging`] renders frames of it on another thread, each of the latest whole state: what a step leaves is handed
//! over through three buffers without locks, so neither thread waits for the other and no frame shows half a step. A
//! [`Simulator`] is both, to drive them in turn or to [split](Simulator::split) them. Where nothing is imaged, a
//! [`Haptic`] is made alone: then no state is handed over, and the model is not asked for one.
//!
//! What haptic devices need besides is here too: a probe's pose from [`TwoPoints`] and the force on each, a [`Damper`], a
//! [`LateralHold`], and a needle [`Guided`] by a template whose holes one device goes through in turn.
//!
//! Frames of reference and signs of forces are stated by [`Forces`], late steps by [`Policy`], saving and replaying by
//! [`State`] and [`Recording`].

mod devices;
mod forces;
mod hand_over;
mod haptic;
mod imaging;
mod recording;
mod seeds;
#[cfg(test)]
mod tests;

use std::time::Duration;

use nalgebra::Matrix4;

use crate::mechanics::insertion::{Instruments, LevelChange, Model, StepError};
use crate::mechanics::tissue::remesh::Level;
use crate::synth::{Frame, SynthError, Synthesizer};
pub use devices::{Damper, Guided, HoldOptions, HoleError, InvalidDevice, LateralHold, PointsPose, TwoPoints};
pub use forces::Forces;
pub use haptic::Haptic;
pub use imaging::{Imaging, InvalidImaging};
pub use recording::{Input, InvalidInput, Recording, State};

/// How long a step may take, and what happens if it takes longer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Time for a step, hand-over to the image included. Default 1 ms.
    pub budget: Duration,
    /// What the hand gets when a step took longer. Default [`Policy::Finish`].
    pub policy: Policy,
    /// Two points that drive the probe, among which [`Forces::probe_points`] splits its force. Default none.
    pub probe_points: Option<TwoPoints>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            budget: Duration::from_millis(1),
            policy: Policy::Finish,
            probe_points: None,
        }
    }
}

/// What the hand gets from a step that took longer than its budget.
///
/// Under either policy the step is completed, so that the state does not depend on the clock, and [`Forces::overrun`]
/// says by how much it was late. While the caller waits, a device goes on with the forces it had; when the late ones
/// come, the instruments may have moved far, and the forces jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// The forces of the step, as they are.
    Finish,
    /// The forces given before go over into those of the model linearly within this much simulated time, from the late
    /// step on. Where every step is late, forces follow the model as through a low-pass filter of this time constant:
    /// they lag, but neither jump nor freeze.
    Ease {
        /// Simulated time from the forces given before to those of the model.
        over: Duration,
    },
}

/// Steps and images of one model, on one thread or on two.
pub struct Simulator {
    haptic: Haptic,
    imaging: Imaging,
}

impl Simulator {
    /// Joins a model and what images it. `synthesizer` has the mesh of the model, in the same order, if tissue is to be
    /// seen moving, and the needle effect if the needle is to be seen, whose diameter is `needle_diameter_mm`.
    ///
    /// # Errors
    /// [`InvalidImaging`].
    pub fn new(
        model: Box<dyn Model>,
        synthesizer: Synthesizer,
        needle_diameter_mm: f64,
        options: Options,
    ) -> Result<Self, InvalidImaging> {
        let mut haptic = Haptic::new(model, options);
        let imaging = haptic.imaged(synthesizer, needle_diameter_mm)?;
        Ok(Self { haptic, imaging })
    }

    /// See [`Haptic::step`].
    ///
    /// # Errors
    /// Those of [`Haptic::step`].
    pub fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<Forces, StepError> {
        self.haptic.step(instruments, dt_s)
    }

    /// See [`Haptic::set_level`].
    ///
    /// # Errors
    /// Those of [`Haptic::set_level`].
    pub fn set_level(&mut self, level: Level) -> Result<LevelChange, StepError> {
        self.haptic.set_level(level)
    }

    /// See [`Imaging::frame`].
    ///
    /// # Errors
    /// Those of [`Imaging::frame`].
    pub fn frame(&mut self, probe_to_world: &Matrix4<f64>) -> Result<&Frame, SynthError> {
        self.imaging.frame(probe_to_world)
    }

    /// The part that steps, to save, restore, record and replay.
    pub fn haptic(&mut self) -> &mut Haptic {
        &mut self.haptic
    }

    /// The part for the haptic thread and that for the image thread.
    pub fn split(self) -> (Haptic, Imaging) {
        (self.haptic, self.imaging)
    }
}
