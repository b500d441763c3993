//! Cases of radio-frequency echoes and of motion estimated from them.

use super::record::{Record, Unexpected, largest};
use super::{Group, HardCase};
use insonify_base::random::{hash3, seed_words, unit};
use insonify_imaging::rf::medium::{Medium, PITCH_MM};
use insonify_imaging::rf::motion::{Estimate, Options, Tracker};

/// Group of motion cases.
pub(crate) const GROUP: Group = Group {
    name: "Motion from echoes",
    cases: &[
        HardCase {
            name: "echoes without signal",
            criterion: "zeros, constants, noise alone: no window correlates, and references stay; tissue that jumps out of reach: at most a tenth \
                        correlate by chance; everything finite",
            covers: &["cpu f32"],
            seed: 121,
            run: none,
        },
        HardCase {
            name: "damaged echoes",
            criterion: "cut off at half of their RMS, every fifth line constant, some samples at the limit: what correlates errs by less than \
                        0.5 um in the mean and 1 um in standard deviation; constant lines do not correlate",
            covers: &["cpu f32"],
            seed: 122,
            run: damaged,
        },
    ],
};

const JUMP: &str = "tissue moved by 6 mm";
const LINES: usize = 40;
const SAMPLES: usize = 1000;

fn options() -> Options {
    Options {
        windows: 30,
        ..Options::new(40.0, PITCH_MM)
    }
}

/// Correlation from which a window counts.
const TRUSTED: f64 = 0.8;

fn share(estimates: &[Estimate]) -> f64 {
    let trusted = estimates.iter().filter(|estimate| estimate.is_trusted(TRUSTED)).count();
    trusted as f64 / estimates.len() as f64
}

fn magnitude(estimates: &[Estimate]) -> f64 {
    largest(
        estimates
            .iter()
            .flat_map(|estimate| [estimate.axial_um, estimate.lateral_um, estimate.correlation]),
    )
}

fn none(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let seed = seed_words(record.seed());
    let noise = |frame: i32| -> Vec<f32> {
        let value = |index: usize| unit(hash3([index as i32, frame, 0], seed)[0]) - 0.5;
        (0..LINES * SAMPLES).map(value).collect()
    };
    let medium = Medium::new(LINES, SAMPLES);
    let zeros = vec![0.0; LINES * SAMPLES];
    let constant = vec![1.0e4; LINES * SAMPLES];
    let at_rest = medium.frame(0, |_| [0.0; 2]);
    let moved_away = medium.frame(1, |_| [6.0, 0.0]);
    let cases = [
        ("zeros", zeros.clone(), zeros.clone()),
        ("constants", constant.clone(), constant),
        ("zeros after echoes", at_rest.clone(), zeros),
        ("noise", noise(0), noise(1)),
        (JUMP, at_rest, moved_away),
    ];
    for (name, frame, second) in cases {
        let mut tracker = Tracker::new(options(), LINES, &frame);
        let estimates = tracker.next(&second);
        let jumps = name == JUMP;
        let limit = if jumps { 0.1 } else { 0.0 };
        record.under(
            format!("{name}: share of windows that correlate"),
            share(&estimates),
            limit,
        );
        // The reach of the search, and of its refinement, is far below a metre.
        record.under(format!("{name}: largest number"), magnitude(&estimates), 1e6);
        if !jumps {
            record.zero(format!("{name}: changes of the reference"), tracker.references());
        }
    }
    Ok(())
}

fn damaged(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const MOVED_MM: f64 = 0.0777;
    let medium = Medium::new(LINES, SAMPLES);
    let seed = seed_words(record.seed());
    let frames = [medium.frame(0, |_| [0.0; 2]), medium.frame(1, |_| [MOVED_MM, 0.0])];
    let rms = (frames[0].iter().map(|value| value * value).sum::<f32>() / frames[0].len() as f32).sqrt();
    let cut = |_: usize, value: f32| value.clamp(-0.5 * rms, 0.5 * rms);
    let lines = |index: usize, value: f32| {
        if (index / SAMPLES).is_multiple_of(5) {
            rms
        } else {
            value
        }
    };
    let spikes = |index: usize, value: f32| match hash3([index as i32, 0, 0], seed)[0] % 2000 {
        0 => 20.0 * rms,
        _ => value,
    };
    let cases: [(&str, &dyn Fn(usize, f32) -> f32); 3] =
        [("cut off", &cut), ("constant lines", &lines), ("spikes", &spikes)];
    for (name, damage) in cases {
        let [before, after] = frames.each_ref().map(|frame| -> Vec<f32> {
            frame
                .iter()
                .enumerate()
                .map(|(index, value)| damage(index, *value))
                .collect()
        });
        let mut tracker = Tracker::new(options(), LINES, &before);
        let estimates = tracker.next(&after);
        let count = options().windows;
        let on_lines = estimates
            .iter()
            .enumerate()
            .filter(|(index, _)| index % count + 1 < count);
        // Only windows that correlate promise a motion; others are not to be used, and may be anywhere.
        let trusted = on_lines.filter(|(_, estimate)| estimate.is_trusted(TRUSTED));
        let errors: Vec<f64> = trusted
            .map(|(_, estimate)| estimate.axial_um - 1e3 * MOVED_MM)
            .collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let square = errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / errors.len() as f64;
        record.under(format!("{name}: axial bias, um"), mean.abs(), 0.5);
        record.under(format!("{name}: axial standard deviation, um"), square.sqrt(), 1.0);
        record.report(format!("{name}: share of windows that correlate"), share(&estimates));
        record.under(format!("{name}: largest number"), magnitude(&estimates), 1e6);
        if name == "constant lines" {
            // A constant line looks alike at every shift: none of them may pass for a match.
            let stuck = estimates
                .chunks(count)
                .step_by(5)
                .flatten()
                .filter(|estimate| estimate.is_trusted(TRUSTED));
            record.zero("windows of constant lines that correlate", stuck.count() as f64);
        }
    }
    Ok(())
}
