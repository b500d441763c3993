//! `insonify identify`: parameters of tissue layers from a measured insertion.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::Args;

use insonify_base::output::OutputError;
use insonify_study::identification::{self, CaseFile};
use insonify_study::identify::identify;

use super::output::{self, Force};
use super::terminal;
use insonify::Error;

const TEACHING: &str = "\
The case file names a scenario (mesh or volume, fixed nodes, line of the needle), the force over the depth of the tip, and displacements of the
tissue: from `insonify motion`, or of nodes or markers. The result is, for each layer on the line, Young's modulus and the three parameters of the force
along the shaft: f_p within w of the tip, f_s behind.

Examples:
  insonify identify --example > case.toml            an example case with every key; the next three commands make its measurement
  insonify insert two-layer-insertion -o run           its force, run/steps.csv
  insonify rf two-layer-insertion -o rf.igs.mha        its echoes
  insonify motion rf.igs.mha -o u.csv                  motion of the tissue in them
  insonify identify case.toml -o found
  insonify insert found/scenario-0.49.toml -o again  the scenario with what was found
  insonify schema identify                           every key, as a JSON schema

Writes DIR/index.html (parameters, errors, certainty, figures), DIR/plots, and scenarios. The method, its accuracy and its limits: docs/identification.md.
Source: E. Dehghan et al., \"Needle-tissue interaction modeling using ultrasound-based motion estimation: Phantom study\", Computer Aided
Surgery 13 (2008) 265-280.
Exit status: 0 success; 2 the case or a file is wrong; 1 a failure of the machine.";

/// Identifies force parameters and Young's moduli of tissue layers from one measured needle insertion
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct Identify {
    /// Case file: the scenario and the measurement
    #[arg(value_name = "CASE.toml", required_unless_present = "example")]
    case: Option<PathBuf>,
    /// Print an example case file
    #[arg(long, exclusive = true)]
    example: bool,
    /// Folder to write to
    #[arg(short, long, value_name = "DIR", required_unless_present = "example")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print one JSON object: `force_model`, and `found` with `layers`, `force`, `motion`, `beside`, `notes` for each
    /// Poisson's ratio
    #[arg(long)]
    json: bool,
}

impl Identify {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (Some(path), Some(target)) = (&self.case, &self.output) else {
            return terminal::emit(identification::EXAMPLE);
        };
        let folder = self
            .force
            .folder(target, "identify", &["index.html"], &output::inputs(path))?;
        let base = path.parent().unwrap_or(Path::new(""));
        let file = CaseFile::read(path)?;
        let case = terminal::with_share("making the mesh", |share| {
            file.resolve(base, &mut |done| share(f64::from(done)))
        })?;
        case.scenario.warnings.iter().for_each(terminal::warn);
        let identified = terminal::with_share("simulating insertions", |share| {
            identify(case, &|done| {
                share(done);
                ControlFlow::Continue(())
            })
        })?;
        for parameters in &identified.results {
            parameters.notes.iter().for_each(terminal::warn);
        }
        let path_of = |name: &str| folder.path().join(name);
        let plots = path_of("plots");
        std::fs::create_dir_all(&plots).map_err(|cause| OutputError::Folder {
            path: folder.place(&plots),
            cause,
        })?;
        output::plots(&plots, identified.plots())?;
        for (name, text) in identified.scenarios() {
            output::text(&path_of(&name), &text)?;
        }
        output::text(&path_of("index.html"), &identified.page()?)?;
        folder.install()?;
        terminal::print(&identified, self.json)
    }
}
