//! Blur: a convolution across scanlines with weights that sum to 1.

use insonify::effects::blur::Blur;

use crate::case::{Case, check_all};
use crate::rounding::{DIVIDE, ULP};
use crate::scenes;
use crate::slack::{Slack, Step};
use crate::support::scene::{self, SHAPES};

pub fn carry(step: &Step, slack: &mut Slack) {
    let Some(kernel) = &step.tables.blur else {
        panic!("{}: blur without a kernel", step.case.name)
    };
    let (lines, samples) = (step.lines(), step.samples());
    let before = std::mem::take(&mut slack.amplitude);
    slack.amplitude = vec![0.0; before.len()];
    for sample in 0..samples {
        let weights: Vec<f64> = kernel.at(sample).collect();
        for line in 0..lines {
            let (mut off, mut size, mut norm) = (0.0, 0.0, 0.0);
            for (tap, weight) in weights.iter().enumerate() {
                if let Some(other) = (line + tap).checked_sub(kernel.reach).filter(|&other| other < lines) {
                    let at = other * samples + sample;
                    off += weight * before[at];
                    size += weight * (step.before.amplitude[at].abs() + before[at]);
                    norm += weight;
                }
            }
            // Weights stored (1/2), products (1) and sums; where the kernel is cut, the sum of its weights and a division.
            let rounding = (1.5 + 2.0 * weights.len() as f64) * ULP + DIVIDE;
            slack.amplitude[line * samples + sample] = (off + rounding * size) / norm.min(1.0);
        }
    }
}

#[test]
fn narrow_and_wide_blurs_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (width_mm, growth_mm_cm) in [(0.6, 0.06), (0.0, 0.0), (12.0, 2.0)] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
            settings.effects.blur = Some(Blur { width_mm, growth_mm_cm });
            cases.push(Case::new(
                format!("{name}, {width_mm} mm"),
                scenes::random_anatomy(),
                settings,
                scenes::oblique_pose(),
            ));
        }
    }
    check_all("blur", &cases);
}
