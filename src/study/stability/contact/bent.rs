//! Case of a strongly bent needle in tissue.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::setup::{ASIDE, STEP_S, Watch, build, displaced, image, tissue, travel};
use crate::mechanics::insertion::finite::Setup;
use crate::mechanics::insertion::{Instruments, Model, Snapshot};
use crate::mechanics::needle::Stiffness;
use crate::mechanics::tissue::material::Material;
use crate::study::block::{self, USUAL};
use crate::study::stability::record::{Record, Unexpected};

/// Turns the base of an inserted needle about the skin, so that the shaft bends between hand and tip.
pub fn far(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const DEPTH_MM: f64 = 50.0;
    const TURN_DEG: f64 = 60.0;
    let steps: usize = record.effort().pick(60, 600);
    let all = [(1.0, 10.0), (0.1, 100.0), (1.0, 100.0)];
    let cases = record.effort().pick(&all[..1], &all[..]);
    for (at, &(needle, young_kpa)) in cases.iter().enumerate() {
        record.done(at as f64 / cases.len() as f64);
        let tissue = tissue(USUAL)?;
        let stiffness = Stiffness::BendingNmm2(needle * Stiffness::default().bending_nmm2());
        let mut finite = build(Setup {
            needle: block::springs(stiffness, block::LINK_MM, block::BEVEL)?,
            materials: vec![Material::new(young_kpa, 0.45)?; tissue.mesh.elements().len()],
            ..tissue
        })?;
        let mut watch = Watch::default();
        travel(&mut finite, [-1.0, DEPTH_MM], 0.25, |it| watch.see(it))?;
        let straight = block::tip_at([ASIDE[0], ASIDE[1], DEPTH_MM]);
        let skin = Translation3::new(ASIDE[0], ASIDE[1], 0.0);
        let mut bent = 0.0f64;
        let mut snapshot = Snapshot::default();
        for step in (0..=2 * steps).map(|step| steps - step.abs_diff(steps)) {
            let angle = TURN_DEG.to_radians() * step as f64 / steps as f64;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle);
            let about = Isometry3::from(skin) * turn * skin.inverse();
            let instruments = Instruments {
                base: about * straight.base,
                ..straight
            };
            watch.see(finite.step(&instruments, STEP_S)?);
            finite.snapshot(&mut snapshot);
            let line = &snapshot.line;
            let [base, tip] = [0.0, line.length_mm() - block::BEVEL.length_mm - 1.0].map(|arc| line.at(arc).tangent);
            bent = bent.max(base.angle(&tip).to_degrees());
        }
        let name = format!("needle x {needle}, tissue {young_kpa} kPa");
        travel(&mut finite, [DEPTH_MM, -60.0], 0.25, |it| watch.see(it))?;
        watch.write(record, &name);
        // The hand turns by 60 degrees; a soft shaft bows between hand and skin, and its buried part may tilt the other way.
        record.report(format!("bend, degrees, {name}"), bent);
        record.zero(
            format!("force left, N, {name}"),
            finite.outcome().on_hand.force_n.norm(),
        );
        record.zero(format!("displacement left, mm, {name}"), displaced(&image(&mut finite)));
    }
    Ok(())
}
