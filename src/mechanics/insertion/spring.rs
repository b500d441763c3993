//! Mass-spring model of tissue in a cylinder around the needle path: the faster alternative to finite elements, after
//! Zhu et al. 2007 (section 2.2).
//!
//! Before the needle breaks the skin there is no mesh but an [`Anatomy`], which gives the regions. The elements of the
//! cylinder are made with the model and never change; its position is set when the tip enters the body: from the point
//! of entry along the needle. Until then it lies in front of the tip of the first step, at rest, so that an image made
//! from it shows the undeformed tissue. Every entry from outside places it again, at rest; after the needle has come
//! out it stays until then. Its side and its far end are fixed. Tissue is one material throughout; regions differ in
//! their interaction with the needle. Only bone is met where it lies in the undeformed body: it does not yield.
//!
//! Nodes on the shaft form a stack; its last node is held at the tip until it is penetrated: when the far face of the
//! element in front of the tip is within `lambda` circumferences of the tip. Then the corner of that face nearest to
//! the needle is moved to the tip and becomes the tip node. Withdrawing the needle empties the tip, and nodes that come
//! off the needle return to their rest positions, last first. The tip pushes its node with at most the tissue's
//! `cutting_n` (`puncture_n` where a surface is met): a node that needs more slides back along the shaft under that
//! force. A surface with a `puncture_n` breaks at that force alone, any other as the rule of Zhu et al. has it, or at
//! `cutting_n`; with a large `cutting_n` the rule alone decides. Regions are met one by one along the way of the tip in
//! the tissue at rest.
//!
//! A step is cut into equal substeps: so many that springs and damping are stable ([`MassSpring::explicit_limit_s`]),
//! up to [`MassSpringParameters::most_substeps`], and that in none of them base or tip moves farther than half the
//! range of the penetration rule, up to [`MAX_PARTS`]. If a substep is still too long for stability, the tissue is
//! simulated for the longest stable time instead: it then approaches equilibrium more slowly, but reaches the same one.
//! A step that would need more than `MAX_PARTS` is reported as not converged. In each substep the needle's shape is
//! computed once, from the forces of the substep before; a flexible needle is then coupled to the tissue by its
//! flexibility (one linear solve), which is as good as iterated while the needle turns little in a substep.
//!
//! The force on the hand is the mean over the substeps of a step.

mod body;
mod contacts;
mod cylinder;
mod geometry;
mod network;
mod saving;
mod step;
mod tip_events;

#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, Unit, Vector3};

use super::imager::NetworkImager;
use super::{
    Anatomy, EventKind, Field, Instruments, Model, NodeSolver, Outcome, Saved, ShaftLoad, Snapshot, StepError, Wrench,
};
use crate::insertion::InvalidSetup;
use crate::needle::{CentreLine, Load, Needle, check_needle};
use body::{NeedleState, unloaded_tip};
use contacts::Contacts;
use cylinder::Cylinder;
pub(crate) use cylinder::MIN_DIHEDRAL_DEG;
pub use cylinder::{MAX_NODES, MassSpringParameters};
use network::Network;

/// Maximum number of substeps.
pub const MAX_PARTS: usize = 4096;

/// Mass-spring model of tissue with a needle.
/// ```
/// use insonify_mechanics::insertion::spring::{MassSpring, MassSpringParameters};
/// use insonify_mechanics::insertion::{Anatomy, EventKind, Instruments, Interaction, Model};
/// use insonify_mechanics::needle::{Rigid, Shaft};
/// use nalgebra::{Isometry3, Point3};
///
/// /// Tissue from z = 0 on.
/// #[derive(Debug)]
/// struct Below;
///
/// impl Anatomy for Below {
///     fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
///         (at_rest_mm.z >= 0.0).then_some(1)
///     }
///
///     fn interaction(&self, _: i32) -> Interaction {
///         Interaction { friction_n_per_mm: 0.01, cutting_n: 0.2, ..Interaction::default() }
///     }
/// }
///
/// let parameters = MassSpringParameters { length_mm: Some(40.0), ..MassSpringParameters::default() };
/// let shaft = Shaft { length_mm: 100.0, radius_mm: 0.6 };
/// let mut model = MassSpring::new(parameters, Box::new(Below), Box::new(Rigid::new(shaft, None)?))?;
/// let mut events = Vec::new();
/// for step in 0..40 {
///     let tip_mm = -2.0 + 0.3 * f64::from(step);
///     let base = Isometry3::translation(0.0, 0.0, tip_mm - shaft.length_mm);
///     let instruments = Instruments { base, probe: None, guide: None, deposit: false };
///     let outcome = model.step(&instruments, 0.01)?;
///     events.extend(outcome.events.iter().map(|event| event.kind));
/// }
/// assert_eq!(events[0], EventKind::Skin);
/// // The tissue pushes the hand back out.
/// assert!(model.outcome().inserted_mm > 5.0 && model.outcome().on_hand.force_n.z < 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct MassSpring {
    /// Parameters and needle as text, to recognise saved states of others. A needle's own text changes with the shape
    /// that it was last asked for.
    name: String,
    parameters: MassSpringParameters,
    anatomy: Box<dyn Anatomy>,
    needle: Box<dyn Needle>,
    network: Network,
    contacts: Contacts,
    body: NeedleState,
    outcome: Outcome,
    /// Frame of the cylinder to world.
    frame: Isometry3<f64>,
    loads: Vec<Load>,
    /// The straight needle as measured at its base, its bevel included.
    measured: CentreLine,
    skin_nodes: usize,
    /// Elements of the mesh, then of the cap before the skin.
    imaged: Arc<[[u32; 4]]>,
    least_dihedral_deg: f64,
    /// Length of the shortest edge at the original positions, mm.
    spacing_mm: f64,
}

impl MassSpring {
    /// Builds a model at rest. `anatomy` is the body that the needle enters.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn new(
        parameters: MassSpringParameters,
        anatomy: Box<dyn Anatomy>,
        mut needle: Box<dyn Needle>,
    ) -> Result<MassSpring, InvalidSetup> {
        // Before the name is taken, which a needle's shape may change.
        let named = format!("{needle:?}");
        check_needle(&mut *needle)?;
        let cylinder = Cylinder::new(&parameters)?;
        let (skin_nodes, least_dihedral_deg) = (cylinder.skin_nodes, cylinder.least_dihedral_deg);
        let imaged = [cylinder.mesh.elements(), &cylinder.cap].concat().into();
        let network = Network::new(cylinder, &parameters);
        let capacity = 4 * parameters.layers();
        Ok(MassSpring {
            // By the name of the type in states that were saved before.
            name: format!("mass-spring, version 2, {parameters:?}, {named}")
                .replace("MassSpringParameters", "Parameters"),
            spacing_mm: network.shortest_edge_mm(),
            parameters,
            anatomy,
            needle,
            network,
            contacts: Contacts::new(capacity),
            body: NeedleState::default(),
            outcome: Outcome::default(),
            frame: Isometry3::identity(),
            loads: Vec::with_capacity(capacity + 1),
            measured: CentreLine::default(),
            skin_nodes,
            imaged,
            least_dihedral_deg,
        })
    }

    /// Nodes of the cap before the skin, mm.
    fn cap(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        let before = self.frame.rotation * Vector3::z() * self.parameters.radius_mm;
        let skin = &self.network.original[..self.skin_nodes];
        skin.iter().map(move |node| (node - before).into())
    }

    /// Returns the least angle between two faces of an element at the original positions, degrees.
    pub fn least_dihedral_deg(&self) -> f64 {
        self.least_dihedral_deg
    }

    /// Returns the longest stable substep with every node at its rest position, s.
    pub fn explicit_limit_s(&self) -> f64 {
        self.network.limit_s
    }

    /// Returns the elastic and kinetic energy of the tissue, N mm.
    pub fn energy_nmm(&self) -> f64 {
        self.network.energy()
    }

    /// Returns whether the tissue moves or may move; steps of resting tissue without a needle are skipped.
    pub fn is_active(&self) -> bool {
        self.body.active
    }

    /// Returns the pose of the base before the first step: a needle that begins in the body has been pushed in along
    /// its axis.
    fn begin(&mut self, base: &Isometry3<f64>) -> Isometry3<f64> {
        self.needle.place(base, None, &[], &[], &mut self.body.line);
        let inside = self.anatomy.region(&self.body.line.tip()).is_some();
        let back = if inside { self.needle.length_mm() } else { 0.0 };
        let start = base * Translation3::new(0.0, 0.0, -back);
        self.needle.place(&start, None, &[], &[], &mut self.body.line);
        let tip = self.tip();
        self.put(&tip_events::frame_at(&tip.point_mm, &tip.tangent));
        start
    }

    fn put(&mut self, frame: &Isometry3<f64>) {
        self.frame = *frame;
        self.network.place(frame);
    }

    /// Returns the number of substeps, and whether it is as large as required.
    fn parts(&self, from: &Isometry3<f64>, to: &Isometry3<f64>, dt_s: f64) -> (usize, bool) {
        let for_stability = if self.body.active {
            (dt_s / self.network.limit_s).ceil()
        } else {
            1.0
        };
        let length = self.needle.length_mm();
        let base = (to.translation.vector - from.translation.vector).norm();
        let tip = (unloaded_tip(to, length) - unloaded_tip(from, length)).norm();
        let farthest = 1.5 * self.parameters.lambda * self.spacing_mm;
        let for_motion = (base.max(tip) / farthest).ceil();
        let max_substeps = self.parameters.most_substeps as f64;
        let parts = for_stability
            .min(max_substeps)
            .max(for_motion)
            .clamp(1.0, MAX_PARTS as f64);
        (parts as usize, for_motion <= MAX_PARTS as f64)
    }

    /// Fills in the results known only at the end of a step.
    fn conclude(&mut self, instruments: &Instruments, parts: usize) {
        let tip = self.body.line.tip();
        let length = self.body.line.length_mm();
        // Where bone stops the tip the base lags behind the hand: that is no deflection of the needle.
        let measured = self
            .body
            .bone_contact
            .map_or(instruments.base, |contact| contact.stopped(&instruments.base, length));
        self.needle.place(&measured, None, &[], &[], &mut self.measured);
        let inside = self.body.active && !self.contacts.stack.is_empty();
        let location = inside
            .then(|| self.network.locate(&tip.coords, self.body.element))
            .flatten();
        let at_rest =
            location.map(|(element, coordinates)| Point3::from(self.network.to_reference(element, &coordinates)));
        if let Some(position) = at_rest.filter(|_| instruments.deposit) {
            self.body.seeds.push(position);
            self.event(EventKind::Seed, tip, self.body.region);
        }
        let crushed = self
            .network
            .crushed(self.contacts.stack.iter().map(|contact| contact.node));
        if crushed > 0 && self.outcome.crushed == 0 {
            self.event(EventKind::Crushed, tip, self.body.region);
        }
        let stack = &self.contacts.stack;
        self.outcome = Outcome {
            // Summed over the substeps so far; the hand feels their mean.
            on_hand: Wrench {
                force_n: self.outcome.on_hand.force_n / parts as f64,
                torque_nmm: self.outcome.on_hand.torque_nmm / parts as f64,
            },
            tip_mm: tip,
            tip_at_rest_mm: at_rest,
            tip_deflection_mm: (tip - self.measured.tip()).norm(),
            inserted_mm: stack.first().map_or(0.0, |first| (length - first.arc).max(0.0)),
            contacts: stack.len(),
            stuck: stack.iter().filter(|contact| contact.stuck).count(),
            substeps: parts,
            iterations: parts,
            crushed,
            events: std::mem::take(&mut self.outcome.events),
            ..self.outcome
        };
    }
}

impl Model for MassSpring {
    fn start(&mut self, instruments: &Instruments) {
        let base = &instruments.base;
        let tip = unloaded_tip(base, self.needle.length_mm());
        let is_new = self.body.base.is_none() && instruments.check(1.0).is_ok();
        if is_new && self.anatomy.region(&tip).is_none() {
            self.body.base = Some(self.begin(base));
        }
    }

    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
        instruments.check(dt_s)?;
        let end = instruments.base;
        let start = match self.body.base {
            Some(base) => base,
            None => self.begin(&end),
        };
        let (parts, enough) = self.parts(&start, &end, dt_s);
        self.body.step += 1;
        self.body.time_s += dt_s;
        self.outcome.on_hand = Wrench::default();
        self.outcome.remeshes = 0;
        self.outcome.converged = enough;
        self.outcome.events.clear();
        // Explicit integration is stable up to the network's limit only: where that would take more parts than allowed,
        // the tissue is slower than time, and forces stay finite.
        let h = (dt_s / parts as f64).min(self.network.limit_s);
        let mut before = start;
        for part in 1..=parts {
            let share = part as f64 / parts as f64;
            let hand = if part == parts || start == end {
                end
            } else {
                start.try_lerp_slerp(&end, share, f64::EPSILON).unwrap_or(end)
            };
            self.part(&before, &hand, h);
            before = hand;
        }
        self.body.base = Some(end);
        if !enough {
            self.event(EventKind::NotConverged, self.body.line.tip(), self.body.region);
        }
        self.conclude(instruments, parts);
        self.settle();
        Ok(&self.outcome)
    }

    fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    fn tip_direction(&self) -> Option<Unit<Vector3<f64>>> {
        self.body.line.direction()
    }

    fn shaft_loads(&self, into: &mut Vec<ShaftLoad>) {
        into.clear();
        let (stack, length) = (&self.contacts.stack, self.body.line.length_mm());
        for (index, contact) in stack.iter().enumerate() {
            let from_mm = contact.arc.min(length);
            let next = stack.get(index + 1).map_or(length, |next| next.arc.min(length));
            into.push(ShaftLoad {
                from_mm,
                to_mm: next.max(from_mm),
                force_n: contact.force,
            });
        }
        if let (Some(contact), Some(base)) = (&self.body.bone_contact, &self.body.base) {
            into.push(ShaftLoad {
                from_mm: length,
                to_mm: length,
                force_n: contact.force(base, self.needle.length_mm()),
            });
        }
    }

    fn snapshot(&mut self, into: &mut Snapshot) {
        into.step = self.body.step;
        into.time_s = self.body.time_s;
        into.line.clone_from(&self.body.line);
        into.seeds.clone_from(&self.body.seeds);
        into.moved.clear();
        let reference = (0..).zip(&self.network.reference);
        into.moved
            .extend(reference.map(|(node, position)| (node, (*position).into())));
        let count = self.network.reference.len() as u32;
        into.moved.extend((count..).zip(self.cap()));
        let mut field = match std::mem::take(&mut into.field) {
            Field::Displacement(field) => field,
            Field::BaseForces(_) => Vec::new(),
        };
        field.clear();
        field.extend(
            self.network
                .displacement
                .iter()
                .map(|&displacement| <[f64; 3]>::from(displacement)),
        );
        into.field = Field::Displacement(field);
    }

    fn imager(&self) -> Box<dyn NodeSolver> {
        Box::new(NetworkImager {
            elements: Arc::clone(&self.imaged),
            first: self
                .network
                .original
                .iter()
                .map(|&node| node.into())
                .chain(self.cap())
                .collect(),
        })
    }

    fn save(&mut self) -> Saved {
        self.to_saved()
    }

    fn restore(&mut self, saved: &Saved) -> Result<(), StepError> {
        self.take_saved(saved)
    }
}
