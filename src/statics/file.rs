//! A problem file as it is written.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use super::course::{HistorySpec, Model, SolverSpec, ViscositySpec};
use super::error::StaticsError;
use crate::document::{self, RegionName, Source, Version};
use crate::mechanics::mesh::file::Unit;

/// A static problem. Nodes are numbered from 0 in the order of the mesh file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProblemFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// The mesh, relative to this file: Gmsh or VTK, tetrahedra.
    pub mesh: PathBuf,
    /// The length that a coordinate of 1 stands for in the mesh file: `mm`, `cm` or `m`. Default `mm`.
    #[serde(default)]
    pub mesh_unit: Unit,
    /// Name of the mesh's cell array (or physical groups) that numbers the regions. Default: the first usual one.
    #[serde(alias = "region")]
    pub region_array: Option<String>,
    /// How tissue answers. Default `linear`.
    #[serde(default)]
    pub model: Model,
    /// Acceleration that pulls on all tissue by its `density_kg_per_m3`, m/s^2, such as `[0, 9.81, 0]` towards the back. Default: none.
    pub gravity_m_per_s2: Option<[f64; 3]>,
    /// Nodes whose displacements are reported.
    #[serde(default)]
    pub report_nodes: Vec<i64>,
    /// What the regions are made of.
    #[serde(default)]
    pub material: Vec<MaterialSpec>,
    /// Prescribed displacements.
    #[serde(default)]
    pub fix: Vec<FixSpec>,
    /// Forces and pressures.
    #[serde(default)]
    pub load: Vec<LoadSpec>,
    /// How a nonlinear or viscoelastic problem is solved.
    #[serde(alias = "nonlinear")]
    pub solver: Option<SolverSpec>,
    /// The viscosity of viscoelastic tissue.
    #[serde(alias = "viscoelastic")]
    pub viscosity: Option<ViscositySpec>,
    /// How loads and prescribed displacements go over time, for nonlinear and viscoelastic tissue.
    pub history: Option<HistorySpec>,
    /// The text that it was read from, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

/// The material of a region, or of all regions that have none of their own.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialSpec {
    /// The region: its name, a part of one, or its number. Without one the material is that of all others.
    pub region: Option<RegionName>,
    /// Young's modulus, kPa, above 0.
    pub young_kpa: f64,
    /// Poisson's ratio, above -1 and below 0.5.
    pub poisson: f64,
    /// The relative strain (0 or more) above which it stiffens, for nonlinear and viscoelastic tissue; sqrt(3)/2 of a knee in simple
    /// shear. Default: never.
    pub knee_strain: Option<f64>,
    /// How fast (0 or more): a in young_kpa (1 + a (strain - knee_strain)^2).
    pub stiffening: Option<f64>,
    /// Density, kg/m^3 (above 0, at most 1e6): about 1050 of soft tissue. Needed with `gravity_m_per_s2`.
    pub density_kg_per_m3: Option<f64>,
}

/// Displacements that are prescribed at some nodes: by number, or all that a box, a region and the surface have in common.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FixSpec {
    /// The nodes.
    pub nodes: Option<Vec<i64>>,
    /// All nodes in this box, its faces included, as two opposite corners, mm. `inf` leaves a side open.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// All nodes of a region: its name, a part of one, or its number.
    pub region: Option<RegionName>,
    /// Only nodes on the surface of the mesh. Default false.
    #[serde(default)]
    pub surface: bool,
    /// The axes along which they are fixed: `x`, `y`, `z` or several. Default `xyz`.
    #[serde(default = "all_axes")]
    pub axes: String,
    /// Where they are held, as a displacement from the mesh, mm (-1e6 to 1e6); only the axes above count. Default 0.
    #[serde(default)]
    pub displacement_mm: [f64; 3],
    /// What it is multiplied by at the times of the history. Default: that of the history.
    pub factor: Option<Vec<f64>>,
}

fn all_axes() -> String {
    "xyz".to_owned()
}

/// A load on some nodes, chosen as in `[[fix]]`, or on the surface between them: exactly one of `total_force_n`, `pressure_kpa` and
/// `node_force_n`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LoadSpec {
    /// The nodes.
    pub nodes: Option<Vec<i64>>,
    /// All nodes in this box, its faces included, as two opposite corners, mm. `inf` leaves a side open.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// All nodes of a region: its name, a part of one, or its number.
    pub region: Option<RegionName>,
    /// Only nodes on the surface of the mesh. Default false; the first two loads act on the surface in any case.
    pub surface: bool,
    /// A force spread evenly over the faces of the surface whose nodes are all chosen, N in all.
    pub total_force_n: Option<[f64; 3]>,
    /// A pressure on these faces, kPa; above 0 it pushes inwards.
    pub pressure_kpa: Option<f64>,
    /// The force on each node, N: a finer mesh has more nodes, and more force in all.
    #[serde(alias = "force_n")]
    pub node_force_n: Option<[f64; 3]>,
    /// What it is multiplied by at the times of the history. Default: that of the history.
    pub factor: Option<Vec<f64>>,
}

impl ProblemFile {
    /// Reads a problem file.
    ///
    /// # Errors
    /// [`StaticsError`] for a file that cannot be read or is no problem.
    pub fn read(path: &Path) -> Result<Self, StaticsError> {
        Self::parse(&document::read(path)?, &path.display().to_string())
    }

    /// Parses the text of a problem file; `name` names it in errors.
    ///
    /// # Errors
    /// [`StaticsError`] that points at what is no TOML, at a key that no problem has, or at a value of the wrong type.
    pub fn parse(text: &str, name: &str) -> Result<Self, StaticsError> {
        let (mut file, source): (Self, _) = document::parse(text, name)?;
        file.source = Some(source);
        Ok(file)
    }
}
