//! Saving the state of an insertion, and going back to it.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::contact::Contact;
use super::{Finite, Nearby, Tip};
use crate::mechanics::insertion::{Saved, StepError};
use crate::mechanics::needle::{CentreLine, Entry};
use crate::mechanics::tissue::remesh::RemeshError;

/// All that a step depends on.
#[derive(Serialize, Deserialize)]
struct State {
    nodes: usize,
    elements: usize,
    steps: u64,
    time_s: f64,
    base: Option<Isometry3<f64>>,
    /// The pose of the probe, and which candidates touch it.
    probe: Option<(Option<Isometry3<f64>>, Vec<bool>)>,
    line: CentreLine,
    entry: Option<(Point3<f64>, Vector3<f64>)>,
    guide: Option<Point3<f64>>,
    contacts: Vec<Contact>,
    forces: Vec<Vector3<f64>>,
    laid: [bool; 2],
    fading: Vec<f64>,
    tip: Tip,
    seeds: Vec<Point3<f64>>,
    /// Where moved nodes are in the reference state.
    moved: Vec<(u32, [f64; 3])>,
}

impl Finite {
    /// The state. What the compliance has gathered in rounding is computed anew, as after going back to it; the levels II to IV
    /// go on from the compliance of the mesh as it is.
    pub(super) fn save_state(&mut self) -> Saved {
        self.start_anew();
        let mesh = self.adaptation.mesh();
        let state = State {
            nodes: mesh.nodes().len(),
            elements: mesh.elements().len(),
            steps: self.steps,
            time_s: self.time_s,
            base: self.base,
            probe: self
                .press
                .as_ref()
                .map(|press| (press.pose, press.touching_list().to_vec())),
            line: self.line.clone(),
            entry: self.entry.map(|entry| (entry.point_mm, entry.direction.into_inner())),
            guide: self.guide,
            contacts: self.contacts.clone(),
            forces: self.forces.clone(),
            laid: self.laid,
            fading: self.fading.clone(),
            tip: self.tip.clone(),
            seeds: self.seeds.clone(),
            moved: mesh
                .away()
                .iter()
                .map(|node| (*node, mesh.nodes()[*node as usize]))
                .collect(),
        };
        match serde_json::to_value(state) {
            Ok(value) => Saved(value),
            Err(error) => unreachable!("numbers, lists and names: {error}"),
        }
    }

    pub(super) fn restore_state(&mut self, saved: &Saved) -> Result<(), StepError> {
        let state = State::deserialize(&saved.0).map_err(|error| StepError::Foreign(error.to_string()))?;
        let mesh = self.adaptation.mesh();
        let counts = [mesh.nodes().len(), mesh.elements().len()];
        if counts != [state.nodes, state.elements] {
            let [nodes, elements] = counts;
            let (other, of) = (state.nodes, state.elements);
            return Err(StepError::Foreign(format!(
                "its mesh has {other} nodes and {of} elements, that of this one {nodes} and {elements}"
            )));
        }
        let candidates = self.press.as_ref().map(|press| press.nodes().len());
        if state.probe.as_ref().map(|(_, touching)| touching.len()) != candidates {
            return Err(StepError::Foreign("its probe has other candidates".to_owned()));
        }
        self.move_nodes(&state.moved)?;
        self.line.clone_from(&state.line);
        self.entry = state.entry.map(|(point_mm, direction)| Entry {
            point_mm,
            direction: Unit::new_unchecked(direction),
        });
        (self.guide, self.laid, self.fading) = (state.guide, state.laid, state.fading);
        if let (Some(press), Some((pose, touching))) = (&mut self.press, &state.probe) {
            press.put_back(*pose, touching);
        }
        (self.steps, self.time_s, self.base) = (state.steps, state.time_s, state.base);
        (self.contacts, self.forces, self.tip, self.seeds) = (state.contacts, state.forces, state.tip, state.seeds);
        self.name_contacts();
        self.start_anew();
        Ok(())
    }

    /// Puts the reference nodes where a saved state had them.
    fn move_nodes(&mut self, moved: &[(u32, [f64; 3])]) -> Result<(), StepError> {
        let foreign = |error: &dyn std::fmt::Display| StepError::Foreign(error.to_string());
        while self.adaptation.undo().map_err(|error| foreign(&error))?.is_some() {}
        for (node, place) in moved {
            self.adaptation
                .move_node(*node, *place)
                .map_err(|error| foreign(&error))?;
        }
        Ok(())
    }

    /// Computes anew all that is derived from the state.
    fn start_anew(&mut self) {
        let (mesh, remesher) = self.adaptation.parts();
        if let Err(error) = remesher.refresh(mesh) {
            // The updated compliance is kept, as good as it is.
            debug_assert!(matches!(error, RemeshError::FarFromBase { .. }), "{error}");
        }
        self.version += 1;
        self.nearby = Nearby::default();
        self.outlook = None;
        self.take_compliance();
        self.carry();
    }
}
