//! Agreement between backends: a running error analysis, pass by pass and sample by sample.
//!
//! The double-precision reference is the truth; its single-precision twin and every GPU must follow it to within
//! rounding. The tolerance is derived, not guessed: the file `bound.rs` of each effect propagates the error bound
//! through its passes, from the error of single operations in WGSL and in Rust (`rounding`). No sample is excluded and
//! no share of failures is allowed. A label may differ only where the sample provably lies within rounding of a label
//! boundary.
//!
//! Each backend runs the complete chain of passes by itself: no result is passed from one to another.

mod pixels;
pub(crate) mod rounding;
pub(crate) mod slack;

#[cfg(test)]
pub(crate) use crate::effects::slice::bound::possible_labels;
pub use pixels::Pixels;

use std::sync::Arc;

use nalgebra::{Matrix4, Vector3};

pub(crate) use slack::{Slack, Step};

use crate::effects::pass::Pass;
#[cfg(test)]
use crate::synth::cpu::CpuExecutor;
use crate::synth::layers::Beam;
use crate::synth::local_origin::LocalFrame;
use crate::synth::tables::{Anatomy, Settings};
use crate::synth::{Backend, FrameState, SynthError, Synthesizer};
use insonify_anatomy::volume::VolumeError;
use insonify_gpu::Gpu;
#[cfg(test)]
use insonify_testing::lossy::{self, Bias, Lossy};

/// Scene on which the backends are compared.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name used in reports of disagreement.
    pub name: String,
    /// Anatomy to image. Its mesh, if any, must not be folded by the state.
    pub anatomy: Anatomy,
    /// Rendering settings.
    pub settings: Settings,
    /// State of the frame.
    pub state: FrameState,
}

impl Case {
    /// Creates a case.
    pub fn new(name: impl Into<String>, anatomy: Anatomy, settings: Settings, state: FrameState) -> Self {
        Self {
            name: name.into(),
            anatomy,
            settings,
            state,
        }
    }

    /// Returns the case translated in the world by a vector, mm.
    ///
    /// # Errors
    /// [`VolumeError`] if the translated position is not finite.
    pub fn moved(&self, by_mm: [f64; 3]) -> Result<Self, VolumeError> {
        let by = Vector3::from(by_mm);
        let mut case = self.clone();
        case.name = format!("{} moved by {by_mm:?} mm", self.name);
        case.anatomy.volume = Arc::new(self.anatomy.volume.moved(by)?);
        let mesh = self.anatomy.mesh.as_ref();
        case.anatomy.mesh = mesh.map(|mesh| Arc::new(mesh.moved(by_mm)));
        let state = &mut case.state;
        state.probe_to_world = Matrix4::new_translation(&by) * state.probe_to_world;
        for shaft in state.needle.iter_mut().chain(&mut state.seeds) {
            shaft.nodes.iter_mut().for_each(|node| *node += by);
        }
        for node in state.nodes.iter_mut().chain(&mut state.reference).flatten() {
            *node = (Vector3::from(*node) + by).into();
        }
        Ok(case)
    }

    /// Creates a synthesizer of the scene on a backend.
    ///
    /// # Errors
    /// [`SynthError`] if the backend cannot render the scene.
    pub fn on(&self, backend: Backend) -> Result<Synthesizer, SynthError> {
        Synthesizer::new(self.anatomy.clone(), self.settings.clone(), backend)
    }

    /// Creates the double-precision reference synthesizer.
    ///
    /// # Errors
    /// [`SynthError`] if the scene cannot be rendered.
    pub fn exact(&self) -> Result<Synthesizer, SynthError> {
        self.on(Backend::CpuF64)
    }

    /// Creates the single-precision synthesizers: the CPU's, then each GPU's.
    ///
    /// # Errors
    /// [`SynthError`] if one of them cannot render the scene.
    pub fn twins(&self, gpus: &[Gpu]) -> Result<Vec<Synthesizer>, SynthError> {
        let on_gpus = gpus.iter().map(|gpu| Backend::Gpu(Box::new(gpu.clone())));
        std::iter::once(Backend::Cpu)
            .chain(on_gpus)
            .map(|backend| self.on(backend))
            .collect()
    }
}

/// How the bound on a twin's error passes through a pass.
#[derive(Clone, Copy)]
pub(crate) enum Bound {
    /// Propagates it.
    By(fn(&Step, &mut Slack)),
    /// Nothing to propagate: what the pass leaves is not compared, or bounded elsewhere, as said here.
    Covered(#[expect(dead_code, reason = "for the reader")] &'static str),
}

/// Beam-space state after each pass of the plan, in order, relative to the local origin as the passes use it.
#[derive(Default)]
pub(crate) struct Trail {
    pub passes: Vec<&'static Pass>,
    pub beams: Vec<Beam>,
}

impl Trail {
    /// Runs the plan pass by pass.
    pub(crate) fn of(synth: &mut Synthesizer, state: &FrameState) -> Result<Self, SynthError> {
        let passes = synth.plan().passes.iter().map(|planned| planned.pass).collect();
        let origin = synth.tables().origin;
        let beams = synth.render_each(state)?.into_iter();
        Ok(Self {
            beams: beams.map(|beam| origin.beam_into_local(beam)).collect(),
            passes,
        })
    }

    fn names(&self) -> Vec<&'static str> {
        self.passes.iter().map(|pass| pass.name).collect()
    }
}

/// Result of comparing a twin with the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// `cpu`, the name of the GPU adapter, or the bias of the least accurate arithmetic.
    pub backend: String,
    /// Number of samples in beam space, each compared after every pass.
    pub samples: usize,
    /// Number of samples whose label differs, each proven to lie within rounding of a label boundary.
    pub labels_apart: usize,
    /// Largest deviation as a fraction of the rounding bound, 0 to 1 if the backends agree.
    pub share: f64,
    /// Descriptions of deviations that rounding cannot explain; empty if the backends agree.
    pub faults: Vec<String>,
    /// Comparison of the pixels.
    pub pixels: Pixels,
}

/// Compares the single-precision CPU and each GPU with the reference, after every pass and at the pixels.
///
/// # Errors
/// [`SynthError`] if a backend cannot render the scene.
pub fn check(case: &Case, gpus: &[Gpu]) -> Result<Vec<Comparison>, SynthError> {
    let mut exact = case.exact()?;
    let trail = Trail::of(&mut exact, &case.state)?;
    let twins = case.twins(gpus)?.into_iter();
    twins
        .map(|mut synth| {
            let twin = Twin {
                trail: Trail::of(&mut synth, &case.state)?,
                pixels: synth.render(&case.state)?.pixels.clone(),
                // WGSL leaves the direction open; in software it is that of the CPU.
                to_nearest: synth.gpu().is_none_or(|gpu| gpu.report().software),
                backend: synth
                    .gpu()
                    .map_or_else(|| synth.backend().to_owned(), |gpu| gpu.report().name.clone()),
            };
            compare(case, &mut exact, &trail, twin)
        })
        .collect()
}

/// Compares the least accurate arithmetic that WGSL allows with the reference, as [`check`] does a GPU: once for each
/// bias.
///
/// # Errors
/// [`SynthError`] if a backend cannot render the scene.
#[cfg(test)]
pub fn check_lossy(case: &Case, biases: &[Bias]) -> Result<Vec<Comparison>, SynthError> {
    let mut exact = case.exact()?;
    let trail = Trail::of(&mut exact, &case.state)?;
    let mut local = LocalFrame::new(exact.tables().origin);
    local.take(&case.state).map_err(SynthError::Pose)?;
    let state = local.localized(&case.state);
    let comparisons = biases.iter().map(|&bias| {
        let (plan, tables) = (exact.plan(), exact.tables());
        let twin = lossy::with(bias, || -> Result<Twin, SynthError> {
            let mut cpu = CpuExecutor::<Lossy>::new(plan, tables)?;
            let mut trail = Trail::default();
            for planned in &plan.passes {
                cpu.run(std::slice::from_ref(planned), tables, state)?;
                trail.passes.push(planned.pass);
                trail.beams.push(Beam::of_store(&cpu.store, tables));
            }
            Ok(Twin {
                trail,
                pixels: cpu.store.pixels,
                to_nearest: false,
                backend: format!("{bias:?}"),
            })
        })?;
        compare(case, &mut exact, &trail, twin)
    });
    comparisons.collect()
}

/// Result of a backend that is compared with the reference.
struct Twin {
    trail: Trail,
    pixels: Vec<u8>,
    /// Whether its sums and products are rounded to nearest.
    to_nearest: bool,
    /// See [`Comparison::backend`].
    backend: String,
}

fn compare(case: &Case, exact: &mut Synthesizer, trail: &Trail, twin: Twin) -> Result<Comparison, SynthError> {
    let mut local = LocalFrame::new(exact.tables().origin);
    local.take(&case.state).map_err(SynthError::Pose)?;
    let empty = Beam::default();
    let mut slack = Slack::default();
    if twin.trail.names() != trail.names() {
        slack.fault(format!(
            "passes {:?} instead of {:?}",
            twin.trail.names(),
            trail.names()
        ));
    }
    for (index, (pass, beam)) in trail.passes.iter().zip(&twin.trail.beams).enumerate() {
        let step = Step {
            tables: exact.tables(),
            state: local.localized(&case.state),
            before: index.checked_sub(1).map_or(&empty, |before| &trail.beams[before]),
            after: &trail.beams[index],
            twin: beam,
            to_nearest: twin.to_nearest,
        };
        let earlier = slack.faults.len();
        // The bound comes first: it widens the slack by what this pass may round, to which the twin is then
        // held.
        if let Bound::By(carry) = pass.bound {
            carry(&step, &mut slack);
        }
        slack::compare(&step, &mut slack);
        for fault in &mut slack.faults[earlier..] {
            fault.insert_str(0, &format!("after {}, ", pass.name));
        }
    }
    let last = trail.beams.last().unwrap_or(&empty);
    let samples = last.lines * last.samples;
    let pixels = pixels::compare(case, exact, &mut slack, twin.pixels)?;
    Ok(Comparison {
        backend: twin.backend,
        samples,
        labels_apart: slack.labels_apart,
        share: slack.share,
        faults: slack.faults,
        pixels,
    })
}
