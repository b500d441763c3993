//! Main loop of a scenario: it moves the instruments, steps the model and notifies an observer.

pub mod deformed;
pub mod material_points;
#[cfg(feature = "record")]
pub mod record;
pub mod summary;
mod trial;

pub use trial::Trial;

use std::time::Instant;

use nalgebra::{Isometry3, Matrix4, Vector3};

use crate::input::scenario::Scenario;
use crate::input::scenario::guidance::{Guidance, Guide};
use crate::input::scenario::reported_points::{Displaced, Points};
use insonify_imaging::synth::{FrameState, NeedleShaft};
use insonify_mechanics::insertion::{Model, NodeSolver, Outcome, ShaftLoad, Snapshot, StepCost, StepError, Tissue};
use insonify_mechanics::needle::CentreLine;
use material_points::MaterialPoints;
use summary::{Summary, Tally};

/// Tolerance for reaching a time, as a fraction of a step.
const REACHED: f64 = 1e-6;

/// A completed step.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// Step number, counted from 1.
    pub number: u64,
    /// Simulated time at the end of the step, s from the start of the run.
    pub time_s: f64,
    /// Transform from the base frame of the needle to world.
    pub base: Isometry3<f64>,
    /// Transform from the frame of the probe in contact (see
    /// [`ProbeContact`](insonify_mechanics::insertion::ProbeContact)) to world; without one, from that of the imaging
    /// probe.
    pub probe: Isometry3<f64>,
    /// Outcome of the step.
    pub outcome: &'a Outcome,
    /// Forces of the tissue on the needle, base first.
    pub loads: &'a [ShaftLoad],
    /// Force on the probe split between the two points that drive it, N, world axes; `None` for a probe without such
    /// points.
    pub driven: Option<[Vector3<f64>; 2]>,
    /// Geometry from which the insertion is scored.
    pub guidance: Guidance,
    /// Duration of the step, ms.
    pub ms: f64,
    /// CPU time of the calling thread in the step, ms; `None` where the system does not state it. Wall time also counts
    /// what other programs take.
    pub cpu_ms: Option<f64>,
    /// Wall time of the step by kind of work; `None` for models that do not measure it.
    pub cost: Option<&'a StepCost>,
}

/// Returns the CPU time of this thread, ms.
fn thread_cpu_ms() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Some(time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6)
    }
    #[cfg(not(unix))]
    None
}

/// A moment at which an image is due.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// Number of the image, counted from 0.
    pub number: u64,
    /// Simulated time, s from the start of the run.
    pub time_s: f64,
    /// Distance of the tip from the nearest critical structure at rest, mm: see [`Guidance`].
    pub clearance_mm: Option<f64>,
    /// State that a [`Synthesizer`](insonify_imaging::synth::Synthesizer) renders.
    pub state: &'a FrameState,
}

/// Export of the deformed mesh at one time.
#[derive(Clone, Copy, Debug)]
pub struct Deformed<'a> {
    /// Number of the mesh, counted from 0.
    pub number: u64,
    /// Simulated time, s from the start of the run.
    pub time_s: f64,
    /// Elements, four nodes each.
    pub elements: &'a [[u32; 4]],
    /// Deformed tissue with node positions.
    pub tissue: &'a Tissue,
    /// Von Mises stress of each element, kPa; `None` for masses and springs, and for viscous tissue of which it is not
    /// followed.
    pub von_mises_kpa: Option<&'a [f64]>,
    /// Centre line of the needle.
    pub needle: &'a CentreLine,
    /// Forces of the tissue on the needle, base first.
    pub loads: &'a [ShaftLoad],
    /// Seeds in the tissue.
    pub seeds: &'a [NeedleShaft],
    /// Imaging probe to world.
    pub probe: Isometry3<f64>,
    /// Frame of the probe in contact to world.
    pub contact: Option<Isometry3<f64>>,
}

/// Observer of a run.
///
/// ```
/// use insonify::{Observer, Requests, ScenarioFile, Step, StepError, run_scenario};
///
/// /// The largest force on the hand, N.
/// struct Largest(f64);
///
/// impl Observer for Largest {
///     type Error = StepError;
///
///     fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
///         self.0 = self.0.max(step.outcome.on_hand.force_n.norm());
///         Ok(())
///     }
/// }
///
/// let text = r#"
/// version = 2
/// [scene]
/// volume = { phantom = "two-layer", resolution_mm = 3.0 }
/// image = { width = 160, height = 120 }
/// [tissue]
/// model = "mass-spring"
/// [[needle.motion.keyframes]]
/// time_s = 0.0
/// tip_mm = [8.0, 0.0, -46.0]
/// direction = [0.0, 0.0, 1.0]
/// [[needle.motion.keyframes]]
/// time_s = 0.1
/// tip_mm = [8.0, 0.0, -26.0]
/// direction = [0.0, 0.0, 1.0]
/// "#;
/// let scenario = ScenarioFile::parse(text, "insert.toml")?.resolve(".".as_ref(), |_| ())?;
/// let mut model = scenario.model(|_, _| {})?;
/// let mut largest = Largest(0.0);
/// let summary = run_scenario(&scenario, model.as_mut(), Requests::default(), &mut largest)?;
/// assert_eq!(summary.steps, 100);
/// assert!((summary.max_base_force_n - largest.0).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Observer {
    /// Errors of the observer and of steps.
    type Error: From<StepError>;

    /// Called after every step.
    ///
    /// # Errors
    /// Errors of the observer; they end the run.
    fn step(&mut self, step: &Step<'_>) -> Result<(), Self::Error>;

    /// Called when an image is due, if frames were requested.
    ///
    /// # Errors
    /// Errors of the observer; they end the run.
    fn frame(&mut self, _moment: &Moment<'_>) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called when the mesh is due, if it was requested.
    ///
    /// # Errors
    /// Errors of the observer; they end the run.
    fn mesh(&mut self, _deformed: &Deformed<'_>) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Called at the scenario's rate of frames if points are reported. By default it does nothing.
    ///
    /// # Errors
    /// Errors of the observer; they end the run.
    fn points(&mut self, _displaced: &Displaced<'_>) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// Output requested in addition to steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Requests {
    /// Whether frames are requested, at the scenario's rate.
    pub frames: bool,
    /// Interval between deformed meshes, s of simulated time (above 0).
    pub mesh_s: Option<f64>,
}

/// Equidistant moments from the start on, each reported after the first step that reaches it.
struct Beat {
    every_s: f64,
    next: u64,
}

impl Beat {
    /// Number of the next moment, if a time has reached it. A step longer than the interval reports one moment.
    fn reached(&mut self, time_s: f64, dt_s: f64) -> Option<u64> {
        let number = self.next;
        let due = time_s + REACHED * dt_s >= number as f64 * self.every_s;
        self.next += u64::from(due);
        due.then_some(number)
    }
}

/// Runs a scenario from start to end. Step times are measured and reported; nothing depends on them.
///
/// ```
/// use insonify::run::{Moment, Observer, Requests, Step, run};
/// use insonify::{ScenarioFile, StepError};
///
/// /// Counts images and events.
/// #[derive(Default)]
/// struct Counts([usize; 2]);
///
/// impl Observer for Counts {
///     type Error = StepError;
///
///     fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
///         self.0[1] += step.outcome.events.len();
///         Ok(())
///     }
///
///     fn frame(&mut self, moment: &Moment<'_>) -> Result<(), StepError> {
///         assert!(moment.state.needle.is_some(), "a synthesizer renders this state");
///         self.0[0] += 1;
///         Ok(())
///     }
/// }
///
/// let text = r#"
/// [scene]
/// volume = { phantom = "two-layer", resolution_mm = 3.0 }
/// [tissue]
/// model = "mass-spring"
/// [[needle.motion.keyframes]]
/// time_s = 0.0
/// tip_mm = [8.0, 0.0, -46.0]
/// direction = [0.0, 0.0, 1.0]
/// [[needle.motion.keyframes]]
/// time_s = 0.1
/// tip_mm = [8.0, 0.0, -26.0]
/// direction = [0.0, 0.0, 1.0]
/// "#;
/// let scenario = ScenarioFile::parse(text, "insert.toml")?.resolve(".".as_ref(), |_| ())?;
/// let mut model = scenario.model(|_, _| {})?;
/// let mut counts = Counts::default();
/// let requests = Requests { frames: true, mesh_s: None };
/// let summary = run(&scenario, model.as_mut(), requests, &mut counts)?;
/// assert_eq!((counts.0[1], summary.steps), (summary.events.len(), 100));
/// assert!(counts.0[0] > 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
/// # Errors
/// Errors of steps, of changes of level, and of the observer.
pub fn run<O: Observer>(
    scenario: &Scenario,
    model: &mut dyn Model,
    requests: Requests,
    observer: &mut O,
) -> Result<Summary, O::Error> {
    let timing = scenario.timing;
    let contact = scenario.contact();
    let beat = |every_s| Beat { every_s, next: 0 };
    let mut frames = requests.frames.then(|| beat(timing.frame_s));
    let mut meshes = requests.mesh_s.map(beat);
    let mut guide = Guide::new(scenario);
    let mut points = Points::new(scenario);
    let mut carried = (guide.follows() || points.follows()).then(|| beat(timing.frame_s));
    match scenario.start() {
        Some(state) => model.restore(state)?,
        None => model.start(&scenario.instruments(0)),
    }
    let mut view = View::new(scenario, model);
    let mut tally = Tally::new(scenario);
    let mut changes = scenario.level_changes().iter().peekable();
    let mut loads = Vec::new();
    for number in 1..=timing.steps {
        // A change takes effect before the step that reaches its time.
        while let Some((_, level)) = changes.next_if(|(at_s, _)| timing.step_at(*at_s) <= number) {
            tally.change(number, &model.set_level(*level)?);
        }
        let instruments = scenario.instruments(number);
        let (start, cpu_start) = (Instant::now(), thread_cpu_ms());
        model.step(&instruments, timing.dt_s)?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let cpu_ms = thread_cpu_ms().zip(cpu_start).map(|(end, start)| end - start);
        model.shaft_loads(&mut loads);
        let step = Step {
            number,
            time_s: number as f64 * timing.dt_s,
            base: instruments.base,
            probe: instruments.probe.unwrap_or_else(|| scenario.probe(number)),
            outcome: model.outcome(),
            loads: &loads,
            driven: contact.and_then(|contact| contact.driven(instruments.probe.as_ref(), model.outcome())),
            guidance: guide.at(model, &instruments.base, &scenario.probe(number)),
            ms,
            cpu_ms,
            cost: model.cost(),
        };
        tally.add(&step);
        observer.step(&step)?;
        let (time_s, clearance_mm) = (step.time_s, step.guidance.clearance_mm);
        let frame = frames.as_mut().and_then(|beat| beat.reached(time_s, timing.dt_s));
        let mesh = meshes.as_mut().and_then(|beat| beat.reached(time_s, timing.dt_s));
        let carry = carried.as_mut().and_then(|beat| beat.reached(time_s, timing.dt_s));
        if frame.is_none() && mesh.is_none() && carry.is_none() {
            continue;
        }
        view.look(model, &instruments.base);
        guide.carry(view.imager.as_ref(), &view.tissue);
        if carry.is_some() && points.follows() {
            let displaced = Displaced {
                time_s,
                inserted_mm: model.outcome().inserted_mm,
                displacement_mm: points.carry(view.imager.as_ref(), &view.tissue, &scenario.probe(number)),
            };
            tally.displace(&displaced);
            observer.points(&displaced)?;
        }
        if frame.is_none() && mesh.is_none() {
            continue;
        }
        tally.see(&view.tissue);
        if let Some(number_of_frame) = frame {
            let state = view.state(number_of_frame, scenario.probe(number).to_homogeneous());
            observer.frame(&Moment {
                number: number_of_frame,
                time_s,
                clearance_mm,
                state,
            })?;
        }
        if let Some(number_of_mesh) = mesh {
            observer.mesh(&view.deformed(scenario, model, number_of_mesh, number))?;
        }
    }
    model.snapshot(&mut view.snapshot);
    Ok(tally.finish(&view.snapshot))
}

/// Inputs of an image taken from a model, in reused memory.
struct View {
    imager: Box<dyn NodeSolver>,
    snapshot: Snapshot,
    tissue: Tissue,
    state: FrameState,
    seeds: MaterialPoints,
    loads: Vec<ShaftLoad>,
    von_mises_kpa: Option<Vec<f64>>,
}

impl View {
    fn new(scenario: &Scenario, model: &dyn Model) -> Self {
        let mut state = FrameState::at(Matrix4::identity());
        state.needle = Some(NeedleShaft {
            nodes: Vec::new(),
            diameter_mm: scenario.needle.diameter_mm,
        });
        state.nodes = Some(Vec::new());
        state.reference = Some(Vec::new());
        Self {
            imager: model.imager(),
            snapshot: Snapshot::default(),
            tissue: Tissue::default(),
            state,
            seeds: MaterialPoints::default(),
            loads: Vec::new(),
            von_mises_kpa: None,
        }
    }

    fn look(&mut self, model: &mut dyn Model, base: &Isometry3<f64>) {
        model.snapshot(&mut self.snapshot);
        // Seeds leave the needle along its direction.
        self.seeds
            .along
            .resize(self.snapshot.seeds.len(), base.rotation * Vector3::z());
        self.imager.tissue(&self.snapshot, &mut self.tissue);
    }

    /// Deformed mesh of a number, after a step, with needle, seeds and probe.
    fn deformed(&mut self, scenario: &Scenario, model: &dyn Model, number: u64, step: u64) -> Deformed<'_> {
        let probe = scenario.probe(step);
        self.state(number, probe.to_homogeneous());
        model.shaft_loads(&mut self.loads);
        self.von_mises_kpa = scenario.von_mises_kpa(model, self.imager.elements(), &self.tissue);
        Deformed {
            number,
            time_s: step as f64 * scenario.timing.dt_s,
            elements: self.imager.elements(),
            tissue: &self.tissue,
            von_mises_kpa: self.von_mises_kpa.as_deref(),
            needle: &self.snapshot.line,
            loads: &self.loads,
            seeds: &self.state.seeds,
            probe,
            contact: scenario.instruments(step).probe,
        }
    }

    fn state(&mut self, frame: u64, probe_to_world: Matrix4<f64>) -> &FrameState {
        self.state.frame = frame;
        self.state.probe_to_world = probe_to_world;
        if let Some(needle) = &mut self.state.needle {
            needle.nodes.clear();
            needle
                .nodes
                .extend(self.snapshot.line.nodes().iter().map(|(_, point)| *point));
        }
        let (seeds, tissue) = (&self.snapshot.seeds, &self.tissue);
        self.seeds
            .place(seeds, self.imager.elements(), tissue, &mut self.state.seeds);
        if let Some(nodes) = &mut self.state.nodes {
            nodes.clone_from(&self.tissue.current);
        }
        if let Some(nodes) = &mut self.state.reference {
            nodes.clone_from(&self.tissue.reference);
        }
        &self.state
    }
}
