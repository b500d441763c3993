//! The tip meets bone.

use super::setup::{CELL_MM, EXTENT, Layers, Watch, build, coarse, resistance, travel};
use crate::mechanics::insertion::spring::MassSpring;
use crate::mechanics::insertion::{Bone, EventKind, Interaction, Model};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::material::Material;
use crate::study::block::{self, USUAL};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Where bone begins, mm.
const SURFACE_MM: f64 = 50.0;
/// How far the hand goes, mm.
const HAND_MM: f64 = 59.0;
const FINITE: &str = "finite elements";
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

fn finite() -> Result<Box<dyn Model>, Unexpected> {
    let plain = block::plain(EXTENT, CELL_MM)?;
    let (nodes, elements) = (plain.nodes().to_vec(), plain.elements().to_vec());
    let deep = |corners: &[u32; 4]| corners.iter().all(|node| nodes[*node as usize][2] >= SURFACE_MM);
    let regions = elements.iter().map(|corners| i32::from(deep(corners))).collect();
    let mesh = TetMesh::new(nodes.clone(), elements, regions)?;
    let mut setup = block::on_table(mesh, Material::new(10.0, 0.45)?, USUAL, block::rigid()?);
    let held = (0..).zip(&nodes).filter(|(_, p)| p[2] >= SURFACE_MM);
    setup.fixed = held.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect();
    setup.interactions.push((1, of_bone()));
    Ok(Box::new(build(setup)?))
}

fn springs() -> Result<Box<dyn Model>, Unexpected> {
    let layers = Layers {
        border: SURFACE_MM,
        of: [USUAL, of_bone()],
    };
    Ok(Box::new(MassSpring::new(coarse(), Box::new(layers), block::rigid()?)?))
}

pub fn hit(record: &mut Record<'_>) -> Result<(), Unexpected> {
    type Make = fn() -> Result<Box<dyn Model>, Unexpected>;
    for (kind, make) in [
        ("finite elements", finite as Make),
        ("masses and springs", springs as Make),
    ] {
        for step in [1.0, 10.0] {
            let mut model = make()?;
            let name = format!("{step} mm a step, {kind}");
            let (mut watch, mut hits, mut deepest) = (Watch::default(), Vec::new(), 0.0);
            travel(&mut *model, [-1.0, HAND_MM], step, |outcome| {
                watch.see(outcome);
                let met = outcome.events.iter().filter(|event| event.kind == EventKind::Bone);
                hits.extend(met.map(|event| event.at_mm.z));
                deepest = largest([deepest, outcome.tip_mm.z]);
            })?;
            watch.write(record, &name);
            record.zero(
                format!("times that bone is met, beyond once, {name}"),
                hits.len() as f64 - 1.0,
            );
            let met = hits.first().copied().unwrap_or(f64::NAN);
            record.under(
                format!("penetration, mm, {name}"),
                deepest - met,
                BONE.penetration_mm + 1e-9,
            );
            record.report(
                format!("where bone is met, mm before its surface, {name}"),
                SURFACE_MM - met,
            );
            let last = model.outcome();
            record.report(
                format!("force with the hand {} mm too far, N, {name}", HAND_MM - SURFACE_MM),
                resistance(last),
            );
            if kind == FINITE {
                // Within one part of a step of its surface; the hand feels what it is too far, and friction and cutting at most.
                record.under(
                    format!("where bone is met, mm off, {name}"),
                    (met - SURFACE_MM).abs(),
                    0.5 + 1e-9,
                );
                let pushed = BONE.stiffness_n_per_mm * (HAND_MM - met);
                let friction = USUAL.friction_n_per_mm * last.inserted_mm + USUAL.cutting_n;
                let off = (resistance(last) - pushed).abs();
                record.under(
                    format!("force off stiffness times way, over friction, {name}"),
                    off / friction,
                    1.0,
                );
            }
            travel(&mut *model, [HAND_MM, -3.0], step, |_| {})?;
            // What a fast needle has torn along out of the body slides off it as it is drawn on.
            travel(&mut *model, [-3.0, -23.0], 1.0, |_| {})?;
            record.zero(format!("force left, N, {name}"), model.outcome().on_hand.force_n.norm());
        }
    }
    Ok(())
}
