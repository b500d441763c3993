//! Case of short and long time steps of the mass-spring model.

use super::setup::{ASIDE, Watch, coarse, displaced, image, springs};
use crate::mechanics::insertion::Model;
use crate::mechanics::insertion::spring::Parameters;
use crate::study::block::{USUAL, tip_at};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Depth of the needle, mm.
const DEPTH_MM: f64 = 40.0;

/// Inserts and withdraws at time steps of 1e-5 to 0.1 s, at speeds that take some hundred steps each.
pub fn any(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let usual = Parameters::default().young_kpa;
    let steps: usize = record.effort().pick(20, 400);
    for (at, young_kpa) in [usual, 1e4 * usual].into_iter().enumerate() {
        for (place, dt) in [1e-5, 1e-4, 1e-3, 1e-2, 0.1].into_iter().enumerate() {
            record.done(0.5 * at as f64 + 0.1 * place as f64);
            let parameters = Parameters { young_kpa, ..coarse() };
            let mut it = springs(parameters, USUAL)?;
            let limit = it.explicit_limit_s();
            let name = format!("dt = {dt:.0e} s, {young_kpa:e} kPa");
            let (mut watch, mut excess, mut farthest) = (Watch::default(), 0.0, 0.0);
            let (mut too_long, mut capped) = (Vec::new(), 0);
            for step in 0..=2 * steps {
                let z = -2.0 + (DEPTH_MM + 2.0) * (steps - step.abs_diff(steps)) as f64 / steps as f64;
                let awake = it.is_awake();
                let outcome = it.step(&tip_at([ASIDE[0], ASIDE[1], z]), dt)?;
                watch.see(outcome);
                let bound = USUAL.friction_n_per_mm * (DEPTH_MM + 0.1) + USUAL.puncture_n;
                excess = largest([excess, (outcome.on_hand.force_n.z.abs() - bound).max(0.0)]);
                // Where the number of substeps is capped, less time passes in the tissue than in the step.
                if awake && outcome.substeps >= parameters.most_substeps {
                    capped += 1;
                } else if awake {
                    too_long.push(dt / outcome.substeps as f64 / limit);
                }
                if step % 20 == 0 {
                    farthest = largest([farthest, displaced(&image(&mut it))]);
                }
            }
            watch.write(record, &name);
            record.zero(format!("force over friction and puncture, N, {name}"), excess);
            record.under(format!("displacement, mm, {name}"), farthest, DEPTH_MM);
            if !too_long.is_empty() {
                let what = format!("part of a step over the explicit limit, {name}");
                record.under(what, largest(too_long), 1.0);
            }
            record.report(
                format!("steps of as many parts as there may be, {name}"),
                f64::from(capped),
            );
            // Tissue that a fast needle has dragged out of the body returns by itself.
            for _ in 0..60 {
                it.step(&tip_at([ASIDE[0], ASIDE[1], -2.0]), 0.1)?;
            }
            record.zero(format!("energy left, N mm, {name}"), it.energy_nmm());
        }
    }
    Ok(())
}
