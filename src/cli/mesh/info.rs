//! `insonify mesh info`: contents and quality of a mesh file.

mod report;

use std::path::PathBuf;

use crate::mechanics::mesh::file::{ReadOptions, Unit, read_mesh};
use crate::mechanics::mesh::quality::Quality;
use clap::Args;

use crate::cli::failure::Failure;
use crate::cli::terminal;
use crate::cli::variants::variants;
use report::Report;

const NOTES: &str = "\
A file that is no mesh of tetrahedra, or in which a tetrahedron names a node twice or one that is not there, or three
tetrahedra share a face, is an error (exit status 2). Inverted, flat and too thin tetrahedra are reported as a warning:
the file can be looked at, but not be calculated on.";

/// Prints nodes, elements, regions, volumes and the quality of the elements of a mesh
#[derive(Args)]
#[command(after_help = NOTES)]
pub struct Info {
    /// Mesh file: Gmsh 2.2 or 4.1 (.msh), or VTK (.vtk, .vtu); LPS
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Length unit of the coordinates
    #[arg(long, value_parser = variants::<Unit>(), default_value = "mm")]
    unit: Unit,
    /// Cell array with the region numbers (of Gmsh: `gmsh:physical` or `gmsh:geometrical`); by default the first of
    /// `region`, `label`, `material`, `medit:ref`, `gmsh:physical` and `CellEntityIds`
    #[arg(long, alias = "region", value_name = "NAME")]
    region_array: Option<String>,
    /// Print JSON: `nodes`, `elements`, `bounds_mm`, `volume_ml`, `regions`, `parts`, `quality`, `warnings`; infinite or
    /// missing numbers are null
    #[arg(long)]
    json: bool,
}

impl Info {
    pub fn run(&self) -> Result<(), Failure> {
        let options = ReadOptions {
            region: self.region_array.as_deref(),
            unit: self.unit,
            ..ReadOptions::default()
        };
        let file = read_mesh(&self.file, &options)?;
        let quality = Quality::of(&file.mesh, file.mesh.nodes());
        let report = Report::new(&self.file, &file, &quality);
        if self.json {
            terminal::emit_json(&report)
        } else {
            terminal::emit(&report.to_string())
        }
    }
}
