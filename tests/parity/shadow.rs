//! Shadow: a sum of integers, which agree exactly wherever the labels above agree, and one exponential.

use insonify::effects::shadow::{MOST_UNITS, exponent_per_unit, units};

use crate::case::{Case, check_all};
use crate::rounding::{TINY, ULP, exp2};
use crate::scenes;
use crate::slack::{Slack, Step};
use crate::support::scene::{self, SHAPES};

pub fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let needle = tables.settings.has_needle.then(|| {
        let db_mm = tables
            .settings
            .effects
            .shadow
            .as_ref()
            .map_or(0.0, |own| own.needle_db_mm);
        f64::from(units(db_mm * tables.sample_mm()))
    });
    let tissue = |label: u8| f64::from(tables.label_rows[usize::from(label)].loss);
    slack.loss = vec![0.0; step.after.loss.len()];
    for line in 0..step.lines() {
        let mut above = 0.0;
        for sample in 0..step.samples() {
            let index = line * step.samples() + sample;
            let mut own = (tissue(step.after.label[index]) - tissue(step.twin.label[index])).abs();
            let mask_off = slack.mask.get(index).copied().unwrap_or(0.0);
            if let Some(units) = needle
                && mask_off > 0.0
            {
                // Cutting the product to a whole number of units may take one more or less.
                own += units * (mask_off + ULP) + 1.0;
            }
            // Half of the sample's own loss, again cut to whole units.
            let halved = if own > 0.0 { 0.5 * own + 1.0 } else { 0.0 };
            let off = above + halved;
            slack.loss[index] = off;
            above += own;

            let exact = f64::from(step.after.loss[index]);
            let left = |units: f64| (units.clamp(0.0, f64::from(MOST_UNITS)) * exponent_per_unit()).exp2();
            let (most, least) = (left(exact - off), left(exact + off));
            let exponent = (exact + off) * exponent_per_unit().abs();
            // Units stored (1/2), the factor stored (1/2), product (1); then the exponential and a product.
            let relative = exp2(exponent, 2.0 * ULP * exponent) + ULP;
            let amplitude = step.before.amplitude[index];
            slack.amplitude[index] = slack.amplitude[index] * most
                + amplitude * (most - least)
                + amplitude * most * relative.min(1.0)
                + TINY * (1.0 + amplitude);
        }
    }
}

#[test]
fn attenuation_and_occlusion_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        // 700 samples: several to an invocation of the parallel sum.
        for samples in [96, 255, 256, 257, 700] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, 5, samples), scene::bare());
            settings.effects.shadow = Some(Default::default());
            cases.push(Case::new(
                format!("{name}, {samples} samples"),
                scenes::random_anatomy(),
                settings,
                scenes::oblique_pose(),
            ));
        }
    }
    check_all("shadow", &cases);
}

#[test]
fn the_needle_shades() {
    let mut settings = scene::settings(scene::small_probe(), scene::bare());
    settings.has_needle = true;
    settings.effects.needle = Some(Default::default());
    settings.effects.shadow = Some(Default::default());
    let cases = [
        Case::new(
            "needle and tissue",
            scenes::random_anatomy(),
            settings.clone(),
            scenes::with_needle(scenes::oblique_pose()),
        ),
        Case::new(
            "needle alone",
            scenes::unattenuating(),
            settings,
            scenes::with_needle(scenes::oblique_pose()),
        ),
    ];
    check_all("needle shadow", &cases);
}
