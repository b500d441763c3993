//! `insonify solve`: a static problem of tissue mechanics.

use std::path::{Path, PathBuf};

use clap::Args;
use insonify::mechanics::mesh::file::write_vtu;
use insonify::statics::{self, ProblemFile, Report};

use super::failure::Failure;
use super::{terminal, vtu};

const EXAMPLES: &str = "\
The problem file names a mesh, [[material]] by region, [[fix]] and [[load]] by node numbers or by a box:
  mesh = \"block.vtu\"
  report_nodes = [7]
  [[material]]
  young_kpa = 5.0
  poisson = 0.45
  [[fix]]
  box_mm = [[-inf, -inf, -inf], [inf, inf, 0.0]]
  [[load]]
  nodes = [7]
  force_n = [0.0, 0.0, 0.002]

Examples:
  insonify solve --example > problem.toml          a file to start from: every key, its unit and default
  insonify solve problem.toml                      displacements and reactions as a table
  insonify solve problem.toml -o deformed.vtu      for ParaView: warp by the point array `displacement`
  insonify solve problem.toml --json | jq .displacement_mm
  insonify schema solve                            every key, as a JSON schema

Linear elastic tetrahedra in static balance, solved directly; `residual` is the normwise backward error, about 1e-16.
Exit status: 0 solved; 2 the problem or a file is wrong; 1 what the machine could not do.";

/// Solves a static problem: how tissue deforms under forces and prescribed displacements
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Solve {
    /// Problem file: mesh, materials, what is fixed and what is loaded
    #[arg(value_name = "PROBLEM.toml", required_unless_present = "example")]
    problem: Option<PathBuf>,
    /// Print a problem file to start from, which says how its mesh is made
    #[arg(long, conflicts_with_all = ["problem", "json", "output"])]
    example: bool,
    /// Print one JSON object: `nodes`, `elements`, `residual`, `displacement_mm`, `max_displacement_mm`, `reaction_n`, `seconds`, `warnings`
    #[arg(long)]
    json: bool,
    /// Write the mesh with its displacements (point array `displacement`, mm)
    #[arg(short, long, value_name = "OUT.vtu")]
    output: Option<PathBuf>,
}

impl Solve {
    pub fn run(&self) -> Result<(), Failure> {
        let Some(path) = self.problem.as_deref().filter(|_| !self.example) else {
            return terminal::emit(statics::EXAMPLE);
        };
        self.output.as_deref().map_or(Ok(()), vtu::check)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let problem = ProblemFile::read(path)?.resolve(folder)?;
        problem.warnings().iter().for_each(terminal::warn);
        let solution = problem.solve()?;
        if let Some(output) = &self.output {
            write_vtu(output, problem.mesh(), Some(&solution.displacement_mm))?;
        }
        let report = Report::new(&problem, &solution);
        if self.json {
            terminal::emit_json(&report)
        } else {
            terminal::emit(&report.to_string())
        }
    }
}
