//! Imaging part of the simulator, for the image thread.

use std::collections::BTreeSet;
use std::mem;
use std::sync::Arc;

use nalgebra::{Matrix4, Vector3, center};

use super::SimulatorError;
use super::haptic::Latest;
use insonify_imaging::synth::{Frame, FrameState, NeedleShaft, SynthError, Synthesizer};
use insonify_mechanics::insertion::{NodeSolver, Snapshot, Tissue};
use insonify_mesh::TetMesh;
use insonify_mesh::locator::{Locator, NO_ELEMENT};

/// Greatest distance between a node of the imaged mesh and that of the model, mm: more than rounding to f32 in a file.
const SAME_MM: f64 = 1e-2;

/// Renders frames of the latest complete state. [`Simulator`](super::Simulator) has an example.
pub struct Imaging {
    latest: Latest,
    /// `None` if the image has no mesh: then node positions are not needed.
    imager: Option<Box<dyn NodeSolver>>,
    synthesizer: Synthesizer,
    tissue: Tissue,
    state: FrameState,
    needle_diameter_mm: f64,
    seeds: Seeds,
}

impl Imaging {
    pub(super) fn new(
        synthesizer: Synthesizer,
        imager: Box<dyn NodeSolver>,
        needle_diameter_mm: f64,
        latest: Latest,
    ) -> Result<Self, SimulatorError> {
        let expected = "a finite number above 0";
        SimulatorError::check(
            "needle_diameter_mm",
            needle_diameter_mm,
            needle_diameter_mm > 0.0,
            expected,
        )?;
        let mesh = synthesizer.tables().anatomy.mesh.as_ref();
        if let Some(mesh) = mesh {
            same_elements(mesh.elements(), imager.elements())?;
        }
        let mut imaging = Self {
            seeds: Seeds::new(mesh.cloned()),
            imager: mesh.is_some().then_some(imager),
            latest,
            synthesizer,
            tissue: Tissue::default(),
            state: FrameState::at(Matrix4::identity()),
            needle_diameter_mm,
        };
        if imaging.latest.take() {
            imaging.read();
        }
        imaging.check_nodes()?;
        Ok(imaging)
    }

    /// Checks that the nodes of the imaged mesh lie where those of the model do at rest, but for those that remeshing
    /// has moved. A solver that returns no positions is not asked.
    fn check_nodes(&self) -> Result<(), SimulatorError> {
        let (Some(reference), Some(mesh)) = (&self.state.reference, &self.seeds.mesh) else {
            return Ok(());
        };
        if reference.len() != mesh.nodes().len() {
            return Ok(());
        }
        let is_moved: BTreeSet<u32> = self.latest.state().moved.iter().map(|(node, _)| *node).collect();
        for (node, (imaged, expected)) in (0..).zip(mesh.nodes().iter().zip(reference)) {
            let distance_mm = (Vector3::from(*imaged) - Vector3::from(*expected)).norm();
            if distance_mm > SAME_MM && !is_moved.contains(&node) {
                return Err(SimulatorError::Mesh(format!(
                    "node {node} of the imaged mesh lies at {imaged:?}, {distance_mm} mm from that of the tissue model; \
                     expected both meshes at the same place"
                )));
            }
        }
        Ok(())
    }

    /// Renders the latest state for a pose of the probe (probe frame to world, mm). Frames count up from 0. Where no
    /// step was made since the last frame, tissue stays as it was imaged then. In the steady state the
    /// synthesizer allocates nothing, and a [`NodeSolver`] what its solution needs.
    ///
    /// # Errors
    /// [`SynthError`].
    pub fn frame(&mut self, probe_to_world: &Matrix4<f64>) -> Result<&Frame, SynthError> {
        self.show(probe_to_world, |synthesizer, state| synthesizer.render(state).map(drop))?;
        Ok(self.synthesizer.frame())
    }

    /// Number of the next frame, by which the receiver's noise is drawn.
    pub fn next_frame(&self) -> u64 {
        self.state.frame
    }

    /// Sets the number of the next frame: after a model is restored, frames of the same numbers are those of before,
    /// bit for bit.
    pub fn set_next_frame(&mut self, frame: u64) {
        self.state.frame = frame;
    }

    /// Renders as [`Imaging::frame`] does, and leaves the frame on the GPU, in [`Synthesizer::texture`] of the
    /// synthesizer: the image thread does not wait for it.
    ///
    /// # Errors
    /// [`SynthError`].
    pub fn frame_to_texture(&mut self, probe_to_world: &Matrix4<f64>) -> Result<(), SynthError> {
        self.show(probe_to_world, Synthesizer::render_to_texture)
    }

    fn show(
        &mut self,
        probe_to_world: &Matrix4<f64>,
        render: impl FnOnce(&mut Synthesizer, &FrameState) -> Result<(), SynthError>,
    ) -> Result<(), SynthError> {
        if self.latest.take() {
            self.read();
        }
        self.state.probe_to_world = *probe_to_world;
        render(&mut self.synthesizer, &self.state)?;
        self.state.frame += 1;
        // The synthesizer keeps the node positions until it gets others.
        self.take_nodes();
        Ok(())
    }

    /// Writes the state taken last into the frame state.
    fn read(&mut self) {
        let snapshot = self.latest.state();
        let line = snapshot.line.nodes();
        let needle = self.state.needle.get_or_insert_with(|| NeedleShaft {
            nodes: Vec::with_capacity(line.len()),
            diameter_mm: self.needle_diameter_mm,
        });
        needle.nodes.clear();
        needle.nodes.extend(line.iter().map(|node| node.1));
        if line.is_empty() {
            self.state.needle = None;
        }
        self.take_nodes();
        let snapshot = self.latest.state();
        if let Some(imager) = &mut self.imager {
            imager.tissue(snapshot, &mut self.tissue);
        }
        self.seeds.show(snapshot, &self.tissue, &mut self.state.seeds);
        if self.imager.is_some() {
            self.state.nodes = Some(mem::take(&mut self.tissue.current));
            self.state.reference = Some(mem::take(&mut self.tissue.reference));
        }
    }

    /// Takes back the memory of the node positions passed to a frame.
    fn take_nodes(&mut self) {
        if let (Some(current), Some(reference)) = (self.state.nodes.take(), self.state.reference.take()) {
            (self.tissue.current, self.tissue.reference) = (current, reference);
        }
    }

    /// Returns the state shown by the last frame.
    pub fn snapshot(&self) -> &Snapshot {
        self.latest.state()
    }

    /// Returns the number of inverted elements in the last frame: tissue is crushed there. It is 0 for an image without
    /// a mesh.
    pub fn inverted(&self) -> usize {
        self.tissue.inverted
    }

    /// Returns the synthesizer, to change its settings between frames.
    pub fn synthesizer(&mut self) -> &mut Synthesizer {
        &mut self.synthesizer
    }
}

/// Checks that elements match; nodes are not compared, since a mesh that was written and read differs in their last
/// bits.
fn same_elements(found: &[[u32; 4]], expected: &[[u32; 4]]) -> Result<(), SimulatorError> {
    if found.len() != expected.len() {
        let (found, expected) = (found.len(), expected.len());
        return Err(SimulatorError::Mesh(format!(
            "the imaged mesh has {found} elements; expected the {expected} of the tissue model"
        )));
    }
    match found
        .iter()
        .zip(expected)
        .position(|(found, expected)| found != expected)
    {
        Some(element) => {
            let (found, expected) = (found[element], expected[element]);
            let expected = format!("those of the tissue model, {expected:?}");
            let text = format!("element {element} of the imaged mesh has nodes {found:?}; expected {expected}");
            Err(SimulatorError::Mesh(text))
        }
        None => Ok(()),
    }
}

// Positions of seeds in the deformed tissue.

/// Locates seeds in the tissue.
pub(super) struct Seeds {
    mesh: Option<Arc<TetMesh>>,
    /// Locator from the reference state to the current one; made for the first seed.
    locator: Option<Locator<f64>>,
    /// Last element of each seed.
    elements: Vec<u32>,
}

impl Seeds {
    /// Takes the mesh of the tissue, or `None` if it does not move.
    pub(super) fn new(mesh: Option<Arc<TetMesh>>) -> Self {
        Self {
            mesh,
            locator: None,
            elements: Vec::new(),
        }
    }

    /// Writes the seeds of a state with the given tissue. A seed points along the needle at the time it was first seen
    /// here, since only its position is known; one outside the tissue stays at its position in the reference state.
    pub(super) fn show(&mut self, snapshot: &Snapshot, tissue: &Tissue, into: &mut Vec<NeedleShaft>) {
        let count = snapshot.seeds.len();
        self.elements.resize(count, NO_ELEMENT);
        into.truncate(count);
        if count == 0 {
            return;
        }
        if let Some(mesh) = &self.mesh {
            let locator = self.locator.get_or_insert_with(|| Locator::new(mesh));
            let moved = locator.update_states(Some(&tissue.reference), Some(&tissue.current));
            // The synthesizer reports a wrong number of nodes.
            if moved.is_err() {
                return;
            }
        }
        for (index, (seed, element)) in snapshot.seeds.iter().zip(&mut self.elements).enumerate() {
            let locator = self.locator.as_ref();
            let position = locator.map_or(*seed, |locator| locator.carry((*seed).into(), element).into());
            match into.get_mut(index) {
                Some(NeedleShaft { nodes, .. }) => {
                    let shift = position - center(&nodes[0], &nodes[1]);
                    nodes.iter_mut().for_each(|node| *node += shift);
                }
                None => into.push(NeedleShaft::seed(position, &at_tip(snapshot))),
            }
        }
    }
}

/// Returns the direction of the needle at its tip.
fn at_tip(snapshot: &Snapshot) -> Vector3<f64> {
    match snapshot.line.nodes() {
        [] => Vector3::z(),
        _ => snapshot
            .line
            .point_at_arc(snapshot.line.length_mm())
            .tangent
            .into_inner(),
    }
}
