//! Saved states of a finite element insertion.

use std::fmt::Display;

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::body::Channel;
use super::contact::Contact;
use super::probe::ProbeNodes;
use super::tissue::Tissue;
use super::{Finite, Tip};
use crate::insertion::{Saved, StepError};
use crate::needle::{CentreLine, Entry};
use crate::tissue::dofs::NO_DOF;
use crate::tissue::remesh::{Adaptation, RemeshError};

/// Tolerance of the length of a unit vector.
const UNIT: f64 = 1e-9;

/// Everything that a step depends on except the remeshing level, which belongs to the model.
#[derive(Serialize, Deserialize)]
struct State {
    nodes: usize,
    elements: usize,
    /// Hashes of the needle and of the tissue; none in states that are older than they.
    #[serde(default)]
    fingerprint: Option<[String; 2]>,
    steps: u64,
    time_s: f64,
    base: Option<Isometry3<f64>>,
    /// Pose of the probe, and whether each candidate touches it.
    probe: Option<(Option<Isometry3<f64>>, Vec<bool>)>,
    line: CentreLine,
    entry: Option<(Point3<f64>, Vector3<f64>)>,
    guide: Option<Point3<f64>>,
    contacts: Vec<Contact>,
    forces: Vec<Vector3<f64>>,
    #[serde(rename = "laid")]
    has_others: [bool; 2],
    released: Vec<f64>,
    tip: PlacedTip,
    channel: Channel,
    seeds: Vec<Point3<f64>>,
    /// Moved nodes with their positions in the reference state, mm.
    moved: Vec<(u32, [f64; 3])>,
}

/// The tip, with the pose of the needle's base.
#[derive(Serialize, Deserialize)]
struct PlacedTip {
    base: Option<Isometry3<f64>>,
    #[serde(flatten)]
    state: Tip,
}

fn foreign(error: impl Display) -> StepError {
    StepError::Foreign(error.to_string())
}

impl State {
    /// Checks that the state was saved by a model of the same needle and tissue.
    fn check_fingerprint(&self, expected: &[String; 2]) -> Result<(), StepError> {
        let hashes = self.fingerprint.iter().flatten().zip(expected);
        let kinds = ["needle", "tissue (mesh, materials, supports, interactions or options)"];
        match hashes.zip(kinds).find(|((saved, expected), _)| saved != expected) {
            Some((_, kind)) => Err(foreign(format!("its {kind} is another"))),
            None => Ok(()),
        }
    }

    /// Checks that the state fits this mesh and probe: every index and count is in range.
    fn check(&self, adaptation: &Adaptation, probe: Option<&ProbeNodes>) -> Result<(), StepError> {
        let mesh = adaptation.mesh();
        let [nodes, elements] = [mesh.nodes().len(), mesh.elements().len()];
        if [nodes, elements] != [self.nodes, self.elements] {
            let (saved_nodes, saved_elements) = (self.nodes, self.elements);
            return Err(foreign(format!(
                "its mesh has {saved_nodes} nodes and {saved_elements} elements, that of this one {nodes} and {elements}"
            )));
        }
        let candidates = probe.map(|probe| probe.nodes().len());
        if self.probe.as_ref().map(|(_, touching)| touching.len()) != candidates {
            return Err(foreign("its probe has other candidates"));
        }
        let mut is_taken = vec![false; nodes];
        for node in probe.into_iter().flat_map(ProbeNodes::nodes) {
            is_taken[*node as usize] = true;
        }
        let needle = self.contacts.iter().map(|contact| contact.node);
        for node in needle.chain(self.tip.state.corners.iter().copied()) {
            let is_free = (node as usize) < nodes && !mesh.dofs().of(node).contains(&NO_DOF);
            if !is_free || std::mem::replace(&mut is_taken[node as usize], true) {
                return Err(foreign(format!(
                    "node {node} is on its needle or at its tip; expected free nodes, each once"
                )));
            }
        }
        let new_element = self.tip.state.new_place.map(|place| place.element);
        let lost = |element: &u32| *element as usize >= elements;
        if let Some(element) = self.tip.state.element.into_iter().chain(new_element).find(lost) {
            return Err(foreign(format!("its tip is in element {element} of {elements}")));
        }
        self.check_forces(candidates.unwrap_or(0))?;
        self.check_needle()
    }

    fn check_forces(&self, candidates: usize) -> Result<(), StepError> {
        let others = self.has_others.iter().filter(|has| **has).count();
        let (forces, expected) = (self.forces.len(), self.contacts.len() + others + self.released.len());
        if forces != expected {
            return Err(foreign(format!("it has {forces} forces; expected {expected}")));
        }
        let nodes = candidates + self.contacts.len() + self.tip.state.corners.len();
        let mut shares = self.tip.state.force.row().into_iter().flat_map(|row| row.shares);
        match shares.find(|(node, _)| *node >= nodes) {
            Some((node, _)) => Err(foreign(format!("its tip acts on node {node} of {nodes}"))),
            None => Ok(()),
        }
    }

    fn check_needle(&self) -> Result<(), StepError> {
        let nodes = self.line.nodes();
        if nodes.len() == 1 || nodes.windows(2).any(|pair| pair[0].0 >= pair[1].0) {
            return Err(foreign("the arcs of its needle do not rise"));
        }
        if nodes.is_empty() && (self.tip.base.is_some() || self.entry.is_some()) {
            return Err(foreign("its needle has no shape"));
        }
        let is_in = self.tip.state.entered_without_node || !self.contacts.is_empty();
        match &self.entry {
            Some(_) if !is_in => Err(foreign("it has a point of entry of a needle that is not in tissue")),
            None if is_in => Err(foreign("it has no point of entry of a needle that is in tissue")),
            Some((_, direction)) if (direction.norm() - 1.0).abs() > UNIT => Err(foreign(format!(
                "its direction of entry is {} long; expected 1",
                direction.norm()
            ))),
            _ => Ok(()),
        }
    }
}

impl Finite {
    /// Returns the state. Accumulated rounding of the compliance is removed by recomputation, as after a restore; the
    /// levels II to IV continue from the compliance of the mesh as it is.
    pub(super) fn save_state(&mut self) -> Saved {
        self.recompute();
        let (log, tissue, needle, contacts) = (&self.log, &self.tissue, &self.needle, &self.contacts);
        let mesh = tissue.adaptation.mesh();
        let probe = tissue.probe.as_ref();
        let state = State {
            nodes: mesh.nodes().len(),
            elements: mesh.elements().len(),
            fingerprint: Some(self.fingerprint.clone()),
            steps: log.steps,
            time_s: log.time_s,
            base: log.base,
            probe: probe.map(|probe| (probe.pose, probe.touching_list().to_vec())),
            line: needle.line.clone(),
            entry: needle.entry.map(|entry| (entry.point_mm, entry.direction.into_inner())),
            guide: needle.guide,
            contacts: contacts.nodes.clone(),
            forces: contacts.forces.clone(),
            has_others: contacts.has_others,
            released: contacts.released.clone(),
            tip: PlacedTip {
                base: needle.base,
                state: self.tip.clone(),
            },
            channel: self.body.channel.clone(),
            seeds: log.seeds.clone(),
            moved: tissue.moved(),
        };
        match serde_json::to_value(state) {
            Ok(value) => Saved(value),
            Err(error) => unreachable!("numbers, lists and names: {error}"),
        }
    }

    pub(super) fn restore_state(&mut self, saved: &Saved) -> Result<(), StepError> {
        let state = State::deserialize(&saved.0).map_err(foreign)?;
        let tissue = &mut self.tissue;
        state.check(&tissue.adaptation, tissue.probe.as_ref())?;
        state.check_fingerprint(&self.fingerprint)?;
        tissue.check_moves(&state.moved)?;
        if let Err(error) = tissue.move_nodes(&state.moved) {
            self.recompute();
            return Err(error);
        }
        if let (Some(probe), Some((pose, touching))) = (&mut tissue.probe, &state.probe) {
            probe.restore(*pose, touching);
        }
        let needle = &mut self.needle;
        needle.line.clone_from(&state.line);
        needle.entry = state.entry.map(|(point_mm, direction)| Entry {
            point_mm,
            direction: Unit::new_unchecked(direction),
        });
        (needle.guide, needle.base, self.tip) = (state.guide, state.tip.base, state.tip.state);
        let contacts = &mut self.contacts;
        (contacts.nodes, contacts.forces) = (state.contacts, state.forces);
        (contacts.has_others, contacts.released) = (state.has_others, state.released);
        let log = &mut self.log;
        (log.steps, log.time_s, log.base, log.seeds) = (state.steps, state.time_s, state.base, state.seeds);
        if let Some(living) = &mut self.tissue.living {
            living.go_to(state.time_s);
        }
        self.body.channel = state.channel;
        self.register_contacts();
        self.recompute();
        Ok(())
    }

    /// Recomputes everything derived from the state.
    fn recompute(&mut self) {
        let adaptation = &mut self.tissue.adaptation;
        if let Err(error) = adaptation.with_fallback(|mesh, remesher| remesher.refresh(mesh)) {
            // The updated compliance is kept despite its error.
            debug_assert!(matches!(error, RemeshError::FarFromBase { .. }), "{error}");
        }
        self.take_new_compliance();
    }
}

impl Tissue {
    /// Checks moves of reference nodes without the compliance, which shows most errors.
    fn check_moves(&self, moved: &[(u32, [f64; 3])]) -> Result<(), StepError> {
        let mut trial = self.adaptation.mesh().clone();
        while trial.undo().map_err(foreign)?.is_some() {}
        for (node, position) in moved {
            trial.move_node(*node, *position).map_err(foreign)?;
        }
        Ok(())
    }

    /// Moves the reference nodes to those of a saved state, or back on error.
    fn move_nodes(&mut self, moved: &[(u32, [f64; 3])]) -> Result<(), StepError> {
        let before = self.moved();
        let result = self.try_moves(moved);
        if result.is_err() {
            let back = self.try_moves(&before);
            debug_assert!(back.is_ok(), "they were possible before: {back:?}");
        }
        result
    }

    /// Resets the reference nodes and moves the listed ones, up to the first that cannot be moved.
    fn try_moves(&mut self, moved: &[(u32, [f64; 3])]) -> Result<(), StepError> {
        while self.adaptation.undo().map_err(foreign)?.is_some() {}
        for (node, position) in moved {
            self.adaptation.move_node(*node, *position).map_err(foreign)?;
        }
        Ok(())
    }
}
