//! Case of repeated insertion and withdrawal.

use super::setup::{build, coarse, displaced, image, springs, tissue, travel};
use crate::mechanics::insertion::{Model, Outcome};
use crate::study::block::{self, USUAL};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Range of the tip depth, mm.
const WAY_MM: [f64; 2] = [-2.0, 35.0];
/// Force difference allowed between cycles, N.
const SAME_N: f64 = 1e-6;

pub fn many(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let cycles = record.effort().pick(20, 1000);
    let mut finite = build(tissue(USUAL)?)?;
    let rest = finite.mesh().nodes().to_vec();
    repeat(record, &mut finite, cycles, "finite elements", 0.0)?;
    record.zero("degrees of freedom still held, finite elements", finite.held() as f64);
    let moved = image(&mut finite).reference;
    record.zero("nodes not back, finite elements", f64::from(u8::from(moved != rest)));
    let mut springs = springs(coarse(), USUAL)?;
    repeat(record, &mut springs, cycles, "masses and springs", 0.5)?;
    record.zero("energy left, N mm, masses and springs", springs.energy_nmm());
    Ok(())
}

fn repeat(
    record: &mut Record<'_>,
    model: &mut dyn Model,
    cycles: usize,
    name: &str,
    done: f64,
) -> Result<(), Unexpected> {
    let [out, deep] = WAY_MM;
    let cycle = |model: &mut dyn Model| -> Result<Vec<[f64; 3]>, Unexpected> {
        let mut trace = Vec::new();
        for way in [[out, deep], [deep, out]] {
            travel(model, way, 0.5, |it: &Outcome| trace.push(it.on_hand.force_n.into()))?;
        }
        Ok(trace)
    };
    // The size of a saved state grows with everything that a model stores.
    let size = |model: &mut dyn Model| model.save().0.to_string().len() as f64;
    cycle(model)?;
    let second = cycle(model)?;
    let kept = size(model);
    let mut last = second.clone();
    for at in 2..cycles {
        last = cycle(model)?;
        record.done(done + 0.5 * at as f64 / cycles as f64);
    }
    let pairs = second.as_flattened().iter().zip(last.as_flattened());
    record.under(
        format!("force of cycle {cycles} less that of cycle 2, N, {name}"),
        largest(pairs.map(|(a, b)| a - b)),
        SAME_N,
    );
    record.report(
        format!("largest force, N, {name}"),
        largest(last.as_flattened().iter().copied()),
    );
    record.zero(format!("force left, N, {name}"), model.outcome().on_hand.force_n.norm());
    record.zero(format!("contacts left, {name}"), model.outcome().contacts as f64);
    // Allows for the digits of steps and times.
    record.under(
        format!("growth of a saved state, bytes, {name}"),
        size(model) - kept,
        64.0,
    );
    // The mass-spring tissue needs its own time to come to rest.
    for _ in 0..20 {
        model.step(
            &block::tip_at([super::setup::ASIDE[0], super::setup::ASIDE[1], out]),
            0.1,
        )?;
    }
    record.zero(format!("displacement left, mm, {name}"), displaced(&image(model)));
    Ok(())
}
