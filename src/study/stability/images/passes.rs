//! Cases of single passes: tone, attenuation and blur.

use crate::stability::fixtures::{everywhere, gpus, name, settings, straight};
use crate::stability::record::{Record, Unexpected, largest};
use insonify_gpu::Gpu;
use insonify_imaging::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::blur::Blur;
use insonify_imaging::effects::compound::Compound;
use insonify_imaging::effects::lateral::{FWHM_PER_SIGMA, MAX_REACH};
use insonify_imaging::effects::shadow::downshift::Downshift;
use insonify_imaging::effects::shadow::{MAX_PER_SAMPLE_DB, Shadow, UNITS_PER_DB};
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::thickness::Thickness;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::parity::{Case, check};
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::Anatomy;
use insonify_imaging::synth::{SynthError, Synthesizer};
use insonify_tracking::probe::{Aperture, Curvilinear, Linear, Phased, ProbeShape, TrusTransverse};

const LONG_SAMPLES: u32 = 8192;
const DEPTH_MM: f64 = 160.0;
/// Centre frequency of the scenes, MHz.
const MHZ: f64 = 5.0;

/// Tests a uniform tissue with attenuations from zero to unphysically large.
pub(crate) fn any_attenuation(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let losses_db_cm = [0.0, 1e-6, 1e-3, 0.1, 1.0, 10.0, 1e3, 1e6];
    for (index, db_cm) in losses_db_cm.into_iter().enumerate() {
        let tissue = Acoustics {
            // One-way attenuation; the frame multiplies by the frequency.
            attenuation_db_cm_mhz: db_cm / MHZ,
            ..PLAIN
        };
        let effects = Effects {
            shadow: Some(Shadow {
                beam_mm: Some(0.0),
                ..Shadow::default()
            }),
            ..Effects::default()
        };
        let settings = settings(
            ProbeShape::Linear(Linear { width_mm: 20.0 }),
            DEPTH_MM,
            [2, LONG_SAMPLES],
            effects,
        );
        let anatomy = anatomies::uniform(tissue);
        for mut synth in everywhere(&anatomy, &settings, &gpus)? {
            attenuated(record, &mut synth, db_cm)?;
        }
        record.done((index + 1) as f64 / losses_db_cm.len() as f64);
    }
    Ok(())
}

/// Checks the echoes of a uniform tissue against Beer and Lambert.
fn attenuated(record: &mut Record<'_>, synth: &mut Synthesizer, db_cm: f64) -> Result<(), Unexpected> {
    let backend = name(synth);
    // Lossless tissue casts no shadow: the plan omits the pass.
    let last_pass = if synth.plan().has("shadow") { "shadow" } else { "slice" };
    let beam = synth.render_until(last_pass, &straight())?;
    let lines = || beam.amplitude.chunks(LONG_SAMPLES as usize);
    let rises = lines()
        .flat_map(|line| line.windows(2))
        .filter(|pair| pair[1] > pair[0])
        .count();
    let negative = beam
        .amplitude
        .iter()
        .filter(|echo| !(0.0..=1.0).contains(*echo))
        .count();
    record.zero(
        format!("{db_cm} dB/cm, {backend}: echoes that rise with depth"),
        rises as f64,
    );
    record.zero(
        format!("{db_cm} dB/cm, {backend}: echoes below 0 or above 1"),
        negative as f64,
    );
    // The loss of each sample is rounded to half a unit, half of its own loss to another; what is not felt of it to a
    // unit and in single precision; then the capped sum and the rounding of single precision: units stored and
    // multiplied, the exponential at up to 3 + 2 |x| ULP, and its square.
    let sample_cm = DEPTH_MM / f64::from(LONG_SAMPLES) / 10.0;
    let downshift = Downshift::new(synth.settings().probe.transducer().bandwidth);
    let two_way = |sample: usize| downshift.felt_db((2.0 * db_cm * (sample as f64 + 0.5) * sample_cm).min(2047.0));
    let error = lines().flat_map(|line| line.iter().enumerate()).map(|(sample, echo)| {
        let exact_db = two_way(sample);
        let exact = 10f64.powf(-exact_db / 20.0);
        let units = (0.5 * (sample as f64 + 4.0) / UNITS_PER_DB + 1e-6 * exact_db) / 20.0 * std::f64::consts::LN_10;
        let octaves = exact_db / 20.0 * std::f64::consts::LOG2_10;
        let rounding = 2.0 * (6.0 + 6.0 * octaves) / 8_388_608.0;
        // Values below the range of single precision may be zero.
        (echo - exact).abs() / (exact * (units + rounding) + 1e-37)
    });
    if 2.0 * db_cm * sample_cm > MAX_PER_SAMPLE_DB {
        // The loss per sample is capped; half of it applies to the sample itself.
        record.under(
            format!("{db_cm} dB/cm, {backend}: loudest echo"),
            largest(beam.amplitude.iter().copied()),
            1.001 * 10f64.powf(-downshift.felt_db(0.5 * MAX_PER_SAMPLE_DB) / 20.0),
        );
    } else {
        record.under(
            format!("{db_cm} dB/cm, {backend}: departure from Beer and Lambert over rounding"),
            largest(error),
            1.0,
        );
    }
    if two_way(LONG_SAMPLES as usize - 1) > 800.0 {
        let last_echoes = lines().map(|line| line[LONG_SAMPLES as usize - 1]);
        record.zero(
            format!("{db_cm} dB/cm, {backend}: deepest echo, single precision"),
            match synth.backend() {
                // Double precision represents values that single cannot.
                "cpu-f64" => largest(last_echoes.filter(|echo| *echo > 1e-37)),
                _ => largest(last_echoes),
            },
        );
    }
    Ok(())
}

/// Renders uniform tissue, with a ball that loses more, under apertures at the ends of what a probe may state.
pub(crate) fn any_aperture(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let ends: [(&str, Aperture); 8] = [
        (
            "one element",
            Aperture {
                aperture_mm: Some(0.01),
                ..Aperture::default()
            },
        ),
        (
            "receive f-number 0.5",
            Aperture {
                receive_f_number: Some(0.5),
                ..Aperture::default()
            },
        ),
        (
            "receive f-number 20",
            Aperture {
                receive_f_number: Some(20.0),
                ..Aperture::default()
            },
        ),
        (
            "transmit f-number 0.5",
            Aperture {
                transmit_f_number: Some(0.5),
                ..Aperture::default()
            },
        ),
        (
            "bandwidth 5 %",
            Aperture {
                bandwidth: Some(0.05),
                ..Aperture::default()
            },
        ),
        (
            "bandwidth 150 %",
            Aperture {
                bandwidth: Some(1.5),
                ..Aperture::default()
            },
        ),
        (
            "transmit focus at the array",
            Aperture {
                transmit_focus_mm: Some(0.0),
                ..Aperture::default()
            },
        ),
        (
            "lens focus at the array",
            Aperture {
                lens_focus_mm: Some(1.0),
                height_mm: Some(50.0),
                ..Aperture::default()
            },
        ),
    ];
    let lossy = |db_cm_mhz: f64| Acoustics {
        attenuation_db_cm_mhz: db_cm_mhz,
        ..PLAIN
    };
    let count = ends.len() as f64;
    for (index, (what, aperture)) in ends.into_iter().enumerate() {
        let effects = Effects {
            shadow: Some(Shadow::default()),
            speckle: Some(Speckle::default()),
            thickness: Some(Thickness::default()),
            ..Effects::default()
        };
        let shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
        let mut settings = settings(shape, 60.0, [64, 256], effects);
        settings.probe.aperture = aperture;
        for mut synth in everywhere(&anatomies::uniform(PLAIN), &settings, &gpus)? {
            let backend = name(&synth);
            let beam = synth.render_until("speckle_lateral", &straight())?;
            let power = beam.amplitude.iter().map(|echo| echo * echo).sum::<f64>() / beam.amplitude.len() as f64;
            record.under(
                format!("{what}, {backend}: power of speckle, dB from 1"),
                (10.0 * power.log10()).abs(),
                1.0,
            );
        }
        let frame = Frame::around([0.0, 30.0, 0.0], [60; 3], 1.0);
        let anatomy = anatomies::ball(frame, [0.0, 20.0, 0.0], 6.0, &[SILENT, lossy(0.5), lossy(3.0)]);
        let case = Case::new(what, anatomy, settings, straight());
        for comparison in check(&case, &gpus)? {
            record.zero(
                format!("{what}, {}: deviations beyond rounding", comparison.backend),
                comparison.faults.len() as f64,
            );
        }
        record.done((index + 1) as f64 / count);
    }
    Ok(())
}

/// Averages looks at the ends of what a scene may state, and beyond what array and scanlines hold.
pub(crate) fn any_looks(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let linear = |width_mm: f64| ProbeShape::Linear(Linear { width_mm });
    let curved = ProbeShape::Curvilinear(Curvilinear {
        radius_mm: 10.0,
        angle_deg: 120.0,
    });
    let ends = [
        ("20 degrees beyond a narrow array", linear(10.0), [32, 256], 3, 20.0),
        ("9 looks within a degree", linear(WIDTH_MM), [64, 256], 9, 1.0),
        ("9 looks on scanlines far apart", linear(WIDTH_MM), [9, 64], 9, 20.0),
        ("an array curved sharply", curved, [64, 256], 5, 20.0),
    ];
    for (index, (what, shape, grid, looks, angle_deg)) in ends.into_iter().enumerate() {
        let effects = Effects {
            shadow: Some(Shadow::default()),
            speckle: Some(Speckle::default()),
            compound: Some(Compound { looks, angle_deg }),
            ..Effects::default()
        };
        let settings = settings(shape, 120.0, grid, effects);
        for mut synth in everywhere(&anatomies::uniform(PLAIN), &settings, &gpus)? {
            let backend = name(&synth);
            let mut mean = |pass| -> Result<f64, Unexpected> {
                let amplitudes = synth.render_until(pass, &straight())?.amplitude;
                Ok(amplitudes.iter().sum::<f64>() / amplitudes.len() as f64)
            };
            let change = mean("compound")? / mean("speckle_lateral")?;
            record.under(
                format!("{what}, {backend}: mean of the looks, dB from that of one"),
                (20.0 * change.log10()).abs(),
                0.5,
            );
        }
        let case = Case::new(what, anatomies::uniform(PLAIN), settings, straight());
        for comparison in check(&case, &gpus)? {
            record.zero(
                format!("{what}, {}: deviations beyond rounding", comparison.backend),
                comparison.faults.len() as f64,
            );
        }
        record.done((index + 1) as f64 / ends.len() as f64);
    }
    Ok(())
}

const LINES: u32 = 41;
const SAMPLES: u32 = 96;
const WIDTH_MM: f64 = 40.0;
/// Distance between scanlines, mm.
const LINE_MM: f64 = WIDTH_MM / (LINES as f64 - 1.0);
/// Relative rounding error of a sum of as many terms as the widest kernel, each weight stored and multiplied, and of a
/// division for truncated kernels.
const BLUR_ROUNDING: f64 = (1.5 + 2.0 * (2 * MAX_REACH + 1) as f64 + 2.5) / 8_388_608.0;

/// Creates a slab of tissue in silence that only the middle scanline meets.
fn impulse() -> insonify_imaging::synth::tables::Anatomy {
    anatomies::anatomy_from(
        Frame::around([0.0; 3], [81, 3, 3], 0.5).stretched([1.0, 400.0, 400.0]),
        &[SILENT, PLAIN],
        |p| u8::from(p[0].abs() < 0.25),
    )
}

fn effects(width_mm: f64) -> Effects {
    Effects {
        blur: Some(Blur {
            width_mm: Some(width_mm),
            growth_mm_cm: Some(0.0),
        }),
        ..Effects::default()
    }
}

/// Returns the echoes across the scanlines at the middle depth.
fn across(beam: &Beam) -> Vec<f64> {
    let middle = beam.samples / 2;
    (0..beam.lines)
        .map(|line| beam.amplitude[line * beam.samples + middle])
        .collect()
}

/// Tests kernel and energy at a width of one scanline.
fn one_scanline(record: &mut Record<'_>, shape: ProbeShape, gpus: &[Gpu]) -> Result<(), Unexpected> {
    // Full width at half maximum of one scanline: the kernel is a Gaussian of that width at whole scanlines, truncated
    // at three standard deviations rounded up to whole scanlines, with sum 1.
    let sigma = 1.0 / FWHM_PER_SIGMA;
    let reach = (3.0 * sigma).ceil() as i32;
    let weight = |distance: i32| {
        if distance.abs() > reach {
            0.0
        } else {
            (-0.5 * (f64::from(distance) / sigma).powi(2)).exp()
        }
    };
    let sum: f64 = (-reach..=reach).map(weight).sum();
    for mut synth in everywhere(
        &impulse(),
        &settings(shape, 40.0, [LINES, SAMPLES], effects(LINE_MM)),
        gpus,
    )? {
        let backend = name(&synth);
        let before = across(&synth.render_until("slice", &straight())?);
        let after = across(&synth.render_until("blur", &straight())?);
        let middle = LINES as i32 / 2;
        // Silence is -200 dB, not zero.
        let background = 1e-10;
        record.under(
            format!("{backend}: scanlines that the impulse lights, less one"),
            before.iter().filter(|echo| **echo > 0.5).count() as f64 - 1.0,
            0.0,
        );
        let errors = after
            .iter()
            .enumerate()
            .map(|(line, echo)| echo - weight(line as i32 - middle) / sum);
        record.under(
            format!("{backend}: departure from the kernel"),
            largest(errors),
            BLUR_ROUNDING + 2.0 * background,
        );
        record.under(
            format!("{backend}: energy of the impulse lost"),
            (after.iter().sum::<f64>() - before.iter().sum::<f64>()).abs(),
            BLUR_ROUNDING + 2.0 * background,
        );
    }
    Ok(())
}

/// Tests identity, kernel and energy.
pub(crate) fn any_blur(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
    let flat = anatomies::uniform(Acoustics { echo_db: 3.0, ..PLAIN });
    let scattered = anatomies::random(
        Frame::around([0.0, 20.0, 0.0], [48; 3], 1.0),
        &[SILENT, PLAIN, Acoustics { echo_db: 6.0, ..PLAIN }],
        record.seed() as u32,
    );
    for mut synth in everywhere(
        &scattered,
        &settings(shape, 40.0, [LINES, SAMPLES], effects(0.0)),
        &gpus,
    )? {
        let backend = name(&synth);
        let before = synth.render_until("slice", &straight())?.amplitude;
        let after = synth.render_until("blur", &straight())?.amplitude;
        let changed_echoes = before.iter().zip(&after).filter(|(a, b)| a != b).count();
        record.zero(format!("{backend}: echoes that width 0 changes"), changed_echoes as f64);
    }
    record.done(0.25);
    one_scanline(record, shape, &gpus)?;
    record.done(0.5);
    // Wider than the sector: 20 mm across 5 mm, in a linear probe and in a narrow fan. A constant stays constant at the
    // edges.
    let narrow = [
        ProbeShape::Linear(Linear { width_mm: 5.0 }),
        ProbeShape::Phased(Phased { angle_deg: 10.0 }),
        ProbeShape::TrusTransverse(TrusTransverse {
            radius_mm: 5.0,
            angle_deg: 20.0,
        }),
    ];
    for (index, shape) in narrow.into_iter().enumerate() {
        for mut synth in everywhere(&flat, &settings(shape, 20.0, [11, SAMPLES], effects(20.0)), &gpus)? {
            let backend = name(&synth);
            let before = synth.render_until("slice", &straight())?.amplitude;
            let after = synth.render_until("blur", &straight())?.amplitude;
            let changes = before.iter().zip(&after).map(|(a, b)| b / a - 1.0);
            record.under(
                format!(
                    "{backend}: change of a constant under {}",
                    ["a linear probe", "a fan", "an end ring"][index]
                ),
                largest(changes),
                BLUR_ROUNDING,
            );
        }
        record.done(0.5 + 0.5 * (index + 1) as f64 / narrow.len() as f64);
    }
    Ok(())
}

/// Number of labels besides the background.
const STEPS: usize = 250;

/// Creates slabs of 0.1 mm across the beam, each louder than the one before, from `low` to `high` dB.
fn ladder(low: f64, high: f64) -> Anatomy {
    let tissue = |step: usize| Acoustics {
        echo_db: low + (high - low) * step as f64 / (STEPS - 1) as f64,
        ..PLAIN
    };
    let tissues: Vec<Acoustics> = std::iter::once(SILENT).chain((0..STEPS).map(tissue)).collect();
    let depths: Vec<f64> = (0..STEPS).map(|step| 0.1 * step as f64).collect();
    anatomies::layers(
        Frame::around([0.0, 12.5, 0.0], [3, 252, 3], 0.1).stretched([100.0, 1.0, 100.0]),
        &depths,
        &tissues,
    )
}

/// Rounding allowance for a decrease in grey level, of 255: two logarithms (2^-21 each in WGSL), constants and sum;
/// with the narrowest range, 10 dB, an octave is 0.6 of the scale.
const ROUNDING: f64 = 255.0 * 2.0 * (0.7 / 2_097_152.0 + 8.0 / 8_388_608.0);

/// Tests that tones out of range are refused.
fn refused_tones(record: &mut Record<'_>, anatomy: &Anatomy) {
    for (curve, tone) in [
        (
            "dynamic range 1 dB",
            Tone {
                dynamic_range_db: 1.0,
                ..Tone::default()
            },
        ),
        (
            "dynamic range 200 dB",
            Tone {
                dynamic_range_db: 200.0,
                ..Tone::default()
            },
        ),
        (
            "gain 200 dB",
            Tone {
                gain_db: 200.0,
                ..Tone::default()
            },
        ),
        (
            "gain that is no number",
            Tone {
                gain_db: f64::NAN,
                ..Tone::default()
            },
        ),
    ] {
        let effects = Effects {
            tone: Some(tone),
            ..Effects::default()
        };
        let settings = settings(ProbeShape::Linear(Linear { width_mm: 10.0 }), 25.0, [2, 64], effects);
        // Tables check settings before any backend sees them, so that nothing has to be rendered.
        let answer = insonify_imaging::synth::tables::Tables::new(anatomy.clone(), settings);
        record.refused(
            curve,
            answer,
            |error| matches!(error, SynthError::Effect(fault) if fault.key.starts_with("tone.")),
        );
    }
}

/// Tests ladders from silence past denormal numbers to far above white, and in steps of a few roundings around 0 dB.
pub(super) fn ends(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    // Amplitudes from 1e-50 (zero in single precision) past 1e-45 (its smallest denormal) to 1e10, from 1 to 1.03, and
    // from 1 to 1 + 1e-5.
    let ladders = [ladder(-1000.0, 200.0), ladder(0.0, 0.25), ladder(0.0, 8.7e-5)];
    let flat = |db: f64| vec![[0.0, db], [1000.0, db]];
    let tones = [
        (10.0, 0.0, Vec::new()),
        (10.0, 60.0, flat(100.0)),
        (120.0, -60.0, flat(-100.0)),
        (120.0, 60.0, vec![[0.0, -100.0], [12.0, 100.0], [24.0, 100.0]]),
        (60.0, 0.0, Vec::new()),
    ];
    let mut names = Vec::new();
    let (mut fall, mut undefined) = (Vec::new(), Vec::new());
    for (index, anatomy) in ladders.iter().enumerate() {
        for (dynamic_range_db, gain_db, tgc_points) in tones.clone() {
            // Includes a linear display without tone curve.
            for tone in [None, Some(())] {
                let effects = Effects {
                    tone: tone.map(|()| Tone {
                        dynamic_range_db,
                        gain_db,
                        tgc_db_cm: Some(if gain_db > 0.0 { 20.0 } else { 0.0 }),
                        tgc_points: tgc_points.clone(),
                        ..Tone::linear()
                    }),
                    ..Effects::default()
                };
                let shape = ProbeShape::Linear(Linear { width_mm: 10.0 });
                let settings = settings(shape, 25.0, [2, STEPS as u32], effects);
                for (backend, mut synth) in everywhere(anatomy, &settings, &gpus)?.into_iter().enumerate() {
                    if names.len() <= backend {
                        names.push(name(&synth));
                        fall.push(0.0f64);
                        undefined.push(0usize);
                    }
                    let grey = synth.render_until("tone", &straight())?.amplitude;
                    undefined[backend] += grey.iter().filter(|g| !(0.0..=255.0).contains(*g)).count();
                    let falls = grey
                        .chunks(STEPS)
                        .flat_map(|line| line.windows(2))
                        .map(|pair| (pair[0] - pair[1]).max(0.0));
                    fall[backend] = largest(falls.chain([fall[backend]]));
                    let frame = synth.render(&straight())?;
                    // The fill outside the sector is grey 7; inside, loud echoes must yield white pixels.
                    undefined[backend] += usize::from(index == 0 && gain_db > 0.0 && !frame.pixels.contains(&255));
                }
            }
        }
        record.done((index + 1) as f64 / ladders.len() as f64);
    }
    for (index, backend) in names.iter().enumerate() {
        record.zero(
            format!("{backend}: grey levels outside 0 to 255"),
            undefined[index] as f64,
        );
        record.under(
            format!("{backend}: largest fall of a rising ladder, grey levels"),
            fall[index],
            ROUNDING,
        );
    }
    refused_tones(record, &ladders[0]);
    Ok(())
}
