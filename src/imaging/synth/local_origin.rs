//! Local origin of the passes for scenes far from the origin of the world.
//!
//! Passes run in single precision, whose absolute resolution decreases with magnitude: 0.008 mm at 1e5 mm, half a fine
//! sample. Therefore a distant scene is translated before anything is rounded: volume, mesh, pose, needle, seeds and
//! nodes, in double precision, by one vector of whole metres. Passes use local coordinates only; all output of the
//! synthesizer is in the world.
//!
//! ```text
//!   world, f64:  Anatomy, FrameState ──┐                                      ┌──► Beam, Frame::image_to_world
//!                                      │ - local origin        + local origin │
//!   local, f64 and f32:                └──► Tables, plan, passes ─────────────┘
//! ```
//!
//! **Choice.** If no coordinate of the volume's centre exceeds `FAR_MM`, it is the world's origin: nothing is
//! translated, and results are bit-identical. Otherwise it is the whole number of metres (`STEP_MM`) nearest to the
//! centre along each axis. It depends on the volume alone, so it is the same in all frames, on all backends, and for
//! all settings.
//!
//! **Anchoring of the grain.** The lattice of scatterers and the solid textures start at the local origin, so that they
//! belong to the tissue: a scene translated by whole metres, near or far, is the same scene to the passes, and its
//! frames are the same, as exactly as its coordinates in the world are (a double at 1e5 mm resolves 1.5e-11 mm).
//! Translated by any other vector it has the same anatomy with another grain of the same statistics, as it has near the
//! world's origin.

use std::mem;
use std::sync::Arc;

use nalgebra::{Matrix4, Point3, Vector3};

use super::layers::Beam;
use super::{FrameState, NeedleShaft};
use insonify_anatomy::volume::{LabelVolume, VolumeError};
use insonify_base::matrix::rigid;
use insonify_mesh::TetMesh;

/// Largest coordinate of a volume's centre without translation, mm. Below it, single precision resolves 2^-12 mm:
/// stored and summed, a coordinate has at most this error, which is a tenth of a sample of 0.0024 mm, finer than 8,192
/// samples over 20 mm. Patients and phantoms in the frame of a scanner or tracker lie well within it.
pub(crate) const FAR_MM: f64 = 4096.0;

/// A local origin is a multiple of this along each axis, mm: a metre. Differences of coordinates and such a number are
/// exact in double precision, and coordinates within a volume's extent from its centre are at most 500 mm larger,
/// resolved to 2^-14 mm or less.
pub(crate) const STEP_MM: f64 = 1000.0;

/// Origin of local coordinates in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalOrigin {
    world_mm: Vector3<f64>,
}

impl LocalOrigin {
    /// Returns the local origin for a volume.
    pub(crate) fn of(volume: &LabelVolume) -> Self {
        let centre = volume.centre_mm().coords;
        let far = centre.iter().all(|x| x.is_finite()) && centre.amax() > FAR_MM;
        let world_mm = if far {
            centre.map(|x| (x / STEP_MM).round() * STEP_MM)
        } else {
            Vector3::zeros()
        };
        Self { world_mm }
    }

    /// Whether it is the origin of the world.
    pub(crate) fn is_world(&self) -> bool {
        self.world_mm == Vector3::zeros()
    }

    /// Converts a point of the world to local coordinates, mm.
    pub fn to_local(self, world_mm: [f64; 3]) -> [f64; 3] {
        if self.is_world() {
            return world_mm;
        }
        (Vector3::from(world_mm) - self.world_mm).into()
    }

    /// Converts a point in local coordinates to the world, mm.
    pub(crate) fn to_world(self, local_mm: [f64; 3]) -> [f64; 3] {
        if self.is_world() {
            return local_mm;
        }
        (Vector3::from(local_mm) + self.world_mm).into()
    }

    /// Volume in local coordinates; it shares the voxels.
    pub(super) fn volume(&self, world: &Arc<LabelVolume>) -> Result<Arc<LabelVolume>, VolumeError> {
        if self.is_world() {
            return Ok(Arc::clone(world));
        }
        world.moved(-self.world_mm).map(Arc::new)
    }

    /// Mesh in local coordinates.
    pub(super) fn mesh(&self, world: &Arc<TetMesh>) -> Arc<TetMesh> {
        if self.is_world() {
            return Arc::clone(world);
        }
        Arc::new(world.moved((-self.world_mm).into()))
    }

    /// Converts a transform to the world into one to local coordinates.
    fn pose(&self, to_world: &Matrix4<f64>) -> Matrix4<f64> {
        let mut to_local = *to_world;
        let translation = to_world.fixed_view::<3, 1>(0, 3) - self.world_mm;
        to_local.fixed_view_mut::<3, 1>(0, 3).copy_from(&translation);
        to_local
    }

    /// Converts the positions of a beam to the world.
    pub(super) fn beam_into_world(&self, mut local: Beam) -> Beam {
        if !self.is_world() {
            place(&mut local, |point| self.to_world(point));
        }
        local
    }

    /// Converts the positions of a beam to local coordinates, as in the passes.
    #[cfg(any(test, feature = "analysis"))]
    pub(crate) fn beam_into_local(&self, mut world: Beam) -> Beam {
        if !self.is_world() {
            place(&mut world, |point| self.to_local(point));
        }
        world
    }
}

fn place(beam: &mut Beam, moved: impl Fn([f64; 3]) -> [f64; 3]) {
    for position in &mut beam.position {
        let [x, y, z, _] = *position;
        [position[0], position[1], position[2]] = moved([x, y, z]);
    }
}

/// State of a frame in local coordinates, in memory reused from frame to frame.
#[derive(Debug)]
pub(crate) struct LocalFrame {
    origin: LocalOrigin,
    /// Whether the last state was converted; otherwise it is used as it is.
    is_converted: bool,
    state: FrameState,
    nodes: Vec<[f64; 3]>,
    reference: Vec<[f64; 3]>,
}

impl LocalFrame {
    pub(crate) fn new(origin: LocalOrigin) -> Self {
        Self {
            origin,
            is_converted: false,
            state: FrameState::at(Matrix4::identity()),
            nodes: Vec::new(),
            reference: Vec::new(),
        }
    }

    /// Converts the state of the next frame and returns its pose in the world, which is rigid; an error says what is
    /// wrong with it. At the world's origin there is nothing to do but for the rounding of a pose.
    pub(crate) fn take(&mut self, world: &FrameState) -> Result<Matrix4<f64>, String> {
        let origin = self.origin;
        let probe_to_world = rigid(&world.probe_to_world)?;
        self.is_converted = !origin.is_world() || probe_to_world != world.probe_to_world;
        if !self.is_converted {
            return Ok(probe_to_world);
        }
        let local = &mut self.state;
        local.frame = world.frame;
        local.probe_to_world = origin.pose(&probe_to_world);
        match (&world.needle, &mut local.needle) {
            (Some(world), Some(local)) => origin.shaft(world, local),
            (Some(world), local) => origin.shaft(world, local.insert(nothing())),
            (None, local) => *local = None,
        }
        local.seeds.resize_with(world.seeds.len(), nothing);
        for (world, local) in world.seeds.iter().zip(&mut local.seeds) {
            origin.shaft(world, local);
        }
        origin.nodes(world.nodes.as_deref(), &mut local.nodes, &mut self.nodes);
        origin.nodes(world.reference.as_deref(), &mut local.reference, &mut self.reference);
        Ok(probe_to_world)
    }

    /// Returns the state for the passes: the last one converted.
    pub(crate) fn localized<'a>(&'a self, world: &'a FrameState) -> &'a FrameState {
        if self.is_converted { &self.state } else { world }
    }
}

impl LocalOrigin {
    fn shaft(&self, world: &NeedleShaft, local: &mut NeedleShaft) {
        local.diameter_mm = world.diameter_mm;
        local.nodes.clear();
        let nodes = world.nodes.iter().map(|&node| self.to_local(node.into()));
        local.nodes.extend(nodes.map(Point3::from));
    }

    /// Converts the nodes of a mesh; `spare` is memory for them while a frame has none.
    fn nodes(&self, world: Option<&[[f64; 3]]>, local: &mut Option<Vec<[f64; 3]>>, spare: &mut Vec<[f64; 3]>) {
        if let Some(last) = local.take() {
            *spare = last;
        }
        if let Some(world) = world {
            spare.clear();
            spare.extend(world.iter().map(|&node| self.to_local(node)));
            *local = Some(mem::take(spare));
        }
    }
}

fn nothing() -> NeedleShaft {
    NeedleShaft {
        nodes: Vec::new(),
        diameter_mm: 0.0,
    }
}

#[cfg(test)]
mod tests;
