//! Cases of echoes and gains at the ends of the floating-point range.

use super::super::record::{Record, Unexpected, largest};
use super::setup::{everywhere, gpus, name, settings, straight};
use crate::imaging::effects::Effects;
use crate::imaging::effects::tone::Tone;
use crate::imaging::synth::SynthError;
use crate::imaging::synth::tables::Anatomy;
use crate::study::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::tracking::probe::ProbeShape;

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

/// Rounding allowance for a decrease in grey level, of 255: two logarithms (2^-21 each in WGSL), constants and sum; with the narrowest
/// range, 10 dB, an octave is 0.6 of the scale.
const ROUNDING: f64 = 255.0 * 2.0 * (0.7 / 2_097_152.0 + 8.0 / 8_388_608.0);

/// Tests ladders from silence past denormal numbers to far above white, and in steps of a few roundings around 0 dB.
pub fn ends(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    // Amplitudes from 1e-50 (zero in single precision) past 1e-45 (its smallest denormal) to 1e10, from 1 to 1.03, and from 1 to 1 + 1e-5.
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
    for (at, anatomy) in ladders.iter().enumerate() {
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
                let shape = ProbeShape::Linear { width_mm: 10.0 };
                let settings = settings(shape, 25.0, [2, STEPS as u32], effects);
                for (place, mut synth) in everywhere(anatomy, &settings, &gpus)?.into_iter().enumerate() {
                    if names.len() <= place {
                        names.push(name(&synth));
                        fall.push(0.0f64);
                        undefined.push(0usize);
                    }
                    let grey = synth.render_until("tone", &straight())?.amplitude;
                    undefined[place] += grey.iter().filter(|g| !(0.0..=255.0).contains(*g)).count();
                    let falls = grey
                        .chunks(STEPS)
                        .flat_map(|line| line.windows(2))
                        .map(|pair| (pair[0] - pair[1]).max(0.0));
                    fall[place] = largest(falls.chain([fall[place]]));
                    let frame = synth.render(&straight())?;
                    // The fill outside the sector is grey 7; inside, loud echoes must yield white pixels.
                    undefined[place] += usize::from(at == 0 && gain_db > 0.0 && !frame.pixels.contains(&255));
                }
            }
        }
        record.done((at + 1) as f64 / ladders.len() as f64);
    }
    for (place, backend) in names.iter().enumerate() {
        record.zero(
            format!("{backend}: grey levels outside 0 to 255"),
            undefined[place] as f64,
        );
        record.under(
            format!("{backend}: largest fall of a rising ladder, grey levels"),
            fall[place],
            ROUNDING,
        );
    }
    let anatomy = &ladders[0];
    for (what, tone) in [
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
        let settings = settings(ProbeShape::Linear { width_mm: 10.0 }, 25.0, [2, 64], effects);
        let answer = crate::imaging::synth::tables::Tables::new(anatomy.clone(), settings);
        record.refused(
            what,
            answer,
            |error| matches!(error, SynthError::Effect(own) if own.key.starts_with("tone.")),
        );
    }
    Ok(())
}
