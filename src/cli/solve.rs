//! `insonify solve`: a static problem of tissue mechanics.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use insonify::mechanics::mesh::file::write_vtu;
use insonify::statics::{self, Model, ProblemFile, Report};

use super::failure::Failure;
use super::output::{self, Force};
use super::terminal;

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

By default tissue is linear elastic, solved directly; `residual` is the normwise backward error, about 1e-16.
With `model = \"nonlinear\"` a material stiffens above a knee: young_kpa (1 + stiffening (e - knee_strain)^2), e the relative strain.
With `model = \"viscoelastic\"` it creeps too, with a derivative of fractional order ([viscoelastic]). Both follow a [history]
of times and factors of all loads and displacements, in steps; [nonlinear] says how each step is solved:
  insonify solve --example=viscoelastic > creep.toml
  insonify solve creep.toml --history creep.csv    displacements of report_nodes and forces of each fix, a row a step
Exit status: 0 solved; 2 the problem or a file is wrong; 1 what the machine could not do.";

/// Solves a static problem: how tissue deforms under forces and prescribed displacements
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Solve {
    /// Problem file: mesh, materials, what is fixed and what is loaded
    #[arg(value_name = "PROBLEM.toml", required_unless_present = "example")]
    problem: Option<PathBuf>,
    /// Print a problem file to start from, which says how its mesh is made
    #[arg(
        long, value_name = "MODEL", num_args = 0..=1, require_equals = true, default_missing_value = "linear",
        conflicts_with_all = ["problem", "json", "output", "history"]
    )]
    example: Option<Example>,
    /// Print one JSON object: `model`, `nodes`, `elements`, `residual`, `displacement_mm`, `max_displacement_mm`, `reaction_n`,
    /// `seconds`, `warnings`, and for models with a history `history`
    #[arg(long)]
    json: bool,
    /// Write the mesh with its displacements (point array `displacement`, mm)
    #[arg(short, long, value_name = "OUT.vtu")]
    output: Option<PathBuf>,
    /// Write what happened over time: displacements of `report_nodes` (mm) and forces of each fix (N), a row a step
    #[arg(long, value_name = "OUT.csv")]
    history: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

#[derive(Clone, Copy, ValueEnum)]
enum Example {
    /// A plate on linear tissue
    Linear,
    /// A plate on liver that stiffens and creeps
    Viscoelastic,
}

impl Solve {
    pub fn run(&self) -> Result<(), Failure> {
        let path = match (&self.problem, self.example) {
            (Some(path), None) => path.as_path(),
            (_, Some(Example::Viscoelastic)) => return terminal::emit(statics::CREEP),
            (_, Some(Example::Linear) | None) => return terminal::emit(statics::EXAMPLE),
        };
        let inputs = output::inputs(path);
        if let Some(output) = &self.output {
            self.force.check_ending(output, "vtu", "meshes", &inputs)?;
        }
        let outputs: Vec<&Path> = self.output.iter().chain(&self.history).map(PathBuf::as_path).collect();
        self.force.check(&outputs, &inputs)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let problem = ProblemFile::read(path)?.resolve(folder)?;
        if self.history.is_some() && problem.model() == Model::Linear {
            let found = "--history of a problem without one: `model = \"linear\"`".to_owned();
            return Err(Failure::usage(
                found,
                "leave it out, or give the problem a model with a [history]",
            ));
        }
        problem.warnings().iter().for_each(terminal::warn);
        let solved = problem.solve()?;
        if let Some(output) = &self.output {
            write_vtu(output, problem.mesh(), Some(&solved.solution.displacement_mm))?;
        }
        if let (Some(output), Some(history)) = (&self.history, &solved.history) {
            let table = history.csv(problem.report_nodes());
            output::text(output, &table)?;
        }
        let report = Report::new(&problem, &solved);
        if self.json {
            terminal::emit_json(&report)
        } else {
            terminal::emit(&report.to_string())
        }
    }
}
