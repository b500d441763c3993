//! Serde types of a problem file.

use std::path::PathBuf;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::course::{HistorySpec, Model, SolverSpec, ViscositySpec};
use crate::input::material::material_table;
use crate::input::selection::selecting;
use insonify_base::document::{self, Source, Version};
use insonify_base::range::parameters;
use insonify_mesh::file::Unit;

parameters! {
    /// A static problem. Nodes are numbered from 0 in the order of the mesh file.
    pub struct ProblemFile with required keys by Model in model {
        /// Version of the format: 1, which is the default.
        version: Option<Version>;
        /// Tetrahedral mesh, relative to this file: Gmsh or VTK.
        mesh: PathBuf;
        /// Length unit of the coordinates in the mesh file: `mm`, `cm` or `m`. Default `mm`.
        #[serde(default)]
        mesh_unit: Unit;
        /// Name of the mesh's cell array (or physical groups) that numbers the regions. Default: the first of the
        /// common names.
        #[serde(alias = "region")]
        region_array: Option<String>;
        /// Tissue model. Default `linear`.
        #[serde(default)]
        model: Model;
        /// Gravitational acceleration, acting on all tissue through its `density_kg_per_m3`, m/s^2, such as `[0, 9.81,
        /// 0]` towards the back. Default: none.
        gravity_m_per_s2: Option<[f64; 3]>;
        /// Nodes whose displacements are reported.
        #[serde(default)]
        report_nodes: Vec<i64>;
        /// Materials of the regions.
        #[serde(default)]
        material: Vec<MaterialSpec>;
        /// Prescribed displacements.
        #[serde(default)]
        fix: Vec<FixSpec>;
        /// Forces and pressures.
        #[serde(default)]
        load: Vec<LoadSpec>;
        /// Solver.
        #[serde(alias = "nonlinear")]
        solver: Option<SolverSpec>, for Nonlinear | Viscoelastic;
        /// Time course of loads and prescribed displacements.
        history: Option<HistorySpec>, for Nonlinear | Viscoelastic;
        /// Viscosity.
        #[serde(alias = "viscoelastic")]
        viscosity: Option<ViscositySpec>, for Viscoelastic;
        /// Source text, for errors that point into it.
        #[serde(skip)]
        source: Option<Arc<Source>>;
    }
}

document::input_file!(ProblemFile, in_ranges);

material_table! {
    /// Material of a region, or of all regions without their own.
    #[derive(Default)]
    pub struct MaterialSpec with required keys by Model {
        poisson: f64;
        /// Density: about 1050 for soft tissue. Required with `gravity_m_per_s2`.
        density_kg_per_m3: Option<f64>, above 0..=1e6 "kg/m^3";
    }
}

selecting! {
    /// Prescribed displacements of nodes: selected by number, or as the intersection of a box, a cylinder, a region,
    /// its surface and the surface of the mesh.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    pub struct FixSpec {
        /// Axes along which the nodes are fixed: `x`, `y`, `z` or several. Default `xyz`.
        #[serde(default = "all_axes")]
        pub axes: String,
        /// Prescribed displacement from the mesh, mm (-1e6 to 1e6); only the components in `axes` count. Default 0.
        #[serde(default)]
        pub displacement_mm: [f64; 3],
        /// Factors on the displacement at the times of the history. Default: those of the history.
        pub factor: Option<Vec<f64>>,
    }
}

fn all_axes() -> String {
    "xyz".to_owned()
}

selecting! {
    /// A load on nodes, selected as in `[[fix]]`, or on the surface between them: exactly one of `total_force_n`,
    /// `pressure_kpa` and `node_force_n`.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields, default)]
    pub struct LoadSpec {
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
}
