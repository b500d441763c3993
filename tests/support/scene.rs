//! Probes, settings and poses.

use insonify::imaging::effects::Effects;
use insonify::imaging::synth::FrameState;
use insonify::imaging::synth::tables::{ImageSize, Settings};
use insonify::tracking::probe::{Probe, ProbeShape};
use nalgebra::{Matrix4, Rotation3, Translation3, Vector3};

/// Every shape of field of view, sized for volumes of some 40 mm.
pub const SHAPES: [(&str, ProbeShape); 5] = [
    ("linear", ProbeShape::Linear { width_mm: 36.0 }),
    (
        "curvilinear",
        ProbeShape::Curvilinear {
            radius_mm: 30.0,
            angle_deg: 60.0,
        },
    ),
    ("phased", ProbeShape::Phased { angle_deg: 80.0 }),
    (
        "trus_transverse",
        ProbeShape::TrusTransverse {
            radius_mm: 9.0,
            angle_deg: 200.0,
        },
    ),
    ("trus_sagittal", ProbeShape::TrusSagittal { length_mm: 40.0 }),
];

/// A probe of `lines` by `samples`.
pub fn probe(shape: ProbeShape, depth_mm: f64, lines: u32, samples: u32) -> Probe {
    Probe {
        shape,
        depth_mm,
        frequency_mhz: 5.0,
        lines,
        samples,
    }
}

/// The curvilinear probe at the size of most tests: 24 scanlines of 96 samples, 40 mm deep.
pub fn small_probe() -> Probe {
    probe(SHAPES[1].1, 40.0, 24, 96)
}

/// Nothing but slicing.
pub fn bare() -> Effects {
    Effects::default()
}

/// Settings at 64 x 48 pixels.
pub fn settings(probe: Probe, effects: Effects) -> Settings {
    sized(probe, effects, 64, 48)
}

/// Settings at any size.
pub fn sized(probe: Probe, effects: Effects, width: usize, height: usize) -> Settings {
    Settings {
        seed: 0x5eed_0000_0001,
        probe,
        image: ImageSize {
            width,
            height,
            margin: 0.03,
            fill: 7,
            placed: None,
        },
        effects,
        has_needle: false,
    }
}

/// The probe at the origin, looking along +y.
pub fn straight() -> FrameState {
    FrameState::at(Matrix4::identity())
}

/// A pose turned about every axis, with its array's middle at `origin` and its middle beam towards `target`.
pub fn aimed(origin: [f64; 3], target: [f64; 3], roll: f64) -> FrameState {
    let along = (Vector3::from(target) - Vector3::from(origin)).normalize();
    let swing = Rotation3::rotation_between(&Vector3::y(), &along).unwrap_or_else(Rotation3::identity);
    let turn = swing * Rotation3::from_axis_angle(&Vector3::y_axis(), roll);
    let matrix = Translation3::from(Vector3::from(origin)).to_homogeneous() * turn.to_homogeneous();
    FrameState::at(matrix)
}
