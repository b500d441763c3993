//! Specular echoes of a plane: the reflection coefficient at a right angle, less of it at an angle.

use insonify_imaging::effects::interface::Interface;
use insonify_imaging::synth::Backend;
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, Acoustics, Frame, SILENT};
use crate::support::scene;
use crate::support::scene::{beam_after, precisions};

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
    let anatomy = anatomy::anatomy_from(
        Frame::around([0.0, 20.0, 0.0], [400, 400, 3], 0.1),
        &[SILENT, tissue(Z[0]), tissue(Z[1])],
        |p| 1 + u8::from(p[0] * sin + (p[1] - 20.0) * cos > OFFSET_MM),
    );
    // Cells of the beam grid as high as wide, so that a stair of labels has no preferred direction.
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 30.0 }), 40.0, 151, 200);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.interface = Some(Interface {
        mirror_db: 40.0,
        directivity,
        roughness: 0.0,
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
        for echo in echoes(0.0, 6.0, backend) {
            // In single precision 216 terms make the normal.
            assert!((echo / expected - 1.0).abs() < 1e-4, "{name}: {echo}, not {expected}");
        }
    }
}

#[test]
fn the_echo_of_a_tilted_plane_falls_with_the_power_of_the_cosine() {
    let coefficient = 100.0 * (Z[1] - Z[0]) / (Z[1] + Z[0]);
    for directivity in [1.0, 6.0] {
        let mut before = f64::INFINITY;
        for angle in [0.0, 15.0, 30.0, 45.0, 60.0] {
            // Scanlines every 0.2 mm that meet the plane between 5 and 35 mm.
            let meets = |line: &usize| (0.2 * (*line as f64 - 65.0) * f64::to_radians(angle).tan()).abs() < 15.0;
            let lines = echoes(angle, directivity, Backend::CpuF64).into_iter().enumerate();
            let all: Vec<f64> = lines.filter(|(line, _)| meets(line)).map(|(_, echo)| echo).collect();
            let mean = all.iter().sum::<f64>() / all.len() as f64;
            let expected = coefficient * f64::to_radians(angle).cos().powf(directivity);
            println!("{angle} degrees, power {directivity}: {mean:.3}, expected {expected:.3}");
            // Normals are 3 degrees off: at 60 degrees the sixth power of the cosine is then a tenth more on the mean.
            let error = (mean - expected).abs();
            assert!(error < 0.12 * expected, "{angle} degrees: {mean}, not {expected}");
            assert!(mean < before, "{angle} degrees: {mean} is no less than {before}");
            before = mean;
        }
    }
}

#[test]
fn a_plane_along_the_beam_is_dark() {
    // All that is left is the echo of the silent tissue: -200 dB in each of 160 samples.
    for echo in echoes(90.0, 6.0, Backend::Cpu) {
        assert!(echo < 1.01 * 160.0 * 1e-10, "{echo}");
    }
}

/// Echo of a plane across the beam, of tissue that is silent, after the point spread.
fn spread(roughness: f64, lines: u32) -> (Vec<Vec<f64>>, f64) {
    let tissue = |impedance_mrayl| Acoustics {
        impedance_mrayl,
        ..SILENT
    };
    let anatomy = anatomy::anatomy_from(
        Frame::around([0.0, 20.0, 0.0], [160, 160, 5], 0.5),
        &[SILENT, tissue(Z[0]), tissue(Z[1])],
        |p| 1 + u8::from(p[1] > 20.0 + OFFSET_MM),
    );
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 60.0 }), 40.0, lines, 400);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.interface = Some(Interface {
        mirror_db: 40.0,
        directivity: 4.0,
        roughness,
    });
    settings.effects.speckle = Some(insonify_imaging::effects::speckle::Speckle {
        axial_mm: Some(0.8),
        ..Default::default()
    });
    let beam = beam_after(
        &anatomy,
        &settings,
        Backend::CpuF64,
        "speckle_lateral",
        &scene::straight(),
    );
    let edge = beam.lines / 6;
    let rows = (edge..beam.lines - edge).map(|line| beam.amplitude[line * 400..][..400].to_vec());
    (rows.collect(), 0.1)
}

#[test]
fn a_surface_keeps_its_echo_through_the_point_spread_and_takes_its_width() {
    let expected = 100.0 * (Z[1] - Z[0]) / (Z[1] + Z[0]);
    // Scanlines near enough, and so far apart that they are refined.
    for lines in [241, 61] {
        let (rows, sample_mm) = spread(0.0, lines);
        for row in &rows {
            let peak = row.iter().fold(0.0f64, |a, &b| a.max(b));
            assert!((peak / expected - 1.0).abs() < 0.02, "{peak}, not {expected}");
            let above = row.iter().filter(|x| **x > 0.5 * peak).count() as f64 * sample_mm;
            // A Gaussian intensity whose autocorrelation is 0.8 mm wide has an amplitude that is 0.8 mm wide.
            assert!((above - 0.8).abs() < 0.2, "{above} mm at half the amplitude");
        }
    }
}

#[test]
fn a_rough_surface_is_uneven_along_itself_but_of_the_same_power() {
    let expected = 100.0 * (Z[1] - Z[0]) / (Z[1] + Z[0]);
    let (rows, _) = spread(0.4, 241);
    let peaks: Vec<f64> = rows
        .iter()
        .map(|row| row.iter().fold(0.0f64, |a, &b| a.max(b)))
        .collect();
    let power = peaks.iter().map(|x| x * x).sum::<f64>() / peaks.len() as f64;
    // Some seven independent patches lie along these 40 mm.
    assert!((power.sqrt() / expected - 1.0).abs() < 0.35, "{}", power.sqrt());
    let ratio = peaks.iter().fold(0.0f64, |a, &b| a.max(b)) / peaks.iter().fold(f64::INFINITY, |a, &b| a.min(b));
    assert!(ratio > 1.5, "{ratio}");
}
