//! Finite element insertion: stick-slip contacts, remeshing at the tip, and a pressing probe (Goksel et al. 2011, sections
//! III to V).

mod channel;
mod contact;
mod entry;
mod fetch;
mod forces;
mod friction;
mod imager;
mod joint;
mod level;
mod location;
mod nearby;
mod path;
mod place;
mod prediction;
mod probe_contact;
mod reduced;
mod saved;
mod settle;
mod setup;
mod slider;
mod substep;
#[cfg(test)]
mod tests;
mod tip;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    Anatomy, Event, EventKind, Imager, Instruments, LevelChange, Model, Outcome, Saved, Snapshot, StepError, Wrench,
};
use crate::mechanics::mesh::{Locator, TetMesh};
use crate::mechanics::needle::{CentreLine, Entry, Load, Needle, Row};
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::remesh::{Adaptation, Level, Maker, Precision, Source};
use channel::Channel;
use contact::Contact;
use imager::FiniteImager;
use joint::{Joint, Yielding};
use nearby::Nearby;
use prediction::Outlook;
use probe_contact::ProbeNodes;
pub use setup::{InvalidSetup, Options, Setup};
use slider::Slider;
use substep::advance;
use tip::Tip;

/// Finite element model of tissue with a needle in it.
pub struct Finite {
    mesh: Arc<TetMesh>,
    locator: Arc<Locator<f64>>,
    /// Elements at the surface faces at rest, with the face centres (mm).
    surface: Vec<(u32, Point3<f64>)>,
    /// Whether each node is on the surface.
    on_surface: Vec<bool>,
    factor: Arc<Factor>,
    /// Dense inverse, once a level has needed it.
    dense: Option<Source>,
    precision: Precision,
    adaptation: Adaptation,
    anatomy: Arc<dyn Anatomy>,
    needle: Box<dyn Needle>,
    press: Option<ProbeNodes>,
    options: Options,

    steps: u64,
    time_s: f64,
    /// Pose of the base given by the hand at the end of the last step.
    base: Option<Isometry3<f64>>,
    line: CentreLine,
    entry: Option<Entry>,
    /// Guide hole of the needle, mm.
    guide: Option<Point3<f64>>,
    contacts: Vec<Contact>,
    /// Forces on the tissue at the contacts, at the tip, on the guide, and of fading loads, N.
    forces: Vec<Vector3<f64>>,
    /// Whether `forces` has entries for tip and guide.
    laid: [bool; 2],
    /// Arcs of released contacts that still load the needle, mm; their forces are last in `forces`.
    fading: Vec<f64>,
    tip: Tip,
    channel: Channel,
    seeds: Vec<Point3<f64>>,
    outcome: Outcome,

    joint: Joint,
    /// Counter of changes to the contacts or the mesh.
    version: u64,
    /// Version of the compliance that the joint holds.
    condensed: Option<u64>,
    nearby: Nearby,
    carried: Vec<(usize, f64)>,
    /// Linearised response of the needle where forces act.
    yielding: Yielding,
    /// Inputs of the last remesh prediction given to the remesher.
    outlook: Option<Outlook>,
    memory: Memory,
}

/// Buffers kept from step to step, to avoid allocation.
#[derive(Debug, Default)]
struct Memory {
    starts: Vec<f64>,
    arcs: Vec<f64>,
    loads: Vec<Load>,
    rows: Vec<Row>,
    before: CentreLine,
    about: Vec<Load>,
    kept: Kept,
    forces: Vec<Vector3<f64>>,
    contact_forces: Vec<f64>,
    dofs: Vec<usize>,
}

/// State at the beginning of an attempt.
#[derive(Debug, Default)]
struct Kept {
    base: Option<Isometry3<f64>>,
    line: CentreLine,
    forces: Vec<Vector3<f64>>,
    /// Arcs and sliders.
    contacts: Vec<(f64, Slider)>,
    tip: Option<Slider>,
}

impl Finite {
    /// Builds a model of the tissue at rest, with no instrument near.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn new(setup: Setup, progress: impl FnMut(usize, usize) + Send) -> Result<Finite, InvalidSetup> {
        setup.build(None, progress)
    }

    /// Builds a model as [`Finite::new`] does, with remeshers from `maker`, here and at every change of level. If one of
    /// their devices fails, the model continues on the CPU, and the outcome contains an event.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn with_maker(
        setup: Setup,
        maker: Maker,
        progress: impl FnMut(usize, usize) + Send,
    ) -> Result<Finite, InvalidSetup> {
        setup.build(Some(maker), progress)
    }

    /// Returns the mesh at rest.
    pub fn mesh(&self) -> &Arc<TetMesh> {
        &self.mesh
    }

    /// Returns the mesh with its remesher.
    pub fn adaptation(&self) -> &Adaptation {
        &self.adaptation
    }

    /// Returns the number of free degrees of freedom around moved nodes (|S|), with which the cost of an exact remesh grows.
    pub fn held(&self) -> usize {
        self.adaptation.mesh().support().count()
    }

    /// Returns the nodes on the needle, base first: node, arc from the base (mm), and force on the tissue (N, world axes).
    pub fn contact_forces(&self) -> impl Iterator<Item = (u32, f64, Vector3<f64>)> + '_ {
        let pairs = self.contacts.iter().zip(&self.forces);
        pairs.map(|(contact, force)| (contact.node, contact.arc, *force))
    }

    /// Returns the nodes on the needle, base first, and whether each of them sticks to it.
    pub fn contact_states(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        let contacts = self.contacts.iter();
        contacts.map(|contact| (contact.node, contact.slider.is_stuck()))
    }

    /// Computes in advance the compliance columns that remeshing along a path will read: a path of `length_mm` from `from`
    /// along `direction` that deviates by up to `aside_mm` in the tissue at rest, because the needle bends or a probe moves
    /// the tissue. Without a dense inverse, each node on the path otherwise costs some milliseconds when the tip comes near.
    pub fn prefetch(&mut self, from: &Point3<f64>, direction: &Vector3<f64>, length_mm: f64, aside_mm: f64) {
        self.fetch_along(from, direction, length_mm, aside_mm);
    }

    fn note(&mut self, kind: EventKind, at_mm: Point3<f64>, region: Option<i32>) {
        self.outcome.events.push(Event {
            kind,
            time_s: self.time_s,
            at_mm,
            region,
        });
    }

    /// Gathers the forces by degree of freedom on all contacts: those of the probe, then those of the needle.
    fn carry(&mut self) {
        let forces = &mut self.memory.contact_forces;
        forces.clear();
        let probes = self.press.as_ref().map_or(0, |press| press.nodes().len());
        forces.resize(3 * probes, 0.0);
        for (row, force) in self.joint.tissue.probe_forces(&self.forces) {
            for axis in 0..3 {
                forces[3 * row.contact + axis] += force * row.direction[axis];
            }
        }
        let needle = self.forces.iter().take(self.contacts.len());
        forces.extend(needle.flat_map(|force| [force.x, force.y, force.z]));
        forces.resize(forces.len() + 3 * self.tip.corners.len(), 0.0);
        if let (Some(row), [true, _]) = (&self.tip.row, self.laid) {
            let force = self.forces[self.contacts.len()];
            for (node, share) in row.shares.into_iter().filter(|(_, share)| *share != 0.0) {
                (0..3).for_each(|axis| forces[3 * node + axis] += share * force[axis]);
            }
        }
        if self
            .adaptation
            .parts()
            .1
            .carried_forces(forces, &mut self.carried)
            .is_err()
        {
            unreachable!("one force a contact");
        }
        self.nearby.renew();
    }

    fn conclude(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        let about = Point3::from(base.translation.vector);
        let mut on_hand = Wrench::default();
        let tip = self.line.tip();
        for (at, force) in self.forces.iter().enumerate() {
            let place = self.line.at(self.memory.arcs[at]).point_mm;
            on_hand.add(-force, &place, &about);
        }
        on_hand.add(self.tip.bone_force(&self.line), &tip, &about);
        let mut on_probe = None;
        if let (Some(press), Some(probe)) = (&self.press, probe) {
            let mut wrench = Wrench::default();
            let about = Point3::from(probe.translation.vector);
            for (row, force) in self.joint.tissue.probe_forces(&self.forces) {
                wrench.add(-row.direction * force, &press.place(row.contact), &about);
            }
            on_probe = Some(wrench);
        }
        // The straight needle as measured, its bevel included; at bone it lags behind the hand.
        let measured = self.tip.held(base);
        self.needle.place(&measured, None, &[], &[], &mut self.memory.before);
        let first = self.contacts.first().map_or(f64::INFINITY, |contact| contact.arc);
        let end = self.end_in_tissue();
        let at_rest = self.tip_at_rest();
        let bare = self.depth_of_bare();
        let outcome = &mut self.outcome;
        outcome.on_hand = on_hand;
        outcome.on_probe = on_probe;
        outcome.tip_mm = tip;
        outcome.tip_at_rest_mm = at_rest;
        outcome.tip_deflection_mm = (tip - self.memory.before.tip()).norm();
        outcome.inserted_mm = (end - first).max(bare);
        outcome.contacts = self.contacts.len();
        outcome.stuck = self.contacts.iter().filter(|contact| contact.slider.is_stuck()).count();
        outcome.probe_contacts = self.press.as_ref().map_or(0, ProbeNodes::touching);
    }
}

/// Checks that the values of a step are finite.
fn finite(what: &'static str, values: impl IntoIterator<Item = f64>) -> Result<(), StepError> {
    match values.into_iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(found) => Err(StepError::Input {
            what,
            found,
            expected: "finite numbers",
        }),
    }
}

/// Returns all numbers of a pose.
fn numbers(pose: &Isometry3<f64>) -> impl Iterator<Item = f64> {
    pose.to_homogeneous().data.0.into_iter().flatten()
}

impl Model for Finite {
    fn start(&mut self, instruments: &Instruments) {
        let tip = instruments.base * Point3::new(0.0, 0.0, self.needle.length_mm());
        if self.steps == 0 && numbers(&instruments.base).all(f64::is_finite) && self.anatomy.region(&tip).is_none() {
            self.base = Some(instruments.base);
        }
    }

    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
        finite("the pose of the needle's base", numbers(&instruments.base))?;
        if let Some(probe) = &instruments.probe {
            finite("the pose of the probe", numbers(probe))?;
        }
        if let Some(guide) = &instruments.guide {
            finite("the guide", guide.iter().copied())?;
        }
        if !(dt_s.is_finite() && dt_s > 0.0) {
            return Err(StepError::Input {
                what: "the time",
                found: dt_s,
                expected: "a finite number of seconds above 0",
            });
        }
        self.steps += 1;
        self.time_s += dt_s;
        let was_crushed = self.outcome.crushed > 0;
        self.outcome.begin();
        self.guide = instruments.guide;
        let advance = self.base.map_or(0.0, |from| advance(&from, &instruments.base));
        self.travel(&instruments.base, instruments.probe.as_ref());
        if instruments.deposit {
            self.deposit();
        }
        self.conclude(&instruments.base, instruments.probe.as_ref());
        if self.outcome.remeshes == 0 {
            self.predict_remesh(advance < 0.0);
            if self.adaptation.tend().is_some() {
                self.version += 1;
            }
        }
        if self.adaptation.take_failure().is_some() {
            self.version += 1;
            self.note(EventKind::DeviceLost, self.outcome.tip_mm, None);
        }
        if self.outcome.crushed > 0 && !was_crushed {
            self.note(EventKind::Crushed, self.outcome.tip_mm, None);
        }
        if !self.outcome.converged {
            self.note(EventKind::NotConverged, self.outcome.tip_mm, None);
        }
        Ok(&self.outcome)
    }

    fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    fn snapshot(&mut self, into: &mut Snapshot) {
        self.write_snapshot(into);
    }

    fn imager(&self) -> Box<dyn Imager> {
        let dofs = self.adaptation.mesh().dofs().clone();
        Box::new(FiniteImager::new(
            Arc::clone(&self.mesh),
            Arc::clone(&self.factor),
            dofs,
        ))
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
