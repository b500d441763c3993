//! Cases of large motions: a base moved far in one step, tissue crushed by a probe.

use nalgebra::{Isometry3, Translation3};

use super::setup::{ASIDE, STEP_S, Watch, build, coarse, displaced, go, image, resistance, springs, tissue, travel};
use crate::mechanics::insertion::{EventKind, Instruments, Model, Outcome, ProbeContact};
use crate::study::block::{self, USUAL};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Compares 50 mm in one step with many steps.
pub fn far(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const WAY_MM: [f64; 2] = [-2.0, 48.0];
    // Substeps are no longer than this, mm.
    let part = crate::mechanics::insertion::finite::Options::default().part_mm;
    let both: [(&str, Box<dyn Fn() -> Result<Box<dyn Model>, Unexpected>>, f64); 2] = [
        (
            "finite elements",
            Box::new(|| Ok(Box::new(build(tissue(USUAL)?)?))),
            part,
        ),
        (
            "masses and springs",
            Box::new(|| Ok(Box::new(springs(coarse(), USUAL)?))),
            1.0,
        ),
    ];
    for (name, make, part) in both {
        let mut long = make()?;
        let mut watch = Watch::default();
        watch.see(go(&mut *long, WAY_MM[0])?);
        let outcome = go(&mut *long, WAY_MM[1])?.clone();
        watch.see(&outcome);
        let mut short = make()?;
        go(&mut *short, WAY_MM[0])?;
        travel(&mut *short, WAY_MM, 0.1, |_| {})?;
        let last = short.outcome();
        watch.write(record, name);
        let needed = (WAY_MM[1] - WAY_MM[0]) / part;
        record.under(format!("parts missing, {name}"), needed - outcome.substeps as f64, 0.0);
        record.under(
            format!("contacts unlike those of small steps, {name}"),
            outcome.contacts.abs_diff(last.contacts) as f64,
            1.0,
        );
        let order = [EventKind::Skin, EventKind::Puncture];
        let found = outcome.events.iter().map(|event| event.kind).zip(order);
        record.zero(
            format!("skin and puncture not seen, {name}"),
            2.0 - found.filter(|(found, expected)| found == expected).count() as f64,
        );
        record.report(
            format!("force unlike that of small steps, N, {name}"),
            (resistance(&outcome) - resistance(last)).abs(),
        );
    }
    Ok(())
}

/// Pushes a probe far through tissue and back, with a needle inserted meanwhile.
pub fn crushed(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let pose = |shift: f64| Isometry3::from(Translation3::new(30.0, shift - 10.0, 70.0));
    let mut setup = tissue(USUAL)?;
    let under = |p: &[f64; 3]| p[1] == 0.0 && (p[0] - 30.0).abs() < 11.0 && (15.0..65.0).contains(&p[2]);
    let candidates = (0..).zip(setup.mesh.nodes()).filter(|(_, p)| under(p));
    setup.probe = Some(ProbeContact {
        nominal: pose(0.0),
        length_mm: 60.0,
        candidates: candidates.map(|(node, _)| node).collect(),
        driven_at_mm: None,
    });
    let mut finite = build(setup)?;
    let mut watch = Watch::default();
    let mut told = 0;
    let mut step = |finite: &mut dyn Model, shift: f64, z: f64| -> Result<Outcome, Unexpected> {
        let instruments = Instruments {
            probe: Some(pose(shift)),
            ..block::tip_at([ASIDE[0], 50.0, z])
        };
        let outcome = finite.step(&instruments, STEP_S)?.clone();
        watch.see(&outcome);
        told += outcome
            .events
            .iter()
            .filter(|event| event.kind == EventKind::Crushed)
            .count();
        Ok(outcome)
    };
    step(&mut finite, 45.0, -5.0)?;
    let tissue = image(&mut finite);
    let broken = tissue.current.as_flattened().iter().filter(|x| !x.is_finite()).count();
    record.zero("coordinates that are none", broken as f64);
    record.report("elements inverted", tissue.inverted as f64);
    record.zero("crushed tissue not detected", f64::from(u8::from(tissue.inverted == 0)));
    // A needle inserted there either converges or reports that it does not.
    for at in 0..80 {
        step(&mut finite, 45.0, 0.5 * f64::from(at) - 2.0)?;
    }
    for at in 0..90 {
        step(&mut finite, 45.0, 38.0 - 0.5 * f64::from(at))?;
    }
    let back = step(&mut finite, 0.0, -7.0)?;
    watch.write(record, "a needle in crushed tissue");
    record.report("events of crushed tissue", told as f64);
    let left = back.on_probe.map_or(f64::NAN, |wrench| wrench.force_n.norm());
    record.under("force left on the probe, N", left, 1e-6);
    record.under("displacement left, mm", largest([displaced(&image(&mut finite))]), 1e-6);
    Ok(())
}
