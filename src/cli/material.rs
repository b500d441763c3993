//! `insonify material`: response of a point of tissue to a history of stress or strain.

use std::path::PathBuf;

use crate::input::material_case::{self, CaseFile};
use clap::Args;

use super::failure::Failure;
use super::output::{self, Force};
use super::terminal;

const EXAMPLES: &str = "\
The case file names a law, its numbers, and a history of stress or strain; the other of the two is answered:
  law = \"spring-pot\"      # or \"zener\", with modulus_inf_kpa and tau_s
  order = 0.1             # 0 a spring, 1 a dashpot
  modulus_kpa = 0.4
  [history]
  control = \"stress\"      # creep; \"strain\": relaxation
  time_s = [0, 1, 10, 100]
  value = [0.05, 0.05, 0.05, 0.05]

Examples:
  insonify material --example > creep.toml         liver in a creep test: every key, its unit and default
  insonify material creep.toml                     time, strain and stress as a table
  insonify material creep.toml -o creep.svg        what answers, against time
  insonify material creep.toml --json | jq .strain
  insonify material creep.toml --rheometer tests   the measurements of Kobayashi et al. 2010 on this material: moduli, creep, stiffness
  insonify schema material                         every key, as a JSON schema

The history is linear between its times and may jump at the start, where the material was at rest. In between, steps are
halved until the answer settles to 1e-7 of its largest value, as far as a rule affords; the table says how far it did.
Gruenwald and Letnikov's rule takes equally spaced times only.
A stress that is infinite, at a jump of strain in a spring-pot, is null in JSON.
Source: Y. Kobayashi et al., \"Development of an integrated needle insertion system with image guidance and deformation
simulation\", Computerized Medical Imaging and Graphics 34 (2010) 9-18.
Exit status: 0 done; 2 the case or a file is wrong; 1 what the machine could not do.";

/// Tests a material: strain from a history of stress, or stress from strain, with memory and stiffening
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Material {
    /// Case file: the material and its history
    #[arg(value_name = "CASE.toml", required_unless_present = "example")]
    case: Option<PathBuf>,
    /// Print an example case file
    #[arg(long, conflicts_with_all = ["case", "json", "output", "rheometer"])]
    example: bool,
    /// Print one JSON object: `time_s`, `strain`, `stress_kpa`
    #[arg(long)]
    json: bool,
    /// Plot the computed quantity against time
    #[arg(short, long, value_name = "PLOT.svg")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Run the measurements of Kobayashi et al. 2010 on the material in place of its history: plots, one SVG file each
    #[arg(long, value_name = "DIR", conflicts_with_all = ["json", "output"])]
    rheometer: Option<PathBuf>,
}

impl Material {
    pub fn run(&self) -> Result<(), Failure> {
        let Some(path) = self.case.as_deref().filter(|_| !self.example) else {
            return terminal::emit(material_case::EXAMPLE);
        };
        let inputs = output::inputs(path);
        if let Some(output) = &self.output {
            self.force.check_ending(output, "svg", "plots", &inputs)?;
        }
        let case = CaseFile::read(path)?.resolve()?;
        case.notes().iter().for_each(terminal::warn);
        if let Some(target) = &self.rheometer {
            let folder = self.force.folder(target, "material", &[], &inputs)?;
            let tests = case.rheometer()?;
            for (stem, plot) in tests.plots() {
                output::plot(&folder.path().join(stem).with_extension("svg"), &plot)?;
            }
            folder.install()?;
            return terminal::emit(&tests.to_string());
        }
        let report = case.run()?;
        report.warnings().iter().for_each(terminal::warn);
        if let Some(output) = &self.output {
            output::plot(output, &report.plot())?;
        }
        if self.json {
            terminal::emit_json(&report)
        } else {
            terminal::emit(&report.to_string())
        }
    }
}
