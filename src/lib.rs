//! `insonify` synthesises B-mode ultrasound frames from labelled volumes, on the GPU through wgpu and on a CPU
//! reference that checks every pass.
//!
//! # Map
//!
//! | module | contents |
//! |---|---|
//! | [`document`] | user-written TOML files, and errors that point into them |
//! | [`scene`] | scene files, validated: every effect is optional |
//! | [`volume`] | labelled volumes, solid textures and their file formats |
//! | [`phantom`] | labelled volumes generated from code |
//! | [`tissue`] | the tissue table and the bank of solid textures |
//! | [`segmentation`] | label files and folders of masks, with named labels |
//! | [`tracking`] | probe geometry, poses, trajectories, tracked sequences |
//! | [`effects`] | the ordered registry of effects: parameters, CPU reference, pass declaration |
//! | [`plan`] | scene to passes and resources, each with its reason |
//! | [`quality`] | accuracy levels picked from their measured cost on this machine |
//! | [`synth`] | execution of a plan on the CPU or the GPU |
//! | [`gpu`] | adapters, devices, pipelines, read-back; independent of ultrasound |
//! | [`mechanics`] | tetrahedral meshes, point location, tissue that deforms |
//! | [`material_case`] | case files for material tests |
//! | [`simulator`] | steps at haptic rate, images on another thread |
//! | [`remesh_gpu`] | remeshing with the dense inverse on a GPU |
//! | [`scenario`] | scenario files for needle insertions, and their run |
//! | [`statics`] | problem files for static problems |
//! | [`beam_case`] | case files for needles bent at their base |
//! | [`report`] | tables, pages and plots of all reports |
//! | [`study`] | benchmarks, stability cases, and inspection of single pixels |
//! | [`text`] | sanitising of text from files for a terminal |
//! | [`output`] | PNG, image sequences, sidecars |
//!
//! # Axes and units
//!
//! Lengths are millimetres, angles radians in code and degrees in files, moduli kilopascals. The world is LPS as in DICOM
//! and ITK. The probe frame has its origin at the centre of the transducer array, x lateral towards the marked side,
//! y axial into the body, z = x cross y. Images have columns along x and rows along y (PLUS orientation MF).

#![cfg_attr(not(feature = "internals"), warn(missing_docs))]

// Modules are private; the feature `internals` opens them to this package's tests, benches and examples.
#[cfg(not(feature = "internals"))]
mod beam_case;
#[cfg(feature = "internals")]
pub mod beam_case;
#[cfg(not(feature = "internals"))]
mod document;
#[cfg(feature = "internals")]
pub mod document;
#[cfg(not(feature = "internals"))]
mod effects;
#[cfg(feature = "internals")]
pub mod effects;
#[cfg(not(feature = "internals"))]
mod error;
#[cfg(feature = "internals")]
pub mod error;
#[cfg(not(feature = "internals"))]
mod gpu;
#[cfg(feature = "internals")]
pub mod gpu;
#[cfg(not(feature = "internals"))]
mod material_case;
#[cfg(feature = "internals")]
pub mod material_case;
#[cfg(not(feature = "internals"))]
mod mechanics;
#[cfg(feature = "internals")]
pub mod mechanics;
#[cfg(not(feature = "internals"))]
mod memory;
#[cfg(feature = "internals")]
pub mod memory;
#[cfg(not(feature = "internals"))]
mod output;
#[cfg(feature = "internals")]
pub mod output;
#[cfg(not(feature = "internals"))]
mod phantom;
#[cfg(feature = "internals")]
pub mod phantom;
#[cfg(not(feature = "internals"))]
mod plan;
#[cfg(feature = "internals")]
pub mod plan;
#[cfg(not(feature = "internals"))]
mod quality;
#[cfg(feature = "internals")]
pub mod quality;
#[cfg(not(feature = "internals"))]
mod random;
#[cfg(feature = "internals")]
pub mod random;
mod read;
#[cfg(not(feature = "internals"))]
mod real;
#[cfg(feature = "internals")]
pub mod real;
#[cfg(not(feature = "internals"))]
mod remesh_gpu;
#[cfg(feature = "internals")]
pub mod remesh_gpu;
#[cfg(not(feature = "internals"))]
mod report;
#[cfg(feature = "internals")]
pub mod report;
#[cfg(not(feature = "internals"))]
mod scenario;
#[cfg(feature = "internals")]
pub mod scenario;
#[cfg(not(feature = "internals"))]
mod scene;
#[cfg(feature = "internals")]
pub mod scene;
#[cfg(not(feature = "internals"))]
mod segmentation;
#[cfg(feature = "internals")]
pub mod segmentation;
mod simd;
#[cfg(not(feature = "internals"))]
mod simulator;
#[cfg(feature = "internals")]
pub mod simulator;
#[cfg(not(feature = "internals"))]
mod statics;
#[cfg(feature = "internals")]
pub mod statics;
#[cfg(not(feature = "internals"))]
mod study;
#[cfg(feature = "internals")]
pub mod study;
#[cfg(not(feature = "internals"))]
mod synth;
#[cfg(feature = "internals")]
pub mod synth;
#[cfg(not(feature = "internals"))]
mod text;
#[cfg(feature = "internals")]
pub mod text;
#[cfg(not(feature = "internals"))]
mod tissue;
#[cfg(feature = "internals")]
pub mod tissue;
#[cfg(not(feature = "internals"))]
mod tracking;
#[cfg(feature = "internals")]
pub mod tracking;
#[cfg(not(feature = "internals"))]
mod volume;
#[cfg(feature = "internals")]
pub mod volume;

pub use effects::Effects;
pub use effects::blur::Blur;
pub use effects::contact::Contact;
pub use effects::interface::Interface;
pub use effects::needle::NeedleEcho;
pub use effects::noise::Noise;
pub use effects::receiver::Receiver;
pub use effects::refraction::Refraction;
pub use effects::shadow::Shadow;
pub use effects::slice::{Boundary, Slice};
pub use effects::speckle::Speckle;
pub use effects::texture::Texture;
pub use effects::thickness::Thickness;
pub use effects::tone::{Curve, Tone};
pub use error::Error;
pub use gpu::{AdapterChoice, Gpu, GpuError, row_stride};
pub use mechanics::insertion::finite::{Finite, Options as FiniteOptions, Setup};
pub use mechanics::insertion::nonlinear::{Nonlinear, Setup as NonlinearSetup};
pub use mechanics::insertion::spring::{MassSpring, Parameters as MassSpringParameters};
pub use mechanics::insertion::{
    Event, EventKind, Instruments, Interaction, MeshRegions, Model, Outcome, ProbeContact, StepError,
};
pub use mechanics::mesh::file::read_mesh;
pub use mechanics::mesh::{Displacement, InvalidMesh, TetMesh};
pub use mechanics::needle::{BEVEL_MM, Bevel, Flexible, LINK_MM, Needle, Rigid, Shaft, Stiffness};
pub use mechanics::tissue::material::Material;
pub use mechanics::tissue::remesh::{Level, Precision};
pub use output::OutputError;
pub use output::png::write_grey as write_png;
pub use output::sequence::{FrameInfo, SequenceWriter};
pub use output::sidecar::Sidecar;
pub use phantom::Phantom;
pub use plan::Plan;
pub use scenario::record::Record;
pub use scenario::run::{Deformed, Moment, Observer, Requests, Step, run as run_scenario};
pub use scenario::{EXAMPLES as SCENARIOS, Scenario, ScenarioError, ScenarioFile, Summary};
pub use scene::{DEFAULT as DEFAULT_SCENE, Scene, SceneError, SceneFile};
pub use simulator::{
    Damper, Forces, Guided, Haptic, HoldOptions, Imaging, Input as RecordedInput, LateralHold,
    Options as SimulatorOptions, PointsPose, Policy, Recording, Simulator, SimulatorError, State as SimulatorState,
    TwoPoints,
};
pub use synth::layers::Layer;
pub use synth::tables::{Anatomy, ImageSize, Settings};
pub use synth::{Backend, Frame, FrameState, NeedleShaft, SynthError, Synthesizer};
pub use tissue::presets::get as builtin_tissue;
pub use tissue::{Tissue, TissueTable};
pub use tracking::TrackingError;
pub use tracking::pose::Pose;
pub use tracking::probe::{Probe, ProbeShape};
pub use tracking::sequence::Sequence;
pub use tracking::template::Template;
pub use volume::texture::SolidTexture;
pub use volume::{Label, LabelVolume, VolumeError, load as load_volume, save as save_volume};

#[doc(hidden)]
pub mod cli;
