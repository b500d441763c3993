//! Haze: the share of what lies around by distance along and across the beam, and fully developed speckle.

use insonify_imaging::effects::haze::Haze;
use insonify_imaging::effects::shadow::{SOFT_TISSUE_DB_CM_MHZ, Shadow};
use insonify_imaging::synth::Backend;
use insonify_imaging::synth::layers::Beam;
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene::{self, beam_after, precisions};
use crate::support::stats::mean;

const LINES: u32 = 240;
const SAMPLES: u32 = 600;
const WIDTH_MM: f64 = 60.0;
const DEPTH_MM: f64 = 60.0;

/// Beam of tissue without speckle where `is_tissue` holds of lateral position and depth, mm, and silent tissue
/// elsewhere.
fn beam(haze: Haze, backend: &Backend, seed: u64, is_tissue: impl Fn(f64, f64) -> bool + Sync) -> Beam {
    let frame = Frame::around([0.0, 30.0, 0.0], [160, 180, 3], 0.5);
    let dark = Acoustics {
        echo_db: -200.0,
        ..PLAIN
    };
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, PLAIN, dark], |p| 1 + u8::from(!is_tissue(p[0], p[1])));
    let shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
    let mut settings = scene::settings(scene::probe(shape, DEPTH_MM, LINES, SAMPLES), scene::bare());
    settings.effects.haze = Some(haze);
    settings.seed = seed;
    let backend = match backend {
        Backend::CpuF64 => Backend::CpuF64,
        _ => Backend::Cpu,
    };
    beam_after(&anatomy, &settings, backend, "haze", &scene::straight())
}

/// Mean power of frames of twelve seeds less that of the echo, where `is_there` holds of lateral position and depth,
/// mm.
fn power(
    haze: &Haze,
    backend: &Backend,
    is_tissue: impl Fn(f64, f64) -> bool + Sync,
    is_there: impl Fn(f64, f64) -> bool,
) -> f64 {
    let powers = (0..12).flat_map(|seed| {
        let beam = beam(haze.clone(), backend, seed, &is_tissue);
        let place = |index: usize| {
            let [line, sample] = [index / beam.samples, index % beam.samples].map(|n| n as f64 + 0.5);
            [
                WIDTH_MM * (line / f64::from(LINES) - 0.5),
                DEPTH_MM * sample / f64::from(SAMPLES),
            ]
        };
        let there = |index: &usize| {
            let [x, z] = place(*index);
            is_there(x, z)
        };
        let of = |index: usize| {
            let [x, z] = place(index);
            beam.amplitude[index].powi(2) - f64::from(u8::from(is_tissue(x, z)))
        };
        (0..beam.amplitude.len()).filter(there).map(of).collect::<Vec<f64>>()
    });
    mean(&powers.collect::<Vec<f64>>())
}

fn near(name: &str, what: f64, power: f64, expected: f64, tolerance: f64) {
    let error = power / expected - 1.0;
    assert!(error.abs() < tolerance, "{name}, {what} mm: {power}, not {expected}");
}

#[test]
fn tissue_adds_its_share_from_above() {
    let haze = Haze {
        level_db: -20.0,
        lateral_mm: 15.0,
        axial_mm: 8.0,
        ..Haze::default()
    };
    for (name, backend) in precisions() {
        for depth in [2.0, 8.0, 50.0] {
            let power = power(&haze, &backend, |_, _| true, |_, z| (z - depth).abs() < 1.0);
            near(name, depth, power, 0.01 * (1.0 - (-depth / 8.0f64).exp()), 0.1);
        }
    }
}

/// Longer paths lose as much on the way as the echo does that they arrive with.
#[test]
fn the_share_of_attenuating_tissue_does_not_grow_with_depth() {
    let tissue = Acoustics {
        attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
        ..PLAIN
    };
    let shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
    let mut settings = scene::settings(scene::probe(shape, DEPTH_MM, LINES, SAMPLES), scene::bare());
    settings.probe.frequency_mhz = 9.0;
    settings.effects.shadow = Some(Shadow::default());
    let mut row = |level_db: f64, sample: usize| {
        settings.effects.haze = Some(Haze {
            level_db,
            ..Haze::default()
        });
        let beam = beam_after(
            &anatomy::uniform(tissue),
            &settings,
            Backend::Cpu,
            "haze",
            &scene::straight(),
        );
        let rows = beam
            .amplitude
            .chunks(beam.samples)
            .flat_map(|line| &line[sample..sample + 40]);
        mean(&rows.map(|amplitude| amplitude.powi(2)).collect::<Vec<f64>>())
    };
    for sample in [300, 500] {
        let share = row(-20.0, sample) / row(-200.0, sample) - 1.0;
        near("attenuating", sample as f64 / 10.0, share, 0.01, 0.2);
    }
}

#[test]
fn haze_fades_below_and_beside_tissue() {
    let haze = Haze {
        level_db: -10.0,
        lateral_mm: 20.0,
        axial_mm: 5.0,
        ..Haze::default()
    };
    for (name, backend) in precisions() {
        for below in [2.0, 10.0, 20.0] {
            let power = power(&haze, &backend, |_, z| z < 30.0, |_, z| (z - 30.0 - below).abs() < 0.5);
            near(name, below, power, 0.1 * (-below / 5.0f64).exp(), 0.1);
        }
        for beside in [5.0, 15.0, 25.0] {
            let place = -beside;
            let power = power(
                &haze,
                &backend,
                |x, _| x > 0.0,
                |x, z| (x - place).abs() < 1.0 && z > 30.0,
            );
            // Of the weights over the array, those of its tissue.
            let weight = |from: f64, to: f64| -> f64 { (-from / 20.0f64).exp() - (-to / 20.0f64).exp() };
            let right = weight(beside, beside + 30.0);
            let all = weight(0.0, beside + 30.0) + weight(0.0, 30.0 - beside);
            near(name, beside, power, 0.1 * right / all, 0.12);
        }
    }
}

/// Behind a layer that occludes, the power around at its surface goes on, by what the layer throws back, and fades; the
/// path of fluid beside it stays dark.
#[test]
fn what_occludes_fills_its_shadow() {
    let frame = Frame::around([0.0, 30.0, 0.0], [160, 180, 3], 0.5);
    let occluding = |impedance_mrayl| Acoustics {
        occlusion_per_mm: 0.9999,
        impedance_mrayl,
        echo_db: -200.0,
        ..PLAIN
    };
    let fluid = Acoustics {
        echo_db: -200.0,
        ..PLAIN
    };
    let (gas, bone) = (0.0004, 7.0);
    for (name, backend) in precisions() {
        for (impedance_mrayl, echo_db, share) in [
            (gas, 0.0, 1.0),
            (bone, 0.0, ((7.0f64 - 1.7) / (7.0 + 1.7)).powi(4)),
            // Echoes brighter than liver are those of single paths.
            (gas, 20.0, 1.0),
        ] {
            let above = Acoustics { echo_db, ..PLAIN };
            let tissues = [SILENT, above, fluid, occluding(impedance_mrayl)];
            let anatomy = anatomy::anatomy_from(frame, &tissues, |p| match (p[0] > 0.0, p[1]) {
                (_, y) if y < 20.0 => 1,
                (true, y) if y < 23.0 => 3,
                _ => 2,
            });
            let shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
            let mut settings = scene::settings(scene::probe(shape, DEPTH_MM, LINES, SAMPLES), scene::bare());
            settings.effects.shadow = Some(Shadow {
                attenuation: false,
                mirror: 0.0,
                reverberation: 0.0,
                ..Shadow::default()
            });
            settings.effects.haze = Some(Haze {
                level_db: -40.0,
                lateral_mm: 2.0,
                axial_mm: 4.0,
                behind_db: -10.0,
                behind_mm: 25.0,
            });
            let mut powers = [vec![], vec![], vec![]];
            for seed in 0..12 {
                settings.seed = seed;
                let backend = match backend {
                    Backend::CpuF64 => Backend::CpuF64,
                    _ => Backend::Cpu,
                };
                let beam = beam_after(&anatomy, &settings, backend, "haze", &scene::straight());
                for (powers, (lines, depth)) in powers.iter_mut().zip([(150..220, 30), (150..220, 55), (0..80, 30)]) {
                    for line in lines {
                        let row = &beam.amplitude[line * beam.samples + depth * 10 - 20..][..40];
                        powers.extend(row.iter().map(|amplitude| amplitude.powi(2)));
                    }
                }
            }
            let [near_it, far, beside] = powers.map(|powers| mean(&powers));
            // The layer takes all power within half a millimetre, where the mean around is that of the tissue above.
            let expected = |depth: f64| 0.1 * share * (-(depth - 20.0) / 25.0).exp();
            near(name, 30.0, near_it, expected(30.0), 0.15);
            near(name, 55.0, far, expected(55.0), 0.15);
            assert!(
                beside < 1e-4 * 10f64.powf(echo_db / 10.0),
                "{name}: {beside} below tissue"
            );
        }
    }
}

#[test]
fn haze_is_fully_developed_speckle_and_silent_outside_the_body() {
    for (name, backend) in precisions() {
        let beam = beam(Haze::default(), &backend, 3, |x, z| x > 0.0 && z > 1.0);
        // Dark tissue, where the mean around changes little.
        let columns = 60..110usize;
        let dark = |line: usize| (beam.amplitude[line * beam.samples..][..beam.samples][200..].iter()).copied();
        let values: Vec<f64> = columns.flat_map(dark).collect();
        let average = mean(&values);
        let ratio = average / mean(&values.iter().map(|a| (a - average).powi(2)).collect::<Vec<f64>>()).sqrt();
        assert!(
            (1.65..2.05).contains(&ratio),
            "{name}: {ratio}, Rayleigh amplitudes have 1.91"
        );
    }
    let frame = Frame::around([0.0, 30.0, 0.0], [160, 180, 3], 0.5);
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, PLAIN], |p| u8::from(p[0] > 0.0));
    let shape = ProbeShape::Linear(Linear { width_mm: 40.0 });
    let mut settings = scene::settings(scene::probe(shape, 40.0, 16, 64), scene::bare());
    settings.effects.haze = Some(Haze::default());
    let beam = beam_after(&anatomy, &settings, Backend::Cpu, "haze", &scene::straight());
    let (outside, inside) = beam.amplitude.split_at(8 * 64);
    assert!(outside.iter().all(|amplitude| *amplitude < 1e-9));
    assert!(mean(inside) > 1.001 && inside.iter().all(|amplitude| *amplitude >= 1.0));
}
