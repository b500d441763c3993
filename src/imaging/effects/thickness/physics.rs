//! Elevational thickness: a constant is unchanged, and a layer across the elevation counts by its share of the beam.

use insonify_imaging::effects::thickness::Thickness;
use insonify_imaging::simulated;
use insonify_imaging::synth::tables::Settings;

use crate::support::anatomy::{self, Frame, PLAIN, SILENT};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{beam_after, precisions};
use insonify_tracking::probe::{Apodisation, BeamGrid};

fn settings(shape: usize, width_mm: f64, planes: u32) -> Settings {
    let mut settings = scene::settings(scene::probe(SHAPES[shape].1, 40.0, 9, 32), scene::bare());
    let width_mm = Some(width_mm);
    settings.effects.thickness = Some(Thickness { width_mm, planes });
    settings
}

#[test]
fn a_constant_is_unchanged() {
    for shape in 0..SHAPES.len() {
        for planes in [3, 5, 7, 9] {
            for (name, backend) in precisions() {
                let beam = beam_after(
                    &anatomy::uniform(PLAIN),
                    &settings(shape, 4.0, planes),
                    backend,
                    "thickness",
                    &scene::straight(),
                );
                for value in &beam.amplitude {
                    assert!((value - 1.0).abs() < 1e-6, "{name}: {value} with {planes} planes");
                }
            }
        }
    }
}

#[test]
fn a_slab_beside_the_plane_adds_its_share_of_the_beam() {
    // Echo only where z > 0.5 mm, in which all sub-planes of one side lie. Half of the energy of a Gaussian of 4 mm
    // full width beyond half of the way to the nearest of them, which lies at 2.28 mm.
    let frame = Frame::around([0.0, 20.0, 0.0], [61, 61, 41], 1.0);
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, SILENT, PLAIN], |p| 1 + u8::from(p[2] > 0.5));
    let energy = |from: f64| -> f64 {
        let density = |z: f64| 0.5f64.powf(z * z);
        (0..8000)
            .map(|step| from + 0.001 * (f64::from(step) + 0.5))
            .map(|mm| 0.001 * density(mm / 2.0))
            .sum()
    };
    let power = 0.5 * energy(1.138) / energy(0.0);
    for (name, backend) in precisions() {
        let beam = beam_after(&anatomy, &settings(0, 4.0, 5), backend, "thickness", &scene::straight());
        for value in &beam.amplitude {
            assert!(
                (value * value / power - 1.0).abs() < 0.01,
                "{name}: {}, not {power}",
                value * value
            );
        }
    }
}

#[test]
fn spheres_fill_as_in_a_simulator_of_waves() {
    for [diameter_mm, depth_mm, simulated_db] in simulated::SPHERES {
        let frame = Frame::around([0.0, depth_mm, 0.0], [100; 3], 0.25);
        let radius_mm = 0.5 * diameter_mm;
        let from_centre = |p: [f64; 3]| p[0].hypot(p[1] - depth_mm).hypot(p[2]);
        let anatomy = anatomy::anatomy_from(frame, &[PLAIN, PLAIN, SILENT], |p| {
            1 + u8::from(from_centre(p) < radius_mm)
        });
        let probe = simulated::probe(true, Apodisation::Hann);
        let samples = probe.samples as usize;
        let grid = BeamGrid::new(&probe).expect("a grid");
        let mut settings = scene::settings(probe, scene::bare());
        settings.effects.thickness = Some(Thickness::default());
        for (name, backend) in precisions() {
            let beam = beam_after(&anatomy, &settings, backend, "thickness", &scene::straight());
            let (mut sum, mut count) = (0.0, 0.0);
            for (index, amplitude) in beam.amplitude.iter().enumerate() {
                let [x, y] = grid.to_plane((index / samples) as f64, (index % samples) as f64);
                if from_centre([x, y, 0.0]) < 0.6 * radius_mm {
                    sum += amplitude * amplitude;
                    count += 1.0;
                }
            }
            let db = 10.0 * f64::log10(sum / count);
            assert!(
                (db - simulated_db).abs() < 4.0,
                "{name}: {db} dB in {diameter_mm} mm, not {simulated_db}"
            );
        }
    }
}
