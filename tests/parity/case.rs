//! A scene, and what stands in beam space after each of its passes on each backend.

use insonify::gpu::Gpu;
use insonify::synth::layers::Beam;
use insonify::synth::tables::{Anatomy, Settings};
use insonify::synth::{Backend, FrameState, Synthesizer};

use crate::support::gpu::{backend, gpu_or_skip};

/// A scene to compare the backends on.
#[derive(Clone)]
pub struct Case {
    pub name: String,
    pub anatomy: Anatomy,
    pub settings: Settings,
    pub state: FrameState,
}

/// What stands in beam space after each pass of the plan, in order.
pub struct Trail {
    pub passes: Vec<&'static str>,
    pub beams: Vec<Beam>,
}

impl Trail {
    /// Runs the plan up to each pass in turn.
    pub fn of(synthesizer: &mut Synthesizer, state: &FrameState) -> Self {
        let passes: Vec<&'static str> = synthesizer
            .plan()
            .passes
            .iter()
            .map(|planned| planned.pass.name)
            .collect();
        let beams = passes
            .iter()
            .map(|pass| {
                synthesizer
                    .render_until(pass, state)
                    .unwrap_or_else(|error| panic!("{pass}: {error}"))
            })
            .collect();
        Self { passes, beams }
    }
}

impl Case {
    pub fn new(name: impl Into<String>, anatomy: Anatomy, settings: Settings, state: FrameState) -> Self {
        Self {
            name: name.into(),
            anatomy,
            settings,
            state,
        }
    }

    /// A synthesizer of the scene.
    pub fn on(&self, backend: Backend) -> Synthesizer {
        Synthesizer::new(self.anatomy.clone(), self.settings.clone(), backend)
            .unwrap_or_else(|error| panic!("{}: {error}", self.name))
    }

    /// The reference.
    pub fn exact(&self) -> Synthesizer {
        self.on(Backend::CpuF64)
    }

    /// The backends in single precision: the CPU, and the GPU where there is one.
    pub fn twins(&self, gpu: Option<&Gpu>) -> Vec<Synthesizer> {
        let mut twins = vec![self.on(Backend::Cpu)];
        twins.extend(gpu.map(|gpu| self.on(backend(gpu.clone()))));
        twins
    }
}

/// Compares the twins with the reference after every pass and at the pixels, for each of the cases.
pub fn check_all(test: &str, cases: &[Case]) {
    let gpu = gpu_or_skip(test);
    for case in cases {
        let mut exact = case.exact();
        let trail = Trail::of(&mut exact, &case.state);
        for mut twin in case.twins(gpu.as_ref()) {
            crate::slack::check(case, &exact, &trail, &mut twin);
        }
    }
}
