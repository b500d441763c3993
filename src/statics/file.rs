//! A problem file as it is written.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use schemars::JsonSchema;
use serde::Deserialize;

use super::course::{HistorySpec, Model, SolverSpec, ViscositySpec};
use super::error::StaticsError;
use crate::document::{self, Source};

/// A static problem. Nodes are numbered from 0 in the order of the mesh file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProblemFile {
    /// The mesh, relative to this file: Gmsh or VTK, tetrahedra, coordinates in mm.
    pub mesh: PathBuf,
    /// Name of the mesh's cell array (or physical groups) that numbers the regions. Default: the first usual one.
    pub region: Option<String>,
    /// How tissue answers. Default `linear`.
    #[serde(default)]
    pub model: Model,
    /// Nodes whose displacements are reported.
    #[serde(default)]
    pub report_nodes: Vec<i64>,
    /// What the regions are made of.
    #[serde(default)]
    pub material: Vec<MaterialSpec>,
    /// Prescribed displacements.
    #[serde(default)]
    pub fix: Vec<FixSpec>,
    /// Forces.
    #[serde(default)]
    pub load: Vec<LoadSpec>,
    /// How a nonlinear or viscoelastic problem is solved.
    pub nonlinear: Option<SolverSpec>,
    /// The viscosity of viscoelastic tissue.
    pub viscoelastic: Option<ViscositySpec>,
    /// How loads and prescribed displacements go over time, for nonlinear and viscoelastic tissue.
    pub history: Option<HistorySpec>,
    /// The text that it was read from, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

/// The material of a region, or of all regions that have none of their own.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MaterialSpec {
    /// The region; without one the material is that of all others.
    pub region: Option<i32>,
    /// Young's modulus, kPa, above 0.
    pub young_kpa: f64,
    /// Poisson's ratio, above -1 and below 0.5.
    pub poisson: f64,
    /// The relative strain (0 or more) above which it stiffens, for nonlinear and viscoelastic tissue; sqrt(3)/2 of a knee in simple
    /// shear. Default: never.
    pub knee_strain: Option<f64>,
    /// How fast (0 or more): a in young_kpa (1 + a (strain - knee_strain)^2).
    pub stiffening: Option<f64>,
}

/// Displacements that are prescribed at some nodes.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FixSpec {
    /// The nodes.
    pub nodes: Option<Vec<i64>>,
    /// In place of them: all nodes in this box, its faces included, as two opposite corners, mm. `inf` leaves a side open.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// The axes along which they are fixed: `x`, `y`, `z` or several. Default `xyz`.
    #[serde(default = "all_axes")]
    pub axes: String,
    /// Where they are held, as a displacement from the mesh, mm; only the axes above count. Default 0.
    #[serde(default)]
    pub displacement_mm: [f64; 3],
    /// What it is multiplied by at the times of the history. Default: that of the history.
    pub factor: Option<Vec<f64>>,
}

fn all_axes() -> String {
    "xyz".to_owned()
}

/// A force on some nodes.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadSpec {
    /// The nodes.
    pub nodes: Option<Vec<i64>>,
    /// In place of them: all nodes in this box, its faces included, as two opposite corners, mm. `inf` leaves a side open.
    pub box_mm: Option<[[f64; 3]; 2]>,
    /// The force on each of them, N.
    pub force_n: [f64; 3],
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
