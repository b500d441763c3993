//! `insonify` synthesises B-mode ultrasound frames from labelled volumes, on the GPU through wgpu and on a CPU
//! reference that checks every pass.
//!
//! # Examples
//!
//! A frame of a scene. The GPU or the CPU makes it; here, the CPU:
//!
//! ```
//! use insonify::{Backend, SceneFile};
//!
//! let text = r#"
//! version = 2
//! volume = { phantom = "abdomen", resolution_mm = 4.0 }
//! image = { width = 320, height = 240 }
//! "#;
//! let scene = SceneFile::parse(text, "scene.toml")?.resolve(".".as_ref())?;
//! let mut synthesizer = scene.synthesizer(Backend::Cpu)?;
//! for state in scene.states(1) {
//!     // A state has the poses of probe and needle, and the positions of mesh nodes.
//!     let frame = synthesizer.render(&state?)?;
//!     assert_eq!((frame.width, frame.height, frame.pixels.len()), (320, 240, 320 * 240));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Steps of an insertion at haptic rate, and an image of the moved tissue:
//!
//! ```
//! use insonify::{Backend, ScenarioFile, Simulator, SimulatorOptions};
//!
//! let text = r#"
//! version = 2
//! [scene]
//! volume = { phantom = "two-layer", resolution_mm = 3.0 }
//! image = { width = 160, height = 120 }
//! [tissue]
//! model = "mass-spring"
//! [[needle.motion.keyframes]]
//! time_s = 0.0
//! tip_mm = [8.0, 0.0, -46.0]
//! direction = [0.0, 0.0, 1.0]
//! [[needle.motion.keyframes]]
//! time_s = 0.1
//! tip_mm = [8.0, 0.0, -26.0]
//! direction = [0.0, 0.0, 1.0]
//! "#;
//! let scenario = ScenarioFile::parse(text, "insert.toml")?.resolve(".".as_ref(), |_| ())?;
//! let mut simulator = Simulator::of_scenario(&scenario, Backend::Cpu, SimulatorOptions::default())?;
//! for step in 1..=scenario.timing.steps {
//!     // In a simulator, the poses that devices measure; the forces are rendered on them.
//!     let forces = simulator.step(&scenario.instruments(step), scenario.timing.dt_s)?;
//!     assert!(forces.axial_n() < 1e-9);
//! }
//! let view = scenario.scene.probe_pose(0, 1);
//! let frame = simulator.frame(view.probe_to_world())?;
//! assert!(frame.pixels.iter().any(|grey| *grey > 0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is where
//!
//! | for | at the root |
//! |---|---|
//! | scenes | [`SceneFile`], [`Setting`], [`Scene`], [`DEFAULT_SCENE`], [`Plan`], [`Sidecar`] |
//! | frames | [`Synthesizer`], [`FrameState`], [`FrameSettings`], [`NeedleShaft`], [`Frame`], [`NeedleView`], [`Backend`], [`Ticket`], [`PassTime`], [`SynthError`] |
//! | settings of frames | [`Settings`], [`ImageSize`], [`Effects`] with the parameters of each effect, [`Layer`], [`Probe`], [`ProbeShape`], [`probe`] |
//! | what frames show | [`Anatomy`], [`LabelVolume`], [`Label`], [`Tissue`], [`TissueTable`], [`builtin_tissue`], [`SolidTexture`], [`Phantom`], [`PhantomOptions`], [`make_phantom`], [`Tables`], [`Buffer`] |
//! | GPUs | [`Gpu`], [`AdapterChoice`], [`AdapterReport`], [`Needs`], [`row_stride`], [`GpuError`] |
//! | simulators | [`Simulator`], [`Haptic`], [`Imaging`], [`SimulatorOptions`], [`Policy`], [`Forces`], [`SimulatorState`], [`Recording`], [`RecordedInput`], [`SimulatorError`] |
//! | haptic devices | [`TwoPoints`], [`PointsPose`], [`Damper`], [`LateralHold`], [`HoldOptions`], [`TemplateGuided`], [`Template`], [`UnknownHole`] |
//! | models of insertions | [`Model`], [`Instruments`], [`Outcome`], [`Wrench`], [`Event`], [`EventKind`], [`StepError`], [`Saved`], [`ShaftLoad`], [`LevelChange`] |
//! | images of models | [`NodeSolver`], [`Snapshot`], [`Field`], [`TissueAtTip`], [`MovedTissue`] |
//! | tissue models | [`Finite`], [`FiniteOptions`], [`Setup`], [`Level`], [`Precision`]; [`MassSpring`], [`MassSpringParameters`]; [`Nonlinear`], [`NonlinearSetup`]; [`Material`], [`Interaction`], [`Peak`], [`Bone`], [`InsertionAnatomy`], [`MeshRegions`], [`ProbeContact`], [`TissueMotion`], [`InvalidSetup`] |
//! | needles | [`Needle`], [`Rigid`], [`Flexible`], [`Shaft`], [`Stiffness`], [`Bevel`], [`BEVEL_MM`], [`LINK_MM`], [`CentreLine`], [`Load`], [`Entry`], [`Row`] |
//! | scenarios | [`ScenarioFile`], [`Scenario`], [`SCENARIOS`], [`run_scenario`], [`Observer`], [`Requests`], [`Step`], [`Moment`], [`Deformed`], [`Summary`], [`Record`] |
//! | meshes, poses and paths | [`TetMesh`], [`Displacement`], [`Pose`], [`Trajectory`], [`Sequence`] |
//! | files | [`load_volume`], [`save_volume`], [`read_mesh`], [`write_png`], [`SequenceWriter`], [`FrameInfo`] |
//! | errors | [`Error`], [`Blame`], [`InputError`], [`OutputError`], [`OutOfRange`], [`VolumeError`], [`InvalidMesh`], [`TrackingError`] |
//!
//! # Modules
//!
//! This crate is what a simulator and a renderer need. What it does not have at its root stands in its modules and in
//! the crates below it:
//!
//! | module or crate | contents |
//! |---|---|
//! | [`input`] | needle insertions and static problems as TOML files |
//! | [`run`] | an insertion step by step, its summary and its record |
//! | [`solve`] | static problems and problems in time, solved |
//! | [`simulator`] | steps at haptic rate, images on another thread |
//! | [`insonify_base`] | documents, text, memory, random numbers, output files |
//! | [`insonify_gpu`] | adapters, devices, pipelines, read-back; independent of ultrasound |
//! | [`insonify_mesh`] | tetrahedral meshes |
//! | [`insonify_anatomy`] | labelled volumes and their formats, phantoms, segmentations, acoustics of tissue |
//! | [`insonify_tracking`] | probe geometry, poses, trajectories, tracked sequences |
//! | [`insonify_imaging`] | scenes, effects, plan, execution on the CPU or the GPU, sequences of frames |
//! | [`insonify_mechanics`] | tissue, needles, insertions, remeshing |
//!
//! Features, on by default: `gpu` renders and remeshes on a GPU through wgpu; `record` has files, plots and pages of
//! insertions. For frames alone, [`insonify_imaging`] suffices. Studies and the command are crates of their own.
//! Arguments are types of `nalgebra` 0.35; a device of the host ([`Backend::Host`]) is one of `wgpu` 30.
//!
//! # Threads
//!
//! Loops run on the threads of rayon's pool, one a core unless the environment variable `RAYON_NUM_THREADS` states
//! their number. Frames and steps that are to leave cores free run in a pool of their own; results do not depend on the
//! number of threads:
//!
//! ```
//! use insonify::base::parallel::Pool;
//! use insonify::{Backend, DEFAULT_SCENE, SceneFile};
//!
//! let scene = SceneFile::parse(DEFAULT_SCENE, "scene")?.resolve(".".as_ref())?;
//! let mut synthesizer = scene.synthesizer(Backend::Cpu)?;
//! let pool = Pool::new(2)?;
//! for state in scene.states(1) {
//!     let state = state?;
//!     let frame = pool.install(|| synthesizer.render(&state))?;
//!     assert!(frame.needle.is_none());
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Axes and units
//!
//! Lengths are millimetres, angles radians in code and degrees in files, moduli kilopascals. The world is LPS as in
//! DICOM and ITK. The probe frame has its origin at the centre of the transducer array, x lateral towards the marked
//! side, y axial into the body, z = x cross y. Images have columns along x and rows along y (PLUS orientation MF).

// The crates below, for what has no name at the root.
pub use {
    insonify_anatomy as anatomy, insonify_base as base, insonify_gpu as gpu, insonify_imaging as imaging,
    insonify_mechanics as mechanics, insonify_mesh as mesh, insonify_tracking as tracking,
};

pub mod input;
pub mod run;
pub mod simulator;
pub mod solve;

pub use input::scenario::{EXAMPLES as SCENARIOS, Scenario, ScenarioFile};
pub use insonify_anatomy::acoustics::presets::get as builtin_tissue;
pub use insonify_anatomy::acoustics::{Tissue, TissueTable};
pub use insonify_anatomy::phantom::{Phantom, PhantomOptions, make as make_phantom};
pub use insonify_anatomy::volume::texture::SolidTexture;
pub use insonify_anatomy::volume::{Label, LabelVolume, VolumeError, load as load_volume, save as save_volume};
pub use insonify_base::blame::{Blame, Error};
pub use insonify_base::document::{InputError, Setting};
pub use insonify_base::output::OutputError;
pub use insonify_base::output::png::write_grey as write_png;
pub use insonify_base::range::OutOfRange;
#[cfg(feature = "gpu")]
pub use insonify_gpu::row_stride;
pub use insonify_gpu::{AdapterChoice, AdapterReport, Gpu, GpuError, Needs};
pub use insonify_imaging::effects::Effects;
pub use insonify_imaging::effects::buffers::Buffer;
pub use insonify_imaging::effects::parameters::*;
pub use insonify_imaging::plan::Plan;
pub use insonify_imaging::scene::{DEFAULT as DEFAULT_SCENE, Scene, SceneFile};
pub use insonify_imaging::sequence::{FrameInfo, SequenceWriter};
pub use insonify_imaging::sidecar::Sidecar;
pub use insonify_imaging::synth::layers::Layer;
pub use insonify_imaging::synth::tables::{Anatomy, FrameSettings, ImageSize, Settings, Tables};
pub use insonify_imaging::synth::{
    Backend, Frame, FrameState, NeedleShaft, NeedleView, PassTime, SynthError, Synthesizer, Ticket,
};
pub use insonify_mechanics::insertion::finite::{Finite, FiniteOptions, Setup};
pub use insonify_mechanics::insertion::nonlinear::{Nonlinear, NonlinearSetup};
pub use insonify_mechanics::insertion::spring::{MassSpring, MassSpringParameters};
pub use insonify_mechanics::insertion::{
    Anatomy as InsertionAnatomy, Bone, Event, EventKind, Field, Instruments, Interaction, InvalidSetup, LevelChange,
    MeshRegions, Model, NodeSolver, Outcome, Peak, ProbeContact, RecordedInput, Recording, Saved, ShaftLoad,
    SimulatorState, Snapshot, StepError, Tissue as MovedTissue, TissueAtTip, TissueMotion, Wrench,
};
pub use insonify_mechanics::needle::{
    BEVEL_MM, Bevel, CentreLine, Entry, Flexible, LINK_MM, Load, Needle, Rigid, Row, Shaft, Stiffness,
};
pub use insonify_mechanics::tissue::material::Material;
pub use insonify_mechanics::tissue::remesh::{Level, Precision};
pub use insonify_mesh::file::read_mesh;
pub use insonify_mesh::{Displacement, InvalidMesh, TetMesh};
pub use insonify_tracking::TrackingError;
pub use insonify_tracking::pose::Pose;
pub use insonify_tracking::probe::{self, Probe, ProbeShape};
pub use insonify_tracking::sequence::Sequence;
pub use insonify_tracking::template::{Template, UnknownHole};
pub use insonify_tracking::trajectory::Trajectory;
#[cfg(feature = "record")]
pub use run::record::Record;
pub use run::summary::Summary;
pub use run::{Deformed, Moment, Observer, Requests, Step, run as run_scenario};
pub use simulator::{
    Damper, Forces, Haptic, HoldOptions, Imaging, LateralHold, PointsPose, Policy, Simulator, SimulatorError,
    SimulatorOptions, TemplateGuided, TwoPoints,
};

#[cfg(test)]
mod tests {
    #[test]
    fn versions_of_the_page_are_those_of_the_manifest() {
        for (crate_name, parts) in [("nalgebra", 2), ("wgpu", 1)] {
            let line = |line: &&str| line.starts_with(&format!("{crate_name} = {{ version = "));
            let line = include_str!("../Cargo.toml").lines().find(line).expect("a dependency");
            let version: Vec<&str> = line
                .split('"')
                .nth(1)
                .unwrap_or_default()
                .split('.')
                .take(parts)
                .collect();
            let told = format!("`{crate_name}` {}", version.join("."));
            assert!(include_str!("lib.rs").contains(&told), "{told}");
        }
    }
}
