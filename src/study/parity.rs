//! Whether backends agree: a running error analysis, pass by pass and sample by sample.
//!
//! The reference in double precision is the truth; its single-precision twin and every GPU must follow it to within rounding. How
//! far rounding may carry them is not guessed: each pass has here, in the module of its effect, an analysis that takes the bound before
//! it to the bound after it, from what one operation may lose in WGSL and in Rust (`rounding`). Nothing is excluded and no share of
//! failures allowed. A label may differ only where the sample provably lies within rounding of a place where labels change.
//!
//! Each backend runs the whole chain of passes by itself: no result is carried from one to another.

mod blur;
mod geometry;
mod interface;
mod needle;
mod noise;
mod pixels;
mod quantise;
mod receiver;
mod refraction;
mod rounding;
mod scan_conversion;
mod shadow;
mod slack;
mod slice;
mod speckle;
mod texture;
mod thickness;
mod tone;
mod warp;

pub use pixels::Pixels;
pub use slice::possible_labels;

use std::sync::Arc;

use nalgebra::{Matrix4, Vector3};

use slack::{Slack, Step};

use crate::gpu::Gpu;
use crate::synth::layers::Beam;
use crate::synth::local_origin::LocalFrame;
use crate::synth::tables::{Anatomy, Settings};
use crate::synth::{Backend, FrameState, SynthError, Synthesizer};
use crate::volume::InvalidVolume;

/// A scene to compare the backends on.
#[derive(Clone, Debug)]
pub struct Case {
    /// What it is called where backends disagree.
    pub name: String,
    /// What is imaged. Its mesh, if any, must not be folded by the state.
    pub anatomy: Anatomy,
    /// How.
    pub settings: Settings,
    /// One frame.
    pub state: FrameState,
}

impl Case {
    /// A scene.
    pub fn new(name: impl Into<String>, anatomy: Anatomy, settings: Settings, state: FrameState) -> Self {
        Self {
            name: name.into(),
            anatomy,
            settings,
            state,
        }
    }

    /// The same scene elsewhere: all of it moved by a vector in the world, mm.
    ///
    /// # Errors
    /// [`InvalidVolume`] where its place is then no finite one.
    pub fn moved(&self, by_mm: [f64; 3]) -> Result<Self, InvalidVolume> {
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

    /// A synthesizer of the scene.
    ///
    /// # Errors
    /// [`SynthError`] where the backend cannot render the scene.
    pub fn on(&self, backend: Backend) -> Result<Synthesizer, SynthError> {
        Synthesizer::new(self.anatomy.clone(), self.settings.clone(), backend)
    }

    /// The reference.
    ///
    /// # Errors
    /// [`SynthError`] where the scene cannot be rendered.
    pub fn exact(&self) -> Result<Synthesizer, SynthError> {
        self.on(Backend::CpuF64)
    }

    /// The backends in single precision: the CPU, and each of the GPUs.
    ///
    /// # Errors
    /// [`SynthError`] where one of them cannot render the scene.
    pub fn twins(&self, gpus: &[Gpu]) -> Result<Vec<Synthesizer>, SynthError> {
        let on_gpus = gpus.iter().map(|gpu| Backend::Gpu(Box::new(gpu.clone())));
        std::iter::once(Backend::Cpu)
            .chain(on_gpus)
            .map(|backend| self.on(backend))
            .collect()
    }
}

/// What stands in beam space after each pass of the plan, in order, as passes see it: from the local origin.
struct Trail {
    passes: Vec<&'static str>,
    beams: Vec<Beam>,
}

impl Trail {
    /// Runs the plan up to each pass in turn.
    fn of(synth: &mut Synthesizer, state: &FrameState) -> Result<Self, SynthError> {
        let passes: Vec<&'static str> = synth.plan().passes.iter().map(|planned| planned.pass.name).collect();
        let origin = synth.tables().origin;
        let beams = passes
            .iter()
            .map(|pass| Ok(origin.beam_into_local(synth.render_until(pass, state)?)));
        Ok(Self {
            beams: beams.collect::<Result<_, SynthError>>()?,
            passes,
        })
    }
}

/// How a twin compares with the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// `cpu` or the name of the GPU's adapter.
    pub backend: String,
    /// Samples in beam space, each of them compared after every pass.
    pub samples: usize,
    /// Samples whose label the twin reads otherwise, each of them proven to lie within rounding of a place where labels change.
    pub labels_apart: usize,
    /// The largest departure as a share of what rounding allows (0 to 1 where nothing is wrong).
    pub share: f64,
    /// What rounding cannot explain, in words; none where the backends agree.
    pub faults: Vec<String>,
    /// The frames.
    pub pixels: Pixels,
}

/// Compares the CPU in single precision and each of the GPUs with the reference, after every pass and at the pixels.
///
/// # Errors
/// [`SynthError`] where a backend cannot render the scene.
pub fn check(case: &Case, gpus: &[Gpu]) -> Result<Vec<Verdict>, SynthError> {
    let mut exact = case.exact()?;
    let trail = Trail::of(&mut exact, &case.state)?;
    let twins = case.twins(gpus)?.into_iter();
    twins.map(|twin| follow(case, &mut exact, &trail, twin)).collect()
}

fn follow(case: &Case, exact: &mut Synthesizer, trail: &Trail, mut twin: Synthesizer) -> Result<Verdict, SynthError> {
    let own = Trail::of(&mut twin, &case.state)?;
    let mut local = LocalFrame::new(exact.tables().origin);
    local.take(&case.state);
    let empty = Beam::default();
    let mut slack = Slack::default();
    if own.passes != trail.passes {
        slack.fault(format!("passes {:?} instead of {:?}", own.passes, trail.passes));
    }
    for (at, (pass, twin)) in trail.passes.iter().zip(&own.beams).enumerate() {
        let step = Step {
            case,
            tables: exact.tables(),
            state: local.of(&case.state),
            before: at.checked_sub(1).map_or(&empty, |before| &trail.beams[before]),
            after: &trail.beams[at],
            twin,
        };
        let earlier = slack.faults.len();
        slack::carry(pass, &step, &mut slack)?;
        slack::compare(&step, &mut slack);
        if *pass == "speckle_lateral" {
            speckle::check_typical(&step, &mut slack);
        }
        for fault in &mut slack.faults[earlier..] {
            fault.insert_str(0, &format!("after {pass}, "));
        }
    }
    let last = trail.beams.last().unwrap_or(&empty);
    let pixels = pixels::compare(case, exact, last, &mut slack, &mut twin)?;
    Ok(Verdict {
        backend: twin
            .gpu()
            .map_or_else(|| twin.backend().to_owned(), |gpu| gpu.report().name.clone()),
        samples: last.lines * last.samples,
        labels_apart: slack.labels_apart,
        share: slack.share,
        faults: slack.faults,
        pixels,
    })
}
