//! Frames that stay on the GPU, in a texture.

use super::GpuExecutor;
use crate::effects::buffers::{PIXELS, SCAN_MAP};
use crate::plan::Plan;
use crate::synth::tables::Tables;
use crate::synth::{FrameState, SynthError};
use insonify_gpu::{GpuError, Recorder, TextureOut};

impl GpuExecutor {
    /// Renders a frame into the texture.
    pub(crate) fn render_to_texture(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        self.with_texture(plan, tables, state, |executor| {
            gpu.submit("frame", |recorder| executor.run_into_texture(recorder))?;
            executor.read_times(plan)
        })
    }

    /// Records a frame into a host's encoder, up to its copy into the texture.
    pub(crate) fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        self.with_texture(plan, tables, state, |executor| {
            Ok(executor.run_into_texture(&mut Recorder::new(&gpu, encoder))?)
        })
    }

    /// Uploads a frame and has `run` record it, in one error scope.
    fn with_texture(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
        run: impl FnOnce(&mut Self) -> Result<(), SynthError>,
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        let done = gpu.scoped("frame", || {
            if self.texture.is_none() {
                self.texture = Some(self.make_texture(tables)?);
            }
            self.stage(plan, tables, &[state])?;
            self.upload(self.timers.is_some())?;
            run(self)
        });
        self.resend_maps_on_error(done)
    }

    fn run_into_texture(&self, recorder: &mut Recorder) -> Result<(), GpuError> {
        self.run_all(recorder, 1)?;
        match &self.texture {
            Some(texture) => recorder.copy_to_texture(&self.buffers[&(&PIXELS, 0)], texture),
            None => Ok(()),
        }
    }

    fn make_texture(&self, tables: &Tables) -> Result<TextureOut, GpuError> {
        if self.bands.len() > 1 {
            return Err(GpuError::Limit {
                what: "a frame left on the GPU in one piece".into(),
                limit: "max_storage_buffer_binding_size",
                needed: SCAN_MAP.bytes(tables),
                available: self.gpu.limits().max_storage_buffer_binding_size,
            });
        }
        TextureOut::new(&self.gpu, tables.width() as u32, tables.height() as u32)
    }

    /// Texture of the last frame rendered into it.
    pub(crate) fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref().map(TextureOut::texture)
    }
}
