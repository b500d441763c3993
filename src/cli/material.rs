//! `insonify material`: response of a point of tissue to a history of stress or strain.

use std::path::PathBuf;

use clap::Args;
use insonify_base::csv::CsvError;
use insonify_mechanics::tissue::viscoelastic::point::Structure;
use insonify_study::material_case::fit::{MaterialFit, Measurements};
use insonify_study::material_case::{self, CaseFile};

use super::output::{self, Force};
use super::terminal;
use super::variants::variants;
use insonify::Error;

const EXAMPLES: &str = "\
The case file names a law, its parameters, and a history of stress or strain; the other of the two is computed:
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
  insonify material creep.toml -o creep.svg        the computed quantity against time
  insonify material creep.toml --json | jq .strain
  insonify material creep.toml --rheometer tests   the measurements of Kobayashi et al. 2010 on this material: moduli, creep, stiffness
  insonify material fit moduli.csv creep.csv       the parameters from such measurements of one's own
  insonify schema material                         every key, as a JSON schema

The history is linear between its times and may jump at the start, where the material was at rest. In between, steps are
halved until the result changes by less than 1e-7 of its largest value, or the rule reaches its limit; the table states the change reached.
Gruenwald and Letnikov's rule takes equally spaced times only.
A stress that is infinite, at a jump of strain in a spring-pot, is null in JSON.
Source: Y. Kobayashi et al., \"Development of an integrated needle insertion system with image guidance and deformation
simulation\", Computerized Medical Imaging and Graphics 34 (2010) 9-18.
Exit status: 0 success; 2 the case or a file is wrong; 1 a failure of the machine.";

/// Tests a material: strain from a history of stress, or stress from strain, with memory and stiffening
#[derive(Args)]
#[command(after_help = EXAMPLES, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Material {
    #[command(subcommand)]
    task: Option<Task>,
    #[command(flatten)]
    test: MaterialTest,
}

commands! {
    enum Task {
        Fit(FitArgs),
    }
}

impl Material {
    pub(crate) fn run(&self) -> Result<(), Error> {
        match &self.task {
            None => self.test.run(),
            Some(task) => task.run(),
        }
    }
}

// `insonify material CASE.toml`: response of a material.

#[derive(Args)]
pub(crate) struct MaterialTest {
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
    /// Run the measurements of Kobayashi et al. 2010 on the material in place of its history: plots (SVG), and the
    /// moduli and creep as CSV
    #[arg(long, value_name = "DIR", conflicts_with_all = ["json", "output"])]
    rheometer: Option<PathBuf>,
}

impl MaterialTest {
    fn run(&self) -> Result<(), Error> {
        let Some(path) = self.case.as_deref().filter(|_| !self.example) else {
            return terminal::emit(material_case::EXAMPLE);
        };
        let inputs = output::inputs(path);
        self.force.check_ending(&self.output, "svg", "plots", &inputs)?;
        let case = CaseFile::read(path)?.resolve()?;
        case.notes().iter().for_each(terminal::warn);
        if let Some(target) = &self.rheometer {
            let folder = self.force.folder(target, "material", &[], &inputs)?;
            let tests = case.rheometer()?;
            output::plots(folder.path(), tests.plots())?;
            for (stem, table) in tests.tables() {
                output::text(&folder.path().join(stem).with_extension("csv"), &table.csv())?;
            }
            folder.install()?;
            return terminal::emit(&tests.to_string());
        }
        let report = case.run()?;
        report.warnings().iter().for_each(terminal::warn);
        output::requested(&self.output, || report.plot().svg())?;
        terminal::print(&report, self.json)
    }
}

// `insonify material fit`: parameters from measurements.

const FIT_EXAMPLES: &str = "\
The header of a file says what was measured; other columns are ignored, and lines that begin with # are left out:
  frequency_rad_s,storage_kpa,loss_kpa      a frequency sweep (frequency_hz, storage_pa, loss_pa will do)
  stress_kpa,time_s,strain                  creep from time 0 on, one stress after another (stress_pa, time_min, strain_percent will do)

A sweep gives order k and modulus G of a spring-pot, G (i w)^k. Creep gives the modulus against strain by equation 2 of Kobayashi et
al. 2010, gamma = tau t^k / (G Gamma(1 + k)), and from it G0, the knee gamma0 and the stiffening a of equation 3. The order for creep is that
of --order, else of the sweep, else of the test with the least stress. Standard errors are those of the scatter about the fit.

Examples:
  insonify material fit moduli.csv creep.csv
  insonify material fit moduli.csv creep.csv --json -o plots
  insonify material fit creep.csv --order 0.1 --memory rate
  insonify material creep.toml --rheometer tests; insonify material fit tests/dynamic-moduli.csv tests/creep.csv --memory rate
Exit status: 0 success; 2 a file is wrong, or does not determine the parameters; 1 a failure of the machine.";

/// Fits order, modulus, knee and stiffening to measured moduli and creep
#[derive(Args)]
#[command(after_help = FIT_EXAMPLES)]
pub(crate) struct FitArgs {
    /// Tables of measurements: a frequency sweep, creep tests, or both
    #[arg(value_name = "FILE.csv", required = true)]
    files: Vec<PathBuf>,
    /// Order k for creep, above 0 and below 1 [default: that of the sweep, else of the creep]
    #[arg(long, value_name = "K", value_parser = order)]
    order: Option<f64>,
    /// Quantity that the stiffness multiplies: with `rate` the result is corrected for what equation 2 neglects
    #[arg(long, value_parser = variants::<Structure>(), default_value = "load-integral")]
    memory: Structure,
    /// Print one JSON object: `dynamic` (`order`, `modulus_kpa`, `loss_tangent`, ...), `creep` (`modulus_kpa`,
    /// `knee_shear`, `stiffening`, ...), `warnings`
    #[arg(long)]
    json: bool,
    /// Draw measurements and fitted laws: dynamic-moduli.svg, stiffness.svg
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

fn order(text: &str) -> Result<f64, String> {
    let order = text.parse().ok().filter(|order: &f64| *order > 0.0 && *order < 1.0);
    order.ok_or_else(|| "expected a number above 0 and below 1".to_owned())
}

impl FitArgs {
    fn run(&self) -> Result<(), Error> {
        let folder = self
            .force
            .requested_folder(&self.output, "material", &[], &self.files)?;
        let mut measured = Measurements::default();
        self.files.iter().try_for_each(|file| measured.add(file))?;
        let fit = MaterialFit::new(&measured, self.order, self.memory).map_err(|text| CsvError::Contents {
            path: self.files[0].clone(),
            text,
        })?;
        fit.warnings.iter().for_each(terminal::warn);
        if let Some(folder) = folder {
            output::plots(folder.path(), fit.plots())?;
            folder.install()?;
        }
        terminal::print(&fit, self.json)
    }
}
