//! Elevational thickness: a constant is unchanged, and a layer across the elevation counts by its share of the beam.

use insonify_imaging::effects::thickness::Thickness;
use insonify_imaging::synth::tables::Settings;

use crate::support::anatomy::{self, Frame, PLAIN, SILENT};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{beam_after, precisions};

fn settings(shape: usize, width_mm: f64, planes: u32) -> Settings {
    let mut settings = scene::settings(scene::probe(SHAPES[shape].1, 40.0, 9, 32), scene::bare());
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
fn a_slab_beside_the_plane_adds_the_power_of_the_sub_planes_in_it() {
    // Echo only where z > 0.5 mm: of five sub-planes at 0, 2, -2, 4, -4 mm those at 2 and 4 lie in it. Their weights
    // follow the Gaussian profile of 4 mm full width: 2^-1 and 2^-4 against 1 for the central one.
    let frame = Frame::around([0.0, 20.0, 0.0], [61, 61, 21], 1.0);
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, SILENT, PLAIN], |p| 1 + u8::from(p[2] > 0.5));
    let power = (0.5 + 0.0625) / (1.0 + 2.0 * (0.5 + 0.0625));
    for (name, backend) in precisions() {
        let beam = beam_after(&anatomy, &settings(0, 4.0, 5), backend, "thickness", &scene::straight());
        for value in &beam.amplitude {
            assert!(
                (value - f64::sqrt(power)).abs() < 1e-6,
                "{name}: {value}, not {}",
                power.sqrt()
            );
        }
    }
}
