//! Case of the same insertion near the world origin and far from it.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::setup::{ASIDE, Layers, STEP_S, Watch, build, coarse, image, tissue};
use crate::mechanics::insertion::finite::{Options, Setup};
use crate::mechanics::insertion::spring::MassSpring;
use crate::mechanics::insertion::{Anatomy, EventKind, Instruments, Interaction, Model, Outcome, ProbeContact};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::needle::{Shaft, Stiffness};
use crate::study::block::{self, USUAL};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Offset, mm.
const AWAY_MM: [f64; 3] = [1e5, -1e5, 1e5];
/// Grid of the input coordinates, mm, on which the offset causes no rounding.
const GRID_MM: f64 = 1.0 / (1 << 20) as f64;
/// Half the spacing of doubles between 2^16 and 2^17 mm: the rounding error of one position.
const ROUNDING_MM: f64 = 1.0 / (1u64 << 37) as f64;
/// Maximum number of roundings of a position in one iteration or substep: the base, the twenty links of a needle, the nearest point of a
/// line, the addition of the displacement.
const ROUNDINGS: f64 = 32.0;
/// Upper limit of the stiffness of tissue or needle across a contact, N/mm (as in [`stiffness`](super::stiffness)).
const STIFFEST_N_PER_MM: f64 = 100.0;
/// Start and end depth and advance per step, mm: no step reaches a node, a face or a multiple of a spacing, so that rounding decides
/// nothing.
const WAY_MM: [f64; 3] = [-1.3125, 38.0, 0.375];
/// Number of the last steps that are also made backwards.
const BACK: usize = 40;

/// Insertion that is compared with its translated copy.
struct Case {
    name: &'static str,
    /// Creates the tissue model translated by a vector, mm.
    make: fn(&Vector3<f64>) -> Result<Box<dyn Model>, Unexpected>,
    probe: bool,
    /// Tolerance of the iterations, mm.
    tolerance_mm: f64,
}

fn cases() -> [Case; 4] {
    let tolerance_mm = Options::default().tolerance_mm;
    let finite = |name, make, probe| Case {
        name,
        make,
        probe,
        tolerance_mm,
    };
    [
        finite("a rigid needle", |by| Ok(Box::new(build(moved(by)?)?)), false),
        finite("a needle of springs", |by| bending(by, false), false),
        finite("a needle of springs and a probe", |by| bending(by, true), true),
        Case {
            name: "masses and springs",
            make: masses,
            probe: false,
            // The mass-spring model does not iterate.
            tolerance_mm: 0.0,
        },
    ]
}

fn moved(by: &Vector3<f64>) -> Result<Setup, Unexpected> {
    let near = tissue(USUAL)?;
    let place = |node: &[f64; 3]| (Vector3::from(*node).map(on_grid) + by).into();
    let nodes = near.mesh.nodes().iter().map(place).collect();
    let (elements, regions) = (near.mesh.elements().to_vec(), near.mesh.regions().to_vec());
    Ok(Setup {
        mesh: TetMesh::new(nodes, elements, regions)?,
        ..near
    })
}

fn bending(by: &Vector3<f64>, probe: bool) -> Result<Box<dyn Model>, Unexpected> {
    let near = tissue(USUAL)?;
    let under = |p: &[f64; 3]| p[1] == 0.0 && (p[0] - 30.0).abs() < 11.0 && (15.0..65.0).contains(&p[2]);
    let candidates = (0..).zip(near.mesh.nodes()).filter(|(_, p)| under(p));
    let contact = ProbeContact {
        nominal: pressed(0.0, by),
        length_mm: 60.0,
        candidates: candidates.map(|(node, _)| node).collect(),
        driven_at_mm: None,
    };
    let bevel = block::BEVEL;
    Ok(Box::new(build(Setup {
        needle: block::springs(Stiffness::default(), block::LINK_MM, bevel)?,
        probe: probe.then_some(contact),
        ..moved(by)?
    })?))
}

fn masses(by: &Vector3<f64>) -> Result<Box<dyn Model>, Unexpected> {
    let there = There {
        layers: Layers {
            border: f64::INFINITY,
            of: [USUAL; 2],
        },
        by: *by,
    };
    Ok(Box::new(MassSpring::new(coarse(), Box::new(there), block::rigid()?)?))
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
fn pressed(mm: f64, by: &Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from(Translation3::from(Vector3::new(30.0, mm - 10.0, 70.0) + by))
}

/// Places an oblique needle with its undeformed tip at a depth, and a probe that presses the more the deeper the needle.
fn instruments(depth: f64, probe: bool, by: &Vector3<f64>) -> Instruments {
    let turn = UnitQuaternion::from_euler_angles(-0.13, 0.09, 0.4);
    let axis = turn * Vector3::z();
    let tip = Vector3::new(ASIDE[0], ASIDE[1], 0.0) + axis * (depth / axis.z);
    let base = (tip - axis * Shaft::default().length_mm).map(on_grid) + by;
    let press = on_grid(depth.clamp(0.0, 20.0) / 4.0);
    Instruments {
        base: Isometry3::from_parts(Translation3::from(base), turn),
        probe: probe.then(|| pressed(press, by)),
        guide: None,
        deposit: false,
    }
}

/// Inserts and partly withdraws the needle; returns the outcome of each step and the final node positions, mm.
fn run(case: &Case, by: &Vector3<f64>, watch: &mut Watch) -> Result<(Vec<Outcome>, Vec<[f64; 3]>), Unexpected> {
    let mut model = (case.make)(by)?;
    let [from, to, step] = WAY_MM;
    let count = ((to - from) / step) as usize;
    let depths = (0..=count).chain((count - BACK..count).rev());
    let mut outcomes = Vec::new();
    for at in depths {
        let instruments = instruments(from + step * at as f64, case.probe, by);
        let outcome = model.step(&instruments, STEP_S)?;
        watch.see(outcome);
        outcomes.push(outcome.clone());
    }
    let mut nodes = image(&mut *model).current;
    for node in &mut nodes {
        *node = (Vector3::from(*node) - by).into();
    }
    Ok((outcomes, nodes))
}

/// Compares forces, tip and tissue of both, step by step.
pub fn moved_far(record: &mut Record<'_>) -> Result<(), Unexpected> {
    let by = Vector3::from(AWAY_MM);
    for case in &cases() {
        let name = case.name;
        let mut watch = Watch::default();
        let (near, near_nodes) = run(case, &Vector3::zeros(), &mut watch)?;
        let (far, far_nodes) = run(case, &by, &mut watch)?;
        watch.write(record, name);
        let what = |outcome: &Outcome| {
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
            pairs().filter(|(near, far)| what(near) != what(far)).count() as f64,
        );
        let longer = pairs().filter(|(near, far)| near.iterations != far.iterations).count();
        record.report(format!("steps with more or less iterations, {name}"), longer as f64);
        // Errors accumulate over the steps: positions of sticking nodes are those of the previous step.
        let rounds: usize = far.iter().map(|outcome| outcome.iterations.max(outcome.substeps)).sum();
        let tolerance_mm = if longer > 0 { case.tolerance_mm } else { 0.0 };
        let limit_mm = ROUNDINGS * ROUNDING_MM * rounds as f64 + tolerance_mm;
        let tips = pairs().flat_map(|(near, far)| (far.tip_mm - near.tip_mm - by).data.0[0]);
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
            [0, 1].map(|at| (far[at] - near[at]).norm())
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
