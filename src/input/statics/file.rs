//! Serde types of a problem file.

use std::path::PathBuf;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use super::course::{HistorySpec, Model, SolverSpec, ViscositySpec};
use super::selection::CylinderChoice;
use insonify_base::document::{self, RegionName, Source, Version};
use insonify_base::range::parameters;
use insonify_mechanics::tissue::law::LawSpec;
use insonify_mesh::file::Unit;

/// A static problem. Nodes are numbered from 0 in the order of the mesh file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProblemFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// Tetrahedral mesh, relative to this file: Gmsh or VTK.
    pub mesh: PathBuf,
    /// Length unit of the coordinates in the mesh file: `mm`, `cm` or `m`. Default `mm`.
    #[serde(default)]
    pub mesh_unit: Unit,
    /// Name of the mesh's cell array (or physical groups) that numbers the regions. Default: the first of the
    /// common names.
    #[serde(alias = "region")]
    pub region_array: Option<String>,
    /// Tissue model. Default `linear`.
    #[serde(default)]
    pub model: Model,
    /// Gravitational acceleration, acting on all tissue through its `density_kg_per_m3`, m/s^2, such as `[0, 9.81, 0]` towards the
    /// back. Default: none.
    pub gravity_m_per_s2: Option<[f64; 3]>,
    /// Nodes whose displacements are reported.
    #[serde(default)]
    pub report_nodes: Vec<i64>,
    /// Materials of the regions.
    #[serde(default)]
    pub material: Vec<MaterialSpec>,
    /// Prescribed displacements.
    #[serde(default)]
    pub fix: Vec<FixSpec>,
    /// Forces and pressures.
    #[serde(default)]
    pub load: Vec<LoadSpec>,
    /// Solver of a nonlinear or viscoelastic problem.
    #[serde(alias = "nonlinear")]
    pub solver: Option<SolverSpec>,
    /// Viscosity of viscoelastic tissue.
    #[serde(alias = "viscoelastic")]
    pub viscosity: Option<ViscositySpec>,
    /// Time course of loads and prescribed displacements, for nonlinear and viscoelastic tissue.
    pub history: Option<HistorySpec>,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    pub source: Option<Arc<Source>>,
}

document::input_file!(ProblemFile, in_ranges);

parameters! {
    /// Material of a region, or of all regions without their own.
    #[derive(Default)]
    pub struct MaterialSpec with required keys by Model {
        /// Region: its name, a part of its name, or its number. Without one the material applies to all other regions.
        region: Option<RegionName>;
        /// Young's modulus. Required unless `shear_kpa` is given.
        young_kpa: Option<f64>, above 0 "kPa";
        /// In place of `young_kpa`: shear modulus G. Young's modulus is 2 (1 + poisson) G.
        shear_kpa: Option<f64>, above 0 "kPa";
        /// Poisson's ratio.
        poisson: f64, above -1..0.5;
        /// Law of the tissue, whose moduli at small strain are those above, for example `{ kind = "ogden", alpha = -5 }`; `knee_strain` and
        /// `stiffening` state the law `knee`. Viscosity needs a law with a secant modulus. Default `linear`.
        law: Option<LawSpec>, for Nonlinear | Viscoelastic;
        /// Relative strain (0 or more) above which the tissue stiffens; sqrt(3)/2 times a knee in simple shear. Default: no stiffening.
        knee_strain: Option<f64>, for Nonlinear | Viscoelastic;
        /// Stiffening coefficient: a in E (1 + a (strain - knee_strain)^2).
        stiffening: Option<f64>, for Nonlinear | Viscoelastic, in 0;
        /// Density: about 1050 for soft tissue. Required with `gravity_m_per_s2`.
        density_kg_per_m3: Option<f64>, above 0..=1e6 "kg/m^3";
    }
}

/// Prescribed displacements of nodes: selected by number, or as the intersection of a box, a cylinder, a region, its surface and the
/// surface of the mesh.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FixSpec {
    /// Node numbers.
    pub nodes: Option<Vec<i64>>,
    /// All nodes in this box, including its faces, as two opposite corners, mm. `inf` leaves a side open.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// All nodes inside or outside of an endless cylinder, or near its wall.
    pub cylinder: Option<CylinderChoice>,
    /// All nodes on the surface of a region, where it borders on others or on nothing: its name, a part of its name, or its number.
    pub surface_of: Option<RegionName>,
    /// All nodes of a region: its name, a part of its name, or its number.
    pub region: Option<RegionName>,
    /// Only nodes on the surface of the mesh. Default false.
    #[serde(default)]
    pub surface: bool,
    /// Axes along which the nodes are fixed: `x`, `y`, `z` or several. Default `xyz`.
    #[serde(default = "all_axes")]
    pub axes: String,
    /// Prescribed displacement from the mesh, mm (-1e6 to 1e6); only the components in `axes` count. Default 0.
    #[serde(default)]
    pub displacement_mm: [f64; 3],
    /// Factors on the displacement at the times of the history. Default: those of the history.
    pub factor: Option<Vec<f64>>,
}

fn all_axes() -> String {
    "xyz".to_owned()
}

/// A load on nodes, selected as in `[[fix]]`, or on the surface between them: exactly one of `total_force_n`, `pressure_kpa` and
/// `node_force_n`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LoadSpec {
    /// Node numbers.
    pub nodes: Option<Vec<i64>>,
    /// All nodes in this box, including its faces, as two opposite corners, mm. `inf` leaves a side open.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// All nodes inside or outside of an endless cylinder, or near its wall.
    pub cylinder: Option<CylinderChoice>,
    /// All nodes on the surface of a region, where it borders on others or on nothing: its name, a part of its name, or its number.
    pub surface_of: Option<RegionName>,
    /// All nodes of a region: its name, a part of its name, or its number.
    pub region: Option<RegionName>,
    /// Only nodes on the surface of the mesh. Default false; `total_force_n` and `pressure_kpa` act on the surface
    /// in any case.
    pub surface: bool,
    /// Total force, spread evenly over the surface faces whose nodes are all selected, N.
    pub total_force_n: Option<[f64; 3]>,
    /// Pressure on these faces, kPa; positive values push inwards.
    pub pressure_kpa: Option<f64>,
    /// Force on each node, N: a finer mesh has more nodes, and a larger total force.
    #[serde(alias = "force_n")]
    pub node_force_n: Option<[f64; 3]>,
    /// Factors on the load at the times of the history. Default: those of the history.
    pub factor: Option<Vec<f64>>,
}
