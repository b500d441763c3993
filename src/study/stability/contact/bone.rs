//! Case of a tip that meets bone.

use super::setup::{ASIDE, CELL_MM, EXTENT, Layers, Watch, build, coarse, go, resistance, travel};
use crate::mechanics::insertion::spring::MassSpring;
use crate::mechanics::insertion::{Bone, EventKind, Interaction, Model};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::material::Material;
use crate::study::block::{self, USUAL};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Travel of the hand beyond the bone surface, mm.
const TOO_FAR_MM: f64 = 9.0;
/// Thickness of the bone in the finite-element model, mm.
const THICK_MM: f64 = 20.0;
const BONE: Bone = Bone {
    stiffness_n_per_mm: 10.0,
    penetration_mm: 0.3,
};

fn of_bone() -> Interaction {
    Interaction {
        bone: Some(BONE),
        ..Interaction::default()
    }
}

/// Creates a finite-element model with bone from a depth on (mm), fixed at its nodes so that its surface stays in place.
fn finite(surface: f64) -> Result<Box<dyn Model>, Unexpected> {
    let plain = block::plain(EXTENT, CELL_MM)?;
    let (nodes, elements) = (plain.nodes().to_vec(), plain.elements().to_vec());
    let deep = |z: f64| (surface..=surface + THICK_MM).contains(&z);
    let in_bone = |corners: &[u32; 4]| corners.iter().all(|node| deep(nodes[*node as usize][2]));
    let regions = elements.iter().map(|corners| i32::from(in_bone(corners))).collect();
    let mesh = TetMesh::new(nodes.clone(), elements, regions)?;
    let mut setup = block::on_table(mesh, Material::new(10.0, 0.45)?, USUAL, block::rigid()?);
    let held = (0..).zip(&nodes).filter(|(_, p)| deep(p[2]) || p[2] == EXTENT[2]);
    setup.fixed = held.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect();
    setup.interactions.push((1, of_bone()));
    Ok(Box::new(build(setup)?))
}

/// Creates a mass-spring model with bone from a depth on (mm), at its rest position whatever the springs do.
fn springs(surface: f64) -> Result<Box<dyn Model>, Unexpected> {
    let layers = Layers {
        border: surface,
        of: [USUAL, of_bone()],
    };
    Ok(Box::new(MassSpring::new(coarse(), Box::new(layers), block::rigid()?)?))
}

type Make = fn(f64) -> Result<Box<dyn Model>, Unexpected>;

pub fn hit(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let kinds = [
        ("finite elements", finite as Make),
        ("masses and springs", springs as Make),
    ];
    for (at, (kind, make)) in kinds.into_iter().enumerate() {
        for (place, (surface, of)) in [(50.0, "bone within"), (0.0, "bone at the surface")]
            .into_iter()
            .enumerate()
        {
            for (turn, step) in [1.0, 10.0].into_iter().enumerate() {
                record.done(0.5 * at as f64 + 0.25 * place as f64 + 0.125 * turn as f64);
                let mut model = make(surface)?;
                let name = format!("{step} mm a step, {of}, {kind}");
                one(record, &mut *model, surface, step, &name)?;
            }
        }
    }
    Ok(())
}

/// Pushes the needle into bone that begins at a depth (mm), and withdraws it.
fn one(record: &mut Record<'_>, model: &mut dyn Model, surface: f64, step: f64, name: &str) -> Result<(), Unexpected> {
    let before = -1.0;
    let hand = surface + TOO_FAR_MM;
    model.start(&block::tip_at([ASIDE[0], ASIDE[1], before]));
    let (mut watch, mut hits, mut deepest) = (Watch::default(), Vec::new(), 0.0);
    let mut part = 0.0;
    travel(model, [before, hand], step, |outcome| {
        watch.see(outcome);
        let met = outcome.events.iter().filter(|event| event.kind == EventKind::Bone);
        hits.extend(met.map(|event| event.at_mm.z));
        deepest = largest([deepest, outcome.tip_mm.z]);
        part = largest([part, step / outcome.substeps as f64]);
    })?;
    watch.write(record, name);
    record.zero(
        format!("times that bone is met, beyond once, {name}"),
        hits.len() as f64 - 1.0,
    );
    let met = hits.first().copied().unwrap_or(f64::NAN);
    record.under(
        format!("where bone is met, mm off, {name}"),
        (met - surface).abs(),
        1e-9,
    );
    // Exceeds the limit only by the tip's advance within the substep in which it meets bone.
    record.under(
        format!("penetration, mm, {name}"),
        deepest - surface,
        BONE.penetration_mm + part,
    );
    // The force on the hand is a mean over a step, here of one at rest.
    let last = go(model, hand)?;
    let pushed = BONE.stiffness_n_per_mm * BONE.penetration_mm;
    let friction = USUAL.friction_n_per_mm * last.inserted_mm + USUAL.cutting_n;
    let off = (resistance(last) - pushed).abs();
    record.report(
        format!("force with the hand {TOO_FAR_MM} mm too far, N, {name}"),
        resistance(last),
    );
    record.under(
        format!("force off its limit, over friction, {name}"),
        off / friction,
        1.0,
    );
    record.under(
        format!("penetration at rest, mm, {name}"),
        last.tip_mm.z - surface,
        BONE.penetration_mm + 1e-9,
    );
    travel(model, [hand, -3.0], step, |_| {})?;
    // Tissue that a fast needle has dragged out of the body slides off during further withdrawal.
    travel(model, [-3.0, -23.0], 1.0, |_| {})?;
    record.zero(format!("force left, N, {name}"), model.outcome().on_hand.force_n.norm());
    Ok(())
}
