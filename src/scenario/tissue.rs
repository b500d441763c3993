//! The tissue of a scenario as it is written.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cylinder::CylinderSpec;
use super::stiffened::{StepSolverSpec, TissueViscositySpec};
use crate::document::RegionName;
use crate::mechanics::insertion::{Bone, Interaction, Peak};
use crate::mechanics::mesh::file::Unit;
use crate::mechanics::tissue::remesh::{Level, Precision};

/// Nodes of a mesh made from the scene's volume where a scenario states none: those of Goksel et al. 2011.
pub const DEFAULT_NODES: u32 = 3300;

/// How tissue yields.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TissueSpec {
    /// The model. Default `finite-element`.
    pub model: TissueModel,
    /// A tetrahedral mesh (`.vtu`, `.vtk`, `.msh`; LPS). Its regions are label values of the scene's volume, or have a
    /// `[[tissue.material]]` each. Default: one made from the scene's volume.
    pub mesh: Option<PathBuf>,
    /// The length that a coordinate of 1 stands for in `mesh`: `mm`, `cm` or `m`. Default `mm`.
    pub mesh_unit: Unit,
    /// Name of the cell array (or physical groups) of `mesh` that numbers the regions. Default: the first usual one.
    pub region_array: Option<String>,
    /// The most nodes of a mesh made from the scene's volume (8 to 1000000). Default 3300.
    pub nodes: Option<u32>,
    /// The part of the volume that is meshed, as two opposite corners, mm; `inf` leaves a side open. Default: all of it.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// Whether the elements of a mesh made from the scene's volume are finer along the needle's path. Default: true of
    /// `finite-element`, false of the other models.
    pub along_path: Option<bool>,
    /// Labels that are left out of the mesh, such as gel or air: names or values.
    pub outside: Vec<RegionName>,
    /// How much of the compliance follows each change of the mesh (finite elements). Default `exact`.
    pub level: Option<LevelName>,
    /// Where a dense inverse is kept and updated, at levels I to IV. Default `cpu`.
    pub device: Option<DeviceName>,
    /// Precision of a dense inverse. Default `f64`, on a GPU `f32`, the only one there; the exact level is always in `f64`.
    pub precision: Option<PrecisionName>,
    /// Where the compliance comes from. Default `on-demand` for the exact level, `dense` for all others.
    pub columns: Option<ColumnsName>,
    /// Least distance between nodes on the needle, mm (0.1 to 100; finite elements): a node of the mesh is moved to the tip when that has left
    /// all elements around the last one and is as far from it. Default 1.
    pub contact_spacing_mm: Option<f64>,
    /// The cylinder of a mass-spring model.
    pub cylinder: Option<CylinderSpec>,
    /// How steps of a nonlinear or viscoelastic model are solved.
    pub solver: Option<StepSolverSpec>,
    /// The viscosity of a viscoelastic model.
    pub viscosity: Option<TissueViscositySpec>,
    /// What regions are made of, where they differ from the scene's tissues.
    pub material: Vec<MaterialSpec>,
    /// Nodes that do not move.
    pub fix: Vec<FixSpec>,
}

/// Models of tissue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TissueModel {
    /// Linear finite elements, remeshed at the tip (Goksel et al. 2011).
    #[default]
    FiniteElement,
    /// Masses and springs in a cylinder around the path of the needle (Zhu et al. 2007).
    MassSpring,
    /// Finite elements that stiffen above a knee of strain (`knee_strain` and `stiffening` of a material), pushed, punctured and cut by
    /// a rigid needle that goes straight (Kobayashi et al. 2010).
    Nonlinear,
    /// As `nonlinear`, and viscous of a fractional order.
    Viscoelastic,
}

/// Levels of remeshing: see `docs/remeshing.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum LevelName {
    /// Exact where the contacts are, from an untouched base.
    #[default]
    #[serde(rename = "exact")]
    Exact,
    /// The whole inverse follows every change.
    I,
    /// Rows and columns of the moved node and its neighbours follow.
    II,
    /// Rows and columns of the moved node follow.
    III,
    /// Nothing follows.
    IV,
}

impl From<LevelName> for Level {
    fn from(name: LevelName) -> Level {
        match name {
            LevelName::Exact => Level::Exact,
            LevelName::I => Level::I,
            LevelName::II => Level::II,
            LevelName::III => Level::III,
            LevelName::IV => Level::IV,
        }
    }
}

/// Precisions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum PrecisionName {
    /// Double.
    #[default]
    #[serde(rename = "f64")]
    Double,
    /// Single.
    #[serde(rename = "f32")]
    Single,
}

impl From<PrecisionName> for Precision {
    fn from(name: PrecisionName) -> Precision {
        match name {
            PrecisionName::Double => Precision::Double,
            PrecisionName::Single => Precision::Single,
        }
    }
}

/// Devices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceName {
    /// The processor.
    #[default]
    Cpu,
    /// The best GPU adapter, or the one that `--adapter` or `INSONIFY_ADAPTER` names; software Vulkan where there is no other.
    Gpu,
}

/// Where columns of the compliance come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ColumnsName {
    /// Each is solved for when it is first needed: starts at once, small.
    OnDemand,
    /// All are computed at the start: seconds to minutes, and the memory of a dense inverse.
    Dense,
}

/// What a region is made of. What is left open is that of the scene's tissue of that label.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MaterialSpec {
    /// The region: its name, a part of one, or its number. Without one the table is for all regions that have none of their own.
    pub region: Option<RegionName>,
    /// Young's modulus, kPa (above 0).
    pub young_kpa: Option<f64>,
    /// Poisson's ratio (above -1, below 0.5).
    pub poisson: Option<f64>,
    /// Nonlinear and viscoelastic models: the relative strain above which it stiffens (0 or more). Default: it never does. In simple
    /// shear the relative strain is 0.866 of the shear.
    pub knee_strain: Option<f64>,
    /// With `knee_strain`: how fast, a in E (1 + a (e - knee)^2) (0 or more).
    pub stiffening: Option<f64>,
    /// Sliding friction of the shaft, N for each mm of it (0 or more).
    pub friction_n_per_mm: Option<f64>,
    /// Static over sliding friction (1 or more). Default 1.
    pub static_ratio: Option<f64>,
    /// Force that cuts the tissue at the advancing tip, N (0 or more).
    pub cutting_n: Option<f64>,
    /// Force at the tip that breaks the surface of this tissue, N (0 or more). Default 0: none beyond `cutting_n`.
    pub puncture_n: Option<f64>,
    /// Another force along the shaft near the advancing tip. Default: none.
    pub peak: Option<PeakSpec>,
    /// The needle is stopped, as by bone. Default: only where the region is rigid.
    pub bone: Option<BoneSpec>,
    /// The needle must not enter it, as a large vessel: an event and a warning tell if it does. Default false.
    pub critical: Option<bool>,
    /// All nodes of the region are fixed. Default: where its Young's modulus is 1e6 kPa or more, as of bone.
    pub rigid: Option<bool>,
}

/// The three-parameter force of Dehghan et al. 2008: within `width_mm` of the tip, while that cuts, the shaft meets this force per
/// length in place of `friction_n_per_mm`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PeakSpec {
    /// Force per length within `width_mm` of the tip, N/mm (0 or more).
    pub density_n_per_mm: f64,
    /// mm (above 0).
    pub width_mm: f64,
}

/// Bone. The force on the tip grows in proportion to its depth in the bone, up to `stiffness_n_per_mm` x `penetration_mm`: then the
/// needle stops, and stays behind the hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoneSpec {
    /// Force for each mm of depth, N/mm (above 0). Default for bone 40.
    pub stiffness_n_per_mm: f64,
    /// The depth at which the needle stops, mm (above 0). Default for bone 0.5: the hand feels 20 N at most.
    pub penetration_mm: f64,
}

/// Nodes that do not move: by number, or all that a box, a region and the surface have in common.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FixSpec {
    /// The nodes, by number from 0 in the order of the mesh file.
    pub nodes: Option<Vec<i64>>,
    /// All nodes in this box, its faces included, as two opposite corners, mm. `inf` leaves a side open.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// All nodes of a region: its name, a part of one, or its number.
    pub region: Option<RegionName>,
    /// Only nodes on the surface of the mesh. Default false.
    pub surface: bool,
    /// The axes along which they are fixed: `x`, `y`, `z` or several. Default `xyz`.
    pub axes: Option<String>,
}

impl MaterialSpec {
    /// The interaction, of which what is left open is as in `usual`.
    pub(super) fn interaction(&self, usual: &Interaction) -> Interaction {
        Interaction {
            friction_n_per_mm: self.friction_n_per_mm.unwrap_or(usual.friction_n_per_mm),
            static_ratio: self.static_ratio.unwrap_or(usual.static_ratio),
            cutting_n: self.cutting_n.unwrap_or(usual.cutting_n),
            puncture_n: self.puncture_n.unwrap_or(usual.puncture_n),
            peak: self.peak.map(|peak| Peak {
                density_n_per_mm: peak.density_n_per_mm,
                width_mm: peak.width_mm,
            }),
            bone: self.bone.map_or(usual.bone, |bone| {
                Some(Bone {
                    stiffness_n_per_mm: bone.stiffness_n_per_mm,
                    penetration_mm: bone.penetration_mm,
                })
            }),
            critical: self.critical.unwrap_or(usual.critical),
        }
    }
}
