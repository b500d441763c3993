//! Refraction by a cylinder across the beam, against geometrical optics.

use insonify_imaging::effects::compound::Compound;
use insonify_imaging::effects::refraction::{F_NUMBER, Refraction, index};
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::synth::Backend;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_tracking::probe::{Curvilinear, Linear, ProbeShape};

use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene;
use crate::support::scene::{beam_after, precisions};

const DEPTH_MM: f64 = 60.0;
const SAMPLES: u32 = 2400;
const RADIUS_MM: f64 = 12.0;
const Z: [f64; 2] = [1.65, 1.55];

/// Factor on the echo of every sample, scanline by scanline: linear arrays have one every 0.25 mm.
fn factors(shape: ProbeShape, lines: u32, beam_mm: f64, backend: Backend) -> Vec<Vec<f64>> {
    let (anatomy, settings) = cylinder(shape, lines, beam_mm);
    let beam = beam_after(&anatomy, &settings, backend, "refraction", &scene::straight());
    beam.amplitude.chunks(beam.samples).map(<[f64]>::to_vec).collect()
}

/// A cylinder across the beam, and what images it.
fn cylinder(shape: ProbeShape, lines: u32, beam_mm: f64) -> (Anatomy, Settings) {
    let tissue = |impedance_mrayl| Acoustics {
        impedance_mrayl,
        ..PLAIN
    };
    let frame = Frame::around([0.0, 30.0, 0.0], [500, 800, 3], 0.1);
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, tissue(Z[0]), tissue(Z[1])], |p| {
        1 + u8::from(p[0].hypot(p[1] - 20.0) < RADIUS_MM)
    });
    let mut settings = scene::settings(scene::probe(shape, DEPTH_MM, lines, SAMPLES), scene::bare());
    settings.effects.refraction = Some(Refraction { beam_mm });
    (anatomy, settings)
}

/// The rays of a look at an angle `a` pass the cylinder as those of the middle look do `z tan a` aside, `z` below its
/// centre.
#[test]
fn refraction_runs_along_each_look() {
    let linear = ProbeShape::Linear(Linear { width_mm: 60.0 });
    let straight = factors(linear, 241, 6.0, Backend::CpuF64);
    let (anatomy, mut settings) = cylinder(linear, 241, 6.0);
    settings.effects.speckle = Some(Speckle::default());
    settings.effects.compound = Some(Compound {
        looks: 3,
        angle_deg: 8.0,
    });
    let [without, with] = ["compound", "refraction"]
        .map(|effect| beam_after(&anatomy, &settings, Backend::CpuF64, effect, &scene::straight()).amplitude);
    let samples = SAMPLES as usize;
    let at = |x_mm: f64, sample: usize| {
        let position = 120.0 + 4.0 * x_mm;
        let (first, after) = (position.floor() as usize, position.fract());
        straight[first][sample] * (1.0 - after) + straight[first + 1][sample] * after
    };
    let (mut worst, mut deepest) = (0.0f64, 0.0f64);
    for sample in (samples / 2..samples).step_by(50) {
        let aside_mm = (sample as f64 / 40.0 - 20.0) * 8f64.to_radians().tan();
        for line in 80..=160 {
            let x_mm = 0.25 * (f64::from(line) - 120.0);
            let expected = [-aside_mm, 0.0, aside_mm].map(|aside_mm| at(x_mm + aside_mm, sample));
            let expected = expected.iter().sum::<f64>() / 3.0;
            let index = line as usize * samples + sample;
            worst = worst.max((with[index] / without[index] - expected).abs());
            deepest = deepest.max((1.0 - at(x_mm, sample)).abs());
        }
    }
    println!("within {worst:.4} of lines {deepest:.3} deep");
    assert!(deepest > 0.1 && worst < 0.1 * deepest, "{worst} of {deepest}");
}

#[test]
fn speeds_follow_impedances() {
    for (mrayl, speed) in [(1.38, 1450.0), (1.65, 1575.0), (1.70, 1580.0)] {
        let computed = 1540.0 / index(mrayl);
        assert!((computed / speed - 1.0).abs() < 0.02, "{mrayl} MRayl: {computed} m/s");
    }
    assert_eq!([7.38, 0.0004].map(index), [index(1.65); 2], "bone and gas");
}

/// A beam through the middle of a cylinder of index `n` is gathered by two lenses of focal length `r / (n - 1)`, as far
/// as they act.
#[test]
fn the_middle_of_a_slow_cylinder_gathers_as_a_lens_does() {
    let excess = index(Z[1]) - index(Z[0]);
    for (name, backend) in precisions() {
        let linear = factors(ProbeShape::Linear(Linear { width_mm: 60.0 }), 241, 6.0, backend);
        for depth in [40.0, 50.0, 59.0] {
            // One face within the cylinder, two behind it.
            let fading = F_NUMBER * 6.0;
            let since = |face: f64| (-(depth - face) / fading).exp();
            let ends = [20.0 - RADIUS_MM, 20.0 + RADIUS_MM].map(since);
            let expected = 1.0 / (1.0 - excess / RADIUS_MM * fading * (ends[1] - ends[0] + 2.0 * (1.0 - ends[1])));
            let amplitude = linear[120][(depth * 40.0) as usize];
            assert!(
                (amplitude / expected - 1.0).abs() < 0.03,
                "{name}, {depth} mm: {amplitude}, not {expected}"
            );
        }
    }
}

#[test]
fn edges_of_a_cylinder_cast_dark_lines_and_nothing_else_changes() {
    for (name, backend) in precisions() {
        let linear = factors(ProbeShape::Linear(Linear { width_mm: 60.0 }), 241, 3.0, backend);
        let linear_at = |x_mm: f64, depth: f64| linear[(120.0 + x_mm * 4.0).round() as usize][(depth * 40.0) as usize];
        for side in [-1.0, 1.0] {
            let edge = (0..9).map(|step| linear_at(side * (RADIUS_MM + 0.25 * f64::from(step)), 55.0));
            let darkest = edge.fold(f64::INFINITY, f64::min);
            assert!(darkest < 0.7, "{name}: {darkest} beside the edge");
            assert!(
                (linear_at(side * 20.0, 55.0) - 1.0).abs() < 1e-6,
                "{name}: away from it"
            );
            assert_eq!(linear_at(side * RADIUS_MM, 5.0), 1.0, "{name}: above it");
        }
    }
}

/// What bends is the phase across the beam, whatever the distance between scanlines.
#[test]
fn curved_arrays_and_other_line_counts_see_the_same() {
    let [few, many, most] = [121, 241, 481].map(|lines| {
        factors(
            ProbeShape::Linear(Linear { width_mm: 60.0 }),
            lines,
            3.3,
            Backend::CpuF64,
        )
    });
    for line in 20..101 {
        let (a, b, c) = (few[line][2200], many[2 * line][2200], most[4 * line][2200]);
        assert!((a / b - 1.0).abs() < 0.06, "{line}: {a} and {b}");
        assert!((b / c - 1.0).abs() < 0.03, "{line}: {b} and {c}");
    }
    // From an array of 200 mm radius beams diverge as from a source 220 mm before the middle of the cylinder, and a
    // beam that is wider changes its width by less: by the square of the ratio, on the mean over where the cylinder
    // acts from, its two faces up to 30 mm behind it.
    let straight = ProbeShape::Linear(Linear { width_mm: 60.0 });
    let curved = ProbeShape::Curvilinear(Curvilinear {
        radius_mm: 200.0,
        angle_deg: 17.2,
    });
    let [straight, curved] = [straight, curved].map(|shape| {
        let factors = factors(shape, 241, 6.0, Backend::CpuF64);
        1.0 - 1.0 / factors[120][2000]
    });
    let places = (0..420).map(|step| 0.1 * f64::from(step) - RADIUS_MM);
    let faces = |z: f64| if z < RADIUS_MM { 1.0 } else { 2.0 };
    let weight = |z: f64| faces(z) * ((z - 30.0) / (F_NUMBER * 6.0)).exp();
    let [sum, all] = places.fold([0.0; 2], |[sum, all], z| {
        [sum + weight(z) * (220.0 / (220.0 + z)).powi(2), all + weight(z)]
    });
    let (computed, expected) = (curved / straight, sum / all);
    assert!((computed / expected - 1.0).abs() < 0.06, "{computed}, not {expected}");
}
