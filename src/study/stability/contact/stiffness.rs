//! Cases of needles and tissues far stiffer and softer than usual.

use nalgebra::Vector3;

use super::setup::{ASIDE, STEP_S, Watch, build, tissue};
use crate::mechanics::insertion::finite::{Finite, Setup};
use crate::mechanics::insertion::{Model, Outcome};
use crate::mechanics::needle::{Bevel, Stiffness};
use crate::mechanics::tissue::material::Material;
use crate::study::block;
use crate::study::stability::record::{Record, Unexpected, largest};

/// Insertion depth and advance per step, mm.
const WAY_MM: [f64; 2] = [50.0, 0.5];
/// Amplitude of the subsequent oscillation, mm, and steps per period.
const SWING: (f64, usize) = (0.2, 10);
/// Force difference allowed, N: the response of a dissipative system to periodic motion is periodic, to the tolerance of the iterations
/// (1e-5 mm) through stiffnesses below 100 N/mm.
const SAME_N: f64 = 1e-3;

/// Inserts the needle, then oscillates it.
pub fn contrasts(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let usual = Stiffness::default().bending_nmm2();
    let steps = record.effort().pick(400, 10_000);
    let cases = [
        (1.0, 0.1),
        (1.0, 10.0),
        (1.0, 1000.0),
        (1e3, 10.0),
        (1e-3, 10.0),
        (1e3, 0.1),
        (1e-3, 1000.0),
    ];
    for (at, (needle, young_kpa)) in cases.into_iter().enumerate() {
        record.done(at as f64 / cases.len() as f64);
        let bevel = Bevel {
            r_mm: 0.6,
            ..block::BEVEL
        };
        let tissue = tissue(block::USUAL)?;
        let mut finite = build(Setup {
            needle: block::springs(Stiffness::BendingNmm2(needle * usual), block::LINK_MM, bevel)?,
            materials: vec![Material::new(young_kpa, 0.45)?; tissue.mesh.elements().len()],
            ..tissue
        })?;
        let name = format!("needle x {needle:e}, tissue {young_kpa} kPa");
        let mut watch = Watch::default();
        let [depth, advance] = WAY_MM;
        for step in 0..=(depth / advance) as usize {
            watch.see(go(&mut finite, step as f64 * advance)?);
        }
        let (mut first, mut last) = (0.0, 0.0);
        for step in 0..steps {
            let phase = std::f64::consts::TAU * step as f64 / SWING.1 as f64;
            let outcome = go(&mut finite, depth - SWING.0 * phase.sin())?;
            watch.see(outcome);
            let size = outcome.on_hand.force_n.norm();
            // The first periods are the transient.
            if (2 * SWING.1..steps / 2).contains(&step) {
                first = largest([first, size]);
            } else if step >= steps / 2 {
                last = largest([last, size]);
            }
        }
        watch.write(record, &name);
        record.under(
            format!("growth of the force to and fro, N, {name}"),
            last - first,
            SAME_N,
        );
        record.report(format!("largest force to and fro, N, {name}"), last);
        record.report(format!("deflection, mm, {name}"), finite.outcome().tip_deflection_mm);
        if young_kpa >= 10.0 && needle > 1.0 {
            // A stiff needle follows its base, except for the bevel.
            let tip = finite.outcome().tip_mm.coords;
            let aside = Vector3::new(tip.x - ASIDE[0] - bevel.r_mm, tip.y - ASIDE[1], 0.0).norm();
            record.under(format!("a stiff needle aside, mm, {name}"), aside, 0.05);
        }
    }
    Ok(())
}

/// Steps the needle through a template hole.
fn go(finite: &mut Finite, z: f64) -> Result<&Outcome, Unexpected> {
    Ok(finite.step(&block::guided([ASIDE[0], ASIDE[1], z]), STEP_S)?)
}
