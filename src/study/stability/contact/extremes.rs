//! Cases of extreme stiffness, bending, displacements and coordinates.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::stability::fixtures::{
    ASIDE, Layers, STEP_S, Watch, build, coarse, displaced, go, image, resistance, springs, tissue, travel,
};
use crate::stability::record::{Record, Unexpected, largest};
use insonify_mechanics::block::{self, USUAL};
use insonify_mechanics::insertion::finite::{Finite, FiniteOptions, Setup};
use insonify_mechanics::insertion::spring::MassSpring;
use insonify_mechanics::insertion::{
    Anatomy, EventKind, Instruments, Interaction, Model, Outcome, ProbeContact, Snapshot,
};
use insonify_mechanics::needle::{Bevel, Shaft, Stiffness};
use insonify_mechanics::tissue::material::Material;
use insonify_mesh::TetMesh;

/// Depth of the insertion, mm.
const DEPTH_MM: f64 = 50.0;
/// Advance per step, mm.
const ADVANCE_MM: f64 = 0.5;
/// Amplitude of the subsequent oscillation, mm.
const SWING_MM: f64 = 0.2;
/// Steps per period of it.
const SWING_STEPS: usize = 10;
/// Force difference allowed, N: the response of a dissipative system to periodic motion is periodic, to the tolerance
/// of the iterations (1e-5 mm) through stiffnesses below 100 N/mm.
const SAME_N: f64 = 1e-3;

/// Inserts the needle, then oscillates it.
pub(super) fn contrasts(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let default_nmm2 = Stiffness::default().bending_nmm2();
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
    for (index, (needle, young_kpa)) in cases.into_iter().enumerate() {
        record.done(index as f64 / cases.len() as f64);
        let bevel = Bevel {
            r_mm: 0.6,
            ..block::BEVEL
        };
        let tissue = tissue(block::USUAL)?;
        let mut finite = build(Setup {
            needle: block::springs(Stiffness::BendingNmm2(needle * default_nmm2), block::LINK_MM, bevel)?,
            materials: vec![Material::new(young_kpa, 0.45)?; tissue.mesh.elements().len()],
            ..tissue
        })?;
        let name = format!("needle x {needle:e}, tissue {young_kpa} kPa");
        let mut watch = Watch::default();
        for step in 0..=(DEPTH_MM / ADVANCE_MM) as usize {
            watch.see(go_guided(&mut finite, step as f64 * ADVANCE_MM)?);
        }
        let (mut first_size, mut last_size) = (0.0, 0.0);
        for step in 0..steps {
            let phase = std::f64::consts::TAU * step as f64 / SWING_STEPS as f64;
            let outcome = go_guided(&mut finite, DEPTH_MM - SWING_MM * phase.sin())?;
            watch.see(outcome);
            let size = outcome.on_hand.force_n.norm();
            // The first periods are the transient.
            if (2 * SWING_STEPS..steps / 2).contains(&step) {
                first_size = largest([first_size, size]);
            } else if step >= steps / 2 {
                last_size = largest([last_size, size]);
            }
        }
        watch.write(record, &name);
        record.under(
            format!("growth of the force to and fro, N, {name}"),
            last_size - first_size,
            SAME_N,
        );
        record.report(format!("largest force to and fro, N, {name}"), last_size);
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
fn go_guided(finite: &mut Finite, z: f64) -> Result<&Outcome, Unexpected> {
    Ok(finite.step(&block::guided([ASIDE[0], ASIDE[1], z]), STEP_S)?)
}

/// Turns the base of an inserted needle about the skin, so that the shaft bends between hand and tip.
pub(crate) fn bent_far(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const TURN_DEG: f64 = 60.0;
    let steps: usize = record.effort().pick(60, 600);
    let every_case = [(1.0, 10.0), (0.1, 100.0), (1.0, 100.0)];
    let cases = record.effort().pick(&every_case[..1], &every_case[..]);
    for (index, &(needle, young_kpa)) in cases.iter().enumerate() {
        record.done(index as f64 / cases.len() as f64);
        let tissue = tissue(USUAL)?;
        let stiffness = Stiffness::BendingNmm2(needle * Stiffness::default().bending_nmm2());
        let mut finite = build(Setup {
            needle: block::springs(stiffness, block::LINK_MM, block::BEVEL)?,
            materials: vec![Material::new(young_kpa, 0.45)?; tissue.mesh.elements().len()],
            ..tissue
        })?;
        let mut watch = Watch::default();
        travel(&mut finite, [-1.0, DEPTH_MM], 0.25, |outcome| watch.see(outcome))?;
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
            let [base, tip] =
                [0.0, line.length_mm() - block::BEVEL.length_mm - 1.0].map(|arc| line.point_at_arc(arc).tangent);
            bent = bent.max(base.angle(&tip).to_degrees());
        }
        let name = format!("needle x {needle}, tissue {young_kpa} kPa");
        travel(&mut finite, [DEPTH_MM, -60.0], 0.25, |outcome| watch.see(outcome))?;
        watch.write(record, &name);
        // The hand turns by 60 degrees; a soft shaft bows between hand and skin, and its buried part may tilt the other
        // way.
        record.report(format!("bend, degrees, {name}"), bent);
        record.zero(
            format!("force left, N, {name}"),
            finite.outcome().on_hand.force_n.norm(),
        );
        record.zero(format!("displacement left, mm, {name}"), displaced(&image(&mut finite)));
    }
    Ok(())
}

/// Compares 50 mm in one step with many steps.
pub(crate) fn large_step(record: &mut Record<'_>) -> Result<(), Unexpected> {
    const FROM_TO_MM: [f64; 2] = [-2.0, 48.0];
    // Substeps are no longer than this, mm.
    let part_mm = insonify_mechanics::insertion::finite::FiniteOptions::default().part_mm;
    let models: [(&str, Box<dyn Fn() -> Result<Box<dyn Model>, Unexpected>>, f64); 2] = [
        (
            "finite elements",
            Box::new(|| Ok(Box::new(build(tissue(USUAL)?)?))),
            part_mm,
        ),
        (
            "masses and springs",
            Box::new(|| Ok(Box::new(springs(coarse(), USUAL)?))),
            1.0,
        ),
    ];
    for (name, make, part_mm) in models {
        let mut long = make()?;
        let mut watch = Watch::default();
        watch.see(go(&mut *long, FROM_TO_MM[0])?);
        let outcome = go(&mut *long, FROM_TO_MM[1])?.clone();
        watch.see(&outcome);
        let mut short = make()?;
        go(&mut *short, FROM_TO_MM[0])?;
        travel(&mut *short, FROM_TO_MM, 0.1, |_| {})?;
        let short_outcome = short.outcome();
        watch.write(record, name);
        let needed = (FROM_TO_MM[1] - FROM_TO_MM[0]) / part_mm;
        record.under(format!("parts missing, {name}"), needed - outcome.substeps as f64, 0.0);
        record.under(
            format!("contacts unlike those of small steps, {name}"),
            outcome.contacts.abs_diff(short_outcome.contacts) as f64,
            1.0,
        );
        let order = [EventKind::Skin, EventKind::Puncture];
        let in_order = outcome.events.iter().map(|event| event.kind).zip(order);
        record.zero(
            format!("skin and puncture not seen, {name}"),
            2.0 - in_order.filter(|(kind, expected)| kind == expected).count() as f64,
        );
        record.report(
            format!("force unlike that of small steps, N, {name}"),
            (resistance(&outcome) - resistance(short_outcome)).abs(),
        );
    }
    Ok(())
}

/// Pushes a probe far through tissue and back, with a needle inserted meanwhile.
pub(super) fn crushed(record: &mut Record<'_>) -> Result<(), Unexpected> {
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
    let mut crushed_events = 0;
    let mut step = |finite: &mut dyn Model, shift: f64, z: f64| -> Result<Outcome, Unexpected> {
        let instruments = Instruments {
            probe: Some(pose(shift)),
            ..block::tip_at([ASIDE[0], 50.0, z])
        };
        let outcome = finite.step(&instruments, STEP_S)?.clone();
        watch.see(&outcome);
        crushed_events += outcome
            .events
            .iter()
            .filter(|event| event.kind == EventKind::Crushed)
            .count();
        Ok(outcome)
    };
    step(&mut finite, 45.0, -5.0)?;
    let tissue = image(&mut finite);
    let broken = tissue.current.as_flattened().iter().filter(|x| !x.is_finite()).count();
    record.zero("non-finite coordinates", broken as f64);
    record.report("elements inverted", tissue.inverted as f64);
    record.zero("crushed tissue not detected", f64::from(u8::from(tissue.inverted == 0)));
    // A needle inserted there either converges or reports that it does not.
    for count in 0..80 {
        step(&mut finite, 45.0, 0.5 * f64::from(count) - 2.0)?;
    }
    for count in 0..90 {
        step(&mut finite, 45.0, 38.0 - 0.5 * f64::from(count))?;
    }
    let back = step(&mut finite, 0.0, -7.0)?;
    watch.write(record, "a needle in crushed tissue");
    record.report("events of crushed tissue", crushed_events as f64);
    let force_n = back.on_probe.map_or(f64::NAN, |wrench| wrench.force_n.norm());
    record.under("force left on the probe, N", force_n, 1e-6);
    record.under("displacement left, mm", largest([displaced(&image(&mut finite))]), 1e-6);
    Ok(())
}

/// Offset, mm.
const AWAY_MM: [f64; 3] = [1e5, -1e5, 1e5];
/// Grid of the input coordinates, mm, on which the offset causes no rounding.
const GRID_MM: f64 = 1.0 / (1 << 20) as f64;
/// Half the spacing of doubles between 2^16 and 2^17 mm: the rounding error of one position.
const ROUNDING_MM: f64 = 1.0 / (1u64 << 37) as f64;
/// Maximum number of roundings of a position in one iteration or substep: the base, the twenty links of a needle, the
/// nearest point of a line, the addition of the displacement.
const ROUNDINGS: f64 = 32.0;
/// Upper limit of the stiffness of tissue or needle across a contact, N/mm (as in [`stiffness`](super::stiffness)).
const STIFFEST_N_PER_MM: f64 = 100.0;
/// Start and end depth of the insertion far away, mm: with its advance no step reaches a node, a face or a multiple of
/// a spacing, so that rounding decides nothing.
const AWAY_FROM_TO_MM: [f64; 2] = [-1.3125, 38.0];
/// Its advance per step, mm.
const AWAY_ADVANCE_MM: f64 = 0.375;
/// Number of the last steps that are also made backwards.
const BACK: usize = 40;

/// Insertion that is compared with its translated copy.
struct Insertion {
    name: &'static str,
    /// Creates the tissue model translated by a vector, mm.
    make: fn(&Vector3<f64>) -> Result<Box<dyn Model>, Unexpected>,
    probe: bool,
    /// Tolerance of the iterations, mm.
    tolerance_mm: f64,
}

fn cases() -> [Insertion; 4] {
    let tolerance_mm = FiniteOptions::default().tolerance_mm;
    let finite = |name, make, probe| Insertion {
        name,
        make,
        probe,
        tolerance_mm,
    };
    [
        finite("a rigid needle", |offset| Ok(Box::new(build(moved(offset)?)?)), false),
        finite("a needle of springs", |offset| bending(offset, false), false),
        finite("a needle of springs and a probe", |offset| bending(offset, true), true),
        Insertion {
            name: "masses and springs",
            make: masses,
            probe: false,
            // The mass-spring model does not iterate.
            tolerance_mm: 0.0,
        },
    ]
}

fn moved(offset: &Vector3<f64>) -> Result<Setup, Unexpected> {
    let near = tissue(USUAL)?;
    let moved_node = |node: &[f64; 3]| (Vector3::from(*node).map(on_grid) + offset).into();
    let nodes = near.mesh.nodes().iter().map(moved_node).collect();
    let (elements, regions) = (near.mesh.elements().to_vec(), near.mesh.regions().to_vec());
    Ok(Setup {
        mesh: TetMesh::new(nodes, elements, regions)?,
        ..near
    })
}

fn bending(offset: &Vector3<f64>, probe: bool) -> Result<Box<dyn Model>, Unexpected> {
    let near = tissue(USUAL)?;
    let under = |p: &[f64; 3]| p[1] == 0.0 && (p[0] - 30.0).abs() < 11.0 && (15.0..65.0).contains(&p[2]);
    let candidates = (0..).zip(near.mesh.nodes()).filter(|(_, p)| under(p));
    let contact = ProbeContact {
        nominal: pressed(0.0, offset),
        length_mm: 60.0,
        candidates: candidates.map(|(node, _)| node).collect(),
        driven_at_mm: None,
    };
    let bevel = block::BEVEL;
    Ok(Box::new(build(Setup {
        needle: block::springs(Stiffness::default(), block::LINK_MM, bevel)?,
        probe: probe.then_some(contact),
        ..moved(offset)?
    })?))
}

fn masses(offset: &Vector3<f64>) -> Result<Box<dyn Model>, Unexpected> {
    let moved_block = There {
        layers: Layers {
            border: f64::INFINITY,
            interactions: [USUAL; 2],
        },
        by: *offset,
    };
    Ok(Box::new(MassSpring::new(
        coarse(),
        Box::new(moved_block),
        block::rigid()?,
    )?))
}

/// Layers translated by a vector.
#[derive(Debug)]
struct There {
    layers: Layers,
    by: Vector3<f64>,
}

impl Anatomy for There {
    fn region(&self, point_mm: &Point3<f64>) -> Option<i32> {
        self.layers.region(&(point_mm - self.by))
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.layers.interaction(region)
    }
}

fn on_grid(x: f64) -> f64 {
    (x / GRID_MM).round() * GRID_MM
}

/// Places the probe below the block, pressed into it by `mm`.
fn pressed(mm: f64, offset: &Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from(Translation3::from(Vector3::new(30.0, mm - 10.0, 70.0) + offset))
}

/// Places an oblique needle with its undeformed tip at a depth, and a probe that presses the more the deeper the
/// needle.
fn instruments(depth: f64, probe: bool, offset: &Vector3<f64>) -> Instruments {
    let turn = UnitQuaternion::from_euler_angles(-0.13, 0.09, 0.4);
    let axis = turn * Vector3::z();
    let tip = Vector3::new(ASIDE[0], ASIDE[1], 0.0) + axis * (depth / axis.z);
    let base = (tip - axis * Shaft::default().length_mm).map(on_grid) + offset;
    let press = on_grid(depth.clamp(0.0, 20.0) / 4.0);
    Instruments {
        base: Isometry3::from_parts(Translation3::from(base), turn),
        probe: probe.then(|| pressed(press, offset)),
        guide: None,
        deposit: false,
    }
}

/// Inserts and partly withdraws the needle; returns the outcome of each step and the final node positions, mm.
fn run(
    case: &Insertion,
    offset: &Vector3<f64>,
    watch: &mut Watch,
) -> Result<(Vec<Outcome>, Vec<[f64; 3]>), Unexpected> {
    let mut model = (case.make)(offset)?;
    let [from, to] = AWAY_FROM_TO_MM;
    let count = ((to - from) / AWAY_ADVANCE_MM) as usize;
    let depths = (0..=count).chain((count - BACK..count).rev());
    let mut outcomes = Vec::new();
    for advance in depths {
        let instruments = instruments(from + AWAY_ADVANCE_MM * advance as f64, case.probe, offset);
        let outcome = model.step(&instruments, STEP_S)?;
        watch.see(outcome);
        outcomes.push(outcome.clone());
    }
    let mut nodes = image(&mut *model).current;
    for node in &mut nodes {
        *node = (Vector3::from(*node) - offset).into();
    }
    Ok((outcomes, nodes))
}

/// Compares forces, tip and tissue of both, step by step.
pub(crate) fn moved_far(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let offset = Vector3::from(AWAY_MM);
    for case in &cases() {
        let name = case.name;
        let mut watch = Watch::default();
        let (near, near_nodes) = run(case, &Vector3::zeros(), &mut watch)?;
        let (far, far_nodes) = run(case, &offset, &mut watch)?;
        watch.write(record, name);
        let discrete = |outcome: &Outcome| {
            let events = outcome
                .events
                .iter()
                .map(|event| event.kind)
                .collect::<Vec<EventKind>>();
            (outcome.contacts, outcome.probe_contacts, outcome.remeshes, events)
        };
        let pairs = || near.iter().zip(&far);
        record.zero(
            format!("steps with other contacts, remeshes or events, {name}"),
            pairs().filter(|(near, far)| discrete(near) != discrete(far)).count() as f64,
        );
        let longer = pairs().filter(|(near, far)| near.iterations != far.iterations).count();
        record.report(format!("steps with more or less iterations, {name}"), longer as f64);
        // Errors accumulate over the steps: positions of sticking nodes are those of the previous step.
        let rounds: usize = far.iter().map(|outcome| outcome.iterations.max(outcome.substeps)).sum();
        let tolerance_mm = if longer > 0 { case.tolerance_mm } else { 0.0 };
        let limit_mm = ROUNDINGS * ROUNDING_MM * rounds as f64 + tolerance_mm;
        let tips = pairs().flat_map(|(near, far)| (far.tip_mm - near.tip_mm - offset).data.0[0]);
        record.under(format!("tip off, mm, {name}"), largest(tips), limit_mm);
        let nodes = near_nodes.as_flattened().iter().zip(far_nodes.as_flattened());
        record.under(
            format!("tissue off, mm, {name}"),
            largest(nodes.map(|(near, far)| far - near)),
            limit_mm,
        );
        let wrenches = |outcome: &Outcome| {
            let probe = outcome.on_probe.unwrap_or_default();
            [outcome.on_hand.force_n, probe.force_n]
        };
        let forces = pairs().flat_map(|(near, far)| {
            let [near, far] = [near, far].map(wrenches);
            [0, 1].map(|index| (far[index] - near[index]).norm())
        });
        record.under(
            format!("force off, N, {name}"),
            largest(forces),
            limit_mm * STIFFEST_N_PER_MM,
        );
        record.report(
            format!("largest force, N, {name}"),
            largest(near.iter().map(|outcome| outcome.on_hand.force_n.norm())),
        );
    }
    Ok(())
}
