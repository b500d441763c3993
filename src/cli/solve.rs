//! `insonify solve`: a static problem of tissue mechanics.

use std::path::{Path, PathBuf};

use clap::Args;
use insonify::mechanics::mesh::file::write_vtu;
use insonify::statics::{ProblemFile, Report};

use super::failure::Failure;
use super::terminal;

/// Solves a static problem: how tissue deforms under forces and prescribed displacements
#[derive(Args)]
pub struct Solve {
    /// Problem file (TOML): mesh, materials, fixes and loads
    #[arg(value_name = "PROBLEM.toml")]
    problem: PathBuf,
    /// Print JSON: `nodes`, `elements`, `residual`, `displacement_mm`, `max_displacement_mm`, `seconds`, `warnings`
    #[arg(long)]
    json: bool,
    /// Write mesh and displacements there (.vtu)
    #[arg(short, long, value_name = "OUT.vtu", value_parser = vtu)]
    output: Option<PathBuf>,
}

impl Solve {
    pub fn run(&self) -> Result<(), Failure> {
        let folder = self.problem.parent().unwrap_or(Path::new(""));
        let problem = ProblemFile::read(&self.problem)?.resolve(folder)?;
        problem.warnings().iter().for_each(terminal::warn);
        let solution = problem.solve()?;
        if let Some(path) = &self.output {
            write_vtu(path, problem.mesh(), Some(&solution.displacement_mm))?;
        }
        let report = Report::new(&problem, &solution);
        if self.json {
            terminal::emit_json(&report)
        } else {
            terminal::emit(&report.to_string())
        }
    }
}

fn vtu(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("vtu"))
    {
        true => Ok(path),
        false => Err("expected a file that ends in .vtu".to_owned()),
    }
}
