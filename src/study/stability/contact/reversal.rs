//! Cases of a needle that reverses its motion repeatedly.

use std::collections::BTreeMap;

use super::setup::{STEP_S, Watch, build, coarse, go, resistance, springs, tissue, travel};
use crate::mechanics::insertion::Model;
use crate::mechanics::insertion::finite::Finite;
use crate::mechanics::insertion::spring::MassSpring;
use crate::study::block::USUAL;
use crate::study::stability::record::{Record, Unexpected, largest};

/// Depth of the needle, mm.
const DEPTH_MM: f64 = 40.0;
/// Amplitudes of the reversal, mm: contacts stick throughout, slip partly, slip everywhere, and detach.
const SWINGS_MM: [f64; 4] = [0.01, 0.3, 1.0, 8.0];
/// Relative excess allowed of forces over their bound: friction over 1e-5 mm, the tolerance of the iterations, relative to the cutting
/// force.
const BOUND: f64 = 4e-7;
/// Deficit allowed in dissipation, N mm: the slip that counts as rest, 1e-9 mm, under the largest force here, 2 N.
const IDLE_NMM: f64 = 2e-9;
/// Force change allowed between steps at rest, N: the tolerance of the iterations, 1e-5 mm, through stiffnesses of some N/mm.
const STILL_N: f64 = 1e-4;
/// Number of steps at rest.
const REST: usize = 20;

/// Reverses the needle at every step.
pub fn chatter(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let steps = record.effort().pick(500, 10_000);
    let count = SWINGS_MM.len() as f64;
    for (at, swing) in SWINGS_MM.into_iter().enumerate() {
        record.done(at as f64 / count);
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
            springs.step(&crate::study::block::tip_at(at_rest(turned(steps - 1, swing))), 0.1)?;
        }
        // The mass-spring model reports only how many nodes stick, not which.
        let count = |it: &MassSpring| (0..it.outcome().stuck as u32).map(|at| (at, true)).collect();
        settles(record, &mut springs, count, turned(steps - 1, swing), &name)?;
    }
    Ok(())
}

fn at_rest(z: f64) -> [f64; 3] {
    [super::setup::ASIDE[0], super::setup::ASIDE[1], z]
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
        before.get(&node).map(|from| force.z * (arc - from))
    })
}

/// Whether each contact sticks, by node.
type States = BTreeMap<u32, bool>;

fn states(finite: &Finite) -> States {
    finite.contact_states().collect()
}

/// Counts the contacts present before and after that changed their state.
fn changed(before: &States, after: &States) -> usize {
    let both = before
        .iter()
        .filter_map(|(node, stuck)| Some((stuck, after.get(node)?)));
    both.filter(|(before, after)| before != after).count()
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
        let now = go(model, z)?.on_hand.force_n;
        change = largest([change, (now - force).norm()]);
        force = now;
        let after = states(model);
        switches += changed(&before, &after) + before.len().abs_diff(after.len());
        before = after;
    }
    record.zero(format!("changes of state at rest, {name}"), switches as f64);
    record.under(format!("change of force in a step at rest, N, {name}"), change, STILL_N);
    Ok(())
}

/// Moves the needle sinusoidally, in ever shorter steps.
pub fn switches(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const SWING_MM: f64 = 1.0;
    const PERIODS: usize = 2;
    let steps = record.effort().pick(&[25, 250][..], &[25, 250, 2500][..]);
    for (at, &steps) in steps.iter().enumerate() {
        record.done(at as f64 / 3.0);
        let mut finite = build(tissue(USUAL)?)?;
        travel(&mut finite, [-1.0, DEPTH_MM], 0.25, |_| {})?;
        let (mut before, mut count, mut most) = (states(&finite), 0, 0);
        for step in 1..=PERIODS * steps {
            let phase = std::f64::consts::TAU * step as f64 / steps as f64;
            go(&mut finite, DEPTH_MM - 0.5 * SWING_MM * (1.0 - phase.cos()))?;
            let after = states(&finite);
            count += changed(&before, &after);
            most = most.max(after.len());
            before = after;
        }
        // At each of the two turns of a period a contact sticks and slips again at most once.
        let limit = (4 * PERIODS * most) as f64;
        let dt = 0.25 * STEP_S * 1000.0 / steps as f64;
        record.under(
            format!("changes of state in {PERIODS} periods of 0.25 s, dt = {dt:.0e} s"),
            count as f64,
            limit,
        );
    }
    Ok(())
}
