//! `[tissue]` table of a scenario file.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::nonlinear_tissue::{StepSolverSpec, TissueViscositySpec};
use crate::input::material::material_table;
use crate::input::selection::selecting;
use insonify_base::document::{RegionName, word};
use insonify_base::range::{Kind, parameters};
use insonify_mechanics::insertion::spring::MassSpringParameters;
use insonify_mechanics::insertion::{Bone, Interaction, Peak};
use insonify_mechanics::tissue::remesh::{Level, Precision};
use insonify_mesh::file::Unit;

/// Default number of nodes of a mesh made from the scene's volume: that of Goksel et al. 2011.
pub const DEFAULT_NODES: u32 = 3300;

/// Default radius of the patch of tissue that bears the force at the tip, mm.
pub(super) const PATCH_MM: f64 = 5.0;

parameters! {
    /// Model of tissue deformation.
    pub struct TissueSpec by TissueModel in model {
        /// Tissue model. Default `finite-element`.
        model: TissueModel;
        /// Tetrahedral mesh (`.vtu`, `.vtk`, `.msh`; LPS). Its regions are label values of the scene's volume, or have
        /// a `[[tissue.material]]` each. Default: one made from the scene's volume.
        mesh: Option<PathBuf>, for FiniteElement | Nonlinear | Viscoelastic;
        /// Length unit of the coordinates in `mesh`: `mm`, `cm` or `m`. Default `mm`.
        mesh_unit: Unit;
        /// Name of the cell array (or physical groups) of `mesh` that numbers the regions. Default: the first of the
        /// common names.
        region_array: Option<String>, for FiniteElement | Nonlinear | Viscoelastic;
        /// Maximum number of nodes of a mesh made from the scene's volume. Default 3300.
        nodes: Option<u32>, for FiniteElement | Nonlinear | Viscoelastic, in 8..=1000000 "nodes";
        /// Part of the volume that is meshed, as two opposite corners, mm; `inf` leaves a side open. Default: all of
        /// it.
        box_mm: Option<[[f64; 3]; 2]>, for FiniteElement | Nonlinear | Viscoelastic;
        /// Whether the elements of a mesh made from the scene's volume are finer along the needle's path. Default: true
        /// for `finite-element`, false for the other models.
        along_path: Option<bool>, for FiniteElement | Nonlinear | Viscoelastic;
        /// Labels excluded from the mesh, such as gel or air: names or values.
        outside: Vec<RegionName>;
        /// Which part of the compliance is updated after each change of the mesh. Default `exact`.
        level: Option<Level>, for FiniteElement;
        /// Device that stores and updates a dense inverse, at levels I to IV. Default `cpu`.
        device: Option<DeviceName>, for FiniteElement;
        /// Precision of a dense inverse. Default `f64`, on a GPU `f32`, the only one supported there; the exact level
        /// always uses `f64`.
        precision: Option<Precision>, for FiniteElement;
        /// Source of the compliance. Default `on-demand` for the exact level, `dense` for all others.
        columns: Option<ColumnsName>, for FiniteElement;
        /// Minimum distance between nodes on the needle: a node of the mesh is moved to the tip when the tip has left
        /// all elements around the last such node and is at least this far from it. Default 1.
        contact_spacing_mm: Option<f64>, for FiniteElement, in 0.1..=100 "mm";
        /// Radius of the patch of tissue that bears the force at the tip, which the tip dents as a rigid punch of this
        /// radius would, in any mesh. Default 5.
        patch_mm: Option<f64>, for FiniteElement | Nonlinear | Viscoelastic, in 0.1..=100 "mm";
        /// Cylinder of masses and springs.
        cylinder: Option<MassSpringParameters>, for MassSpring;
        /// Solver for the steps.
        solver: Option<StepSolverSpec>, for Nonlinear | Viscoelastic;
        /// Viscosity.
        viscosity: Option<TissueViscositySpec>, for Viscoelastic;
        /// Materials of regions, where they differ from the scene's tissues.
        material: Vec<MaterialSpec>;
        /// Fixed nodes.
        fix: Vec<FixSpec>, for FiniteElement | Nonlinear | Viscoelastic;
    }
}

/// Tissue model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TissueModel {
    /// Linear finite elements, remeshed at the tip (Goksel et al. 2011).
    #[default]
    FiniteElement,
    /// Masses and springs in a cylinder around the path of the needle (Zhu et al. 2007).
    MassSpring,
    /// Finite elements that stiffen above a knee strain (`knee_strain` and `stiffening` of a material), pushed,
    /// punctured and cut by a rigid, straight needle (Kobayashi et al. 2010).
    Nonlinear,
    /// Finite elements as in `nonlinear`, with viscosity of fractional order.
    Viscoelastic,
}

impl TissueModel {
    /// Whether its elements are remeshed at the tip, at one of several levels.
    pub fn is_remeshed(self) -> bool {
        self == Self::FiniteElement
    }

    /// Whether the mesh is of the anatomy, and so has a place at rest: that of masses and springs has one once the
    /// needle enters.
    pub fn is_meshed(self) -> bool {
        self != Self::MassSpring
    }

    /// Whether a mesh made from the scene's volume is finer along the needle's path by default.
    pub fn is_finer_along_path(self) -> bool {
        self.is_remeshed()
    }
}

impl Kind for TissueModel {
    fn stated_as(self) -> String {
        format!("`model = {}`", word(&self))
    }
}

/// Device for the dense inverse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceName {
    /// CPU.
    #[default]
    Cpu,
    /// The best GPU adapter, or the one named by `--adapter` or `INSONIFY_ADAPTER`; software Vulkan if there is no
    /// other.
    Gpu,
}

/// Source of the columns of the compliance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ColumnsName {
    /// Each column is solved for when first needed: immediate start, little memory.
    OnDemand,
    /// All columns are computed at the start: seconds to minutes, and the memory of a dense inverse.
    Dense,
}

material_table! {
    /// Material of a region. Keys left open are taken from the scene's tissue of that label.
    pub struct MaterialSpec by TissueModel {
        poisson: Option<f64>;
        /// Sliding friction of the shaft, per length of shaft.
        friction_n_per_mm: Option<f64>, in 0 "N/mm";
        /// Ratio of static to sliding friction. Default 1.
        static_ratio: Option<f64>, in 1;
        /// Cutting force at the advancing tip.
        cutting_n: Option<f64>, in 0 "N";
        /// Puncture force at the surface of this tissue. Default 0: none beyond `cutting_n`.
        puncture_n: Option<f64>, in 0 "N";
        /// Different friction along the shaft near the advancing tip. Default: none.
        peak: Option<Peak>;
        /// Stops the needle, as bone does. Default: only where the region is rigid.
        bone: Option<Bone>;
        /// Whether the needle must avoid the region, as a large vessel: entering it raises an event and a warning.
        /// Default false.
        critical: Option<bool>;
        /// Whether all nodes of the region are fixed. Default: where its Young's modulus is 1e6 kPa or more, as of
        /// bone.
        rigid: Option<bool>;
    }
}

selecting! {
    /// Fixed nodes: by number, or the intersection of a box, a cylinder, a region, its surface and the surface of the
    /// mesh.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields, default)]
    pub struct FixSpec {
        /// Axes along which the nodes are fixed: `x`, `y`, `z` or several. Default `xyz`.
        pub axes: Option<String>,
    }
}

impl MaterialSpec {
    /// Interaction with the needle; keys left open are taken from `usual`.
    pub(crate) fn interaction(&self, usual: &Interaction) -> Interaction {
        Interaction {
            friction_n_per_mm: self.friction_n_per_mm.unwrap_or(usual.friction_n_per_mm),
            static_ratio: self.static_ratio.unwrap_or(usual.static_ratio),
            cutting_n: self.cutting_n.unwrap_or(usual.cutting_n),
            puncture_n: self.puncture_n.unwrap_or(usual.puncture_n),
            peak: self.peak,
            bone: self.bone.or(usual.bone),
            critical: self.critical.unwrap_or(usual.critical),
        }
    }
}
