//! Setup of a finite element insertion.

use crate::tissue::error::LinearError;
use std::sync::Arc;

use super::body::{Channel, CutTissue};
use super::{Attempt, Contacts, Finite, Joint, Log, PlacedNeedle, Prediction, ProbeNodes, Tip, Tissue};
use crate::insertion::interaction::MeshRegions;
use crate::insertion::{Anatomy, Interaction, InvalidSetup, ProbeContact, validation};
use crate::needle::{CentreLine, Needle, check_needle};
use crate::tissue::columns::Columns;
use crate::tissue::dofs::{Dofs, NO_DOF};
use crate::tissue::factor::Factor;
use crate::tissue::inverse::invert;
use crate::tissue::material::Material;
use crate::tissue::remesh::{Adaptation, AdaptedMesh, Level, Maker, Precision, Source};
use crate::tissue::rigid;
use insonify_mesh::{Locator, TetMesh};

/// Options for the subdivision and iteration of steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiniteOptions {
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
    /// Radius of the patch of tissue that bears the force at the tip, mm.
    pub patch_mm: f64,
    /// Largest Jacobian condition that remeshing at the tip may cause; where it would be exceeded, the next position is
    /// tried.
    pub condition_limit: f64,
    /// Limits of the remesher.
    pub remesh: crate::tissue::remesh::RemesherOptions,
    /// Number of columns of the base's compliance that are cached where there is no dense inverse (exact level).
    pub columns: usize,
    /// Whether there is a dense inverse at the exact level too: it is used there if it is in f64, and a change to
    /// another level does not wait for one.
    pub dense: bool,
}

impl Default for FiniteOptions {
    fn default() -> Self {
        FiniteOptions {
            part_mm: 0.5,
            most_parts: 1000,
            most_iterations: 40,
            tolerance_mm: 1e-5,
            spacing_mm: 1.0,
            patch_mm: 5.0,
            condition_limit: 100.0,
            remesh: crate::tissue::remesh::RemesherOptions {
                deferred: true,
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
    /// Regions met by the needle, in place of those of the mesh and of `interactions` (which are checked all the same):
    /// the mesh then provides only stiffness. Default: the regions of the mesh.
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
    pub options: FiniteOptions,
}

impl Setup {
    fn check(&mut self) -> Result<(), InvalidSetup> {
        check_needle(&mut *self.needle)?;
        validation::size(&self.mesh, self.needle.radius_mm())?;
        validation::interactions(&self.mesh, &self.interactions)?;
        validation::fixed(&self.fixed, self.mesh.nodes().len())?;
        let options = &self.options;
        validation::above_zero(&[
            ("part_mm", options.part_mm),
            ("most_parts", options.most_parts as f64),
            ("most_iterations", options.most_iterations as f64),
            ("tolerance_mm", options.tolerance_mm),
            ("spacing_mm", options.spacing_mm),
            ("patch_mm", options.patch_mm),
            ("condition_limit", options.condition_limit),
            ("columns", options.columns as f64),
            ("length_mm", self.probe.as_ref().map_or(1.0, |probe| probe.length_mm)),
        ])
    }

    /// Returns hashes of the needle and of the tissue with the options that change results: a saved state is taken back
    /// only by a model whose hashes are the same.
    fn fingerprint(&self) -> [String; 2] {
        let mut tissue = blake3::Hasher::new();
        let options = &self.options;
        let limits = (
            (options.part_mm, options.most_parts, options.most_iterations),
            (options.tolerance_mm, options.spacing_mm, options.condition_limit),
        );
        let numbers = (&self.materials, &self.fixed, &self.interactions, limits);
        tissue.update(format!("{numbers:?}").as_bytes());
        tissue.update(bytemuck::cast_slice(self.mesh.nodes()));
        tissue.update(bytemuck::cast_slice(self.mesh.elements()));
        [blake3::hash(format!("{:?}", self.needle).as_bytes()), tissue.finalize()].map(short)
    }

    fn check_candidates(&self, dofs: &Dofs) -> Result<(), InvalidSetup> {
        let mut seen = vec![false; dofs.nodes()];
        for &node in self.probe.iter().flat_map(|probe| &probe.candidates) {
            let reason = match seen.get_mut(node as usize) {
                None => "is not in the mesh",
                Some(true) => "is named twice",
                Some(_) if dofs.of(node).contains(&NO_DOF) => "is fixed",
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
        mut self,
        maker: Option<Maker>,
        progress: &mut (dyn FnMut(usize, usize) + Send),
    ) -> Result<Finite, InvalidSetup> {
        // Before the checks, by which a needle may keep another shape.
        let fingerprint = self.fingerprint();
        // Every check comes before the factorisation, which takes most of the time.
        self.check()?;
        let dofs = Dofs::new(self.mesh.nodes().len(), self.fixed.iter().copied());
        self.check_candidates(&dofs)?;
        rigid::check(&self.mesh, &dofs)?;
        let of_elements = self.mesh.regions().iter().zip(&self.materials);
        let moduli = of_elements.map(|(region, material)| {
            let modulus = material.young_kpa() / (1.0 - material.poisson().powi(2));
            (*region, modulus * 1e-3)
        });
        let moduli = moduli.collect();
        let adapted = AdaptedMesh::new(&self.mesh, &self.materials, &dofs)?;
        let mut base = Base {
            factor: Arc::new(Factor::new(adapted.stiffness())?),
            dense: None,
            precision: self.precision,
        };
        // All levels but the exact one update the entries of an inverse; that one solves with the factor.
        if self.options.dense || self.level != Level::Exact {
            base.invert(progress)?;
        }
        let (source, precision) = base.source(self.level, &self.options);
        let adaptation = Adaptation::with_maker(adapted, source, self.level, precision, self.options.remesh, maker)?;
        let (locator, mesh) = (Arc::new(Locator::new(&self.mesh)), Arc::new(self.mesh));
        let of_mesh = || MeshRegions::located(&mesh, Arc::clone(&locator), &self.interactions);
        let anatomy = self.anatomy.unwrap_or_else(|| Arc::new(of_mesh()));
        let probe = self.probe.map(|probe| ProbeNodes::new(probe, mesh.nodes()));
        Ok(Finite {
            fingerprint,
            base,
            options: self.options,
            body: CutTissue {
                anatomy,
                channel: Channel::default(),
                patch_mm: self.options.patch_mm,
                moduli,
            },
            tissue: Tissue::new(mesh, locator, adaptation, probe),
            needle: PlacedNeedle::new(self.needle),
            tip: Tip::default(),
            contacts: Contacts::default(),
            joint: Joint::default(),
            attempt: Attempt::default(),
            prediction: Prediction::default(),
            log: Log::default(),
            unloaded: CentreLine::default(),
        })
    }
}

/// Returns the beginning of a hash in hexadecimal.
pub(super) fn short(hash: blake3::Hash) -> String {
    hash.to_hex()[..16].to_owned()
}

/// Compliance of the mesh at rest, from which the remesher of each level starts.
pub(super) struct Base {
    pub factor: Arc<Factor>,
    /// Dense inverse, once a level has needed it.
    dense: Option<Source>,
    precision: Precision,
}

impl Base {
    /// Computes the dense inverse.
    fn invert(&mut self, progress: &mut (dyn FnMut(usize, usize) + Send)) -> Result<(), LinearError> {
        self.dense = Some(match self.precision {
            Precision::Double => Source::Double(Arc::new(invert(&self.factor, progress)?)),
            Precision::Single => Source::Single(Arc::new(invert(&self.factor, progress)?)),
        });
        Ok(())
    }

    /// Computes the dense inverse if a level needs it.
    pub(super) fn prepare(&mut self, level: Level) -> Result<(), LinearError> {
        if level == Level::Exact || self.dense.is_some() {
            return Ok(());
        }
        self.invert(&mut |_, _| {})
    }

    /// Returns the source of compliance for a level and its precision: the dense inverse, except for the exact level
    /// where that is in f32 or missing.
    pub(super) fn source(&self, level: Level, options: &FiniteOptions) -> (Source, Precision) {
        let suits = |dense: &&Source| level != Level::Exact || dense.precision() == Precision::Double;
        let columns = || Source::Columns(Columns::new(Arc::clone(&self.factor), options.columns));
        let source = self.dense.as_ref().filter(suits).cloned().unwrap_or_else(columns);
        let precision = source.precision();
        (source, precision)
    }
}
