//! Runs of the dispatches of a frame, all or a part.

use super::GpuExecutor;
use super::steps::dispatches;
use crate::effects::buffers::HITS;
use crate::plan::Plan;
use crate::synth::tables::Tables;
use crate::synth::{FrameState, SynthError};
use insonify_gpu::{GpuError, Recorder};

impl GpuExecutor {
    pub(super) fn run_all(&self, recorder: &mut Recorder, frames: usize) -> Result<(), GpuError> {
        self.clear_hits(recorder);
        let Some([of_passes, of_frame]) = &self.timers else {
            return recorder.run("frame", dispatches(&self.fused, frames));
        };
        recorder.run_timed(of_passes, dispatches(&self.single, frames))?;
        self.clear_hits(recorder);
        recorder.run_timed_whole(of_frame, dispatches(&self.fused, frames))
    }

    /// Runs the steps up to and including a pass; all of them if there is none of that name.
    pub(crate) fn run_until(
        &mut self,
        pass: &str,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        let staged = self.stage_for(true, (plan, tables), &[state]);
        let run = staged.and_then(|()| {
            self.upload(true)?;
            self.gpu.submit("clear", |recorder| {
                self.clear_hits(recorder);
                Ok(())
            })?;
            self.run_steps(0, self.end_of(pass))
        });
        self.resend_maps_on_error(run)
    }

    /// Goes on with the frame that [`Self::run_until`] began: from behind a pass up to and including another.
    #[cfg(any(test, feature = "analysis"))]
    pub(crate) fn run_on(&mut self, behind: &str, pass: &str) -> Result<(), SynthError> {
        let start = self.end_of(behind);
        self.run_steps(start, self.end_of(pass).max(start))
    }

    fn run_steps(&mut self, start: usize, end: usize) -> Result<(), SynthError> {
        self.gpu.submit("part of a frame", |recorder| {
            recorder.run("part of a frame", dispatches(&self.single[start..end], 1))
        })?;
        Ok(())
    }

    fn end_of(&self, pass: &str) -> usize {
        let last = self.single.iter().rposition(|step| step.passes[0].name == pass);
        last.map_or(self.single.len(), |at| at + 1)
    }

    /// Zeroes the hits of the warp.
    fn clear_hits(&self, recorder: &mut Recorder) {
        if let Some(hits) = self.buffers.get(&(&HITS, 0)) {
            recorder.clear(hits);
        }
    }
}
