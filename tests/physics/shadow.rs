//! Loss down the beam: Beer and Lambert's law through layers, bone, and the needle.

use insonify::effects::shadow::{Shadow, UNITS_PER_DB};
use insonify::synth::layers::Beam;
use insonify::synth::tables::{Anatomy, Settings};
use insonify::synth::{Backend, NeedleShaft};
use insonify::tracking::probe::ProbeShape;

use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene::{self, SHAPES};
use crate::support::stats::{order, rms};
use crate::{beam_after, precisions};

const DEPTH_MM: f64 = 60.0;
const MHZ: f64 = 5.0;

fn attenuating(alpha: f64) -> Acoustics {
    Acoustics {
        attenuation_db_cm_mhz: alpha,
        ..PLAIN
    }
}

/// Slabs whose boundaries lie at `depths`, with voxels of 1/16 mm along the beam.
fn slabs(depths: &[f64], tissues: &[Acoustics]) -> Anatomy {
    let mut frame = Frame::around([0.0, 40.0, 0.0], [3, 1600, 3], 1.0 / 16.0);
    for column in [0, 2] {
        frame.index_to_world[(column, column)] = 200.0;
        frame.index_to_world[(column, 3)] = -200.0;
    }
    anatomy::layers(frame, depths, tissues)
}

fn settings(shape: ProbeShape, samples: u32) -> Settings {
    let mut settings = scene::settings(scene::probe(shape, DEPTH_MM, 9, samples), scene::bare());
    settings.effects.shadow = Some(Shadow::default());
    settings
}

fn loss_db(beam: &Beam, line: usize, sample: usize) -> f64 {
    f64::from(beam.loss[line * beam.samples + sample]) / UNITS_PER_DB
}

/// Two-way loss of layers with one-way coefficients `alphas` (dB/cm/MHz) that start at `starts`, at a depth.
fn beer_lambert(starts: &[f64], alphas: &[f64], depth: f64) -> f64 {
    let mut db = 0.0;
    for (at, (&start, alpha)) in starts.iter().zip(alphas).enumerate() {
        let end = starts.get(at + 1).copied().unwrap_or(f64::INFINITY);
        db += 2.0 * alpha * MHZ / 10.0 * (depth.min(end) - start).max(0.0);
    }
    db
}

#[test]
fn one_tissue_follows_the_exponential_law_exactly() {
    for (kind, shape) in SHAPES {
        let settings = settings(shape, 128);
        for (name, backend) in precisions() {
            let beam = beam_after(
                &anatomy::uniform(attenuating(0.7)),
                &settings,
                backend,
                "shadow",
                &scene::straight(),
            );
            for line in 0..beam.lines {
                for sample in 0..beam.samples {
                    let depth = (sample as f64 + 0.5) * DEPTH_MM / 128.0;
                    let expected = 2.0 * 0.7 * MHZ * depth / 10.0;
                    // Half a unit of fixed point a sample.
                    let slack = (sample as f64 + 1.0) * 0.5 / UNITS_PER_DB + 1.0 / UNITS_PER_DB;
                    let found = loss_db(&beam, line, sample);
                    assert!(
                        (found - expected).abs() <= slack,
                        "{name}, {kind}: {found} dB at {depth} mm, not {expected}"
                    );
                    let left = beam.amplitude[line * beam.samples + sample];
                    assert!(
                        (left / 10f64.powf(-found / 20.0) - 1.0).abs() < 1e-4,
                        "{name}, {kind}: {left} is left of 1"
                    );
                }
            }
        }
    }
}

#[test]
fn layers_converge_to_beer_and_lambert() {
    let counts = [30u32, 60, 120, 240, 480];
    let alphas = [0.3, 1.4, 0.1, 0.9];
    let mut tissues = vec![SILENT];
    tissues.extend(alphas.map(attenuating));
    let mut errors = vec![Vec::new(); counts.len()];
    for shift in 0..12 {
        let starts = [-10.0, 9.6, 21.3, 37.8].map(|start| start + 0.1625 * f64::from(shift));
        let anatomy = slabs(&starts, &tissues);
        for (errors, &samples) in errors.iter_mut().zip(&counts) {
            let settings = settings(SHAPES[0].1, samples);
            let beam = beam_after(&anatomy, &settings, Backend::CpuF64, "shadow", &scene::straight());
            let depth = |sample: usize| (sample as f64 + 0.5) * DEPTH_MM / f64::from(samples);
            let last = beam.samples - 1;
            // The voxels put a boundary at the centre of the first voxel of the next layer, less half a voxel.
            let starts: Vec<f64> = starts
                .iter()
                .map(|start| (start * 16.0 - 0.5).ceil() / 16.0)
                .map(|s| s.max(0.0))
                .collect();
            errors.push(loss_db(&beam, 4, last) - beer_lambert(&starts, &alphas, depth(last)));
        }
    }
    let errors: Vec<f64> = errors.iter().map(|errors| rms(errors)).collect();
    let steps: Vec<f64> = counts.iter().map(|&count| DEPTH_MM / f64::from(count)).collect();
    let found = order(&steps, &errors);
    println!("loss through layers: errors {errors:.4?} dB, order {found:.2}");
    // A boundary inside a sample counts for one side of it: off by up to half a sample at each boundary, first order.
    assert!(found > 0.8, "order {found} of {errors:?}");
    assert!(errors[4] < 0.1, "{errors:?}");
}

#[test]
fn behind_bone_it_is_dark() {
    let bone = Acoustics {
        occlusion_per_mm: 0.9,
        echo_db: 10.0,
        ..attenuating(5.0)
    };
    let anatomy = slabs(
        &[-10.0, 20.0, 26.0],
        &[SILENT, attenuating(0.5), bone, attenuating(0.5)],
    );
    for (name, backend) in precisions() {
        let beam = beam_after(
            &anatomy,
            &settings(SHAPES[0].1, 240),
            backend,
            "shadow",
            &scene::straight(),
        );
        for line in 0..beam.lines {
            let at = |depth: f64| beam.amplitude[line * beam.samples + (depth / DEPTH_MM * 240.0) as usize];
            assert!(
                at(19.5) > 0.2,
                "{name}: tissue in front of the bone shows: {}",
                at(19.5)
            );
            assert!(at(27.0) < 1e-5, "{name}: behind bone is {}", at(27.0));
        }
    }
}

#[test]
fn the_loss_at_the_probe_frequency_can_be_switched_off_part_by_part() {
    let bone = Acoustics {
        occlusion_per_mm: 0.5,
        ..attenuating(2.0)
    };
    let anatomy = anatomy::uniform(bone);
    // One millimetre takes 20 log10(1 / (1 - 0.5)) = 6.02 dB by occlusion and 2 * 2 * 5 / 10 = 2 dB by attenuation.
    for (attenuation, occlusion, db_mm) in [(true, true, 8.0206), (true, false, 2.0), (false, true, 6.0206)] {
        let mut settings = settings(SHAPES[0].1, 240);
        settings.effects.shadow = Some(Shadow {
            attenuation,
            occlusion,
            ..Shadow::default()
        });
        let beam = beam_after(&anatomy, &settings, Backend::CpuF64, "shadow", &scene::straight());
        let found = loss_db(&beam, 0, 40) / (40.5 * 0.25);
        assert!((found - db_mm).abs() < 1e-3, "{found} dB/mm, not {db_mm}");
    }
}

#[test]
fn the_needle_casts_a_shadow_of_its_thickness() {
    // A needle of 2 mm across the beam, in the plane: the middle line crosses its whole diameter.
    for (name, backend) in precisions() {
        let mut settings = settings(ProbeShape::Linear { width_mm: 40.0 }, 600);
        settings.has_needle = true;
        settings.effects.needle = Some(Default::default());
        settings.effects.shadow = Some(Shadow {
            needle_db_mm: 6.0,
            ..Shadow::default()
        });
        let mut state = scene::straight();
        let nodes = vec![[-8.0, 20.0, 0.0].into(), [8.0, 20.0, 0.0].into()];
        state.needle = Some(NeedleShaft {
            nodes,
            diameter_mm: 2.0,
        });
        let beam = beam_after(&anatomy::uniform(PLAIN), &settings, backend, "shadow", &state);
        // Scanlines lie 5 mm apart: those at -5, 0 and 5 mm cross the needle. The share along the chord is the cylinder's
        // half chord over the slab's: its mean over the diameter is pi / 4. Summed in steps of 0.1 mm, a root that starts and
        // ends steeply is off by half a percent.
        for line in 0..9 {
            let found = loss_db(&beam, line, 599);
            let expected = if (3..=5).contains(&line) {
                6.0 * 2.0 * std::f64::consts::FRAC_PI_4
            } else {
                0.0
            };
            assert!(
                (found - expected).abs() <= 0.005 * expected,
                "{name}: line {line}: {found} dB, not {expected}"
            );
            assert_eq!(
                loss_db(&beam, line, 180),
                0.0,
                "{name}: above the needle nothing is lost"
            );
        }
    }
}
