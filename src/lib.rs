//! `insonify` synthesises B-mode ultrasound frames from labelled volumes, on the GPU through wgpu and on a CPU
//! reference that checks every pass.
//!
//! # Map
//!
//! | module | contents |
//! |---|---|
//! | [`base`] | documents, text, memory, random numbers, output files, reports |
//! | [`gpu`] | adapters, devices, pipelines, read-back; independent of ultrasound |
//! | [`anatomy`] | labelled volumes and their formats, phantoms, segmentations, acoustics of tissue |
//! | [`mechanics`] | meshes, tissue, needles, insertions, remeshing |
//! | [`tracking`] | probe geometry, poses, trajectories, tracked sequences |
//! | [`imaging`] | effects, plan, execution on the CPU or the GPU, accuracy levels, sequences of frames |
//! | [`input`] | scenes, scenarios, static problems, beam and material cases as TOML files |
//! | [`simulator`] | steps at haptic rate, images on another thread |
//! | [`study`] | benchmarks, parity, stability cases, trade-offs of accuracy and time |
//!
//! # Axes and units
//!
//! Lengths are millimetres, angles radians in code and degrees in files, moduli kilopascals. The world is LPS as in DICOM
//! and ITK. The probe frame has its origin at the centre of the transducer array, x lateral towards the marked side,
//! y axial into the body, z = x cross y. Images have columns along x and rows along y (PLUS orientation MF).

#![cfg_attr(not(feature = "internals"), warn(missing_docs))]
// The command is the only caller of much that is not worth a condition of its own.
#![cfg_attr(not(feature = "cli"), allow(dead_code, unused_imports))]

// Modules are private; the feature `internals` opens them to this package's tests, benches and examples.
#[cfg(not(feature = "internals"))]
mod anatomy;
#[cfg(feature = "internals")]
pub mod anatomy;
#[cfg(not(feature = "internals"))]
mod base;
#[cfg(feature = "internals")]
pub mod base;
#[cfg(not(feature = "internals"))]
mod error;
#[cfg(feature = "internals")]
pub mod error;
#[cfg(all(feature = "gpu", not(feature = "internals")))]
mod gpu;
#[cfg(all(feature = "gpu", feature = "internals"))]
pub mod gpu;
#[cfg(not(feature = "gpu"))]
#[path = "gpu/absent.rs"]
mod gpu;
#[cfg(not(feature = "internals"))]
mod imaging;
#[cfg(feature = "internals")]
pub mod imaging;
#[cfg(not(feature = "internals"))]
mod input;
#[cfg(feature = "internals")]
pub mod input;
#[cfg(not(feature = "internals"))]
mod mechanics;
#[cfg(feature = "internals")]
pub mod mechanics;
#[cfg(not(feature = "internals"))]
mod simulator;
#[cfg(feature = "internals")]
pub mod simulator;
#[cfg(all(feature = "cli", not(feature = "internals")))]
mod study;
#[cfg(all(feature = "cli", feature = "internals"))]
pub mod study;
#[cfg(not(feature = "internals"))]
mod tracking;
#[cfg(feature = "internals")]
pub mod tracking;

pub use anatomy::acoustics::presets::get as builtin_tissue;
pub use anatomy::acoustics::{Tissue, TissueTable};
pub use anatomy::phantom::Phantom;
pub use anatomy::volume::texture::SolidTexture;
pub use anatomy::volume::{Label, LabelVolume, VolumeError, load as load_volume, save as save_volume};
pub use base::cause::Cause;
pub use base::document::InputError;
pub use base::output::OutputError;
pub use base::output::png::write_grey as write_png;
pub use error::Error;
#[cfg(feature = "gpu")]
pub use gpu::row_stride;
pub use gpu::{AdapterChoice, Gpu, GpuError};
pub use imaging::effects::Effects;
pub use imaging::effects::blur::Blur;
pub use imaging::effects::contact::Contact;
pub use imaging::effects::interface::Interface;
pub use imaging::effects::needle::NeedleEcho;
pub use imaging::effects::noise::Noise;
pub use imaging::effects::receiver::Receiver;
pub use imaging::effects::refraction::Refraction;
pub use imaging::effects::shadow::Shadow;
pub use imaging::effects::slice::{Boundary, Slice};
pub use imaging::effects::speckle::Speckle;
pub use imaging::effects::texture::Texture;
pub use imaging::effects::thickness::Thickness;
pub use imaging::effects::tone::{Curve, Tone};
pub use imaging::plan::Plan;
pub use imaging::sequence::{FrameInfo, SequenceWriter};
pub use imaging::sidecar::Sidecar;
pub use imaging::synth::layers::Layer;
pub use imaging::synth::tables::{Anatomy, ImageSize, Settings};
pub use imaging::synth::{Backend, Frame, FrameState, NeedleShaft, SynthError, Synthesizer, Ticket};
#[cfg(feature = "cli")]
pub use input::scenario::record::Record;
pub use input::scenario::run::{Deformed, Moment, Observer, Requests, Step, run as run_scenario};
pub use input::scenario::{EXAMPLES as SCENARIOS, Scenario, ScenarioFile, Summary};
pub use input::scene::{DEFAULT as DEFAULT_SCENE, Scene, SceneFile};
pub use mechanics::insertion::finite::{Finite, Options as FiniteOptions, Setup};
pub use mechanics::insertion::nonlinear::{Nonlinear, Setup as NonlinearSetup};
pub use mechanics::insertion::spring::{MassSpring, Parameters as MassSpringParameters};
pub use mechanics::insertion::{
    Event, EventKind, Input as RecordedInput, Instruments, Interaction, MeshRegions, Model, Outcome, ProbeContact,
    Recording, State as SimulatorState, StepError,
};
pub use mechanics::mesh::file::read_mesh;
pub use mechanics::mesh::{Displacement, InvalidMesh, TetMesh};
pub use mechanics::needle::{BEVEL_MM, Bevel, Flexible, LINK_MM, Needle, Rigid, Shaft, Stiffness};
pub use mechanics::tissue::material::Material;
pub use mechanics::tissue::remesh::{Level, Precision};
pub use simulator::{
    Damper, Forces, Guided, Haptic, HoldOptions, Imaging, LateralHold, Options as SimulatorOptions, PointsPose, Policy,
    Simulator, SimulatorError, TwoPoints,
};
pub use tracking::TrackingError;
pub use tracking::pose::Pose;
pub use tracking::probe::{Probe, ProbeShape};
pub use tracking::sequence::Sequence;
pub use tracking::template::Template;

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
