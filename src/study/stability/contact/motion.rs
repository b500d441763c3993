//! Cases of needle motions: reversals, stick and slip, repeated insertions, and steps of any length.

use std::collections::BTreeMap;

use crate::stability::fixtures::{
    ASIDE, STEP_S, Watch, build, coarse, displaced, go, image, resistance, springs, tissue, travel,
};
use crate::stability::record::{Record, Unexpected, largest};
use insonify_mechanics::block::{self, USUAL, tip_at};
use insonify_mechanics::insertion::finite::Finite;
use insonify_mechanics::insertion::spring::{MassSpring, MassSpringParameters};
use insonify_mechanics::insertion::{Interaction, Model, Outcome};

/// Depth of the needle, mm.
const DEPTH_MM: f64 = 40.0;
/// Amplitudes of the reversal, mm: contacts stick throughout, slip partly, slip everywhere, and detach.
const SWINGS_MM: [f64; 4] = [0.01, 0.3, 1.0, 8.0];
/// Relative excess allowed of forces over their bound: friction over 1e-5 mm, the tolerance of the iterations, relative
/// to the cutting force.
const BOUND: f64 = 4e-7;
/// Deficit allowed in dissipation, N mm: the slip that counts as rest, 1e-9 mm, under the largest force here, 2 N.
const IDLE_NMM: f64 = 2e-9;
/// Force change allowed between steps at rest, N: the tolerance of the iterations, 1e-5 mm, through stiffnesses of some
/// N/mm.
const STILL_N: f64 = 1e-4;
/// Number of steps at rest.
const REST: usize = 20;

/// Reverses the needle at every step.
pub(crate) fn chatter(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let steps = record.effort().pick(500, 10_000);
    let count = SWINGS_MM.len() as f64;
    for (index, swing) in SWINGS_MM.into_iter().enumerate() {
        record.done(index as f64 / count);
        let mut finite = build(tissue(USUAL)?)?;
        let name = format!("finite elements, {swing} mm");
        travel(&mut finite, [-1.0, DEPTH_MM], 0.25, |_| {})?;
        let mut arcs = arcs(&finite);
        let (mut watch, mut excess, mut returned) = (Watch::default(), f64::NEG_INFINITY, f64::NEG_INFINITY);
        for step in 0..steps {
            let outcome = go(&mut finite, turned(step, swing))?;
            watch.see(outcome);
            let bound = USUAL.friction_n_per_mm * outcome.inserted_mm + USUAL.cutting_n;
            excess = largest_of(excess, resistance(outcome).abs() / bound - 1.0);
            returned = given_back(&finite, &mut arcs).fold(returned, largest_of);
        }
        watch.write(record, &name);
        record.under(format!("force over Coulomb's bound, {name}"), excess, BOUND);
        record.under(
            format!("work that friction gives back in a step, N mm, {name}"),
            returned,
            IDLE_NMM,
        );
        settles(record, &mut finite, states, turned(steps - 1, swing), &name)?;

        let mut springs = springs(coarse(), USUAL)?;
        let name = format!("masses and springs, {swing} mm");
        travel(&mut springs, [-2.0, DEPTH_MM], 0.1, |_| {})?;
        let (mut watch, mut excess) = (Watch::default(), f64::NEG_INFINITY);
        let mut before_mm = springs.outcome().inserted_mm;
        for step in 0..steps {
            let outcome = go(&mut springs, turned(step, swing))?;
            watch.see(outcome);
            // Forces are means over a step, in which the tip moves from its previous to its current position.
            let deepest_mm = outcome
                .inserted_mm
                .max(std::mem::replace(&mut before_mm, outcome.inserted_mm));
            let bound = USUAL.friction_n_per_mm * deepest_mm + USUAL.cutting_n;
            excess = largest_of(excess, resistance(outcome).abs() / bound - 1.0);
        }
        watch.write(record, &name);
        record.under(format!("force over Coulomb's bound, {name}"), excess, BOUND);
        // The mass-spring tissue needs its own time to come to rest.
        for _ in 0..REST {
            springs.step(
                &insonify_mechanics::block::tip_at(at_rest(turned(steps - 1, swing))),
                0.1,
            )?;
        }
        // The mass-spring model reports only how many nodes stick, not which.
        let count = |springs: &MassSpring| (0..springs.outcome().stuck as u32).map(|node| (node, true)).collect();
        settles(record, &mut springs, count, turned(steps - 1, swing), &name)?;
    }
    Ok(())
}

fn at_rest(z: f64) -> [f64; 3] {
    [
        crate::stability::fixtures::ASIDE[0],
        crate::stability::fixtures::ASIDE[1],
        z,
    ]
}

/// Returns the depth of the tip at a step, mm.
fn turned(step: usize, swing: f64) -> f64 {
    if step.is_multiple_of(2) {
        DEPTH_MM - swing
    } else {
        DEPTH_MM
    }
}

/// Returns the larger number; NaN if either is NaN.
fn largest_of(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

/// Returns the position of each contact along the shaft, by node.
fn arcs(finite: &Finite) -> BTreeMap<u32, f64> {
    finite.contact_forces().map(|(node, arc, _)| (node, arc)).collect()
}

/// Returns the work that friction at each contact gave back in the last step, N mm: negative if it dissipates.
fn given_back(finite: &Finite, arcs: &mut BTreeMap<u32, f64>) -> impl Iterator<Item = f64> {
    let before = std::mem::take(arcs);
    finite.contact_forces().filter_map(move |(node, arc, force)| {
        arcs.insert(node, arc);
        // The force on tissue opposes its slip along the shaft, which is parallel to z.
        before.get(&node).map(|arc_before| force.z * (arc - arc_before))
    })
}

/// Whether each contact sticks, by node.
type States = BTreeMap<u32, bool>;

fn states(finite: &Finite) -> States {
    finite.contact_states().collect()
}

/// Counts the contacts present before and after that changed their state.
fn changed(before: &States, after: &States) -> usize {
    let shared = before
        .iter()
        .filter_map(|(node, stuck)| Some((stuck, after.get(node)?)));
    shared.filter(|(before, after)| before != after).count()
}

/// Records the changes that remain once the needle has rested at a depth for some steps.
fn settles<M: Model>(
    record: &mut Record<'_>,
    model: &mut M,
    states: impl Fn(&M) -> States,
    z: f64,
    name: &str,
) -> Result<(), Unexpected> {
    for _ in 0..REST {
        go(model, z)?;
    }
    let mut force = go(model, z)?.on_hand.force_n;
    let mut before = states(model);
    let (mut switches, mut change) = (0, 0.0);
    for _ in 0..REST {
        let force_now = go(model, z)?.on_hand.force_n;
        change = largest([change, (force_now - force).norm()]);
        force = force_now;
        let after = states(model);
        switches += changed(&before, &after) + before.len().abs_diff(after.len());
        before = after;
    }
    record.zero(format!("changes of state at rest, {name}"), switches as f64);
    record.under(format!("change of force in a step at rest, N, {name}"), change, STILL_N);
    Ok(())
}

/// Moves the needle sinusoidally, in ever shorter steps.
pub(super) fn switches(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const SWING_MM: f64 = 1.0;
    const PERIODS: usize = 2;
    let steps = record.effort().pick(&[25, 250][..], &[25, 250, 2500][..]);
    for (index, &steps) in steps.iter().enumerate() {
        record.done(index as f64 / 3.0);
        let mut finite = build(tissue(USUAL)?)?;
        travel(&mut finite, [-1.0, DEPTH_MM], 0.25, |_| {})?;
        let (mut before, mut count, mut most_contacts) = (states(&finite), 0, 0);
        for step in 1..=PERIODS * steps {
            let phase = std::f64::consts::TAU * step as f64 / steps as f64;
            go(&mut finite, DEPTH_MM - 0.5 * SWING_MM * (1.0 - phase.cos()))?;
            let after = states(&finite);
            count += changed(&before, &after);
            most_contacts = most_contacts.max(after.len());
            before = after;
        }
        // At each of the two turns of a period a contact sticks and slips again at most once.
        let limit = (4 * PERIODS * most_contacts) as f64;
        let dt = 0.25 * STEP_S * 1000.0 / steps as f64;
        record.under(
            format!("changes of state in {PERIODS} periods of 0.25 s, dt = {dt:.0e} s"),
            count as f64,
            limit,
        );
    }
    Ok(())
}

/// Depth of the needle, mm: less than a cell, so that the node at the skin is the only contact.
const BELT_DEPTH_MM: f64 = 6.0;
/// Withdrawal speed, mm/s.
const SPEED: f64 = 1.0;
/// Relative friction error from iteration: positions on the shaft are solved to 1e-5 mm, and friction acts on the
/// length beyond them, here at least 3 mm.
const ITERATED: f64 = 1e-5 / 3.0;

/// Tests the stick-slip period. While the node sticks, the force rises by k v per second, from Fd after a slip to Fs at
/// the next. Both are friction over the length of shaft beyond the node, which a slip shortens.
pub(super) fn period(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const RATIO: f64 = 1.5;
    let density = 0.005;
    let interaction = Interaction {
        friction_n_per_mm: density,
        static_ratio: RATIO,
        cutting_n: 0.0,
        puncture_n: 0.0,
        ..USUAL
    };
    let every_step = [1e-3, 2.5e-4, 6.1e-5];
    let steps = record.effort().pick(&every_step[..2], &every_step[..]);
    for (index, &dt) in steps.iter().enumerate() {
        record.done(index as f64 / steps.len() as f64);
        let mut finite = build(tissue(interaction)?)?;
        travel(&mut finite, [-1.0, BELT_DEPTH_MM], 0.1, |_| {})?;
        let length = finite.outcome().tip_mm.z;
        record.zero(
            format!("contacts beyond the one wanted, dt = {dt:.0e} s"),
            finite.outcome().contacts.abs_diff(1) as f64,
        );
        // Force on the node in the direction of withdrawal, and length of shaft beyond it.
        let (mut before, mut slip_start, mut slips) = (None::<[f64; 2]>, None::<(usize, f64)>, 0);
        let (mut sliding, mut late, mut stiffness) = (Vec::new(), Vec::new(), 0.0);
        for step in 1.. {
            let drawn = SPEED * dt * step as f64;
            if drawn > 0.3 * length || slips > 12 {
                break;
            }
            go(&mut finite, BELT_DEPTH_MM - drawn)?;
            let Some((_, arc, force)) = finite.contact_forces().next() else {
                break;
            };
            let sample = [-force.z, insonify_mechanics::needle::Shaft::default().length_mm - arc];
            if let Some([force, beyond]) = before {
                if sample[1] < beyond - 1e-9 {
                    slips += 1;
                    sliding.push(sample[0] / (density * sample[1]) - 1.0);
                    if let Some((start, low)) = slip_start {
                        let expected = (RATIO * density * beyond - low) / (stiffness * SPEED);
                        let period_s = (step - start) as f64 * dt;
                        late.push((period_s - expected) / dt);
                    }
                    slip_start = Some((step, sample[0]));
                } else {
                    stiffness = (sample[0] - force) / (SPEED * dt);
                }
            }
            before = Some(sample);
        }
        let name = format!("dt = {dt:.0e} s");
        record.report(format!("slips, {name}"), f64::from(slips));
        record.zero(format!("periods missing, {name}"), f64::from(u8::from(late.len() < 3)));
        record.under(format!("sliding force off its law, {name}"), largest(sliding), ITERATED);
        record.under(
            format!("period off (Fs - Fd)/(k v), steps, {name}"),
            largest(late),
            // One step, plus the effect of the iteration tolerance on a period of up to 1e4 steps.
            1.0 + 1e4 * ITERATED,
        );
    }
    Ok(())
}

/// Range of the tip depth, mm.
const WAY_MM: [f64; 2] = [-2.0, 35.0];
/// Force difference allowed between cycles, N.
const SAME_N: f64 = 1e-6;

pub(super) fn many(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let cycles = record.effort().pick(20, 1000);
    let mut finite = build(tissue(USUAL)?)?;
    let rest_nodes = finite.mesh().nodes().to_vec();
    repeat(record, &mut finite, cycles, "finite elements", 0.0)?;
    record.zero(
        "degrees of freedom still held, finite elements",
        finite.support_size() as f64,
    );
    let nodes_after = image(&mut finite).reference;
    record.zero(
        "nodes not back, finite elements",
        f64::from(u8::from(nodes_after != rest_nodes)),
    );
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
    let [withdrawn, deep] = WAY_MM;
    let cycle = |model: &mut dyn Model| -> Result<Vec<[f64; 3]>, Unexpected> {
        let mut trace = Vec::new();
        for depths in [[withdrawn, deep], [deep, withdrawn]] {
            travel(model, depths, 0.5, |outcome: &Outcome| {
                trace.push(outcome.on_hand.force_n.into())
            })?;
        }
        Ok(trace)
    };
    // The size of a saved state grows with everything that a model stores.
    let size = |model: &mut dyn Model| model.save().0.to_string().len() as f64;
    cycle(model)?;
    let second = cycle(model)?;
    let size_before = size(model);
    let mut latest = second.clone();
    for index in 2..cycles {
        latest = cycle(model)?;
        record.done(done + 0.5 * index as f64 / cycles as f64);
    }
    let pairs = second.as_flattened().iter().zip(latest.as_flattened());
    record.under(
        format!("force of cycle {cycles} less that of cycle 2, N, {name}"),
        largest(pairs.map(|(a, b)| a - b)),
        SAME_N,
    );
    record.report(
        format!("largest force, N, {name}"),
        largest(latest.as_flattened().iter().copied()),
    );
    record.zero(format!("force left, N, {name}"), model.outcome().on_hand.force_n.norm());
    record.zero(format!("contacts left, {name}"), model.outcome().contacts as f64);
    // Allows for the digits of steps and times.
    record.under(
        format!("growth of a saved state, bytes, {name}"),
        size(model) - size_before,
        64.0,
    );
    // The mass-spring tissue needs its own time to come to rest.
    for _ in 0..20 {
        model.step(
            &block::tip_at([
                crate::stability::fixtures::ASIDE[0],
                crate::stability::fixtures::ASIDE[1],
                withdrawn,
            ]),
            0.1,
        )?;
    }
    record.zero(format!("displacement left, mm, {name}"), displaced(&image(model)));
    Ok(())
}

/// Depth of the needle, mm.
const STEPPED_DEPTH_MM: f64 = 40.0;

/// Inserts and withdraws at time steps of 1e-5 to 0.1 s, at speeds that take some hundred steps each.
pub(crate) fn any_length(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let default_kpa = MassSpringParameters::default().young_kpa;
    let steps: usize = record.effort().pick(20, 400);
    for (index, young_kpa) in [default_kpa, 1e4 * default_kpa].into_iter().enumerate() {
        for (dt_index, dt) in [1e-5, 1e-4, 1e-3, 1e-2, 0.1].into_iter().enumerate() {
            record.done(0.5 * index as f64 + 0.1 * dt_index as f64);
            let parameters = MassSpringParameters { young_kpa, ..coarse() };
            let mut model = springs(parameters, USUAL)?;
            let limit = model.explicit_limit_s();
            let name = format!("dt = {dt:.0e} s, {young_kpa:e} kPa");
            let (mut watch, mut excess, mut farthest) = (Watch::default(), 0.0, 0.0);
            let (mut too_long, mut capped) = (Vec::new(), 0);
            for step in 0..=2 * steps {
                let z = -2.0 + (STEPPED_DEPTH_MM + 2.0) * (steps - step.abs_diff(steps)) as f64 / steps as f64;
                let active = model.is_active();
                let outcome = model.step(&tip_at([ASIDE[0], ASIDE[1], z]), dt)?;
                watch.see(outcome);
                let bound = USUAL.friction_n_per_mm * (STEPPED_DEPTH_MM + 0.1) + USUAL.puncture_n;
                excess = largest([excess, (outcome.on_hand.force_n.z.abs() - bound).max(0.0)]);
                // Where the number of substeps is capped, less time passes in the tissue than in the step.
                if active && outcome.substeps >= parameters.most_substeps {
                    capped += 1;
                } else if active {
                    too_long.push(dt / outcome.substeps as f64 / limit);
                }
                if step % 20 == 0 {
                    farthest = largest([farthest, displaced(&image(&mut model))]);
                }
            }
            watch.write(record, &name);
            record.zero(format!("force over friction and puncture, N, {name}"), excess);
            record.under(format!("displacement, mm, {name}"), farthest, STEPPED_DEPTH_MM);
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
                model.step(&tip_at([ASIDE[0], ASIDE[1], -2.0]), 0.1)?;
            }
            record.zero(format!("energy left, N mm, {name}"), model.energy_nmm());
        }
    }
    Ok(())
}
