//! Deforming mesh on the GPU: buffers of the warp pass, synchronised with the states of the mesh.

use crate::effects::buffers::{ADJACENCY, Buffer, CELL_ELEMENTS, CELL_STARTS, ELEMENT_MAPS};
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::map::{Moved, States};
use crate::mechanics::mesh::pack::{self, Piece, WarpBuffer, WarpParams};
use crate::synth::FrameState;

/// The mesh, and the parts that are not yet in the buffers.
pub(super) struct Warp {
    states: States<f32>,
    params: WarpParams,
    due: Moved,
    topology_due: bool,
}

impl Warp {
    pub fn new(mesh: &TetMesh) -> Self {
        let states = States::new(mesh);
        Self {
            params: pack::params(&states),
            states,
            due: Moved {
                deformed: true,
                reference: true,
            },
            topology_due: true,
        }
    }

    /// Marks a buffer as recreated and empty.
    pub fn buffer_is_new(&mut self, buffer: &Buffer) {
        self.topology_due |= *buffer == ADJACENCY;
        if [&ELEMENT_MAPS, &CELL_STARTS, &CELL_ELEMENTS].contains(&buffer) {
            (self.due.deformed, self.due.reference) = (true, true);
        }
    }

    /// Moves the nodes to the state of a frame.
    pub fn update(&mut self, state: &FrameState) -> Result<(), InvalidMesh> {
        let moved = self.states.update(state.nodes.as_deref(), state.reference.as_deref())?;
        self.due.deformed |= moved.deformed;
        self.due.reference |= moved.reference;
        if moved.deformed || moved.reference {
            self.params = pack::params(&self.states);
        }
        Ok(())
    }

    /// Data to be written before the next frame.
    pub fn pieces(&self) -> impl Iterator<Item = (&'static Buffer, Piece<'_>)> {
        let topology = self.topology_due.then(|| pack::topology(&self.states));
        let reference = self.due.reference.then(|| pack::reference(&self.states));
        let deformed = self.due.deformed.then(|| pack::deformed(&self.states));
        let pieces = topology.into_iter().chain(reference.into_iter().flatten());
        pieces.chain(deformed.into_iter().flatten()).map(|piece| {
            let buffer: &'static Buffer = match piece.buffer {
                WarpBuffer::Frames => &ELEMENT_MAPS,
                WarpBuffer::Neighbours => &ADJACENCY,
                WarpBuffer::Starts => &CELL_STARTS,
                WarpBuffer::Lists => &CELL_ELEMENTS,
            };
            (buffer, piece)
        })
    }

    /// Marks all pieces as written.
    pub fn is_uploaded(&mut self) {
        (self.due, self.topology_due) = (Moved::default(), false);
    }

    pub fn params(&self) -> &WarpParams {
        &self.params
    }
}
