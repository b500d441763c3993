//! Compounding against closed forms: correlation of looks, what their mean gains, and where shadows end.

use std::f64::consts::{FRAC_PI_4, PI};

use insonify_imaging::effects::compound::Compound;
use insonify_imaging::effects::interface::Interface;
use insonify_imaging::effects::shadow::Shadow;
use insonify_imaging::effects::slice::Boundary;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState};
use insonify_tracking::probe::{Curvilinear, Linear, Phased, ProbeShape};
use nalgebra::Matrix4;

use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene::{self, synthesizer};
use crate::support::stats::{correlation, mean, std};
use crate::synth::cpu::CpuExecutor;

const DEPTH_MM: f64 = 48.0;
const WIDTH_MM: f64 = 60.0;
const LINES: usize = 151;
const SAMPLES: usize = 240;

/// Lateral length of speckle, mm.
const LATERAL_MM: f64 = 1.6;

const LINEAR: ProbeShape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
/// As wide, with the same distance of scanlines at the array.
const CURVED: ProbeShape = ProbeShape::Curvilinear(Curvilinear {
    radius_mm: 60.0,
    angle_deg: 180.0 / PI,
});

fn settings(shape: ProbeShape, looks: u32, angle_deg: f64) -> Settings {
    let probe = scene::probe(shape, DEPTH_MM, LINES as u32, SAMPLES as u32);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.slice.boundary = Boundary::Vote;
    settings.effects.speckle = Some(Speckle {
        receive_bandwidth: None,
        axial_mm: Some(0.8),
        lateral_mm: Some(LATERAL_MM),
        elevational_mm: Some(1.6),
        focus_mm: None,
        focal_zone_mm: Some(10_000.0),
    });
    settings.effects.compound = Some(Compound { looks, angle_deg });
    settings
}

/// Envelopes of the middle look, and of those to the left and to the right, at the samples that all meet.
fn looks(settings: &Settings, count: u64) -> Vec<Vec<f64>> {
    let mut looks = Vec::new();
    for number in 0..count {
        let aside = FrameState::at(Matrix4::new_translation(&[0.0, 0.0, 30.0 * number as f64].into()));
        let synthesizer = synthesizer(&anatomy::uniform(PLAIN), settings, Backend::CpuF64);
        let (plan, tables) = (synthesizer.plan(), synthesizer.tables());
        let last = plan
            .passes
            .iter()
            .position(|planned| planned.pass.name == "speckle_lateral");
        let passes = &plan.passes[..=last.expect("the envelope")];
        let mut executor = CpuExecutor::<f64>::new(plan, tables).expect("memory");
        executor.run(passes, tables, &aside).expect("a frame");
        let store = &executor.store;
        let envelopes =
            std::iter::once(&store.amplitude[..]).chain(store.effects.compound.envelopes.chunks(LINES * SAMPLES));
        looks.resize(1 + tables.effects.compound.steered, Vec::new());
        for (look, envelope) in looks.iter_mut().zip(envelopes) {
            for line in envelope.chunks(SAMPLES).skip(40).take(LINES - 80) {
                look.extend_from_slice(&line[10..SAMPLES - 10]);
            }
        }
    }
    looks
}

/// Correlation of the envelopes of two complex Gaussian signals with a correlation of this modulus (D. Middleton, An
/// Introduction to Statistical Communication Theory, 1960, section 9.1): the series of 2F1(-1/2, -1/2; 1; x^2) - 1 over
/// that of full correlation.
fn of_envelopes(modulus: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 0.0);
    for order in 0..200 {
        let order = f64::from(order);
        term *= ((order - 0.5) / (order + 1.0) * modulus).powi(2);
        sum += term;
    }
    sum * FRAC_PI_4 / (1.0 - FRAC_PI_4)
}

/// Distances (mm) and squares of the lateral kernel.
fn squares(settings: &Settings) -> Vec<[f64; 2]> {
    let synthesizer = synthesizer(&anatomy::uniform(PLAIN), settings, Backend::CpuF64);
    let speckle = synthesizer.tables().effects.speckle.as_ref().expect("speckle");
    let fine_mm = WIDTH_MM / (LINES as f64 - 1.0) / speckle.oversampling as f64;
    let taps = speckle.lateral.at(SAMPLES / 2).enumerate();
    taps.map(|(tap, weight)| [(tap as f64 - speckle.lateral.reach as f64) * fine_mm, weight * weight])
        .collect()
}

/// Modulus of the correlation of two looks at angles (degrees): the transform of the square of the lateral kernel `w`,
/// `|sum w^2 exp(i dk x)| / sum w^2`.
fn modulus(angles_deg: [f64; 2], squares: &[[f64; 2]]) -> f64 {
    let wavelength_mm = 1.54 / 5.0;
    let [a, b] = angles_deg.map(|angle_deg| 4.0 * PI / wavelength_mm * angle_deg.to_radians().sin());
    let rotated: f64 = squares
        .iter()
        .map(|[away_mm, square]| square * ((a - b) * away_mm).cos())
        .sum();
    (rotated / squares.iter().map(|[_, square]| square).sum::<f64>()).abs()
}

#[test]
fn looks_correlate_as_the_closed_form_says() {
    for angle_deg in [1.0, 1.5, 2.0, 3.0, 8.0] {
        let settings = settings(LINEAR, 3, angle_deg);
        let looks = looks(&settings, 6);
        for ([first, second], angles) in [
            ([0, 1], [0.0, angle_deg]),
            ([0, 2], [0.0, angle_deg]),
            ([1, 2], [-angle_deg, angle_deg]),
        ] {
            let measured = correlation(&looks[first], &looks[second]);
            let expected = of_envelopes(modulus(angles, &squares(&settings)));
            println!("{angle_deg} degrees, looks {first} and {second}: {measured:.3}, {expected:.3}");
            assert!(
                (measured - expected).abs() < 0.05,
                "{angle_deg} degrees: {measured}, not {expected}"
            );
        }
        for look in &looks[1..] {
            let gain = mean(look) / mean(&looks[0]);
            assert!((gain - 1.0).abs() < 0.02, "{angle_deg} degrees: a look of {gain}");
        }
    }
}

/// Under a curved array waves steered at the array run less aside at depth, where scanlines are farther apart.
#[test]
fn phases_under_a_curved_array_advance_from_scanline_to_scanline_as_those_of_a_flat_one() {
    let [flat, curved] = [LINEAR, CURVED].map(|shape| {
        let settings = settings(shape, 3, 3.0);
        synthesizer(&anatomy::uniform(PLAIN), &settings, Backend::CpuF64)
    });
    let [flat, curved] = [flat, curved].map(|synthesizer| {
        let speckle = synthesizer.tables().effects.speckle.clone().expect("speckle");
        let phasors = &speckle.phasors.of::<f64>()[2 * SAMPLES..];
        phasors[2 * speckle.oversampling + 1].atan2(phasors[2 * speckle.oversampling])
    });
    assert!(flat < -0.5 && (flat - curved).abs() < 1e-9, "{flat} {curved}");
}

/// The mean of looks varies less, by their correlations; its mean is that of each.
#[test]
fn the_mean_of_looks_gains_as_their_correlations_say() {
    for (count, angle_deg) in [(3, 1.5), (3, 8.0), (5, 4.0), (9, 8.0)] {
        let settings = settings(LINEAR, count, angle_deg);
        let looks = looks(&settings, 6);
        let sums: Vec<f64> = (0..looks[0].len())
            .map(|index| looks.iter().map(|look| look[index]).sum())
            .collect();
        let gain = mean(&sums) / std(&sums) / (mean(&looks[0]) / std(&looks[0]));
        let count = count as usize;
        let angle = |look: usize| angle_deg * (2.0 * look as f64 / (count - 1) as f64 - 1.0);
        let squares = squares(&settings);
        let pairs =
            (0..count * count).map(|pair| of_envelopes(modulus([angle(pair / count), angle(pair % count)], &squares)));
        let expected = count as f64 / pairs.sum::<f64>().sqrt();
        println!("{count} looks to {angle_deg} degrees: {gain:.3} times, {expected:.3}");
        assert!((gain / expected - 1.0).abs() < 0.05, "{gain}, not {expected}");
    }
}

const ABSORBER_MM: f64 = 5.0;
const BELOW_MM: f64 = 12.0;

/// Tissue with an absorber from 10 to 12 mm, without one if it is not wide.
fn absorber(width_mm: f64) -> Anatomy {
    let frame = Frame::around([0.0, 25.0, 0.0], [240, 220, 3], 0.25);
    let opaque = Acoustics {
        occlusion_per_mm: 0.9999,
        ..PLAIN
    };
    anatomy::anatomy_from(frame, &[SILENT, PLAIN, opaque], |p| {
        1 + u8::from(p[0].abs() < 0.5 * width_mm && (10.0..BELOW_MM).contains(&p[1]))
    })
}

/// Share of the echo that an absorber leaves on the axis, a row over the samples.
fn left_on_axis(shape: ProbeShape, angle_deg: f64, backend: Backend) -> Vec<f64> {
    let mut settings = settings(shape, 3, angle_deg);
    settings.probe.lines = 601;
    // Sharp and straight, so that geometry alone counts.
    settings.effects.shadow = Some(Shadow {
        beam_mm: Some(0.0),
        f_number: Some(0.0),
        mirror: 0.0,
        reverberation: 0.0,
        ..Shadow::default()
    });
    // Without the absorber nothing is lost, and there is no shadow.
    let amplitudes = [ABSORBER_MM, 0.0].map(|width_mm| {
        let mut synthesizer = synthesizer(&absorber(width_mm), &settings, backend.clone());
        let mut sums = vec![0.0; SAMPLES];
        for number in 0..24 {
            let seed = 7 * number;
            synthesizer
                .set(Settings {
                    seed,
                    ..settings.clone()
                })
                .expect("another seed");
            let beam = synthesizer
                .render_until("compound", &scene::straight())
                .expect("a beam");
            for line in beam.amplitude.chunks(SAMPLES).skip(299).take(3) {
                sums.iter_mut().zip(line).for_each(|(sum, amplitude)| *sum += amplitude);
            }
        }
        sums
    });
    amplitudes[0]
        .iter()
        .zip(&amplitudes[1])
        .map(|(shaded, open)| shaded / open)
        .collect()
}

/// Behind an absorber of width `w` the full shadow ends at `w / (2 tan a)` below it, where the looks from either side
/// meet; beyond, two of three pass.
#[test]
fn full_shadows_end_as_triangles() {
    for (angle_deg, backend) in [(8.0, Backend::CpuF64), (8.0, Backend::Cpu), (12.0, Backend::CpuF64)] {
        let left = left_on_axis(LINEAR, angle_deg, backend);
        let depth_mm = |sample: usize| (sample as f64 + 0.5) * DEPTH_MM / SAMPLES as f64;
        let end = (60..SAMPLES).find(|sample| left[*sample] > 1.0 / 3.0).expect("an end");
        let length_mm = depth_mm(end) - BELOW_MM;
        let expected_mm = 0.5 * ABSORBER_MM / angle_deg.to_radians().tan();
        println!("{angle_deg} degrees: {length_mm:.2} mm, {expected_mm:.2}");
        assert!(
            (length_mm / expected_mm - 1.0).abs() < 0.05,
            "{length_mm} mm, not {expected_mm}"
        );
        let share = |samples: &[f64]| mean(samples);
        let (shaded, beyond) = (share(&left[70..end - 8]), share(&left[end + 8..]));
        assert!(shaded < 0.01, "{shaded} in the full shadow");
        assert!((beyond - 2.0 / 3.0).abs() < 0.04, "{beyond} beyond it");
    }
}

/// Where a look comes from beyond the array the others are averaged: the sides are no darker.
#[test]
fn sides_that_fewer_looks_meet_are_as_bright() {
    for shape in [LINEAR, CURVED] {
        let mut settings = settings(shape, 5, 16.0);
        settings.effects.shadow = Some(Shadow::default());
        let mut sums = vec![0.0; LINES];
        for number in 0..6 {
            let aside = FrameState::at(Matrix4::new_translation(&[0.0, 0.0, 30.0 * f64::from(number)].into()));
            let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, Backend::CpuF64);
            let beam = synthesizer.render_until("compound", &aside).expect("a beam");
            for (sum, line) in sums.iter_mut().zip(beam.amplitude.chunks(SAMPLES)) {
                *sum += mean(&line[SAMPLES / 2..]);
            }
        }
        let side = mean(&sums[..20]) + mean(&sums[LINES - 20..]);
        let middle = 2.0 * mean(&sums[40..LINES - 40]);
        assert!((side / middle - 1.0).abs() < 0.04, "{shape:?}: {}", side / middle);
    }
}

/// Where no steered look comes from the array, the middle one is left as it is.
#[test]
fn what_no_steered_look_meets_is_that_of_the_middle_one() {
    let mut narrow = settings(ProbeShape::Linear(Linear { width_mm: 8.0 }), 3, 20.0);
    narrow.effects.shadow = Some(Shadow::default());
    let envelopes = [true, false].map(|compounds| {
        let mut settings = narrow.clone();
        settings.effects.compound = settings.effects.compound.filter(|_| compounds);
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, Backend::CpuF64);
        let last = if compounds { "compound" } else { "speckle_lateral" };
        synthesizer
            .render_until(last, &scene::straight())
            .expect("a beam")
            .amplitude
            .to_vec()
    });
    let deep_mm = 8.0 / 20f64.to_radians().tan();
    let first = (deep_mm / DEPTH_MM * SAMPLES as f64) as usize + 2;
    for (with, without) in envelopes[0].chunks(SAMPLES).zip(envelopes[1].chunks(SAMPLES)) {
        assert_eq!(with[first..], without[first..]);
        assert_ne!(with[..first], without[..first]);
    }
}

/// Shadows that a scene asks to be straight have edges as wide as the beam, with looks as without them.
#[test]
fn straight_shadows_are_as_sharp_as_without_looks() {
    let kernels = [
        Some(Compound {
            looks: 3,
            angle_deg: 8.0,
        }),
        None,
    ]
    .map(|compound| {
        let mut settings = settings(LINEAR, 3, 8.0);
        settings.effects.compound = compound;
        settings.effects.shadow = Some(Shadow {
            f_number: Some(0.0),
            ..Shadow::default()
        });
        let synthesizer = synthesizer(&absorber(ABSORBER_MM), &settings, Backend::CpuF64);
        let kernel = synthesizer.tables().effects.shadow.penumbra.clone();
        kernel.expect("a penumbra").reach
    });
    assert_eq!(kernels[0], kernels[1]);
}

/// Exponent of the cosine of the incidence on the plate.
const DIRECTIVITY: f64 = 12.0;

/// A plate tilted in the scan plane is brightest in the look that meets it square; in the others as the power of the
/// cosine of the angle between them says.
#[test]
fn a_tilted_plate_is_brightest_in_the_look_that_meets_it_square() {
    let steel = Acoustics {
        impedance_mrayl: 3.0,
        ..SILENT
    };
    let water = Acoustics {
        impedance_mrayl: 1.5,
        ..SILENT
    };
    for shape in [LINEAR, CURVED] {
        for tilt_deg in [-12.0f64, 0.0, 12.0] {
            let normal = tilt_deg.to_radians();
            let frame = Frame::around([0.0, 20.0, 0.0], [400, 300, 3], 0.125);
            let plate = anatomy::anatomy_from(frame, &[SILENT, water, steel], |p| {
                1 + u8::from(p[0] * normal.sin() + (p[1] - 20.0) * normal.cos() > 0.0)
            });
            let mut settings = settings(shape, 3, 12.0);
            settings.effects.interface = Some(Interface {
                directivity: DIRECTIVITY,
                roughness: 0.0,
                ..Interface::default()
            });
            let synthesizer = synthesizer(&plate, &settings, Backend::CpuF64);
            let (plan, tables) = (synthesizer.plan(), synthesizer.tables());
            let last = plan.passes.iter().position(|planned| planned.pass.name == "interface");
            let mut executor = CpuExecutor::<f64>::new(plan, tables).expect("memory");
            let passes = &plan.passes[..=last.expect("echoes")];
            executor.run(passes, tables, &scene::straight()).expect("a frame");
            let store = &executor.store;
            // Echo of each look on the scanlines beside the middle one, where the plate lies some 20 mm deep.
            let lines = LINES / 2 - 20..LINES / 2 + 21;
            let echo = |look: usize, line: usize, sample: usize| {
                let middle = store.specular[line * SAMPLES + sample][0];
                let more = &store.effects.compound.specular;
                middle
                    + look
                        .checked_sub(1)
                        .map_or(0.0, |look| more[(2 * line + look) * SAMPLES + sample][0])
            };
            let sum = |look: usize| -> f64 {
                let of_line = |line| (0..SAMPLES).map(move |sample| (line, sample));
                lines
                    .clone()
                    .flat_map(of_line)
                    .map(|(line, sample)| echo(look, line, sample))
                    .sum()
            };
            let sums = [0, 1, 2].map(sum);
            let angle = match shape {
                ProbeShape::Curvilinear(curved) => {
                    (curved.radius_mm * 12f64.to_radians().sin() / (curved.radius_mm + 20.0)).asin()
                }
                _ => 12f64.to_radians(),
            };
            let expected = [0.0, -angle, angle].map(|look| (look - normal).cos().powf(DIRECTIVITY));
            let square = if tilt_deg == 0.0 {
                0
            } else {
                1 + usize::from(tilt_deg > 0.0)
            };
            println!("{shape:?}, {tilt_deg} degrees: {sums:.3?}, {expected:.3?}");
            for look in 0..3 {
                let (measured, expected) = (sums[look] / sums[square], expected[look] / expected[square]);
                assert!(
                    measured <= 1.0,
                    "look {look} of a plate at {tilt_deg} degrees: {measured}"
                );
                assert!(
                    (measured - expected).abs() < 0.1,
                    "look {look}: {measured}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn plans_say_what_cannot_be_compounded() {
    let phased = ProbeShape::Phased(Phased { angle_deg: 90.0 });
    let mut without_speckle = settings(LINEAR, 3, 8.0);
    without_speckle.effects.speckle = None;
    for (settings, reason) in [(settings(phased, 3, 8.0), "one place"), (without_speckle, "no speckle")] {
        let synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, Backend::Cpu);
        let plan = synthesizer.plan();
        assert!(
            plan.passes
                .iter()
                .all(|planned| !planned.pass.name.starts_with("compound"))
        );
        let omitted = plan.without.iter().find(|omitted| omitted.name == "compound");
        assert!(omitted.is_some_and(|omitted| omitted.reason.contains(reason)));
    }
}
