//! Times of passes and frames.

use super::GpuExecutor;
use crate::plan::Plan;
use crate::synth::tables::Tables;
use crate::synth::{PassTime, SynthError};
use insonify_gpu::Timer;

impl GpuExecutor {
    /// Enables or disables timing: each frame is then made twice, by passes one by one and fused.
    pub(crate) fn time_passes(&mut self, on: bool, plan: &Plan, tables: &Tables) -> Result<(), SynthError> {
        if on {
            self.make_single(plan, tables)?;
        }
        let names: Vec<&str> = self.single.iter().map(|step| step.passes[0].name).collect();
        let timers = |names: &[&str]| Timer::new(&self.gpu, names);
        self.timers = if on {
            timers(&names)?.zip(timers(&["frame"])?).map(<[Timer; 2]>::from)
        } else {
            None
        };
        self.times.clear();
        self.frame_ms = None;
        self.times.reserve_exact(plan.passes.len());
        Ok(())
    }

    pub(super) fn read_times(&mut self, plan: &Plan) -> Result<(), SynthError> {
        self.times.clear();
        self.frame_ms = None;
        let Some([of_passes, of_frame]) = &mut self.timers else {
            return Ok(());
        };
        let timings = of_passes.read(&self.gpu)?;
        self.frame_ms = Some(of_frame.read(&self.gpu)?.frame_ms);
        for planned in &plan.passes {
            let name = planned.pass.name;
            let ms = timings
                .passes
                .iter()
                .filter(|pass| pass.name == name)
                .map(|pass| pass.ms)
                .sum();
            self.times.push(PassTime { name, ms });
        }
        Ok(())
    }

    /// Durations of the passes of the last frame.
    pub(crate) fn times(&self) -> &[PassTime] {
        &self.times
    }

    /// GPU time of the fused passes of the last frame, ms.
    pub(crate) fn frame_ms(&self) -> Option<f64> {
        self.frame_ms
    }
}
