//! Each effect against what physics or arithmetic say of it, through the whole pipeline of the reference in both
//! precisions. The GPU follows by parity (`tests/parity`).

mod blur;
mod changes;
mod contact;
mod determinism;
mod empty;
mod interface;
mod large;
mod needle;
mod noise;
mod receiver;
mod refraction;
mod scan_conversion;
mod seeds;
mod shadow;
mod slice;
mod speckle;
mod speckle_motion;
mod thickness;
mod tissue_motion;
mod tone;

use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};

/// Both precisions of the reference.
pub(crate) fn precisions() -> [(&'static str, Backend); 2] {
    [("f32", Backend::Cpu), ("f64", Backend::CpuF64)]
}

/// A synthesizer of a scene that must be valid.
pub(crate) fn synthesizer(anatomy: &Anatomy, settings: &Settings, backend: Backend) -> Synthesizer {
    Synthesizer::new(anatomy.clone(), settings.clone(), backend).expect("a synthesizer")
}

/// What stands in beam space after a pass.
pub(crate) fn beam_after(
    anatomy: &Anatomy,
    settings: &Settings,
    backend: Backend,
    pass: &str,
    state: &FrameState,
) -> Beam {
    synthesizer(anatomy, settings, backend)
        .render_until(pass, state)
        .expect("a beam")
}
