//! Case of a block on a belt: stick-slip of one contact, dragged by the needle until static friction gives way.

use super::setup::{build, go, tissue, travel};
use crate::mechanics::insertion::{Interaction, Model};
use crate::study::block::USUAL;
use crate::study::stability::record::{Record, Unexpected, largest};

/// Depth of the needle, mm: less than a cell, so that the node at the skin is the only contact.
const DEPTH_MM: f64 = 6.0;
/// Withdrawal speed, mm/s.
const SPEED: f64 = 1.0;
/// Relative friction error from iteration: positions on the shaft are solved to 1e-5 mm, and friction acts on the length beyond them, here
/// at least 3 mm.
const ITERATED: f64 = 1e-5 / 3.0;

/// Tests the stick-slip period. While the node sticks, the force rises by k v per second, from Fd after a slip to Fs at the next. Both are
/// friction over the length of shaft beyond the node, which a slip shortens.
pub fn period(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const RATIO: f64 = 1.5;
    let density = 0.005;
    let interaction = Interaction {
        friction_n_per_mm: density,
        static_ratio: RATIO,
        cutting_n: 0.0,
        puncture_n: 0.0,
        ..USUAL
    };
    let all = [1e-3, 2.5e-4, 6.1e-5];
    let steps = record.effort().pick(&all[..2], &all[..]);
    for (at, &dt) in steps.iter().enumerate() {
        record.done(at as f64 / steps.len() as f64);
        let mut finite = build(tissue(interaction)?)?;
        travel(&mut finite, [-1.0, DEPTH_MM], 0.1, |_| {})?;
        let length = finite.outcome().tip_mm.z;
        record.zero(
            format!("contacts beyond the one wanted, dt = {dt:.0e} s"),
            finite.outcome().contacts.abs_diff(1) as f64,
        );
        // Force on the node in the direction of withdrawal, and length of shaft beyond it.
        let (mut before, mut since, mut slips) = (None::<[f64; 2]>, None::<(usize, f64)>, 0);
        let (mut sliding, mut late, mut stiffness) = (Vec::new(), Vec::new(), 0.0);
        for step in 1.. {
            let drawn = SPEED * dt * step as f64;
            if drawn > 0.3 * length || slips > 12 {
                break;
            }
            go(&mut finite, DEPTH_MM - drawn)?;
            let Some((_, arc, force)) = finite.contact_forces().next() else {
                break;
            };
            let now = [-force.z, crate::mechanics::needle::Shaft::default().length_mm - arc];
            if let Some([force, beyond]) = before {
                if now[1] < beyond - 1e-9 {
                    slips += 1;
                    sliding.push(now[0] / (density * now[1]) - 1.0);
                    if let Some((from, low)) = since {
                        let expected = (RATIO * density * beyond - low) / (stiffness * SPEED);
                        let found = (step - from) as f64 * dt;
                        late.push((found - expected) / dt);
                    }
                    since = Some((step, now[0]));
                } else {
                    stiffness = (now[0] - force) / (SPEED * dt);
                }
            }
            before = Some(now);
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
