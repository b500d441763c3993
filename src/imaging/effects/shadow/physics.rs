//! Loss down the beam: Beer and Lambert's law through layers, bone, and the needle.

use crate::effects::shadow::reverberation::BONE_RADIUS_MM;
use insonify_imaging::effects::shadow::downshift::Downshift;
use insonify_imaging::effects::shadow::{SOFT_TISSUE_DB_CM_MHZ, Shadow, UNITS_PER_DB};
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, NeedleShaft};
use nalgebra::{Matrix4, Vector3};

use insonify_tracking::probe::{Curvilinear, Linear, ProbeShape};

use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{beam_after, precisions};
use crate::support::stats::{order, rms};

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

/// What a pulse of the default bandwidth feels of attenuation that takes so many dB at the frequency of the probe.
fn felt_db(db: f64) -> f64 {
    Downshift::new(0.6).felt_db(db)
}

/// Two-way loss of layers with one-way coefficients `alphas` (dB/cm/MHz) that start at `starts`, at a depth.
fn beer_lambert(starts: &[f64], alphas: &[f64], depth: f64) -> f64 {
    let mut db = 0.0;
    for (index, (&start, alpha)) in starts.iter().zip(alphas).enumerate() {
        let end = starts.get(index + 1).copied().unwrap_or(f64::INFINITY);
        db += 2.0 * alpha * MHZ / 10.0 * (depth.min(end) - start).max(0.0);
    }
    felt_db(db)
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
                    let expected = felt_db(2.0 * 0.7 * MHZ * depth / 10.0);
                    // Half a unit of fixed point a sample; what is not felt, some 6 dB, in single precision.
                    let slack = (sample as f64 + 1.0) * 0.5 / UNITS_PER_DB + 2.0 / UNITS_PER_DB + 6e-6;
                    let computed = loss_db(&beam, line, sample);
                    assert!(
                        (computed - expected).abs() <= slack,
                        "{name}, {kind}: {computed} dB at {depth} mm, not {expected}"
                    );
                    let left = beam.amplitude[line * beam.samples + sample];
                    assert!(
                        (left / 10f64.powf(-computed / 20.0) - 1.0).abs() < 1e-4,
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
    let observed_order = order(&steps, &errors);
    println!("loss through layers: errors {errors:.4?} dB, order {observed_order:.2}");
    // A boundary inside a sample counts for one side of it: off by up to half a sample at each boundary, first order.
    assert!(observed_order > 0.8, "order {observed_order} of {errors:?}");
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
            let amplitude_at = |depth: f64| beam.amplitude[line * beam.samples + (depth / DEPTH_MM * 240.0) as usize];
            assert!(
                amplitude_at(19.5) > 0.2,
                "{name}: tissue in front of the bone shows: {}",
                amplitude_at(19.5)
            );
            assert!(
                amplitude_at(27.0) < 1e-5,
                "{name}: behind bone is {}",
                amplitude_at(27.0)
            );
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
    // One millimetre takes 20 log10(1 / (1 - 0.5)) = 6.02 dB by occlusion, and 10.125 take 20.25 dB at the
    // frequency of the probe by attenuation, 18.7 of a pulse.
    let of_pulse = felt_db(20.25) / 10.125;
    for (attenuation, occlusion, db_mm) in [
        (true, true, of_pulse + 6.0206),
        (true, false, of_pulse),
        (false, true, 6.0206),
    ] {
        let mut settings = settings(SHAPES[0].1, 240);
        settings.effects.shadow = Some(Shadow {
            attenuation,
            occlusion,
            ..Shadow::default()
        });
        let beam = beam_after(&anatomy, &settings, Backend::CpuF64, "shadow", &scene::straight());
        let computed = loss_db(&beam, 0, 40) / (40.5 * 0.25);
        assert!((computed - db_mm).abs() < 1e-3, "{computed} dB/mm, not {db_mm}");
    }
}

#[test]
fn the_needle_casts_a_shadow_of_its_thickness() {
    // A needle of 2 mm across the beam, in the plane: the middle line crosses its whole diameter. It fills two thirds
    // of a beam of 3 mm.
    for (name, backend) in precisions() {
        let mut settings = settings(ProbeShape::Linear(Linear { width_mm: 40.0 }), 600);
        settings.has_needle = true;
        settings.effects.needle = Some(Default::default());
        settings.effects.shadow = Some(Shadow {
            needle_db_mm: 6.0,
            beam_mm: Some(3.0),
            ..Shadow::default()
        });
        let mut state = scene::straight();
        let nodes = vec![[-8.0, 20.0, 0.0].into(), [8.0, 20.0, 0.0].into()];
        state.needle = Some(NeedleShaft {
            nodes,
            diameter_mm: 2.0,
        });
        let beam = beam_after(&anatomy::uniform(PLAIN), &settings, backend, "shadow", &state);
        // Scanlines lie 5 mm apart: those at -5, 0 and 5 mm cross the needle. The share along the chord is the
        // cylinder's half chord over the slab's: its mean over the diameter is pi / 4. Summed in steps of 0.1 mm, a
        // root that starts and ends steeply is off by half a percent.
        for line in 0..9 {
            let computed = loss_db(&beam, line, 599);
            let expected = if (3..=5).contains(&line) {
                6.0 * 2.0 * std::f64::consts::FRAC_PI_4 * 2.0 / 3.0
            } else {
                0.0
            };
            assert!(
                (computed - expected).abs() <= 0.005 * expected,
                "{name}: line {line}: {computed} dB, not {expected}"
            );
            assert_eq!(
                loss_db(&beam, line, 180),
                0.0,
                "{name}: above the needle nothing is lost"
            );
        }
    }
}

const BONE_MRAYL: f64 = 7.0;

/// Tissue above something opaque whose face lies 20 mm deep in the middle and rises to one side by an angle, after the
/// pass that repeats its echoes if they are.
fn above_opaque(angle_deg: f64, reverberation: f64, backend: Backend) -> Beam {
    let opaque = Acoustics {
        occlusion_per_mm: 1.0,
        impedance_mrayl: BONE_MRAYL,
        ..PLAIN
    };
    let frame = Frame::around([0.0, 30.0, 0.0], [400, 700, 3], 0.1);
    let slope = angle_deg.to_radians().tan();
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, attenuating(0.7), opaque], |p| {
        1 + u8::from(p[1] > 20.0 + slope * p[0])
    });
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 30.0 }), DEPTH_MM, 61, 1200);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.shadow = Some(Shadow {
        beam_mm: Some(0.0),
        f_number: Some(0.0),
        reverberation,
        ..Shadow::default()
    });
    let last = if reverberation > 0.0 {
        "shadow_reverberation"
    } else {
        "shadow"
    };
    beam_after(&anatomy, &settings, backend, last, &scene::straight())
}

#[test]
fn tissue_above_a_reflector_comes_back_below_it_again_and_again() {
    for angle_deg in [0.0, 10.0, 20.0] {
        for ((name, backend), (_, backend_without)) in precisions().into_iter().zip(precisions()) {
            let with = above_opaque(angle_deg, 0.35, backend);
            let without = above_opaque(angle_deg, 0.0, backend_without);
            let angle = f64::to_radians(angle_deg);
            // Lines whose neighbours all see the face.
            for line in 12..49 {
                let depth = 20.0 + angle.tan() * 0.5 * (line as f64 - 30.0);
                let reflected = (BONE_MRAYL - PLAIN.impedance_mrayl) / (BONE_MRAYL + PLAIN.impedance_mrayl);
                let spread = 1.0 + 2.0 * depth / BONE_RADIUS_MM;
                let gain = 0.35 * reflected / spread * angle.cos().powi(4) * (2.0 * angle).cos().powi(4);
                let row = line * with.samples;
                for (order, share) in [(1, 0.6), (1, 0.9), (2, 0.15)] {
                    let from = (share * depth / 0.05) as usize;
                    let top = (depth / 0.05).round() as usize;
                    // Average tissue on the way, whatever is there.
                    let lost_db = |depth: f64| felt_db(2.0 * SOFT_TISSUE_DB_CM_MHZ * MHZ / 10.0 * depth);
                    let shallow = share * depth;
                    let lost = 10f64.powf((lost_db(shallow) - lost_db(shallow + f64::from(order) * depth)) / 20.0);
                    let expected = gain.powi(order) * lost * without.amplitude[row + from];
                    let amplitude = with.amplitude[row + from + order as usize * top];
                    let error = (amplitude / expected - 1.0).abs();
                    // Faces lie on samples, which moves the angle by up to half a degree.
                    assert!(
                        error < 0.02 + 0.006 * angle_deg * f64::from(order),
                        "{name}, {angle_deg} degrees, line {line}, {share}, {order}: {amplitude}, not {expected}"
                    );
                }
            }
        }
    }
}

/// Gas 20 mm deep below a plain tissue that was moved by a way across, under an array of 120 mm, with B-lines from a
/// share of it.
fn above_lung(b_lines: f64, seed: u64, moved_mm: f64, backend: Backend) -> Beam {
    let gas = Acoustics {
        occlusion_per_mm: 1.0,
        impedance_mrayl: 0.0004,
        ..PLAIN
    };
    let frame = Frame::around([0.0, 30.0, 0.0], [400, 120, 3], 0.5);
    let anatomy = anatomy::layers(frame, &[-100.0, 20.0], &[SILENT, attenuating(0.5), gas]);
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 120.0 }), DEPTH_MM, 481, 240);
    let mut settings = scene::settings(probe, scene::bare());
    settings.seed = seed;
    settings.effects.shadow = Some(Shadow {
        b_lines,
        mirror: 0.0,
        reverberation: 0.0,
        ..Shadow::default()
    });
    let mut state = scene::straight();
    state.probe_to_world = Matrix4::new_translation(&Vector3::new(moved_mm, 0.0, 0.0)) * state.probe_to_world;
    let last = if b_lines > 0.0 { "shadow_b_lines" } else { "shadow" };
    beam_after(&anatomy, &settings, backend, last, &state)
}

/// Stripes rise from the stated share of the surface, fade as average tissue attenuates and no more, and stay on the
/// tissue when the probe slides over it.
#[test]
fn b_lines_rise_from_a_share_of_the_lung_and_belong_to_it() {
    let lost_db = |depth: f64| felt_db(2.0 * SOFT_TISSUE_DB_CM_MHZ * MHZ / 10.0 * depth);
    // Power of a scanline over a range of depth, less the loss of average tissue from the surface.
    let power = |beam: &Beam, line: usize, range: std::ops::Range<usize>| {
        let count = range.len() as f64;
        let sample = |sample: usize| {
            let kept = 10f64.powf(lost_db(0.25 * (sample as f64 + 0.5)) / 10.0);
            beam.amplitude[line * beam.samples + sample].powi(2) * kept
        };
        range.map(sample).sum::<f64>() / count
    };
    for (name, backend) in precisions() {
        let (mut striped, mut near, mut far) = (0, 0.0, 0.0);
        for seed in 0..6 {
            let beam = above_lung(0.3, seed, 0.0, backend.clone());
            for line in 0..beam.lines {
                // The darkest gas returns less than 1e-4.
                let bright = power(&beam, line, 100..160);
                striped += usize::from(bright > 1e-4);
                near += bright;
                far += power(&beam, line, 180..240);
            }
        }
        // 20 stretches of 6 mm in each of 6 frames: a standard deviation of 0.04; the lattice adds 0.02.
        let share = striped as f64 / (6.0 * 481.0);
        assert!((share - 0.3).abs() < 0.1, "{name}: {share} of the surface");
        assert!(
            (near / far - 1.0).abs() < 0.2,
            "{name}: {near} near the surface, {far} far from it"
        );
        let (here, there) = (
            above_lung(0.3, 3, 0.0, backend.clone()),
            above_lung(0.3, 3, 10.0, backend),
        );
        for line in 0..441 {
            let [before, after] = [power(&here, line + 40, 100..240), power(&there, line, 100..240)];
            assert!(
                (before - after).abs() < 1e-3 * (before + 1.0),
                "{name}, line {line}: {before}, then {after}"
            );
        }
    }
}

/// A mirror image lies where a flat mirror shows it: at the reflection of what it is of in the plane of the surface.
#[test]
fn a_ball_above_gas_is_mirrored_in_its_surface() {
    const BALL: [f64; 2] = [4.0, 22.0];
    for angle_deg in [0.0, 10.0, 20.0] {
        let slope = f64::to_radians(angle_deg).tan();
        let gas = Acoustics {
            occlusion_per_mm: 1.0,
            impedance_mrayl: 0.0004,
            ..PLAIN
        };
        let frame = Frame::around([0.0, 30.0, 0.0], [500, 700, 3], 0.1);
        let anatomy = anatomy::anatomy_from(frame, &[SILENT, SILENT, PLAIN, gas], |p| {
            if p[1] > 30.0 + slope * p[0] {
                return 3;
            }
            1 + u8::from((p[0] - BALL[0]).hypot(p[1] - BALL[1]) < 2.0)
        });
        // The normal of the surface, and the ball beyond it.
        let normal = [-slope, 1.0].map(|x| x / slope.hypot(1.0));
        let away = -normal[0] * BALL[0] + normal[1] * (30.0 - BALL[1]);
        let expected = [BALL[0] + 2.0 * away * normal[0], BALL[1] + 2.0 * away * normal[1]];
        for (shape, spread) in [
            (ProbeShape::Linear(Linear { width_mm: 40.0 }), 0.0),
            (
                ProbeShape::Curvilinear(Curvilinear {
                    radius_mm: 40.0,
                    angle_deg: 50.0,
                }),
                40.0,
            ),
        ] {
            let mut settings = scene::settings(scene::probe(shape, DEPTH_MM, 161, 1200), scene::bare());
            settings.effects.shadow = Some(Shadow {
                beam_mm: Some(0.0),
                f_number: Some(0.0),
                reverberation: 0.0,
                ..Shadow::default()
            });
            for (name, backend) in precisions() {
                let beam = beam_after(&anatomy, &settings, backend, "shadow_mirror", &scene::straight());
                let (mut sum, mut middle, mut loudest) = (0.0, [0.0; 2], 0.0f64);
                for (index, amplitude) in beam.amplitude.iter().enumerate() {
                    let [line, sample] = [index / 1200, index % 1200].map(|n| n as f64);
                    let depth = (sample + 0.5) * 0.05;
                    let centre = if spread > 0.0 {
                        let angle = (line - 80.0) / 160.0 * 50f64.to_radians();
                        [(spread + depth) * angle.sin(), (spread + depth) * angle.cos() - spread]
                    } else {
                        [(line - 80.0) * 0.25, depth]
                    };
                    // Beyond the surface, past what gas itself returns; areas of samples grow with the distance from
                    // the apex.
                    if centre[1] < 30.0 + slope * centre[0] + 4.0 {
                        continue;
                    }
                    let weight = amplitude * (spread + depth).max(f64::from(u8::from(spread == 0.0)));
                    sum += weight;
                    (0..2).for_each(|axis| middle[axis] += weight * centre[axis]);
                    loudest = loudest.max(*amplitude);
                }
                for axis in 0..2 {
                    let centroid = middle[axis] / sum;
                    assert!(
                        (centroid - expected[axis]).abs() < 0.4,
                        "{name}, {shape:?}, {angle_deg} degrees: axis {axis} at {centroid}, not {expected:?}"
                    );
                }
                assert!((loudest - 0.5).abs() < 0.01, "{name}, {angle_deg} degrees: {loudest}");
            }
        }
    }
}

/// A plate from y = 10 to 12 mm on the side x > 0, before tissue, on a fine linear array.
fn half_plane(plate: Acoustics, [beam_mm, f_number]: [f64; 2], backend: Backend) -> Beam {
    let frame = Frame::around([0.0, 20.0, 0.0], [160, 160, 3], 0.25);
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, PLAIN, plate], |p| {
        1 + u8::from(p[0] > 0.0 && (10.0..12.0).contains(&p[1]))
    });
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 29.75 }), 30.0, 120, 120);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.shadow = Some(Shadow {
        beam_mm: Some(beam_mm),
        f_number: Some(f_number),
        ..Shadow::default()
    });
    beam_after(&anatomy, &settings, backend, "shadow", &scene::straight())
}

/// Shadows of a cylinder of 8 mm across the plane by geometry: the share of the transmitting aperture (focus 22 mm,
/// f/2.5; of the curved array 75 mm, f/3) times that of the receiving one (Hann weights, f/1.5; f/1.75) that sees a
/// point, summed over 401 straight rays each. Depth, distances from the axis at which the amplitude has risen by 10, 50
/// and 90 % of what the shadow takes from it on the axis, and the distance between the first and the last of them
/// behind a cylinder that absorbs 2.5 dB/cm/MHz more than its surroundings, mm.
const BEHIND_LINEAR: [[f64; 5]; 6] = [
    [18.0, 3.57, 4.53, 5.36, 2.27],
    [22.0, 3.33, 4.78, 5.92, 3.139],
    [26.0, 3.13, 5.00, 6.39, 3.84],
    [30.0, 2.97, 5.19, 6.95, 4.40],
    [34.0, 2.82, 5.36, 7.60, 4.97],
    [38.0, 2.68, 5.50, 8.25, 5.67],
];
const BEHIND_CURVED: [[f64; 5]; 7] = [
    [45.0, 3.70, 5.43, 7.10, 4.26],
    [60.0, 3.49, 7.66, 11.12, 7.60],
    [75.0, 5.20, 10.71, 15.26, 9.60],
    [90.0, 7.51, 14.23, 20.31, 11.91],
    [105.0, 9.76, 17.80, 27.07, 16.34],
    [120.0, 11.87, 21.23, 34.98, 21.89],
    [135.0, 14.01, 24.30, 44.02, 28.11],
];

/// Distances from the axis at which the amplitude behind a cylinder has risen by 10, 50 and 90 %, mm.
fn edge(beam: &Beam, sample: usize, line_mm: f64) -> [f64; 3] {
    let middle = beam.lines / 2;
    let at = |line: usize| beam.amplitude[line * beam.samples + sample];
    // Both sides, relative to the outermost scanlines, where all rays pass the cylinder.
    let side: Vec<f64> = (0..=middle)
        .map(|away| (at(middle + away) + at(middle - away)) / (2.0 * at(0)))
        .collect();
    [0.1, 0.5, 0.9].map(|share| {
        let level = side[0] + share * (1.0 - side[0]);
        let beyond = side
            .iter()
            .position(|level_at| *level_at >= level)
            .expect("the edge of a shadow");
        (beyond as f64 - (side[beyond] - level) / (side[beyond] - side[beyond - 1])) * line_mm
    })
}

#[test]
fn the_edge_of_a_shadow_opens_with_depth_as_the_aperture_does() {
    let bone = Acoustics {
        occlusion_per_mm: 1.0,
        ..attenuating(0.5)
    };
    let linear = ProbeShape::Linear(Linear { width_mm: 38.4 });
    let curved = ProbeShape::Curvilinear(Curvilinear {
        radius_mm: 49.57,
        angle_deg: 74.6,
    });
    for (shape, depth_mm, mhz, axis_mm, voxels, expected) in [
        (linear, 45.0, 7.6, 12.0, ([400, 480], 0.1), &BEHIND_LINEAR[..]),
        (curved, 145.0, 3.57, 35.0, ([1000, 800], 0.25), &BEHIND_CURVED),
    ] {
        let (across, size) = voxels;
        let mut probe = scene::probe(shape, depth_mm, 257, 290);
        probe.frequency_mhz = mhz;
        probe.aperture.transmit_focus_mm = Some(if mhz > 5.0 { 22.0 } else { 75.0 });
        let mut settings = scene::settings(probe, scene::bare());
        settings.effects.shadow = Some(Shadow::default());
        for (occluder, is_opaque) in [(bone, true), (attenuating(3.0), false)] {
            let frame = Frame::around([0.0, 0.35 * depth_mm, 0.0], [across[0], across[1], 3], size);
            let anatomy = anatomy::anatomy_from(frame, &[SILENT, attenuating(0.5), occluder], |p| {
                1 + u8::from(p[0].hypot(p[1] - axis_mm) < 4.0)
            });
            for (name, backend) in precisions() {
                let beam = beam_after(&anatomy, &settings, backend, "shadow", &scene::straight());
                for &[depth, x10, x50, x90, absorbed] in expected {
                    let sample = (depth / depth_mm * 290.0) as usize;
                    let line_mm = match shape {
                        ProbeShape::Linear(_) => 38.4 / 256.0,
                        _ => (49.57 + depth) * 74.6f64.to_radians() / 256.0,
                    };
                    let [start, middle, end] = edge(&beam, sample, line_mm);
                    let penumbra = end - start;
                    let expected = if is_opaque { x90 - x10 } else { absorbed };
                    println!(
                        "{name}, {mhz} MHz, {depth} mm: {:.3} of {expected} mm, edge {middle:.2}",
                        penumbra / expected
                    );
                    assert!(
                        (penumbra / expected - 1.0).abs() < 0.2,
                        "{name}, {mhz} MHz, {depth} mm: a penumbra of {penumbra} mm, not {expected}"
                    );
                    assert!(
                        !is_opaque || (middle / x50 - 1.0).abs() < 0.1,
                        "{name}, {mhz} MHz, {depth} mm: edge at {middle} mm, not {x50}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_edge_of_a_shadow_is_as_soft_as_the_beam() {
    let bone = Acoustics {
        occlusion_per_mm: 1.0,
        ..PLAIN
    };
    for beam_mm in [1.0, 3.0, 6.0] {
        for (name, backend) in precisions() {
            let beam = half_plane(bone, [beam_mm, 0.0], backend);
            let sigma = beam_mm / 2.354_820_045;
            for line in 0..beam.lines {
                // Scanlines every 0.25 mm from -14.875 mm; those at 0.125 mm and beyond meet the plate.
                let x = -14.875 + 0.25 * line as f64;
                // What passes the edge, there and back; sampled weights miss a smooth profile by less than 1 %, and
                // their cut at three deviations by 0.3 %.
                let open = 0.5 * (1.0 - erf(x / sigma / 2f64.sqrt()));
                let amplitude = beam.amplitude[line * beam.samples + 100];
                let edge = 14.9 - x.abs() < 3.0 * sigma;
                assert!(
                    edge || (amplitude.sqrt() - open).abs() < 0.012,
                    "{name}: {amplitude} is left at {x} mm of a beam of {beam_mm} mm, not {}",
                    open * open
                );
            }
        }
    }
}

#[test]
fn a_shadow_without_a_beam_is_one_scanline_sharp_and_bone_never_glows() {
    let bone = Acoustics {
        occlusion_per_mm: 0.9,
        echo_db: 20.0,
        ..PLAIN
    };
    let sharp = half_plane(bone, [0.0, 0.0], Backend::CpuF64);
    let soft = half_plane(bone, [3.0, 0.0], Backend::CpuF64);
    for line in 0..sharp.lines {
        let amplitude = |beam: &Beam, sample: usize| beam.amplitude[line * beam.samples + sample];
        // Two millimetres at 0.9 a millimetre leave a hundredth.
        let left = if line < 60 { 1.0 } else { 0.01 };
        assert!((amplitude(&sharp, 100) / left - 1.0).abs() < 1e-4, "line {line}");
        // From 11 mm on, within the plate, 20 dB and more are lost: however wide the beam, the plate is no brighter.
        for sample in 40..48 {
            assert!(
                amplitude(&soft, sample) <= amplitude(&sharp, sample) * (1.0 + 1e-12),
                "line {line}"
            );
        }
    }
}

/// The error function, by its series below 3 and as 1 above (off by 2e-5 there).
fn erf(x: f64) -> f64 {
    if x.abs() > 3.0 {
        return x.signum();
    }
    let mut term = x;
    let mut sum = x;
    for n in 1..60 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * std::f64::consts::FRAC_2_SQRT_PI
}
