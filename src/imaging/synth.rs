//! Synthesizer: created once from a scene and a backend, it renders frame after frame.

mod batch;
pub mod cpu;
mod flight;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(not(feature = "gpu"))]
#[path = "synth/gpu_absent.rs"]
pub mod gpu;
pub mod layers;
#[cfg(feature = "gpu")]
pub mod linker;
pub(crate) mod local_origin;
pub mod slab;
pub mod store;
pub mod tables;

use std::collections::VecDeque;
use std::sync::Arc;

use batch::Team;
use flight::Flight;
pub(crate) use flight::IN_FLIGHT;
pub use flight::Ticket;
use local_origin::LocalFrame;
pub use local_origin::LocalOrigin;
use nalgebra::{Matrix4, Point3, Vector3};
use tables::{Anatomy, FrameSettings, Settings, Tables};

use crate::effects::buffers::Buffer;
use crate::effects::{REGISTRY, needle};
use crate::plan::Plan;
use insonify_anatomy::acoustics::{TissueError, TissueTable};
use insonify_anatomy::volume::VolumeError;
use insonify_base::blame::Blame;
use insonify_base::memory::TooLarge;
use insonify_base::range::OutOfRange;
use insonify_gpu::{AdapterChoice, Gpu, GpuError, adapter};
use insonify_mesh::{InvalidMesh, check_positions};
use insonify_tracking::TrackingError;

/// Why a frame cannot be synthesised.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// A parameter of an effect lies outside its range.
    #[error(transparent)]
    Effect(#[from] OutOfRange),
    /// The probe is invalid, or the image cannot be laid out.
    #[error(transparent)]
    Tracking(#[from] TrackingError),
    /// The volume cannot be placed about its local origin, or the tissues name more textures than an atlas holds.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The tissues do not fit the labels or the textures, or a number of theirs is out of range.
    #[error(transparent)]
    Tissue(#[from] TissueError),
    /// A needle or seed that cannot be: says what is wrong with it.
    #[error("a needle or seed has {0}")]
    Needle(String),
    /// A GPU operation failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The node positions do not match the mesh, or are not finite.
    #[error(transparent)]
    Nodes(#[from] InvalidMesh),
    /// More memory is needed than is available.
    #[error(transparent)]
    Memory(#[from] TooLarge),
    /// The limit of frames in flight is reached; take one before submitting another.
    #[error("{IN_FLIGHT} frames are in flight; take one before submitting another")]
    Busy,
    /// The probe's pose is not rigid; says what is wrong with the matrix.
    #[error("the probe's pose, a matrix on column vectors in mm: {0}")]
    Pose(String),
}

impl Blame for SynthError {
    fn is_machine(&self) -> bool {
        match self {
            Self::Gpu(error) => error.is_machine(),
            Self::Memory(_) => true,
            _ => false,
        }
    }
}

/// Processor that computes frames: the CPU, in single or in double precision, or a GPU. All run the same passes; the
/// GPU and the CPU in single precision agree but for rounding.
#[derive(Clone)]
pub enum Backend {
    /// CPU reference in single precision, matching the GPU.
    Cpu,
    /// CPU reference in double precision: the gold standard.
    CpuF64,
    /// The best hardware GPU, or [`Backend::Cpu`] where there is none or where it cannot render the scene. Nothing is
    /// timed: the choice does not depend on the load of the machine. The command, whose `--backend auto` times frames
    /// on both, says which is faster.
    Auto,
    /// A GPU adapter of this machine.
    Adapter(AdapterChoice),
    /// A device and its queue, lent by the host.
    #[cfg(feature = "gpu")]
    Host(Box<(wgpu::Device, wgpu::Queue)>),
    /// An open GPU. Synthesizers on clones of one share volume and textures: several probes on one anatomy have one
    /// copy.
    Gpu(Box<Gpu>),
}

impl Backend {
    /// The best GPU adapter, software Vulkan included.
    pub fn gpu() -> Self {
        Self::Adapter(AdapterChoice::default())
    }

    fn executor(self, plan: &Plan, tables: &Tables) -> Result<Executor, SynthError> {
        let on = |gpu: Gpu| Ok(Executor::Gpu(Box::new(gpu::GpuExecutor::new(gpu, plan, tables)?)));
        let needs = || gpu::needs(plan);
        match self {
            Self::Cpu => Ok(Executor::Cpu(cpu::CpuExecutor::new(plan, tables)?)),
            Self::CpuF64 => Ok(Executor::CpuF64(cpu::CpuExecutor::new(plan, tables)?)),
            Self::Auto if adapter::hardware(&adapter::list()).is_err() => Self::Cpu.executor(plan, tables),
            Self::Auto => match Self::gpu().executor(plan, tables) {
                Err(SynthError::Gpu(error)) if error.is_machine() => Self::Cpu.executor(plan, tables),
                executor => executor,
            },
            Self::Adapter(choice) => on(Gpu::open(&choice, &needs())?),
            #[cfg(feature = "gpu")]
            Self::Host(host) => on(Gpu::from_host(host.0, host.1, &needs())?),
            Self::Gpu(gpu) => on(*gpu),
        }
    }
}

enum Executor {
    Cpu(cpu::CpuExecutor<f32>),
    CpuF64(cpu::CpuExecutor<f64>),
    Gpu(Box<gpu::GpuExecutor>),
}

/// Duration of a pass.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PassTime {
    /// Name of the pass.
    pub name: &'static str,
    /// Duration, ms.
    pub ms: f64,
}

/// Renderer of a scene. Create it once and call [`render`](Self::render) for each state.
///
/// ```
/// use insonify_imaging::scene::SceneFile;
/// use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
/// use nalgebra::Translation3;
///
/// let text = "volume = { phantom = \"abdomen\", resolution_mm = 4 }";
/// let scene = SceneFile::parse(text, "scene.toml")?.resolve(".".as_ref())?;
/// let pose = *scene.probe_pose(0, 1).probe_to_world();
/// let mut synth = Synthesizer::new(scene.anatomy, scene.settings, Backend::Cpu)?;
///
/// // The probe slides 5 mm along its array.
/// let mut state = FrameState::at(pose);
/// for step in 0..3 {
///     state.frame = step;
///     state.probe_to_world = pose * Translation3::new(2.5 * step as f64, 0.0, 0.0).to_homogeneous();
///     let frame = synth.render(&state)?;
///     assert_eq!(frame.pixels.len(), frame.width * frame.height);
/// }
///
/// // More gain, from the next frame on: the amplitudes stay, only the table of gains is recomputed.
/// let before = synth.frame().clone();
/// let mut settings = synth.settings().clone();
/// settings.effects.tone.get_or_insert_default().gain_db += 10.0;
/// synth.set(settings)?;
/// let brightness = |pixels: &[u8]| pixels.iter().map(|&grey| u64::from(grey)).sum::<u64>();
/// assert!(brightness(&synth.render(&state)?.pixels) > brightness(&before.pixels));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Synthesizer {
    tables: Arc<Tables>,
    plan: Plan,
    executor: Executor,
    local: LocalFrame,
    /// The last frame taken.
    frame: Frame,
    /// Submitted frames, in order.
    in_flight: VecDeque<Flight>,
    /// Memory of frames that are not in flight.
    spare: Vec<Frame>,
    /// Frames submitted so far.
    submitted: u64,
    /// Threads of the last batch.
    team: Option<Team>,
}

impl Synthesizer {
    /// Prepares tables, plan, and the memory or GPU objects that the plan needs, and nothing else.
    pub fn new(anatomy: Anatomy, settings: Settings, backend: Backend) -> Result<Self, SynthError> {
        Self::from_tables(Arc::new(Tables::new(anatomy, settings)?), backend)
    }

    /// A synthesizer with tables that others may share.
    pub fn from_tables(tables: Arc<Tables>, backend: Backend) -> Result<Self, SynthError> {
        let plan = Plan::new(&tables);
        let executor = backend.executor(&plan, &tables)?;
        let frame = Frame {
            width: tables.width(),
            height: tables.height(),
            pixels: vec![0; tables.width() * tables.height()],
            image_to_world: Matrix4::identity(),
            pixel_mm: tables.image_grid.pixel_mm(),
            needle: None,
            left_out: 0,
            layers: Vec::new(),
        };
        Ok(Self {
            local: LocalFrame::new(tables.origin),
            tables,
            plan,
            executor,
            frame,
            in_flight: VecDeque::with_capacity(IN_FLIGHT),
            spare: Vec::with_capacity(IN_FLIGHT),
            submitted: 0,
            team: None,
        })
    }

    /// Renders one frame. In the steady state it allocates nothing. Frames in flight are dropped. A probe beside the
    /// volume gives a dark frame and no error: [`LabelVolume::label_index_at`](insonify_anatomy::volume::LabelVolume)
    /// tells whether a point before it lies in the volume.
    ///
    /// # Errors
    /// [`SynthError::Pose`] for a pose that a scene file would not be allowed either, [`SynthError::Nodes`],
    /// [`SynthError::Needle`], and errors of a GPU. The first frame with a needle or seeds may also give those of
    /// [`Self::set`].
    pub fn render(&mut self, state: &FrameState) -> Result<&Frame, SynthError> {
        self.drop_in_flight();
        let ticket = self.submit(state)?;
        self.take(ticket)
    }

    /// Renders one frame and leaves it on the GPU, in the texture returned by [`Synthesizer::texture`]. On a CPU
    /// backend it is the same as [`Synthesizer::render`].
    pub fn render_to_texture(&mut self, state: &FrameState) -> Result<(), SynthError> {
        if !matches!(self.executor, Executor::Gpu(_)) {
            return self.render(state).map(drop);
        }
        self.with_last(state, |gpu, plan, tables, state| {
            gpu.render_to_texture(plan, tables, state)
        })
    }

    /// Records a frame into an encoder of the host's own, on the device lent as [`Backend::Host`], up to its copy into
    /// [`Synthesizer::texture`]. The host submits the encoder before it records or renders the next frame. On a CPU
    /// backend nothing is recorded.
    #[cfg(feature = "gpu")]
    pub fn encode(&mut self, encoder: &mut wgpu::CommandEncoder, state: &FrameState) -> Result<(), SynthError> {
        self.with_last(state, |gpu, plan, tables, state| {
            gpu.encode(encoder, plan, tables, state)
        })
    }

    /// Has a GPU make a frame that stays there; its place becomes that of the last frame.
    fn with_last(
        &mut self,
        state: &FrameState,
        make: impl FnOnce(&mut gpu::GpuExecutor, &Plan, &Tables, &FrameState) -> Result<(), SynthError>,
    ) -> Result<(), SynthError> {
        self.take_settings(state)?;
        self.admit(std::slice::from_ref(state))?;
        check_finite(state)?;
        Self::begin(&self.tables, &mut self.local, state, &mut self.frame)?;
        let state = self.local.localized(state);
        match &mut self.executor {
            Executor::Gpu(gpu) => make(gpu, &self.plan, &self.tables, state),
            _ => Ok(()),
        }
    }

    /// Texture (R8Unorm) that holds the last frame of [`Synthesizer::render_to_texture`]; `None` on a CPU backend. The
    /// same texture is reused as long as the image size does not change.
    #[cfg(feature = "gpu")]
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        match &self.executor {
            Executor::Gpu(gpu) => gpu.texture(),
            _ => None,
        }
    }

    /// Checks a state and takes it over, and prepares the frame for it.
    fn begin(tables: &Tables, local: &mut LocalFrame, state: &FrameState, frame: &mut Frame) -> Result<(), SynthError> {
        let nodes = tables.mesh.as_ref().map_or(0, |mesh| mesh.nodes().len());
        check_positions(state.nodes.as_deref(), state.reference.as_deref(), nodes)?;
        state
            .needle
            .iter()
            .chain(&state.seeds)
            .try_for_each(NeedleShaft::check)?;
        let probe_to_world = local.take(state).map_err(SynthError::Pose)?;
        let local = local.localized(state);
        frame.needle = needle::view(tables, local);
        frame.left_out = REGISTRY.iter().map(|effect| (effect.left_out)(tables, local)).sum();
        frame.image_to_world = probe_to_world * tables.image_grid.image_to_probe();
        (frame.width, frame.height, frame.pixel_mm) = (tables.width(), tables.height(), tables.image_grid.pixel_mm());
        frame.pixels.resize(frame.width * frame.height, 0);
        Ok(())
    }

    /// Changes settings between frames: gain, depth, focus, effects. Only what depends on a changed setting is rebuilt,
    /// and the rebuilt buffers are returned. On an invalid setting the synthesizer is left unchanged. Frames in flight
    /// are dropped.
    pub fn set(&mut self, settings: Settings) -> Result<Vec<&'static Buffer>, SynthError> {
        self.drop_in_flight();
        self.change(settings)
    }

    fn change(&mut self, settings: Settings) -> Result<Vec<&'static Buffer>, SynthError> {
        // Without a team nobody shares the tables, and nothing is copied here.
        self.team = None;
        let tissues = Arc::clone(&self.tables.anatomy.tissues);
        self.set_with_tissues(settings, &tissues)
    }

    /// Takes over the settings of a state that has some.
    fn take_settings(&mut self, state: &FrameState) -> Result<(), SynthError> {
        let Some(own) = &state.settings else { return Ok(()) };
        let mut settings = own.settings.clone();
        // What a needle has called for stays.
        settings.has_needle |= self.tables.settings.has_needle;
        if self.tables.settings == settings && Arc::ptr_eq(&self.tables.anatomy.tissues, &own.tissues) {
            return Ok(());
        }
        self.drop_in_flight();
        self.set_with_tissues(settings, &own.tissues).map(drop)
    }

    fn set_with_tissues(
        &mut self,
        settings: Settings,
        tissues: &Arc<TissueTable>,
    ) -> Result<Vec<&'static Buffer>, SynthError> {
        let previous = (self.tables.settings.clone(), Arc::clone(&self.tables.anatomy.tissues));
        let changed = Arc::make_mut(&mut self.tables).set_with_tissues(settings, tissues)?;
        if let Err(refused) = self.fit(&changed) {
            let changed = Arc::make_mut(&mut self.tables).set_with_tissues(previous.0, &previous.1)?;
            self.fit(&changed)?;
            return Err(refused);
        }
        let (width, height) = (self.tables.width(), self.tables.height());
        if (self.frame.width, self.frame.height) != (width, height) {
            (self.frame.width, self.frame.height) = (width, height);
            self.frame.pixels = vec![0; width * height];
        }
        self.frame.pixel_mm = self.tables.image_grid.pixel_mm();
        Ok(changed)
    }

    /// Has the pass of needle and seeds made for the first of these states that has one. Frames in flight stay.
    fn admit(&mut self, states: &[FrameState]) -> Result<(), SynthError> {
        let settings = &self.tables.settings;
        let is_called_for = |state: &FrameState| state.needle.is_some() || !state.seeds.is_empty();
        if settings.has_needle || settings.effects.needle.is_none() || !states.iter().any(is_called_for) {
            return Ok(());
        }
        let mut settings = settings.clone();
        settings.has_needle = true;
        self.finish_in_flight()?;
        self.change(settings).map(drop)
    }

    fn fit(&mut self, changed: &[&'static Buffer]) -> Result<(), SynthError> {
        self.plan = Plan::new(&self.tables);
        match &mut self.executor {
            Executor::Cpu(cpu) => cpu.fit(&self.plan, &self.tables)?,
            Executor::CpuF64(cpu) => cpu.fit(&self.plan, &self.tables)?,
            Executor::Gpu(gpu) => gpu.fit(&self.plan, &self.tables, changed)?,
        }
        Ok(())
    }

    /// Current settings.
    pub fn settings(&self) -> &Settings {
        &self.tables.settings
    }

    /// Current plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The derived tables.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }

    /// The last frame.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// `cpu`, `cpu-f64` or `gpu`.
    pub fn backend(&self) -> &'static str {
        match &self.executor {
            Executor::Cpu(_) => "cpu",
            Executor::CpuF64(_) => "cpu-f64",
            Executor::Gpu(_) => "gpu",
        }
    }

    /// The GPU and its adapter, on the GPU backend.
    pub fn gpu(&self) -> Option<&insonify_gpu::Gpu> {
        match &self.executor {
            Executor::Gpu(gpu) => Some(gpu.gpu()),
            _ => None,
        }
    }

    /// Enables or disables timing of passes. Off initially. A GPU makes each timed frame twice: by passes one by one,
    /// for their times, and fused.
    pub fn time_passes(&mut self, on: bool) -> Result<(), SynthError> {
        match &mut self.executor {
            Executor::Cpu(cpu) => cpu.timed = on,
            Executor::CpuF64(cpu) => cpu.timed = on,
            Executor::Gpu(gpu) => gpu.time_passes(on, &self.plan, &self.tables)?,
        }
        Ok(())
    }

    /// Durations of the passes of the last frame; empty if not measured.
    pub fn pass_times(&self) -> &[PassTime] {
        match &self.executor {
            Executor::Cpu(cpu) => &cpu.times,
            Executor::CpuF64(cpu) => &cpu.times,
            Executor::Gpu(gpu) => gpu.times(),
        }
    }

    /// GPU time of the last frame, whose passes are fused, from its first timestamp to its last, ms; `None` on a CPU
    /// backend, on a device without timestamps, and while passes are not timed.
    pub fn gpu_frame_ms(&self) -> Option<f64> {
        match &self.executor {
            Executor::Gpu(gpu) => gpu.frame_ms(),
            _ => None,
        }
    }

    /// Beam-space results of the last frame in world coordinates, for ground-truth layers.
    pub fn beam(&self) -> Result<layers::Beam, SynthError> {
        self.beam_after(self.plan.passes.len())
    }

    fn begin_alone(&mut self, state: &FrameState) -> Result<(), SynthError> {
        self.drop_in_flight();
        self.take_settings(state)?;
        self.admit(std::slice::from_ref(state))?;
        Self::begin(&self.tables, &mut self.local, state, &mut Frame::default())
    }

    /// Runs the passes up to and including `pass` and returns the beam-space results; nothing is displayed. For
    /// inspection of a frame and for tests. All passes run if the plan has none of that name.
    pub fn render_until(&mut self, pass: &str, state: &FrameState) -> Result<layers::Beam, SynthError> {
        self.begin_alone(state)?;
        let state = self.local.localized(state);
        let passes = &self.plan.passes;
        let end = passes
            .iter()
            .rposition(|planned| planned.pass.name == pass)
            .map_or(passes.len(), |index| index + 1);
        match &mut self.executor {
            Executor::Cpu(cpu) => cpu.run(&passes[..end], &self.tables, state)?,
            Executor::CpuF64(cpu) => cpu.run(&passes[..end], &self.tables, state)?,
            Executor::Gpu(gpu) => gpu.run_until(pass, &self.plan, &self.tables, state)?,
        }
        self.beam_after(end)
    }

    /// Runs the passes one by one and returns the beam-space results after each; nothing is displayed.
    #[cfg(any(test, feature = "analysis"))]
    pub(crate) fn render_each(&mut self, state: &FrameState) -> Result<Vec<layers::Beam>, SynthError> {
        self.begin_alone(state)?;
        let mut beams = Vec::with_capacity(self.plan.passes.len());
        for index in 0..self.plan.passes.len() {
            let (state, passes) = (self.local.localized(state), &self.plan.passes[..=index]);
            match (&mut self.executor, passes) {
                (Executor::Cpu(cpu), [.., last]) => cpu.run(std::slice::from_ref(last), &self.tables, state)?,
                (Executor::CpuF64(cpu), [.., last]) => cpu.run(std::slice::from_ref(last), &self.tables, state)?,
                (Executor::Gpu(gpu), [.., behind, last]) => gpu.run_on(behind.pass.name, last.pass.name)?,
                (Executor::Gpu(gpu), [first]) => gpu.run_until(first.pass.name, &self.plan, &self.tables, state)?,
                (_, []) => {}
            }
            beams.push(self.beam_after(index + 1)?);
        }
        Ok(beams)
    }

    fn beam_after(&self, passes: usize) -> Result<layers::Beam, SynthError> {
        let local = match &self.executor {
            Executor::Cpu(cpu) => layers::Beam::of_store(&cpu.store, &self.tables),
            Executor::CpuF64(cpu) => layers::Beam::of_store(&cpu.store, &self.tables),
            Executor::Gpu(gpu) => {
                let flips = self.plan.passes[..passes].iter().filter(|planned| planned.pass.flips);
                gpu.beam(flips.count() % 2 == 1, &self.tables)?
            }
        };
        Ok(self.tables.origin.beam_into_world(local))
    }

    /// Names of the passes compiled for the GPU, each once; empty on a CPU backend.
    pub fn pipelines(&self) -> Vec<&'static str> {
        match &self.executor {
            Executor::Gpu(gpu) => gpu.pipelines().collect(),
            _ => Vec::new(),
        }
    }

    /// Bytes of working memory on the backend.
    pub fn memory_bytes(&self) -> u64 {
        match &self.executor {
            Executor::Cpu(cpu) => cpu.store.bytes() as u64,
            Executor::CpuF64(cpu) => cpu.store.bytes() as u64,
            Executor::Gpu(gpu) => gpu.bytes(),
        }
    }
}

/// Refuses positions of nodes that are NaN or infinite: nothing would be seen in their elements.
fn check_finite(state: &FrameState) -> Result<(), SynthError> {
    let is_lost = |node: &[f64; 3]| !node.iter().all(|x| x.is_finite());
    for positions in [&state.nodes, &state.reference].into_iter().flatten() {
        if let Some(node) = positions.iter().position(is_lost) {
            let position = positions[node];
            return Err(InvalidMesh::Coordinate { node, position }.into());
        }
    }
    Ok(())
}

// Input state and output of a frame.

/// Shaft of a needle, or a seed, in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct NeedleShaft {
    /// Nodes of the shaft, mm, hub first and tip last; two for a straight one, none where there is no shaft yet. If
    /// there are more than 65, those towards the tip are shown.
    pub nodes: Vec<Point3<f64>>,
    /// Diameter, mm.
    pub diameter_mm: f64,
}

/// Length of a usual brachytherapy seed, mm.
pub const SEED_LENGTH_MM: f64 = 4.5;
/// Diameter of a usual brachytherapy seed, mm.
pub const SEED_DIAMETER_MM: f64 = 0.8;

impl NeedleShaft {
    fn check(&self) -> Result<(), SynthError> {
        let wrong = if !(0.0..f64::INFINITY).contains(&self.diameter_mm) {
            format!("a diameter of {} mm; expected 0 or more", self.diameter_mm)
        } else if let Some(node) = self.nodes.iter().find(|node| !node.iter().all(|x| x.is_finite())) {
            format!("a node at {:?} mm; expected finite numbers", [node.x, node.y, node.z])
        } else if self.nodes.len() == 1 {
            "one node; expected two or more".to_owned()
        } else {
            return Ok(());
        };
        Err(SynthError::Needle(wrong))
    }

    /// A brachytherapy seed centred at `centre_mm` (world) along a direction of any length but 0, with which a frame is
    /// refused.
    pub fn seed(centre_mm: Point3<f64>, along: &Vector3<f64>) -> Self {
        let half = along.normalize() * (SEED_LENGTH_MM / 2.0);
        Self {
            nodes: vec![centre_mm - half, centre_mm + half],
            diameter_mm: SEED_DIAMETER_MM,
        }
    }
}

/// State that varies from frame to frame. All positions are in the world, the probe at most 1e6 mm from its origin:
/// they are in double precision, and are translated near 0 before they are rounded.
#[derive(Clone, Debug)]
pub struct FrameState {
    /// Frame number; it seeds the additive noise.
    pub frame: u64,
    /// Transform from the probe frame to the world, on column vectors, mm: rigid. Rotations with errors of up to 5e-3
    /// per entry are orthonormalised, as those of files are, others refused with [`SynthError::Pose`].
    pub probe_to_world: Matrix4<f64>,
    /// Needle of this frame, if any. Giving one is calling for it: its pass is made at the first frame with a needle or
    /// seeds, where the settings have not announced them ([`tables::Settings::has_needle`]). Without
    /// [`Effects::needle`](crate::effects::Effects::needle), as in a scene with `needle = false`, it is not drawn;
    /// [`Frame::needle`] says so.
    pub needle: Option<NeedleShaft>,
    /// Seeds in the tissue, and other shafts beside the needle: shown as the needle is, with or without one. Of those
    /// that meet the scan plane the first are shown, up to 256 segments with the needle's; [`Frame::left_out`] counts
    /// the others.
    pub seeds: Vec<NeedleShaft>,
    /// Current positions of the mesh nodes, mm; `None` keeps those of the last frame (initially the reference).
    pub nodes: Option<Vec<[f64; 3]>>,
    /// Reference positions of the mesh nodes, mm, which remeshing moves; `None` keeps those of the last frame
    /// (initially those of the mesh). Labels, textures and speckle are looked up there.
    pub reference: Option<Vec<[f64; 3]>>,
    /// Settings and tissues from this frame on, as [`Synthesizer::set`] changes them; `None` keeps those of the last
    /// frame.
    pub settings: Option<Arc<FrameSettings>>,
}

impl FrameState {
    /// A frame state with only a probe pose.
    pub fn at(probe_to_world: Matrix4<f64>) -> Self {
        Self {
            frame: 0,
            probe_to_world,
            needle: None,
            seeds: Vec::new(),
            nodes: None,
            reference: None,
            settings: None,
        }
    }
}

/// View of a needle in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NeedleView {
    /// A part of it lies in the imaged sector.
    Inside,
    /// None of it does, as it is beside the scan plane or beyond the edges of the sector.
    Outside {
        /// Distance of its centre line from the sector, mm, to within a millimetre; infinite without nodes.
        distance_mm: f64,
    },
    /// The settings have no [`Effects::needle`](crate::effects::Effects::needle): it is not drawn.
    Excluded,
}

/// A rendered frame: an image in grey levels, where it lies in the world, and what is shown in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels (0 to 255), `height` rows of `width`, from the top.
    pub pixels: Vec<u8>,
    /// Transform from pixels (column, row, 0) to the world (LPS), mm.
    pub image_to_world: Matrix4<f64>,
    /// Pixel size, mm.
    pub pixel_mm: f64,
    /// View of the needle given to this frame; `None` if none was given.
    pub needle: Option<NeedleView>,
    /// Number of segments of needle and seeds not shown because there are too many.
    pub left_out: usize,
    /// Images of the ground-truth layers asked for ([`tables::Settings::layers`]), in that order.
    pub layers: Vec<Vec<u16>>,
}

#[cfg(test)]
mod tests;
