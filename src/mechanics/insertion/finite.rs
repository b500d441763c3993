//! Finite element insertion: stick-slip contacts, remeshing at the tip, and a pressing probe (Goksel et al. 2011,
//! sections III to V).
//!
//! A step is cut into substeps (`travel`). In each, tissue, contacts and needle settle together (`settle`,
//! with the system of `joint`), then the tip is followed through the tissue (`path`).

mod body;
mod contact;
mod contacts;
mod joint;
mod location;
mod needle;
mod path;
mod prediction;
mod probe;
mod reduced;
mod saved;
mod settle;
mod setup;
#[cfg(test)]
mod tests;
mod tip;
mod tissue;

use std::sync::Arc;
use std::time::Instant;

use nalgebra::{Isometry3, Point3, Translation3, Unit, Vector3};

use super::imager::MeshImager;
use super::living::{Living, TissueMotion};
use super::validation::{BASE, check_pose};
use super::{
    Event, EventKind, Instruments, InvalidSetup, LevelChange, Model, NodeSolver, Outcome, Saved, ShaftLoad, Snapshot,
    StepCost, StepError, TissueAtTip, Work, Wrench,
};
use crate::needle::CentreLine;
use crate::tissue::remesh::{Adaptation, Level, Maker};
use body::CutTissue;
use contacts::Contacts;
use insonify_mesh::TetMesh;
use joint::Joint;
use needle::PlacedNeedle;
use prediction::Prediction;
use probe::ProbeNodes;
use settle::Attempt;
use setup::Base;
pub use setup::{FiniteOptions, Setup};
use tip::{Tip, TipLimits};
use tissue::Tissue;

/// Advance of the base below which it counts as resting (rounding), mm.
const STILL_MM: f64 = 1e-9;

/// Maximum motion by which tissue springs back over the tip before its forces are settled again, mm.
const SPRING_MM: f64 = 0.45;
/// Maximum number of these motions in a substep.
const MAX_SPRINGS: usize = 100;

/// Finite element model of tissue with a needle in it.
///
/// ```
/// use insonify_mechanics::insertion::finite::{Finite, FiniteOptions, Setup};
/// use insonify_mechanics::insertion::{Instruments, Interaction, Model};
/// use insonify_mechanics::needle::{Rigid, Shaft};
/// use insonify_mechanics::tissue::material::Material;
/// use insonify_mechanics::tissue::remesh::{Level, Precision};
/// use insonify_mesh::TetMesh;
/// use nalgebra::Isometry3;
///
/// // A block of 40 mm, held at its far face.
/// let mesh = TetMesh::over_box([0.0; 3], [40.0; 3], 216)?;
/// let far = (0u32..).zip(mesh.nodes()).filter(|(_, node)| node[2] == 40.0);
/// let tissue = Interaction { friction_n_per_mm: 0.02, cutting_n: 0.5, puncture_n: 1.0, ..Interaction::default() };
/// let setup = Setup {
///     materials: vec![Material::new(10.0, 0.45)?; mesh.elements().len()],
///     fixed: far.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect(),
///     interactions: vec![(0, tissue)],
///     anatomy: None,
///     needle: Box::new(Rigid::new(Shaft::default(), None)?),
///     probe: None,
///     level: Level::Exact,
///     precision: Precision::Double,
///     options: FiniteOptions::default(),
///     mesh,
/// };
/// let mut model = Finite::new(setup, |_, _| {})?;
///
/// // The hand pushes a needle of 200 mm along z, 0.5 mm a step.
/// for step in 0..=40 {
///     let base = Isometry3::translation(19.0, 21.0, 0.5 * f64::from(step) - 200.0);
///     model.step(&Instruments { base, probe: None, guide: None, deposit: false }, 5e-3)?;
/// }
/// let outcome = model.outcome();
/// assert!(outcome.inserted_mm > 10.0 && outcome.on_hand.force_n.z < -0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Finite {
    /// Hashes of the needle and of the tissue.
    fingerprint: [String; 2],
    base: Base,
    options: FiniteOptions,
    body: CutTissue,
    tissue: Tissue,
    needle: PlacedNeedle,
    tip: Tip,
    contacts: Contacts,
    joint: Joint,
    attempt: Attempt,
    prediction: Prediction,
    log: Log,
    /// Centre line of the unloaded needle.
    unloaded: CentreLine,
}

/// Progress and outcome of the steps.
#[derive(Debug, Default)]
struct Log {
    steps: u64,
    time_s: f64,
    /// Pose of the base given by the hand at the end of the last step.
    base: Option<Isometry3<f64>>,
    seeds: Vec<Point3<f64>>,
    outcome: Outcome,
    cost: StepCost,
}

impl Log {
    fn note(&mut self, kind: EventKind, at_mm: Point3<f64>, region: Option<i32>) {
        self.outcome.events.push(Event {
            kind,
            time_s: self.time_s,
            at_mm,
            region,
        });
    }
}

impl Finite {
    /// Builds a model of the tissue at rest, with no instrument near.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn new(setup: Setup, mut progress: impl FnMut(usize, usize) + Send) -> Result<Finite, InvalidSetup> {
        setup.build(None, &mut progress)
    }

    /// Builds a model as [`Finite::new`] does, with remeshers from `maker`, here and at every change of level. If one
    /// of their devices fails, the model continues on the CPU, and the outcome contains an event.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn with_maker(
        setup: Setup,
        maker: Maker,
        mut progress: impl FnMut(usize, usize) + Send,
    ) -> Result<Finite, InvalidSetup> {
        setup.build(Some(maker), &mut progress)
    }

    /// Lets the tissue move by itself, from the start of the run.
    pub fn live(&mut self, motions: Vec<TissueMotion>) {
        if motions.is_empty() {
            return;
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.fingerprint[1].as_bytes());
        for motion in &motions {
            hasher.update(bytemuck::cast_slice(&motion.displacements));
        }
        self.fingerprint[1] = setup::short(hasher.finalize());
        let (mesh, locator) = (Arc::clone(&self.tissue.mesh), Arc::clone(&self.tissue.locator));
        self.tissue.living = Some(Living::new(motions, mesh, locator));
    }

    /// Returns the mesh at rest.
    pub fn mesh(&self) -> &Arc<TetMesh> {
        &self.tissue.mesh
    }

    /// Returns the mesh with its remesher.
    pub fn adaptation(&self) -> &Adaptation {
        &self.tissue.adaptation
    }

    /// Returns the number of free degrees of freedom around moved nodes (|S|), with which the cost of an exact remesh
    /// grows.
    pub fn support_size(&self) -> usize {
        self.tissue.adaptation.mesh().support().count()
    }

    /// Returns the nodes on the needle, base first: node, arc from the base (mm), and force on the tissue (N, world
    /// axes).
    pub fn contact_forces(&self) -> impl Iterator<Item = (u32, f64, Vector3<f64>)> + '_ {
        let pairs = self.contacts.nodes.iter().zip(&self.contacts.forces);
        pairs.map(|(contact, force)| (contact.node, contact.arc, *force))
    }

    /// Returns the nodes on the needle, base first, and whether each of them sticks to it.
    pub fn contact_states(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        let contacts = self.contacts.nodes.iter();
        contacts.map(|contact| (contact.node, contact.slider.is_stuck()))
    }

    /// Computes in advance the compliance columns that remeshing along a path will read: a path of `length_mm` from
    /// `from` along `direction` that deviates by up to `aside_mm` in the tissue at rest, because the needle bends or a
    /// probe moves the tissue. Without a dense inverse, each node on the path otherwise costs some milliseconds when
    /// the tip comes near.
    pub fn prefetch(&mut self, from: &Point3<f64>, direction: &Vector3<f64>, length_mm: f64, aside_mm: f64) {
        self.tissue.prefetch(from, direction, length_mm, aside_mm);
    }

    /// Moves the instruments to their new poses, in substeps short enough that no element is skipped.
    /// Tissue that moves by itself does so meanwhile, in the last `dt_s` (s).
    fn travel(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>, dt_s: f64) {
        let start = self.log.base.unwrap_or_else(|| self.beginning(base));
        let pressed = self.tissue.probe.as_ref();
        let probe_from = pressed.and_then(|probe| probe.pose);
        let mut motion = farthest(&start, base, self.needle.length_mm());
        if let (Some(start), Some(to), Some(pressed)) = (&probe_from, probe, pressed) {
            motion = motion.max(farthest(start, to, pressed.length_mm()));
        }
        let [from_s, to_s] = [self.log.time_s - dt_s, self.log.time_s];
        if let Some(living) = &self.tissue.living {
            motion = motion.max(living.farthest_mm(from_s, to_s));
        }
        let parts = (motion / self.options.part_mm)
            .ceil()
            .clamp(1.0, self.options.most_parts as f64);
        for part in 1..=parts as usize {
            let share = part as f64 / parts;
            // The last pose is exactly the given one.
            let between = |start: &Isometry3<f64>, to: &Isometry3<f64>| {
                if share < 1.0 { start.lerp_slerp(to, share) } else { *to }
            };
            let probe = probe.map(|to| between(probe_from.as_ref().unwrap_or(to), to));
            if let Some(living) = &mut self.tissue.living {
                living.go_to(if share < 1.0 { from_s + share * dt_s } else { to_s });
            }
            self.substep(&between(&start, base), probe.as_ref());
            self.log.outcome.substeps += 1;
        }
        self.log.base = Some(*base);
    }

    /// Returns the pose of the base before the first step: a needle that begins in the body has been pushed in along
    /// its axis.
    fn beginning(&mut self, base: &Isometry3<f64>) -> Isometry3<f64> {
        let PlacedNeedle { model, line, .. } = &mut self.needle;
        model.place(base, None, &[], &[], line);
        let (tip, length_mm) = (line.tip(), model.length_mm());
        if self.is_in_body(&tip) {
            base * Translation3::new(0.0, 0.0, -length_mm)
        } else {
            *base
        }
    }

    /// Returns whether a point lies in the body where no instrument displaces it.
    fn is_in_body(&mut self, point: &Point3<f64>) -> bool {
        let anatomy = self.body.anatomy.as_ref();
        if self.tissue.living.is_none() {
            return anatomy.region(point).is_some();
        }
        let place = self.tissue.enter(anatomy, point);
        place.is_some_and(|place| anatomy.region(&self.tissue.point_at(&place)).is_some())
    }

    fn substep(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        self.contacts.start();
        let mut motion_mm = self.tissue.press(probe);
        // Motions of the needle are those in the tissue, which may move by itself.
        let (carried, sheared_mm) = self.carry_along();
        let before = self.needle.base.map(|before| Translation3::from(carried) * before);
        let advance = before.map_or(0.0, |before| advance(&before, base));
        let advance = if advance.abs() < STILL_MM { 0.0 } else { advance };
        motion_mm += sheared_mm;
        motion_mm += before.map_or(0.0, |before| farthest(&before, base, self.needle.length_mm()));
        self.tip.dent.advance(advance);
        self.log.cost.count(Work::Search);
        self.contacts.approach(motion_mm);
        self.contacts.extrapolate(advance);
        self.settle(base);
        self.contacts.note_drift(advance);
        if self.limit_depth_in_bone() {
            self.settle(base);
        }
        if self.release(advance) {
            self.settle(base);
        }
        let was_in_bone = self.tip.in_bone();
        if self.tip.is_broken() {
            self.spring_back(base, advance);
        } else {
            self.tip.break_surface(&self.needle.line, &mut self.log);
            if self.advance(advance, TipLimits::of(motion_mm)) {
                self.settle(base);
            }
        }
        // Bone met in this substep.
        if !was_in_bone && self.tip.in_bone() {
            self.limit_depth_in_bone();
            self.settle(base);
        }
        self.contacts.stick_again();
        self.log.cost.count(Work::Search);
    }

    /// Carries the entry of the needle along with tissue that moves by itself. Returns the way of the tissue at the tip,
    /// and the longest by which that at other contacts differs from it, mm.
    fn carry_along(&mut self) -> (Vector3<f64>, f64) {
        let Some(living) = &self.tissue.living else {
            return (Vector3::zeros(), 0.0);
        };
        let at_tip = self.tip.at_rest(&self.needle).zip(self.tip.element);
        let at_tip = at_tip.map_or_else(Vector3::zeros, |(at_rest, element)| {
            self.tissue.own(&at_rest, element, Living::way)
        });
        let contacts = self.contacts.nodes.iter();
        let ways = contacts.map(|contact| living.way(contact.node, contact.reference.into()));
        let (mut at_entry, mut sheared_mm) = (None, 0.0f64);
        for way in ways {
            at_entry.get_or_insert(way);
            sheared_mm = sheared_mm.max((way - at_tip).norm());
        }
        if let Some(entry) = &mut self.needle.entry {
            entry.point_mm += at_entry.unwrap_or(at_tip);
        }
        (at_tip, sheared_mm)
    }

    /// Lets tissue whose surface has broken spring back over the tip, until the tip is held again.
    fn spring_back(&mut self, base: &Isometry3<f64>, advance: f64) {
        for _ in 0..MAX_SPRINGS {
            let before = self.tip.reference;
            self.tip.release_all(&self.needle.tip().tangent);
            self.settle(base);
            if self.advance(advance, TipLimits::springing(SPRING_MM)) {
                self.settle(base);
            }
            if self.tip.surface.is_some() || (self.tip.reference - before).norm() < SPRING_MM / 8.0 {
                break;
            }
        }
        self.tip.spring_back_ends();
        self.settle(base);
    }

    fn limit_depth_in_bone(&mut self) -> bool {
        self.tip.limit_depth_in_bone(&self.body, &self.needle.line)
    }

    /// Leaves a seed at the tip, if it is in tissue.
    fn deposit(&mut self) {
        let Some(place) = self.tip.at_rest(&self.needle) else {
            return;
        };
        self.log.seeds.push(place);
        self.log.note(EventKind::Seed, self.needle.line.tip(), self.tip.region);
    }

    fn conclude(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        let (contacts, line) = (&self.contacts, &self.needle.line);
        let about = Point3::from(base.translation.vector);
        let mut on_hand = Wrench::default();
        let tip = line.tip();
        for (index, force) in contacts.forces.iter().enumerate() {
            on_hand.add(-force, &line.point_at_arc(contacts.arcs[index]).point_mm, &about);
        }
        on_hand.add(self.tip.bone_force(line), &tip, &about);
        let mut on_probe = None;
        if let (Some(nodes), Some(probe)) = (&self.tissue.probe, probe) {
            let mut wrench = Wrench::default();
            let about = Point3::from(probe.translation.vector);
            for (row, force) in self.joint.tissue.probe_forces(&self.tissue.loads) {
                wrench.add(-row.direction * force, &nodes.place(row.contact), &about);
            }
            on_probe = Some(wrench);
        }
        let first_arc = contacts.nodes.first().map_or(f64::INFINITY, |contact| contact.arc);
        let end = self.tip.end_in_tissue(contacts, line);
        // The straight needle as measured, its bevel included; at bone it lags behind the hand.
        let measured = self.tip.stopped(base);
        self.needle.model.place(&measured, None, &[], &[], &mut self.unloaded);
        let outcome = &mut self.log.outcome;
        outcome.on_hand = on_hand;
        outcome.on_probe = on_probe;
        outcome.tip_mm = tip;
        outcome.tip_at_rest_mm = self.tip.at_rest(&self.needle);
        outcome.tip_deflection_mm = (tip - self.unloaded.tip()).norm();
        outcome.inserted_mm = if self.tip.is_at_skin() {
            0.0
        } else {
            (end - first_arc).max(self.tip.depth_without_node_mm(&self.needle))
        };
        outcome.contacts = contacts.nodes.len();
        outcome.stuck = contacts
            .nodes
            .iter()
            .filter(|contact| contact.slider.is_stuck())
            .count();
        outcome.probe_contacts = self.tissue.probe.as_ref().map_or(0, ProbeNodes::touching);
        outcome.remeshes = self.tissue.remeshes;
        outcome.crushed = self.tissue.crushed;
    }

    /// Settles at the pose of the last step and returns the force on the hand there, N.
    fn settle_again(&mut self) -> Vector3<f64> {
        let Some(base) = self.log.base.filter(|_| self.log.steps > 0) else {
            return Vector3::zeros();
        };
        self.contacts.start();
        self.settle(&base);
        let probe = self.tissue.probe.as_ref().and_then(|probe| probe.pose);
        self.conclude(&base, probe.as_ref());
        self.log.outcome.on_hand.force_n
    }

    /// Takes over a compliance that may differ in every entry.
    fn take_new_compliance(&mut self) {
        self.tissue.forget_compliance();
        self.prediction = Prediction::default();
        self.take_compliance();
        self.take_forces();
    }

    fn change_level(&mut self, level: Level) -> Result<LevelChange, InvalidSetup> {
        let start = Instant::now();
        self.base.prepare(level)?;
        let from = self.tissue.adaptation.remesher().level();
        // Settled before and after, so that the jump of the force is that of the level, not of a step left unfinished.
        let before = self.settle_again();
        let adaptation = &mut self.tissue.adaptation;
        let condensed = adaptation.remesher().condensed().to_owned();
        if (level == Level::Exact) == (from == Level::Exact) {
            adaptation.with_fallback(|mesh, remesher| remesher.set_level(mesh, level))?;
        } else {
            let (source, precision) = self.base.source(level, &self.options);
            adaptation.switch_source(level, precision, source)?;
        }
        self.take_new_compliance();
        let now = self.tissue.adaptation.remesher().condensed();
        let largest = condensed.norm_max();
        Ok(LevelChange {
            from,
            to: level,
            compliance_change: if largest > 0.0 {
                (now - &condensed).norm_max() / largest
            } else {
                0.0
            },
            force_jump_n: (self.settle_again() - before).norm(),
            seconds: start.elapsed().as_secs_f64(),
        })
    }
}

/// Returns the advance of a base along the shaft, mm.
fn advance(from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    let axis = to.rotation * Vector3::z();
    axis.dot(&(to.translation.vector - from.translation.vector))
}

/// Returns an upper bound of the displacement of any point of an instrument of this length (mm) along z, mm.
fn farthest(from: &Isometry3<f64>, to: &Isometry3<f64>, length: f64) -> f64 {
    let shift = (to.translation.vector - from.translation.vector).norm();
    shift + length * from.rotation.angle_to(&to.rotation)
}

impl Model for Finite {
    fn start(&mut self, instruments: &Instruments) {
        let tip = instruments.base * Point3::new(0.0, 0.0, self.needle.length_mm());
        let is_new = self.log.steps == 0 && check_pose(BASE, &instruments.base).is_ok();
        if is_new && !self.is_in_body(&tip) {
            self.log.base = Some(instruments.base);
        }
    }

    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
        instruments.check(dt_s)?;
        self.log.steps += 1;
        self.log.time_s += dt_s;
        let was_crushed = self.tissue.crushed > 0;
        self.log.outcome.begin();
        self.log.cost.start();
        (self.tissue.remeshes, self.tissue.crushed) = (0, 0);
        self.needle.guide = instruments.guide;
        let advance = self.log.base.map_or(0.0, |from| advance(&from, &instruments.base));
        self.travel(&instruments.base, instruments.probe.as_ref(), dt_s);
        if instruments.deposit {
            self.deposit();
        }
        self.conclude(&instruments.base, instruments.probe.as_ref());
        let (tissue, log) = (&mut self.tissue, &mut self.log);
        // Steps that remesh take longest: deferred work waits for one that does not.
        if tissue.remeshes == 0 {
            let (contacts, needle, tip) = (&self.contacts, &self.needle, &self.tip);
            self.prediction
                .renew(advance < 0.0, contacts, needle, tip, tissue, &self.options);
            if tissue.adaptation.run_deferred().is_some() {
                tissue.version += 1;
            }
        }
        let tip = log.outcome.tip_mm;
        if tissue.adaptation.take_failure().is_some() {
            tissue.version += 1;
            log.note(EventKind::DeviceLost, tip, None);
        }
        if tissue.crushed > 0 && !was_crushed {
            log.note(EventKind::Crushed, tip, None);
        }
        if !log.outcome.converged {
            log.note(EventKind::NotConverged, tip, None);
        }
        log.cost.count(Work::Rest);
        Ok(&self.log.outcome)
    }

    fn outcome(&self) -> &Outcome {
        &self.log.outcome
    }

    fn cost(&self) -> Option<&StepCost> {
        Some(&self.log.cost)
    }

    fn tip_direction(&self) -> Option<Unit<Vector3<f64>>> {
        self.needle.line.direction()
    }

    fn shaft_loads(&self, into: &mut Vec<ShaftLoad>) {
        into.clear();
        let (contacts, line) = (&self.contacts, &self.needle.line);
        if line.nodes().is_empty() || self.needle.entry.is_none() {
            return;
        }
        contacts.shaft_loads(line, self.tip.end_in_tissue(contacts, line), into);
        if let Some(tip) = into.last_mut() {
            tip.force_n += self.tip.bone_force(line);
        }
    }

    fn snapshot(&mut self, into: &mut Snapshot) {
        into.step = self.log.steps;
        into.time_s = self.log.time_s;
        into.line.clone_from(&self.needle.line);
        into.seeds.clone_from(&self.log.seeds);
        self.tissue.write_snapshot(into);
        into.at_tip = self.tip.at_rest(&self.needle).and_then(|at_rest| {
            let place = self.tissue.locate_at_rest(&at_rest, self.tip.element?)?;
            Some(TissueAtTip {
                tip_mm: self.needle.line.tip(),
                corners: self.tissue.mesh.elements()[place.element as usize],
                shares: place.bary,
                radius_mm: self.body.patch_mm,
            })
        });
    }

    fn imager(&self) -> Box<dyn NodeSolver> {
        let dofs = self.tissue.adaptation.mesh().dofs().clone();
        let base = (Arc::clone(&self.base.factor), dofs);
        let living = self.tissue.living.clone();
        Box::new(MeshImager::new(Arc::clone(&self.tissue.mesh), Some(base), living))
    }

    fn set_level(&mut self, level: Level) -> Result<LevelChange, StepError> {
        Ok(self.change_level(level)?)
    }

    fn save(&mut self) -> Saved {
        self.save_state()
    }

    fn restore(&mut self, saved: &Saved) -> Result<(), StepError> {
        self.restore_state(saved)
    }
}
