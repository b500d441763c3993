//! `insonify beam CASE.toml`: shape of a needle.

use std::path::PathBuf;

use crate::input::beam_case::{self, CaseFile, Report, plot};
use clap::Args;

use crate::cli::failure::Failure;
use crate::cli::output::{self, Force};
use crate::cli::terminal;

/// Discretisation error above which the elements are too long, mm.
const COARSE_MM: f64 = 1e-3;

/// Compressed length relative to the initial length below which tissue is outside the range that its models were
/// fitted to.
const FAR: f64 = 0.3;

#[derive(Args)]
pub struct Bend {
    /// Case file: needle, base motion, elements and layers of tissue
    #[arg(value_name = "CASE.toml", required_unless_present = "example")]
    case: Option<PathBuf>,
    /// Print an example case file
    #[arg(long, conflicts_with_all = ["case", "json", "output"])]
    example: bool,
    /// Print one JSON object: `tip_mm`, `rcm_mm`, `com_mm`, `residual`, `iterations`, `shape`
    #[arg(long)]
    json: bool,
    /// Draw the needle in its tissue
    #[arg(short, long, value_name = "PLOT.svg")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Bend {
    pub fn run(&self) -> Result<(), Failure> {
        let Some(path) = self.case.as_deref().filter(|_| !self.example) else {
            return terminal::emit(beam_case::EXAMPLE);
        };
        if let Some(output) = &self.output {
            self.force.check_ending(output, "svg", "plots", &output::inputs(path))?;
        }
        let case = CaseFile::read(path)?.resolve()?;
        let shape = case.solve()?;
        if shape.least_ratio < FAR {
            let ratio = shape.least_ratio;
            terminal::warn(format_args!(
                "tissue is compressed to {ratio:.3} of its length: materials are seldom measured there"
            ));
        }
        let error_mm = case.element_error_mm(&shape);
        if let Some(error) = error_mm.filter(|error| *error > COARSE_MM) {
            let element = case.problem.element_mm;
            terminal::warn(format_args!(
                "elements of {element} mm leave {error:.1e} mm (elements of half the length differ by that): use shorter ones"
            ));
        }
        if let Some(output) = &self.output {
            output::plot(output, &plot(&case, &shape))?;
        }
        let report = Report::new(&shape);
        if self.json {
            terminal::emit_json(&report)
        } else {
            let left = error_mm.map_or(String::new(), |error| format!("elements     leave {error:.1e} mm\n"));
            terminal::emit(&(left + &report.to_string()))
        }
    }
}
