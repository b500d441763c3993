//! Cases of regions not resolved by elements: thin layers, borders along the needle, and bone.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::stability::fixtures::{
    ASIDE, CELL_MM, EXTENT, Layers, STEP_S, Watch, build, coarse, go, resistance, travel,
};
use crate::stability::record::{Record, Unexpected, largest};
use insonify_mechanics::block::{self, USUAL};
use insonify_mechanics::insertion::spring::MassSpring;
use insonify_mechanics::insertion::{Anatomy, Bone, EventKind, Instruments, Interaction, Model, Outcome};
use insonify_mechanics::needle::Shaft;
use insonify_mechanics::tissue::material::Material;
use insonify_mesh::TetMesh;

const SOFT: Interaction = Interaction {
    friction_n_per_mm: 0.01,
    cutting_n: 0.2,
    puncture_n: 0.0,
    ..block::USUAL
};
/// Interaction with a surface that punctures at 1.5 N.
const TOUGH: Interaction = Interaction {
    puncture_n: 1.5,
    ..SOFT
};
const BONE: Bone = Bone {
    stiffness_n_per_mm: 20.0,
    penetration_mm: 0.5,
};
/// Distance from the last border within which no border is counted, mm (`insertion::finite`).
const BORDER_MM: f64 = 0.5;

/// Region 0 below a skin through a point of the axis at z = 0, and region 1 between two planes.
#[derive(Clone, Copy, Debug)]
struct Slab {
    skin: Vector3<f64>,
    near_plane: (Vector3<f64>, f64),
    thick_mm: f64,
    interactions: [Interaction; 2],
}

impl Slab {
    /// Creates a slab whose region 1 starts at z = `from_mm`.
    fn level(from_mm: f64, thick_mm: f64, interactions: [Interaction; 2]) -> Slab {
        Slab {
            skin: Vector3::z(),
            near_plane: (Vector3::z(), from_mm),
            thick_mm,
            interactions,
        }
    }
}

impl Anatomy for Slab {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        let point = at_rest_mm - Point3::new(ASIDE[0], ASIDE[1], 0.0);
        let into = point.dot(&self.near_plane.0) - self.near_plane.1;
        (point.dot(&self.skin) >= 0.0).then_some(i32::from((0.0..self.thick_mm).contains(&into)))
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.interactions[usize::from(region == 1)]
    }
}

fn finite(slab: Slab, cell_mm: f64) -> Result<Box<dyn Model>, Unexpected> {
    let mesh = block::plain(EXTENT, cell_mm)?;
    let mut setup = block::on_table(mesh, Material::new(20.0, 0.45)?, SOFT, block::rigid()?);
    // Bone is fixed.
    let is_bone = |p: &[f64; 3]| {
        slab.region(&Point3::from(*p))
            .is_some_and(|region| slab.interaction(region).bone.is_some())
    };
    let fixed_nodes = (0..).zip(setup.mesh.nodes()).filter(|(_, p)| is_bone(p));
    setup
        .fixed
        .extend(fixed_nodes.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))));
    setup.anatomy = Some(Arc::new(slab));
    Ok(Box::new(build(setup)?))
}

fn springs_in(slab: Slab) -> Result<Box<dyn Model>, Unexpected> {
    Ok(Box::new(MassSpring::new(coarse(), Box::new(slab), block::rigid()?)?))
}

/// Places a needle along a direction with its tip `depth_mm` beyond the axis point at z = 0.
fn along(direction: &Vector3<f64>, depth_mm: f64) -> Instruments {
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), direction).unwrap_or_default();
    let tip = Vector3::new(ASIDE[0], ASIDE[1], 0.0) + direction * depth_mm;
    let base = Isometry3::from_parts(Translation3::from(tip - direction * Shaft::default().length_mm), turn);
    Instruments {
        base,
        ..block::tip_at([0.0; 3])
    }
}

/// Advances the needle in steps of 0.1 mm along a direction, starting 1 mm before the axis point.
fn push(
    model: &mut dyn Model,
    direction: &Vector3<f64>,
    to_mm: f64,
    mut see: impl FnMut(&Outcome),
) -> Result<Watch, Unexpected> {
    let mut watch = Watch::default();
    model.start(&along(direction, -1.0));
    for step in 1..=(10.0 * (to_mm + 1.0)).round() as usize {
        let outcome = model.step(&along(direction, 0.1 * step as f64 - 1.0), STEP_S)?;
        watch.see(outcome);
        see(outcome);
    }
    Ok(watch)
}

fn count(outcome: &Outcome, kind: EventKind) -> usize {
    outcome.events.iter().filter(|event| event.kind == kind).count()
}

/// Tests that a layer of a tenth of an element punctures at its own position and force, wherever it lies in the
/// element.
pub(crate) fn thin_layer(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let places = [11.0, 13.3, 15.7, 18.1, 19.6];
    let (mut place_off, mut force_off, mut missed) = (0.0, 0.0, 0);
    let mut watch = Watch::default();
    for (index, surface) in places.into_iter().enumerate() {
        record.done(index as f64 / places.len() as f64);
        // Without friction the hand feels only the tip.
        let smooth = |interaction: Interaction| Interaction {
            friction_n_per_mm: 0.0,
            ..interaction
        };
        let mut model = finite(Slab::level(surface, 1.0, [SOFT, TOUGH].map(smooth)), 10.0)?;
        let (mut before, mut broken) = ((0.0, 0.0f64), Vec::new());
        let pushed = push(model.as_mut(), &Vector3::z(), 40.0, |outcome| {
            let state = (outcome.tip_at_rest_mm.map_or(0.0, |point| point.z), resistance(outcome));
            if count(outcome, EventKind::Puncture) > 0 {
                broken.push((before.0, before.1.max(state.1)));
            }
            before = state;
        })?;
        watch.broken += pushed.broken;
        watch.unsettled += pushed.unsettled;
        watch.unreported += pushed.unreported;
        missed += broken.len().abs_diff(1);
        for (depth, force) in broken {
            place_off = largest([place_off, (depth - surface).abs()]);
            force_off = largest([force_off, (force - TOUGH.puncture_n).abs()]);
        }
    }
    watch.write(record, "thin layer");
    record.zero("punctures missed or beyond one a layer", missed as f64);
    record.under("where the layer breaks at rest, mm off", place_off, 0.15);
    record.under("force at which it breaks, N off", force_off, 0.1);
    Ok(())
}

/// Moves along a border, in it or crossing it at half a degree and back.
pub(super) fn interface(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for (tilt, name) in [(0.0, "in the border"), (0.5f64, "at 0.5 degrees")] {
        let normal = Vector3::new(tilt.to_radians().cos(), 0.0, tilt.to_radians().sin());
        let slab = Slab {
            near_plane: (normal, 20.0 * normal.z),
            ..Slab::level(0.0, f64::INFINITY, [SOFT, TOUGH])
        };
        let mut model = finite(slab, 10.0)?;
        let (mut crossings, mut excess) = (0, 0.0f64);
        let watch = push(model.as_mut(), &Vector3::z(), 60.0, |outcome| {
            crossings += count(outcome, EventKind::Region);
            let limit = TOUGH.puncture_n + SOFT.friction_n_per_mm * outcome.inserted_mm;
            excess = excess.max(resistance(outcome) - limit);
        })?;
        watch.write(record, name);
        record.under(format!("borders crossed, {name}"), crossings as f64, 60.0 / BORDER_MM);
        record.under(
            format!("force beyond that of the tougher side, N, {name}"),
            excess,
            1e-3,
        );
    }
    Ok(())
}

/// Punctures a skin at 30 degrees to it.
pub(super) fn oblique(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let direction = Vector3::new(3f64.sqrt(), 0.0, 1.0).normalize();
    let kinds = [
        (
            "finite elements",
            finite(Slab::level(2.0, f64::INFINITY, [TOUGH, SOFT]), 10.0)?,
        ),
        (
            "masses and springs",
            springs_in(Slab::level(2.0, f64::INFINITY, [TOUGH, SOFT]))?,
        ),
    ];
    for (name, mut model) in kinds {
        let (mut skin, mut excess) = (f64::NAN, 0.0f64);
        let watch = push(model.as_mut(), &direction, 30.0, |outcome| {
            if let Some(event) = outcome.events.iter().find(|event| event.kind == EventKind::Skin) {
                skin = event.at_mm.z;
            }
            let limit = TOUGH.puncture_n + SOFT.friction_n_per_mm * outcome.inserted_mm;
            excess = excess.max(-outcome.on_hand.force_n.dot(&direction) - limit);
        })?;
        watch.write(record, name);
        record.under(format!("where the skin is met, mm off, {name}"), skin.abs(), 1e-6);
        record.under(format!("force beyond puncture and friction, N, {name}"), excess, 0.05);
    }
    Ok(())
}

/// Meets bone whose surface lies at 5 degrees to the needle.
pub(crate) fn grazed_bone(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let tilt = 5f64.to_radians();
    let normal = Vector3::new(tilt.cos(), 0.0, tilt.sin());
    let bone = Interaction {
        bone: Some(BONE),
        ..SOFT
    };
    let slab = Slab {
        near_plane: (normal, 30.0 * normal.z),
        ..Slab::level(0.0, f64::INFINITY, [SOFT, bone])
    };
    for (name, mut model) in [
        ("finite elements", finite(slab, 10.0)?),
        ("masses and springs", springs_in(slab)?),
    ] {
        let (mut met_count, mut bone_mm, mut deepest, mut largest_excess) = (0, f64::INFINITY, 0.0f64, 0.0f64);
        let watch = push(model.as_mut(), &Vector3::z(), 60.0, |outcome| {
            if let Some(event) = outcome.events.iter().find(|event| event.kind == EventKind::Bone) {
                (met_count, bone_mm) = (met_count + 1, event.at_mm.z);
            }
            // Until bone is met it lies infinitely deep, so that no step counts.
            deepest = deepest.max(outcome.tip_mm.z - bone_mm);
            let soft_n = SOFT.friction_n_per_mm * outcome.inserted_mm + SOFT.cutting_n;
            largest_excess = largest_excess.max(resistance(outcome) - soft_n);
        })?;
        watch.write(record, name);
        record.zero(
            format!("times that bone is met, beyond once, {name}"),
            met_count as f64 - 1.0,
        );
        record.under(
            format!("depth along the needle, mm, {name}"),
            deepest,
            BONE.penetration_mm + 0.1,
        );
        let limit = BONE.stiffness_n_per_mm * BONE.penetration_mm;
        record.under(
            format!("force beyond the limit of bone, N, {name}"),
            largest_excess - limit,
            0.05,
        );
    }
    Ok(())
}

/// Oscillates the tip by 0.05 mm at the border of a surface already punctured.
pub(crate) fn wandering(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let mut model = finite(Slab::level(20.0, f64::INFINITY, [SOFT, TOUGH]), 10.0)?;
    let mut depth = 0.0;
    // Until the surface is punctured: the tip is then at the undeformed border.
    model.start(&along(&Vector3::z(), -1.0));
    let mut broken = false;
    while !broken && depth < 60.0 {
        depth += 0.02;
        broken = count(model.step(&along(&Vector3::z(), depth), STEP_S)?, EventKind::Puncture) > 0;
    }
    let (mut watch, mut crossings, mut largest_force) = (Watch::default(), 0, 0.0f64);
    for step in 0..1000 {
        let phase = 0.7 * f64::from(step);
        let mut hand = along(&Vector3::z(), depth + 0.05 * phase.sin());
        hand.base.translation.vector.x += 0.05 * (1.3 * phase).cos();
        let outcome = model.step(&hand, STEP_S)?;
        watch.see(outcome);
        crossings += count(outcome, EventKind::Puncture) + count(outcome, EventKind::Region);
        largest_force = largest([
            largest_force,
            resistance(outcome) - SOFT.friction_n_per_mm * outcome.inserted_mm,
        ]);
    }
    watch.write(record, "trembling");
    record.zero("the surface was not reached", f64::from(u8::from(!broken)));
    record.zero("borders crossed and surfaces broken again", crossings as f64);
    record.under("force beyond that of cutting, N", largest_force - SOFT.cutting_n, 0.05);
    Ok(())
}

/// Travel of the hand beyond the bone surface, mm.
const TOO_FAR_MM: f64 = 9.0;
/// Thickness of the bone in the finite-element model, mm.
const THICK_MM: f64 = 20.0;
const HIT_BONE: Bone = Bone {
    stiffness_n_per_mm: 10.0,
    penetration_mm: 0.3,
};

fn of_bone() -> Interaction {
    Interaction {
        bone: Some(HIT_BONE),
        ..Interaction::default()
    }
}

/// Creates a finite-element model with bone from a depth on (mm), fixed at its nodes so that its surface stays in
/// place.
fn finite_to_bone(surface: f64) -> Result<Box<dyn Model>, Unexpected> {
    let plain = block::plain(EXTENT, CELL_MM)?;
    let (nodes, elements) = (plain.nodes().to_vec(), plain.elements().to_vec());
    let deep = |z: f64| (surface..=surface + THICK_MM).contains(&z);
    let in_bone = |corners: &[u32; 4]| corners.iter().all(|node| deep(nodes[*node as usize][2]));
    let regions = elements.iter().map(|corners| i32::from(in_bone(corners))).collect();
    let mesh = TetMesh::new(nodes.clone(), elements, regions)?;
    let mut setup = block::on_table(mesh, Material::new(10.0, 0.45)?, USUAL, block::rigid()?);
    let fixed_nodes = (0..).zip(&nodes).filter(|(_, p)| deep(p[2]) || p[2] == EXTENT[2]);
    setup.fixed = fixed_nodes
        .flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis)))
        .collect();
    setup.interactions.push((1, of_bone()));
    Ok(Box::new(build(setup)?))
}

/// Creates a mass-spring model with bone from a depth on (mm), at its rest position whatever the springs do.
fn springs_to_bone(surface: f64) -> Result<Box<dyn Model>, Unexpected> {
    let layers = Layers {
        border: surface,
        interactions: [USUAL, of_bone()],
    };
    Ok(Box::new(MassSpring::new(coarse(), Box::new(layers), block::rigid()?)?))
}

type Make = fn(f64) -> Result<Box<dyn Model>, Unexpected>;

pub(super) fn hit(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let kinds = [
        ("finite elements", finite_to_bone as Make),
        ("masses and springs", springs_to_bone as Make),
    ];
    for (index, (kind, make)) in kinds.into_iter().enumerate() {
        for (situation_index, (surface, situation)) in [(50.0, "bone within"), (0.0, "bone at the surface")]
            .into_iter()
            .enumerate()
        {
            for (turn, step) in [1.0, 10.0].into_iter().enumerate() {
                record.done(0.5 * index as f64 + 0.25 * situation_index as f64 + 0.125 * turn as f64);
                let mut model = make(surface)?;
                let name = format!("{step} mm a step, {situation}, {kind}");
                hit_bone(record, &mut *model, surface, step, &name)?;
            }
        }
    }
    Ok(())
}

/// Pushes the needle into bone that begins at a depth (mm), and withdraws it.
fn hit_bone(
    record: &mut Record<'_>,
    model: &mut dyn Model,
    surface: f64,
    step: f64,
    name: &str,
) -> Result<(), Unexpected> {
    let before = -1.0;
    let hand = surface + TOO_FAR_MM;
    model.start(&block::tip_at([ASIDE[0], ASIDE[1], before]));
    let (mut watch, mut hits, mut deepest) = (Watch::default(), Vec::new(), 0.0);
    let mut largest_part = 0.0;
    travel(model, [before, hand], step, |outcome| {
        watch.see(outcome);
        let bone_events = outcome.events.iter().filter(|event| event.kind == EventKind::Bone);
        hits.extend(bone_events.map(|event| event.at_mm.z));
        deepest = largest([deepest, outcome.tip_mm.z]);
        largest_part = largest([largest_part, step / outcome.substeps as f64]);
    })?;
    watch.write(record, name);
    record.zero(
        format!("times that bone is met, beyond once, {name}"),
        hits.len() as f64 - 1.0,
    );
    let hit_mm = hits.first().copied().unwrap_or(f64::NAN);
    record.under(
        format!("where bone is met, mm off, {name}"),
        (hit_mm - surface).abs(),
        1e-9,
    );
    // Exceeds the limit only by the tip's advance within the substep in which it meets bone.
    record.under(
        format!("penetration, mm, {name}"),
        deepest - surface,
        HIT_BONE.penetration_mm + largest_part,
    );
    // The force on the hand is a mean over a step, here of one at rest.
    let pulled = go(model, hand)?;
    let pushed = HIT_BONE.stiffness_n_per_mm * HIT_BONE.penetration_mm;
    let friction = USUAL.friction_n_per_mm * pulled.inserted_mm + USUAL.cutting_n;
    let difference = (resistance(pulled) - pushed).abs();
    record.report(
        format!("force with the hand {TOO_FAR_MM} mm too far, N, {name}"),
        resistance(pulled),
    );
    record.under(
        format!("force off its limit, over friction, {name}"),
        difference / friction,
        1.0,
    );
    record.under(
        format!("penetration at rest, mm, {name}"),
        pulled.tip_mm.z - surface,
        HIT_BONE.penetration_mm + 1e-9,
    );
    travel(model, [hand, -3.0], step, |_| {})?;
    // Tissue that a fast needle has dragged out of the body slides off during further withdrawal.
    travel(model, [-3.0, -23.0], 1.0, |_| {})?;
    record.zero(format!("force left, N, {name}"), model.outcome().on_hand.force_n.norm());
    Ok(())
}
