//! Probes, settings and poses.

use insonify_imaging::effects::Effects;
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::{Anatomy, ImageSize, Settings};
use insonify_imaging::synth::{Backend, FrameState, NeedleShaft, Synthesizer};
use insonify_mesh::Displacement;
use insonify_tracking::probe::{Probe, ProbeShape};
use nalgebra::{Matrix4, Rotation3, Translation3, Vector3};

use super::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};

/// Every shape of field of view with its name, sized for volumes of some 40 mm.
pub(crate) const SHAPES: [(&str, ProbeShape); ProbeShape::EXAMPLES.len()] = ProbeShape::EXAMPLES;

/// A probe of `lines` by `samples`.
pub(crate) fn probe(shape: ProbeShape, depth_mm: f64, lines: u32, samples: u32) -> Probe {
    Probe {
        shape,
        depth_mm,
        frequency_mhz: 5.0,
        lines,
        samples,
        aperture: Default::default(),
    }
}

/// The curvilinear probe at the size of most tests: 24 scanlines of 96 samples, 40 mm deep.
pub(crate) fn small_probe() -> Probe {
    probe(SHAPES[1].1, 40.0, 24, 96)
}

/// Nothing but slicing.
pub(crate) fn bare() -> Effects {
    Effects::default()
}

/// Settings at 64 x 48 pixels.
pub(crate) fn settings(probe: Probe, effects: Effects) -> Settings {
    sized(probe, effects, 64, 48)
}

/// Settings at any size.
pub(crate) fn sized(probe: Probe, effects: Effects, width: usize, height: usize) -> Settings {
    let mut settings = Settings::new(probe, [width, height], effects);
    settings.seed = 0x5eed_0000_0001;
    (settings.image.margin, settings.image.fill) = (0.03, 7);
    settings
}

/// The probe at the origin, looking along +y.
pub(crate) fn straight() -> FrameState {
    FrameState::at(Matrix4::identity())
}

/// A pose turned about every axis, with its array's middle at `origin` and its middle beam towards `target`.
pub(crate) fn aimed(origin: [f64; 3], target: [f64; 3], roll: f64) -> FrameState {
    let along = (Vector3::from(target) - Vector3::from(origin)).normalize();
    let swing = Rotation3::rotation_between(&Vector3::y(), &along).unwrap_or_else(Rotation3::identity);
    let turn = swing * Rotation3::from_axis_angle(&Vector3::y_axis(), roll);
    let matrix = Translation3::from(Vector3::from(origin)).to_homogeneous() * turn.to_homogeneous();
    FrameState::at(matrix)
}

/// Everything at once: textures, a deforming mesh, a bent needle, noise, a thick plane.
pub(crate) fn everything() -> (Anatomy, Settings, FrameState) {
    let tissues = [
        SILENT,
        Acoustics {
            attenuation_db_cm_mhz: 0.6,
            texture: Some("liver"),
            ..PLAIN
        },
        Acoustics {
            echo_db: 8.0,
            occlusion_per_mm: 0.1,
            impedance_mrayl: 2.0,
            ..PLAIN
        },
    ];
    let frame = Frame::around([0.0, 20.0, 0.0], [40; 3], 1.0);
    let anatomy = anatomy::random(frame, &tissues, 5);
    let anatomy = anatomy::with_mesh(anatomy, [[-14.0, 4.0, -14.0], [14.0, 36.0, 14.0]], 400);
    let mut settings = settings(small_probe(), Effects::all());
    settings.has_needle = true;
    (anatomy.clone(), settings, frame_of(&anatomy, 0))
}

/// A frame of a motion: tissue, needle and probe move.
pub(crate) fn frame_of(anatomy: &Anatomy, frame: u64) -> FrameState {
    let share = frame as f64 / 20.0;
    let press = Displacement::Indentation {
        centre_mm: [0.0, 5.0, 0.0],
        direction: [0.1, 1.0, 0.0],
        depth_mm: 4.0 * share.sin(),
        radius_mm: 8.0,
    };
    let mut state = aimed([0.2 * share, 1.0, 0.3], [1.0, 20.0, 0.0], 0.1 * share);
    let mut nodes = Vec::new();
    press.displace(anatomy.mesh.as_ref().expect("a mesh").nodes(), &mut nodes);
    state.nodes = Some(nodes);
    state.frame = frame;
    state.needle = Some(NeedleShaft {
        nodes: [[-15.0, 4.0, 0.0], [-4.0, 14.0 + share, 0.3], [3.0, 24.0, 0.9]]
            .map(Into::into)
            .to_vec(),
        diameter_mm: 1.2,
    });
    state
}

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
