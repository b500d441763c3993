//! Specular echoes of a plane: the reflection coefficient at a right angle, less of it at an angle.

use insonify::effects::interface::Interface;
use insonify::synth::Backend;
use insonify::tracking::probe::ProbeShape;

use crate::support::anatomy::{self, Acoustics, Frame, SILENT};
use crate::support::scene;
use crate::{beam_after, precisions};

/// Keeps scanlines off the ties of votes between the voxels on either side of the plane.
const OFFSET_MM: f64 = 0.08;

const Z: [f64; 2] = [1.5, 1.8];

/// Sum of the echoes down each scanline for a plane through (0, 20) whose normal is `angle` degrees off the beam.
fn echoes(angle: f64, directivity: f64, backend: Backend) -> Vec<f64> {
    let tissue = |impedance_mrayl| Acoustics {
        impedance_mrayl,
        ..SILENT
    };
    let (sin, cos) = angle.to_radians().sin_cos();
    let anatomy = anatomy::of(
        Frame::around([0.0, 20.0, 0.0], [400, 400, 3], 0.1),
        &[SILENT, tissue(Z[0]), tissue(Z[1])],
        |p| 1 + u8::from(p[0] * sin + (p[1] - 20.0) * cos > OFFSET_MM),
    );
    // Cells of the beam grid as high as wide, so that a stair of labels has no preferred direction.
    let probe = scene::probe(ProbeShape::Linear { width_mm: 30.0 }, 40.0, 151, 200);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.interface = Some(Interface {
        mirror_db: 40.0,
        directivity,
    });
    let beam = beam_after(&anatomy, &settings, backend, "interface", &scene::straight());
    (10..141)
        .map(|line| beam.amplitude[line * 200..][20..180].iter().sum::<f64>())
        .collect()
}

#[test]
fn a_plane_across_the_beam_returns_the_reflection_coefficient() {
    let expected = 100.0 * (Z[1] - Z[0]) / (Z[1] + Z[0]);
    for (name, backend) in precisions() {
        for found in echoes(0.0, 6.0, backend) {
            assert!((found / expected - 1.0).abs() < 1e-5, "{name}: {found}, not {expected}");
        }
    }
}

#[test]
fn the_echo_of_a_tilted_plane_falls_with_the_power_of_the_cosine() {
    let coefficient = 100.0 * (Z[1] - Z[0]) / (Z[1] + Z[0]);
    for directivity in [1.0, 6.0] {
        let mut before = f64::INFINITY;
        for angle in [0.0, 15.0, 30.0, 45.0, 60.0] {
            let all = echoes(angle, directivity, Backend::CpuF64);
            let found = all.iter().sum::<f64>() / all.len() as f64;
            let expected = coefficient * f64::to_radians(angle).cos().powf(directivity);
            println!("{angle} degrees, power {directivity}: {found:.3}, expected {expected:.3}");
            // A stencil of three by three on a stair of labels knows the angle to some degrees: enough for a fifth of the
            // echo up to 45 degrees; beyond, for an eighth of that at a right angle.
            let off = (found - expected).abs();
            assert!(
                angle > 45.0 || off < 0.2 * expected,
                "{angle} degrees: {found}, not {expected}"
            );
            assert!(off < 0.125 * coefficient, "{angle} degrees: {found}, not {expected}");
            assert!(found < before, "{angle} degrees: {found} is no less than {before}");
            before = found;
        }
    }
}

#[test]
fn a_plane_along_the_beam_is_dark() {
    let found: f64 = echoes(90.0, 6.0, Backend::Cpu).iter().sum();
    assert!(found == 0.0, "{found}");
}
