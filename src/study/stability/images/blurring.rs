//! Cases of blur kernels of zero width, of one scanline, and wider than the sector.

use super::super::record::{Record, Unexpected, largest};
use super::setup::{everywhere, gpus, name, settings, straight};
use crate::imaging::effects::Effects;
use crate::imaging::effects::blur::Blur;
use crate::imaging::effects::lateral::{FWHM_PER_SIGMA, MAX_REACH};
use crate::imaging::synth::layers::Beam;
use crate::study::anatomies::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::tracking::probe::ProbeShape;

const LINES: u32 = 41;
const SAMPLES: u32 = 96;
const WIDTH_MM: f64 = 40.0;
/// Distance between scanlines, mm.
const LINE_MM: f64 = WIDTH_MM / (LINES as f64 - 1.0);
/// Relative rounding error of a sum of as many terms as the widest kernel, each weight stored and multiplied, and of a division for
/// truncated kernels.
const ROUNDING: f64 = (1.5 + 2.0 * (2 * MAX_REACH + 1) as f64 + 2.5) / 8_388_608.0;

/// Creates a slab of tissue in silence that only the middle scanline meets.
fn impulse() -> crate::imaging::synth::tables::Anatomy {
    anatomies::of(
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

/// Tests identity, kernel and energy.
pub fn any(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let gpus = gpus(record);
    let shape = ProbeShape::Linear { width_mm: WIDTH_MM };
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
        let apart = before.iter().zip(&after).filter(|(a, b)| a != b).count();
        record.zero(format!("{backend}: echoes that width 0 changes"), apart as f64);
    }
    record.done(0.25);
    // Full width at half maximum of one scanline: the kernel is a Gaussian of that width at whole scanlines, truncated at three standard
    // deviations rounded up to whole scanlines, with sum 1.
    let sigma = 1.0 / FWHM_PER_SIGMA;
    let reach = (3.0 * sigma).ceil() as i32;
    let weight = |away: i32| match away.abs() > reach {
        true => 0.0,
        false => (-0.5 * (f64::from(away) / sigma).powi(2)).exp(),
    };
    let sum: f64 = (-reach..=reach).map(weight).sum();
    for mut synth in everywhere(
        &impulse(),
        &settings(shape, 40.0, [LINES, SAMPLES], effects(LINE_MM)),
        &gpus,
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
        let off = after
            .iter()
            .enumerate()
            .map(|(line, echo)| echo - weight(line as i32 - middle) / sum);
        record.under(
            format!("{backend}: departure from the kernel"),
            largest(off),
            ROUNDING + 2.0 * background,
        );
        record.under(
            format!("{backend}: energy of the impulse lost"),
            (after.iter().sum::<f64>() - before.iter().sum::<f64>()).abs(),
            ROUNDING + 2.0 * background,
        );
    }
    record.done(0.5);
    // Wider than the sector: 20 mm across 5 mm, in a linear probe and in a narrow fan. A constant stays constant at the edges.
    let narrow = [
        ProbeShape::Linear { width_mm: 5.0 },
        ProbeShape::Phased { angle_deg: 10.0 },
        ProbeShape::TrusTransverse {
            radius_mm: 5.0,
            angle_deg: 20.0,
        },
    ];
    for (at, shape) in narrow.into_iter().enumerate() {
        for mut synth in everywhere(&flat, &settings(shape, 20.0, [11, SAMPLES], effects(20.0)), &gpus)? {
            let backend = name(&synth);
            let before = synth.render_until("slice", &straight())?.amplitude;
            let after = synth.render_until("blur", &straight())?.amplitude;
            let off = before.iter().zip(&after).map(|(a, b)| b / a - 1.0);
            record.under(
                format!(
                    "{backend}: change of a constant under {}",
                    ["a linear probe", "a fan", "an end ring"][at]
                ),
                largest(off),
                ROUNDING,
            );
        }
        record.done(0.5 + 0.5 * (at + 1) as f64 / narrow.len() as f64);
    }
    Ok(())
}
