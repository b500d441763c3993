//! Interface: a stencil over labels, which are known exactly; only the arithmetic rounds.

use crate::effects::interface::{Interface, reflection};

use super::rounding::{DIVIDE, ROOT, ULP, pow};
use super::slack::{Slack, Step};

/// Losses of a difference of two smoothed impedances, in ULP of the largest impedance: three products and three sums on
/// each side, and the difference.
const STENCIL: f64 = 2.0 * 6.0 + 1.0;

pub fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let own = tables.settings.effects.interface.clone().unwrap_or_default();
    let mirror = 10f64.powf(own.mirror_db / 20.0);
    let (lines, samples) = (step.lines(), step.samples());
    let spacing = tables.line_spacing.of::<f64>();
    let patch = |labels: &[u8], line: usize, sample: usize| -> [[f64; 3]; 3] {
        [line.saturating_sub(1), line, (line + 1).min(lines - 1)].map(|line| {
            [sample - 1, sample, sample + 1]
                .map(|sample| f64::from(tables.label_rows[usize::from(labels[line * samples + sample])].impedance))
        })
    };
    for line in 0..lines {
        for sample in 1..samples.saturating_sub(1) {
            let (z, twin) = (
                patch(&step.after.label, line, sample),
                patch(&step.twin.label, line, sample),
            );
            let share = |z| reflection(z, tables.sample_mm(), spacing[sample], own.directivity);
            let index = line * samples + sample;
            slack.amplitude[index] += mirror * ((share(z) - share(twin)).abs() + rounding(twin, &own))
                + ULP * (step.after.amplitude[index] + 2.0 * mirror * share(twin));
        }
    }
}

/// What rounding does to `|a| / total * (|a| / sqrt(a^2 + l^2))^n`, where `a` and `l` are differences.
fn rounding(z: [[f64; 3]; 3], own: &Interface) -> f64 {
    let largest = z.iter().flatten().fold(0.0f64, |a, &b| a.max(b));
    let smallest = z.iter().flatten().fold(f64::INFINITY, |a, &b| a.min(b));
    if largest == smallest {
        return 0.0;
    }
    let near = 0.25 * z[0][0] + 0.5 * z[1][0] + 0.25 * z[2][0];
    let far = 0.25 * z[0][2] + 0.5 * z[1][2] + 0.25 * z[2][2];
    let total = near + far;
    if total <= 0.0 {
        return 0.0;
    }
    // The derivative over `a` of the whole is at most (1 + n) / total, that over `l` at most n / total.
    let differences = (1.0 + 2.0 * own.directivity) * STENCIL * ULP * largest / total;
    // Relative errors of the cosine (two distances: division and stored spacing; squares, sum, root; quotient), raised to
    // the power; of the quotient by the total; of the products.
    let cosine = 2.0 * (DIVIDE + 1.5 * ULP) + 2.0 * ULP + ROOT + DIVIDE;
    let reflected = (far - near).abs() / total;
    let worst_power = (0..=64)
        .map(|at| f64::from(at) / 64.0)
        .map(|c| c.powf(own.directivity) * pow(c, own.directivity));
    let power = worst_power.fold(0.0f64, f64::max) * 1.1;
    differences + reflected * (own.directivity * cosine + power + DIVIDE + 6.0 * ULP)
}
