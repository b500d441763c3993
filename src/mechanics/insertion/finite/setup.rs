//! Setup of a finite element insertion.

use crate::mechanics::tissue::error::LinearError;
use std::sync::Arc;

use faer::Mat;
use nalgebra::{Point3, Vector3};

use super::channel::Channel;
use super::joint::Yielding;
use super::{Finite, Joint, Memory, Nearby, Outcome, ProbeNodes, Tip};
use crate::mechanics::insertion::anatomy::MeshRegions;
use crate::mechanics::insertion::{Anatomy, Interaction, InvalidPart, ProbeContact, validation};
use crate::mechanics::mesh::{Locator, TetMesh};
use crate::mechanics::needle::{CentreLine, Needle};
use crate::mechanics::tissue::columns::Columns;
use crate::mechanics::tissue::dofs::{Dofs, NONE};
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::inverse::invert;
use crate::mechanics::tissue::material::Material;
use crate::mechanics::tissue::remesh::{Adaptation, AdaptedMesh, Level, Maker, Precision, RemeshError, Source};
use crate::mechanics::tissue::rigid::{self};

/// Options for the subdivision and iteration of steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Maximum motion of an instrument in one substep, mm.
    pub part_mm: f64,
    /// Maximum number of substeps; for longer motions each substep is longer.
    pub most_parts: usize,
    /// Maximum number of iterations over contact states and needle shape in one substep.
    pub most_iterations: usize,
    /// Motion at which the iterations end, mm.
    pub tolerance_mm: f64,
    /// Least distance between nodes on the needle, mm.
    pub spacing_mm: f64,
    /// Largest Jacobian condition that remeshing at the tip may cause; where it would be exceeded, the next position is
    /// tried.
    pub condition_limit: f64,
    /// Limits of the remesher.
    pub remesh: crate::mechanics::tissue::remesh::Options,
    /// Number of columns of the base's compliance that are cached where there is no dense inverse (exact level).
    pub columns: usize,
    /// Whether there is a dense inverse at the exact level too: it is used there if it is in f64, and a change to another
    /// level does not wait for one.
    pub dense: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            part_mm: 0.5,
            most_parts: 1000,
            most_iterations: 40,
            tolerance_mm: 1e-5,
            spacing_mm: 1.0,
            condition_limit: 100.0,
            remesh: crate::mechanics::tissue::remesh::Options {
                tended: true,
                ..Default::default()
            },
            columns: 6000,
            dense: false,
        }
    }
}

/// Tissue, needle and probe.
#[derive(Debug)]
pub struct Setup {
    /// The tissue at rest, mm.
    pub mesh: TetMesh,
    /// Material of each element.
    pub materials: Vec<Material>,
    /// Nodes and axes (0 to 2) that are fixed.
    pub fixed: Vec<(u32, u8)>,
    /// Interactions of the regions of the mesh with the needle; those not listed exert no force.
    pub interactions: Vec<(i32, Interaction)>,
    /// Regions met by the needle, in place of those of the mesh and of `interactions` (which are checked all the same): the
    /// mesh then provides only stiffness. Default: the regions of the mesh.
    pub anatomy: Option<Arc<dyn Anatomy>>,
    /// The needle.
    pub needle: Box<dyn Needle>,
    /// The probe, if one presses.
    pub probe: Option<ProbeContact>,
    /// Level of remeshing, which determines how the compliance is updated.
    pub level: Level,
    /// Precision of the compliance.
    pub precision: Precision,
    /// Options for the subdivision and iteration of steps.
    pub options: Options,
}

/// Reason why an insertion cannot be set up.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidSetup {
    /// An invalid input common to all models on a mesh.
    #[error(transparent)]
    Part(#[from] InvalidPart),
    /// A candidate node of the probe that is missing, listed twice, or fixed.
    #[error("node {node} cannot be a candidate of the probe: it {reason}")]
    Candidate {
        /// The candidate node.
        node: u32,
        /// Description of the fault.
        reason: &'static str,
    },
    /// Supports that do not prevent rigid-body motion, or a stiffness that cannot be assembled, factored or inverted.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// A remeshing level that cannot be used.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
}

impl InvalidSetup {
    /// Returns whether the machine failed rather than the input: too little memory, or a device.
    pub fn is_machine(&self) -> bool {
        match self {
            Self::Linear(error) => error.is_machine(),
            Self::Remesh(error) => matches!(error, RemeshError::Device(_)),
            _ => false,
        }
    }
}

impl Setup {
    fn check(&self) -> Result<(), InvalidPart> {
        validation::interactions(&self.interactions)?;
        validation::fixed(&self.fixed, self.mesh.nodes().len())?;
        let options = &self.options;
        validation::above_zero(&[
            ("part_mm", options.part_mm),
            ("most_parts", options.most_parts as f64),
            ("most_iterations", options.most_iterations as f64),
            ("tolerance_mm", options.tolerance_mm),
            ("spacing_mm", options.spacing_mm),
            ("condition_limit", options.condition_limit),
            ("columns", options.columns as f64),
            ("length_mm", self.probe.as_ref().map_or(1.0, |probe| probe.length_mm)),
        ])
    }

    fn check_candidates(&self, dofs: &Dofs) -> Result<(), InvalidSetup> {
        let mut seen = vec![false; dofs.nodes()];
        for &node in self.probe.iter().flat_map(|probe| &probe.candidates) {
            let reason = match seen.get_mut(node as usize) {
                None => "is not in the mesh",
                Some(true) => "is named twice",
                Some(_) if dofs.of(node).contains(&NONE) => "is fixed",
                Some(seen) => {
                    *seen = true;
                    continue;
                }
            };
            return Err(InvalidSetup::Candidate { node, reason });
        }
        Ok(())
    }

    pub(super) fn build(
        self,
        maker: Option<Maker>,
        progress: impl FnMut(usize, usize) + Send,
    ) -> Result<Finite, InvalidSetup> {
        self.check()?;
        let dofs = Dofs::new(self.mesh.nodes().len(), self.fixed.iter().copied());
        self.check_candidates(&dofs)?;
        rigid::check(&self.mesh, &dofs)?;
        let adapted = AdaptedMesh::new(&self.mesh, &self.materials, &dofs)?;
        let factor = Arc::new(Factor::new(adapted.stiffness())?);
        let is_dense = self.options.dense || self.level != Level::Exact;
        let dense = is_dense.then(|| dense(&factor, self.precision, progress)).transpose()?;
        let (source, precision) = source(self.level, dense.as_ref(), &factor, &self.options);
        let adaptation = Adaptation::with_maker(adapted, source, self.level, precision, self.options.remesh, maker)?;
        let (locator, mesh) = (Arc::new(Locator::new(&self.mesh)), Arc::new(self.mesh));
        let mut on_surface = vec![false; mesh.nodes().len()];
        let mut surface = Vec::new();
        for face in mesh.surface() {
            let corners = face.nodes.map(|node| Point3::from(mesh.nodes()[node as usize]));
            let centre = corners.iter().map(|corner| corner.coords).sum::<Vector3<f64>>() / 3.0;
            surface.push((face.element, Point3::from(centre)));
            face.nodes.iter().for_each(|node| on_surface[*node as usize] = true);
        }
        let of_mesh = || MeshRegions::located(&mesh, Arc::clone(&locator), &self.interactions);
        let mut finite = Finite {
            anatomy: self.anatomy.unwrap_or_else(|| Arc::new(of_mesh())),
            press: self.probe.map(|probe| ProbeNodes::new(probe, mesh.nodes())),
            locator,
            mesh,
            factor,
            dense,
            precision: self.precision,
            adaptation,
            surface,
            on_surface,
            needle: self.needle,
            options: self.options,
            steps: 0,
            time_s: 0.0,
            base: None,
            line: CentreLine::default(),
            entry: None,
            guide: None,
            contacts: Vec::new(),
            forces: Vec::<Vector3<f64>>::new(),
            laid: [false; 2],
            fading: Vec::new(),
            tip: Tip::default(),
            channel: Channel::default(),
            seeds: Vec::new(),
            outcome: Outcome::default(),
            joint: Joint::default(),
            version: 0,
            condensed: None,
            nearby: Nearby::default(),
            carried: Vec::new(),
            outlook: None,
            yielding: Yielding {
                flexibility: Mat::new(),
                drift: Vec::new(),
            },
            memory: Memory::default(),
        };
        finite.name_contacts();
        Ok(finite)
    }
}

/// Computes the dense inverse.
///
/// # Errors
/// As [`invert`].
pub(super) fn dense(
    factor: &Factor,
    precision: Precision,
    progress: impl FnMut(usize, usize) + Send,
) -> Result<Source, LinearError> {
    Ok(match precision {
        Precision::Double => Source::Double(Arc::new(invert(factor, progress)?)),
        Precision::Single => Source::Single(Arc::new(invert(factor, progress)?)),
    })
}

/// Returns the source of compliance for a level and its precision: the dense inverse, except for the exact level where that
/// is in f32 or missing.
pub(super) fn source(
    level: Level,
    dense: Option<&Source>,
    factor: &Arc<Factor>,
    options: &Options,
) -> (Source, Precision) {
    let suits = |dense: &&Source| level != Level::Exact || dense.precision() == Precision::Double;
    let columns = || Source::Columns(Columns::new(Arc::clone(factor), options.columns));
    let source = dense.filter(suits).cloned().unwrap_or_else(columns);
    let precision = source.precision();
    (source, precision)
}
