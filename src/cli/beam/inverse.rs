//! `insonify beam inverse`: base motion for a wanted result.

use std::path::PathBuf;

use crate::input::beam_case::{CaseFile, Report, plot};
use crate::mechanics::needle::beam::inverse::Wanted;
use clap::Args;
use serde_json::json;

use crate::cli::failure::Failure;
use crate::cli::output::{self, Force};
use crate::cli::terminal;

const EXAMPLES: &str = "\
Examples:
  insonify beam inverse case.toml --tip-mm -2             the base turns as the case says: about its RCM, or freely
  insonify beam inverse case.toml --tip-mm -2 --rcm-mm 0  the base turns about the point of entry
  insonify beam inverse case.toml --com-mm 40             the displacement of the case; which slope, so which RCM?
  insonify beam inverse case.toml --tip-mm -2 --com-mm 40 both displacement and slope are found

JSON: displacement_mm, slope, and what `insonify beam CASE.toml --json` prints of the needle then.
Exit status: 0 found; 2 there is no such motion, or a file is wrong.";

/// Finds the base motion for a wanted deflection of the tip or a wanted centre of motion
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Inverse {
    /// Case file, as `insonify beam` reads it
    #[arg(value_name = "CASE.toml")]
    case: PathBuf,
    /// Wanted deflection of the tip, mm
    #[arg(
        long,
        value_name = "MM",
        allow_negative_numbers = true,
        required_unless_present = "com_mm"
    )]
    tip_mm: Option<f64>,
    /// Wanted centre of motion of the needle, mm below the entry
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    com_mm: Option<f64>,
    /// With --tip-mm: the base rotates about this point, mm below the entry
    #[arg(long, value_name = "MM", allow_negative_numbers = true, conflicts_with = "com_mm")]
    rcm_mm: Option<f64>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Draw the resulting needle
    #[arg(short, long, value_name = "PLOT.svg")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Inverse {
    pub fn run(&self) -> Result<(), Failure> {
        if let Some(output) = &self.output {
            self.force
                .check_ending(output, "svg", "plots", &output::inputs(&self.case))?;
        }
        let case = CaseFile::read(&self.case)?.resolve()?;
        for (name, value) in [
            ("--tip-mm", self.tip_mm),
            ("--com-mm", self.com_mm),
            ("--rcm-mm", self.rcm_mm),
        ] {
            if let Some(value) = value.filter(|value| !value.is_finite()) {
                return Err(Failure::usage(
                    format!("{name} {value} is no length"),
                    "ask for a finite number of mm",
                ));
            }
        }
        let base = &case.base;
        let own_rcm = || match base.slope {
            None => Ok(None),
            Some(slope) if slope != 0.0 && base.displacement_mm != 0.0 => {
                Ok(Some(-case.problem.control_distance_mm - base.displacement_mm / slope))
            }
            Some(_) => {
                let found = "the base of the case does not turn about a point";
                Err(Failure::usage(
                    found,
                    "say --rcm-mm, or leave `slope` out for a base that turns freely",
                ))
            }
        };
        let wanted = match (self.tip_mm, self.com_mm) {
            (Some(tip_mm), Some(com_mm)) => Wanted::TipAndCentre { tip_mm, com_mm },
            (Some(tip_mm), None) => match self.rcm_mm.map_or_else(own_rcm, |rcm| Ok(Some(rcm)))? {
                Some(rcm_mm) => Wanted::TipAbout { tip_mm, rcm_mm },
                None => Wanted::TipFree { tip_mm },
            },
            (None, Some(com_mm)) => Wanted::Centre {
                com_mm,
                displacement_mm: base.displacement_mm,
            },
            (None, None) => return Err(Failure::usage("nothing is wanted", "say --tip-mm, --com-mm or both")),
        };
        let (_, shape) = case.find(&wanted)?;
        if let Some(output) = &self.output {
            output::plot(output, &plot(&case, &shape))?;
        }
        let (base, report) = (&shape.points[0], Report::new(&shape));
        if self.json {
            let mut all = json!({ "displacement_mm": base.u_mm, "slope": base.slope });
            let rest = serde_json::to_value(&report).map_err(|error| Failure::Output(error.into()))?;
            if let (Some(all), Some(rest)) = (all.as_object_mut(), rest.as_object()) {
                all.extend(rest.clone());
            }
            return terminal::emit_json(&all);
        }
        let motion = format!("displacement {:.6} mm\nslope        {:.6}\n", base.u_mm, base.slope);
        terminal::emit(&(motion + &report.to_string()))
    }
}
