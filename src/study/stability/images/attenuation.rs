//! Cases of attenuation along long scanlines.

use super::super::record::{Record, Unexpected, largest};
use super::setup::{everywhere, gpus, name, settings, straight};
use crate::imaging::effects::Effects;
use crate::imaging::effects::shadow::{MOST_PER_SAMPLE_DB, Shadow, UNITS_PER_DB};
use crate::study::anatomies::{self, Acoustics, PLAIN};
use crate::tracking::probe::ProbeShape;

const SAMPLES: u32 = 8192;
const DEPTH_MM: f64 = 160.0;
/// Centre frequency of the scenes, MHz.
const MHZ: f64 = 5.0;

/// Tests a uniform tissue with attenuations from zero to unphysically large.
pub fn any(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let losses_db_cm = [0.0, 1e-6, 1e-3, 0.1, 1.0, 10.0, 1e3, 1e6];
    for (at, db_cm) in losses_db_cm.into_iter().enumerate() {
        let tissue = Acoustics {
            // One-way attenuation; the frame multiplies by the frequency.
            attenuation_db_cm_mhz: db_cm / MHZ,
            ..PLAIN
        };
        let effects = Effects {
            shadow: Some(Shadow {
                beam_mm: 0.0,
                ..Shadow::default()
            }),
            ..Effects::default()
        };
        let settings = settings(ProbeShape::Linear { width_mm: 20.0 }, DEPTH_MM, [2, SAMPLES], effects);
        let anatomy = anatomies::uniform(tissue);
        for mut synth in everywhere(&anatomy, &settings, &gpus)? {
            let backend = name(&synth);
            // Lossless tissue casts no shadow: the plan omits the pass.
            let last = if synth.plan().has("shadow") { "shadow" } else { "slice" };
            let beam = synth.render_until(last, &straight())?;
            let lines = || beam.amplitude.chunks(SAMPLES as usize);
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
            // The loss of each sample is rounded to half a unit, half of its own loss to another; then the capped sum and the rounding of
            // single precision: units stored and multiplied, the exponential at up to 3 + 2 |x| ULP, and its square.
            let sample_cm = DEPTH_MM / f64::from(SAMPLES) / 10.0;
            let two_way = |sample: usize| (2.0 * db_cm * (sample as f64 + 0.5) * sample_cm).min(2047.0);
            let off = lines().flat_map(|line| line.iter().enumerate()).map(|(sample, echo)| {
                let exact_db = two_way(sample);
                let exact = 10f64.powf(-exact_db / 20.0);
                let units = (0.5 * (sample as f64 + 2.0)) / UNITS_PER_DB / 20.0 * std::f64::consts::LN_10;
                let octaves = exact_db / 20.0 * std::f64::consts::LOG2_10;
                let rounding = 2.0 * (6.0 + 6.0 * octaves) / 8_388_608.0;
                // Values below the range of single precision may be zero.
                (echo - exact).abs() / (exact * (units + rounding) + 1e-37)
            });
            if 2.0 * db_cm * sample_cm > MOST_PER_SAMPLE_DB {
                // The loss per sample is capped; half of it applies to the sample itself.
                record.under(
                    format!("{db_cm} dB/cm, {backend}: loudest echo"),
                    largest(beam.amplitude.iter().copied()),
                    1.001 * 10f64.powf(-0.5 * MOST_PER_SAMPLE_DB / 20.0),
                );
            } else {
                record.under(
                    format!("{db_cm} dB/cm, {backend}: departure from Beer and Lambert over rounding"),
                    largest(off),
                    1.0,
                );
            }
            if two_way(SAMPLES as usize - 1) > 800.0 {
                let last = lines().map(|line| line[SAMPLES as usize - 1]);
                record.zero(
                    format!("{db_cm} dB/cm, {backend}: deepest echo, single precision"),
                    match synth.backend() {
                        // Double precision represents values that single cannot.
                        "cpu-f64" => largest(last.filter(|echo| *echo > 1e-37)),
                        _ => largest(last),
                    },
                );
            }
        }
        record.done((at + 1) as f64 / losses_db_cm.len() as f64);
    }
    Ok(())
}
