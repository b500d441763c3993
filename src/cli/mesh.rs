//! `insonify mesh`: tetrahedral meshes.

mod make;

use std::fmt;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use crate::terminal;
use crate::variants::variants;
use insonify::Error;
use insonify_base::text;
use insonify_mesh::file::{MeshFile, ReadOptions, Unit, read_mesh};
use insonify_mesh::quality::{Bin, Quality};

/// Makes and inspects tetrahedral meshes
#[derive(Args)]
pub(crate) struct Mesh {
    #[command(subcommand)]
    command: Command,
}

commands! {
    enum Command {
        Info(Info),
        Make(Box<make::Make>),
    }
}

impl Mesh {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.command.run()
    }
}

// `insonify mesh info`: contents and quality of a mesh file.

const NOTES: &str = "\
A file that is no mesh of tetrahedra, or in which a tetrahedron names a node twice or one that is not there, or three
tetrahedra share a face, is an error (exit status 2). Inverted, flat and too thin tetrahedra are reported as a warning:
such a mesh can be inspected, but not used for computation.";

/// Prints nodes, elements, regions, volumes and the quality of the elements of a mesh
#[derive(Args)]
#[command(after_help = NOTES)]
pub(crate) struct Info {
    /// Mesh file: Gmsh 2.2 or 4.1 (.msh), or VTK (.vtk, .vtu); LPS
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Length unit of the coordinates
    #[arg(long, value_parser = variants::<Unit>(), default_value = "mm")]
    unit: Unit,
    /// Cell array with the region numbers (of Gmsh: `gmsh:physical` or `gmsh:geometrical`); by default the first of
    /// `region`, `label`, `material`, `medit:ref`, `gmsh:physical` and `CellEntityIds`, or else the only one of a few
    /// whole numbers
    #[arg(long, alias = "region", value_name = "NAME")]
    region_array: Option<String>,
    /// Print JSON: `nodes`, `elements`, `bounds_mm`, `volume_ml`, `regions`, `parts`, `quality`, `warnings`; infinite
    /// or missing numbers are null
    #[arg(long)]
    json: bool,
}

impl Info {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let options = ReadOptions {
            region: self.region_array.as_deref(),
            unit: self.unit,
            ..ReadOptions::default()
        };
        let file = read_mesh(&self.file, &options)?;
        let quality = Quality::measure(&file.mesh, file.mesh.nodes());
        let report = MeshReport::new(&self.file, &file, &quality);
        terminal::print(&report, self.json)
    }
}

// Report on a mesh, as text and JSON.

/// Contents and quality of a mesh.
#[derive(Serialize)]
pub(crate) struct MeshReport {
    file: String,
    nodes: usize,
    elements: usize,
    /// Number of ignored cells of lower dimension.
    skipped_cells: usize,
    bounds_mm: [[f64; 3]; 2],
    volume_ml: f64,
    regions: Vec<RegionReport>,
    /// Number of disconnected parts.
    parts: usize,
    quality: QualityReport,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct RegionReport {
    value: i32,
    name: Option<String>,
    elements: usize,
    volume_ml: f64,
}

#[derive(Serialize)]
struct QualityReport {
    min_volume_mm3: f64,
    median_volume_mm3: f64,
    max_volume_mm3: f64,
    min_dihedral_deg: f64,
    median_min_dihedral_deg: f64,
    median_max_dihedral_deg: f64,
    max_dihedral_deg: f64,
    median_jacobian_condition: f64,
    max_jacobian_condition: f64,
    min_dihedral_histogram: Vec<Bin>,
    jacobian_condition_histogram: Vec<Bin>,
    /// Whether the mesh is suitable for computation.
    usable: bool,
    inverted: Vec<u32>,
    flat: Vec<u32>,
    too_thin: Vec<u32>,
    duplicates: Vec<[u32; 2]>,
    isolated_nodes: Vec<u32>,
    coincident_nodes: Vec<[u32; 2]>,
}

impl MeshReport {
    pub(crate) fn new(path: &Path, file: &MeshFile, quality: &Quality) -> MeshReport {
        let regions = quality.regions.iter().map(|region| RegionReport {
            value: region.value,
            name: file.region_names.get(&region.value).cloned(),
            elements: region.elements,
            volume_ml: region.volume_ml,
        });
        MeshReport {
            file: path.display().to_string(),
            nodes: file.mesh.nodes().len(),
            elements: file.mesh.elements().len(),
            skipped_cells: file.skipped_cells,
            bounds_mm: file.mesh.bounds(),
            volume_ml: quality.volume_ml(),
            regions: regions.collect(),
            parts: quality.parts.len(),
            quality: QualityReport::new(quality),
            warnings: warnings(file, quality),
        }
    }
}

impl QualityReport {
    fn new(quality: &Quality) -> QualityReport {
        QualityReport {
            min_volume_mm3: quality.volume_mm3.min,
            median_volume_mm3: quality.volume_mm3.median,
            max_volume_mm3: quality.volume_mm3.max,
            min_dihedral_deg: quality.min_dihedral_deg.min,
            median_min_dihedral_deg: quality.min_dihedral_deg.median,
            median_max_dihedral_deg: quality.max_dihedral_deg.median,
            max_dihedral_deg: quality.max_dihedral_deg.max,
            median_jacobian_condition: quality.condition.median,
            max_jacobian_condition: quality.condition.max,
            min_dihedral_histogram: quality.min_dihedral_deg.histogram.clone(),
            jacobian_condition_histogram: quality.condition.histogram.clone(),
            usable: quality.usable().is_ok(),
            inverted: quality.inverted.clone(),
            flat: quality.flat.clone(),
            too_thin: quality.slivers.clone(),
            duplicates: quality.duplicates.clone(),
            isolated_nodes: quality.isolated_nodes.clone(),
            coincident_nodes: quality.coincident_nodes.clone(),
        }
    }
}

fn warnings(file: &MeshFile, quality: &Quality) -> Vec<String> {
    let mut warnings = file.warnings.clone();
    if let Err(unusable) = quality.usable() {
        warnings.push(unusable.to_string());
    }
    if let Some(first) = quality.isolated_nodes.first() {
        let count = quality.isolated_nodes.len();
        warnings.push(format!(
            "{count} nodes belong to no tetrahedron (the first is node {first})"
        ));
    }
    if let Some([a, b]) = quality.coincident_nodes.first() {
        let count = quality.coincident_nodes.len();
        warnings.push(format!(
            "{count} nodes are in the place of another (the first is node {b}, at node {a}): parts may only seem to touch"
        ));
    }
    if quality.face_parts > quality.parts.len() {
        warnings.push(format!(
            "{} parts are joined only by nodes or edges, as by hinges",
            quality.face_parts
        ));
    }
    warnings
}

impl fmt::Display for MeshReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.bounds_mm;
        writeln!(f, "file         {}", text::clipped(&self.file, text::MESSAGE))?;
        writeln!(f, "nodes        {}", self.nodes)?;
        write!(f, "elements     {} tetrahedra", self.elements)?;
        match self.skipped_cells {
            0 => writeln!(f)?,
            count => writeln!(f, " ({count} vertices, lines and surfaces left out)")?,
        }
        write!(f, "bounds       ")?;
        for axis in 0..3 {
            let end = if axis < 2 { ", " } else { " mm (LPS)\n" };
            write!(
                f,
                "{} {:.3} to {:.3}{end}",
                ["x", "y", "z"][axis],
                low[axis],
                high[axis]
            )?;
        }
        writeln!(f, "volume       {:.2} ml", self.volume_ml)?;
        writeln!(f, "parts        {}", self.parts)?;
        writeln!(f)?;
        self.regions(f)?;
        writeln!(f)?;
        self.quality.shapes(f)?;
        for warning in &self.warnings {
            writeln!(f, "warning: {}", text::clipped(warning, text::MESSAGE))?;
        }
        Ok(())
    }
}

impl MeshReport {
    fn regions(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self
            .regions
            .iter()
            .map(|region| region.name.as_deref().unwrap_or_default());
        let names = text::column("name", names);
        writeln!(f, "{:>6}  {}  {:>10}  {:>12}", "region", names[0], "elements", "ml")?;
        for (region, name) in self.regions.iter().zip(&names[1..]) {
            writeln!(
                f,
                "{:>6}  {name}  {:>10}  {:>12.2}",
                region.value, region.elements, region.volume_ml
            )?;
        }
        Ok(())
    }
}

impl QualityReport {
    fn shapes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<32}  {:>10}  {:>10}", "quality", "median", "worst")?;
        for (what, median, worst) in [
            ("volume, mm3", self.median_volume_mm3, self.min_volume_mm3),
            (
                "least dihedral angle, deg",
                self.median_min_dihedral_deg,
                self.min_dihedral_deg,
            ),
            (
                "greatest dihedral angle, deg",
                self.median_max_dihedral_deg,
                self.max_dihedral_deg,
            ),
            (
                "Jacobian condition (regular: 1)",
                self.median_jacobian_condition,
                self.max_jacobian_condition,
            ),
        ] {
            writeln!(f, "{what:<32}  {:>10}  {:>10}", number(median), number(worst))?;
        }
        for (what, counts) in [
            ("least dihedral angle, deg", &self.min_dihedral_histogram),
            ("Jacobian condition", &self.jacobian_condition_histogram),
        ] {
            writeln!(f, "\n{what:<32}  {:>10}", "elements")?;
            for bin in counts.iter().filter(|bin| bin.count > 0) {
                let range = if bin.high.is_finite() {
                    format!("{} to {}", bin.low, bin.high)
                } else {
                    format!("{} and more", bin.low)
                };
                writeln!(f, "{range:>32}  {:>10}", bin.count)?;
            }
        }
        Ok(())
    }
}

/// Formats a number with four significant digits.
fn number(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        f64::INFINITY => "infinite".to_owned(),
        size if (0.01..10_000.0).contains(&size) => format!("{value:.3}"),
        _ => format!("{value:.2e}"),
    }
}
