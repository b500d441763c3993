//! Frames in flight: submitted, worked on by a GPU while the caller goes on, and taken in the same order.

use super::{Executor, Frame, FrameState, SynthError, Synthesizer, check_finite, gpu};

/// Largest number of frames in flight.
pub(crate) const IN_FLIGHT: usize = 3;

/// A submitted frame. Frames are finished in the order of their submission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// A frame between its submission and its arrival.
pub(super) struct Flight {
    ticket: Ticket,
    frame: Frame,
    /// Its submission, on a GPU.
    submission: Option<gpu::Submission>,
}

/// Place in the ring of a GPU.
fn place_of(ticket: Ticket) -> usize {
    (ticket.0 % IN_FLIGHT as u64) as usize
}

impl Synthesizer {
    /// Submits a frame: a GPU works on it while the caller goes on, a CPU backend renders it here. At most three frames
    /// are in flight.
    ///
    /// ```
    /// use insonify_imaging::scene::SceneFile;
    /// use insonify_imaging::synth::Backend;
    ///
    /// let text = "volume = { phantom = \"abdomen\", resolution_mm = 5 }";
    /// let scene = SceneFile::parse(text, "scene.toml")?.resolve(".".as_ref())?;
    /// let mut synth = scene.synthesizer(Backend::Auto)?;
    /// for state in scene.states(4) {
    ///     let ticket = synth.submit(&state?)?;
    ///     // Here the host steps its simulation; then it takes the frame, waiting only if it has not come by then.
    ///     let frame = match synth.try_take()? {
    ///         Some((_, frame)) => frame,
    ///         None => synth.take(ticket)?,
    ///     };
    ///     assert_eq!(frame.pixels.len(), frame.width * frame.height);
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`SynthError::Busy`] if three frames are in flight, and those of [`Self::render`]. A state that changes the
    /// settings drops the frames in flight.
    pub fn submit(&mut self, state: &FrameState) -> Result<Ticket, SynthError> {
        if self.in_flight.len() == IN_FLIGHT {
            return Err(SynthError::Busy);
        }
        self.take_settings(state)?;
        self.admit(std::slice::from_ref(state))?;
        check_finite(state)?;
        let mut frame = self.spare.pop().unwrap_or_default();
        Self::begin(&self.tables, &mut self.local, state, &mut frame)?;
        let state = self.local.localized(state);
        let ticket = Ticket(self.submitted);
        let (plan, tables) = (&self.plan, &self.tables);
        let submission = match &mut self.executor {
            Executor::Cpu(cpu) => cpu.render(plan, tables, state, &mut frame).map(|()| None),
            Executor::CpuF64(cpu) => cpu.render(plan, tables, state, &mut frame).map(|()| None),
            Executor::Gpu(gpu) => {
                let staged = gpu.stage(plan, tables, &[state]);
                staged.and_then(|()| gpu.submit(tables, 1, place_of(ticket))).map(Some)
            }
        };
        let submission = submission?;
        self.submitted += 1;
        self.in_flight.push_back(Flight {
            ticket,
            frame,
            submission,
        });
        Ok(ticket)
    }

    /// The oldest frame in flight with its ticket, if it is finished; never waits.
    pub fn try_take(&mut self) -> Result<Option<(Ticket, &Frame)>, SynthError> {
        let Some(oldest) = self.in_flight.front() else {
            return Ok(None);
        };
        let ticket = oldest.ticket;
        if let (Executor::Gpu(gpu), Some(_)) = (&self.executor, &oldest.submission)
            && !gpu.is_ready(place_of(ticket))?
        {
            return Ok(None);
        }
        self.take(ticket).map(|frame| Some((ticket, frame)))
    }

    /// Waits for a frame in flight and returns it; frames before it are dropped. If the frame is no longer in flight,
    /// returns the last frame taken.
    pub fn take(&mut self, ticket: Ticket) -> Result<&Frame, SynthError> {
        while let Some(mut flight) = self.in_flight.pop_front_if(|oldest| oldest.ticket <= ticket) {
            if flight.ticket < ticket {
                self.recycle(flight);
                continue;
            }
            self.finish(&mut flight)?;
            std::mem::swap(&mut self.frame, &mut flight.frame);
            self.spare.push(flight.frame);
            break;
        }
        Ok(&self.frame)
    }

    /// Waits for the pixels of a frame.
    fn finish(&mut self, flight: &mut Flight) -> Result<(), SynthError> {
        if let (Executor::Gpu(gpu), Some(submission)) = (&mut self.executor, flight.submission.take()) {
            let (plan_and_tables, frames) = ((&self.plan, &*self.tables), std::slice::from_mut(&mut flight.frame));
            gpu.take(plan_and_tables, submission, place_of(flight.ticket), frames)?;
        }
        Ok(())
    }

    /// Waits for the pixels of all frames in flight, which can be taken later.
    pub(super) fn finish_in_flight(&mut self) -> Result<(), SynthError> {
        for _ in 0..self.in_flight.len() {
            let Some(mut flight) = self.in_flight.pop_front() else {
                break;
            };
            if let Err(error) = self.finish(&mut flight) {
                self.spare.push(flight.frame);
                return Err(error);
            }
            self.in_flight.push_back(flight);
        }
        Ok(())
    }

    fn recycle(&mut self, flight: Flight) {
        if let (Executor::Gpu(gpu), Some(_)) = (&self.executor, &flight.submission) {
            gpu.release(place_of(flight.ticket));
        }
        self.spare.push(flight.frame);
    }

    pub(super) fn drop_in_flight(&mut self) {
        while let Some(flight) = self.in_flight.pop_front() {
            self.recycle(flight);
        }
    }
}
