//! `insonify insert`: a needle goes in.

mod writer;

use std::path::{Path, PathBuf};

use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use insonify::quality::Picked;
use insonify::scenario::run::{Asked, run};
use insonify::scenario::{self, Scenario, ScenarioFile, Summary};
use serde::Serialize;

use super::backend::BackendArgs;
use super::failure::Failure;
use super::output::{Force, inputs};
use super::quality::QualityArgs;
use super::terminal;
use writer::{FILES, Writer};

const EXAMPLES: &str = "\
The scenario file names a scene (what is imaged, and how the probe lies or moves) and says what moves through it:
  version = 1
  scene = \"prostate-trus\"
  [[tissue.material]]
  region = \"prostate_peripheral\"
  friction_n_per_mm = 0.03
  [needle]
  model = \"springs\"
  bevel = { r_mm = 0.6, length_mm = 5.0 }
  [[needle.motion.keyframes]]
  time_s = 0.0
  tip_mm = [0.0, -5.0, -62.0]
  direction = [0.0, 0.0, 1.0]
  [[needle.motion.keyframes]]
  time_s = 6.0
  tip_mm = [0.0, -5.0, 0.0]
  direction = [0.0, 0.0, 1.0]

Examples:
  insonify insert liver-biopsy -o out              a scenario that comes with the program
  insonify insert --example liver-biopsy > my.toml the same as a file, commented, ready to edit
  insonify insert my.toml -o out --frames          frames too, as numbered pictures in out/frames
  insonify insert my.toml -o out --frames=mha      as an image sequence with the pose of each frame, out/frames.mha
  insonify insert my.toml -o out --preview         an animated picture of them, out/preview.gif
  insonify insert my.toml -o out --vtu 100         the deformed mesh every 100 ms, out/mesh/mesh.pvd for ParaView
  insonify insert my.toml -o out --json | jq .step_ms
  insonify schema insert                           every key, as a JSON schema

Writes out/steps.csv (a line a step: poses, tip, force and torque on the hand in the needle's base frame and in the world, force on
the probe, contacts, milliseconds), out/plots, out/index.html that shows them, and out/summary.json. Forces on the hand are what the
needle does to it: along the base's z axis, which points into the body, they are negative while the needle is pushed in.
Files of the run before, which out/insonify.json lists, are replaced when the run is done, and only then; other files stay.
Exit status: 0 done; 2 the scenario or a file is wrong; 1 what the machine could not do.";

/// Moves a needle through tissue: forces, deformation and, on request, the ultrasound frames that follow
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Insert {
    /// Scenario file (TOML), or the name of one that comes with the program
    #[arg(value_name = "SCENARIO.toml", required_unless_present = "example")]
    scenario: Option<PathBuf>,
    /// Print a scenario that comes with the program
    #[arg(long, value_name = "NAME", value_parser = names(), conflicts_with_all = ["scenario", "json", "output", "frames", "preview", "vtu"])]
    example: Option<String>,
    /// Folder to write to
    #[arg(short, long, value_name = "DIR", required_unless_present = "example")]
    output: Option<PathBuf>,
    /// Render frames at the scenario's rate: `png` for numbered pictures, `mha` for an image sequence
    #[arg(long, value_enum, value_name = "KIND", num_args = 0..=1, require_equals = true, default_missing_value = "png")]
    frames: Option<Frames>,
    /// Make an animated picture of the frames, small: preview.gif
    #[arg(long)]
    preview: bool,
    /// Write the deformed mesh every so many milliseconds of simulated time
    #[arg(long, value_name = "MS", value_parser = period)]
    vtu: Option<f64>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    quality: QualityArgs,
    /// Print the summary as one JSON object: `steps`, `max_base_force_n`, `tip_deflection_mm`, `remeshes`, `step_ms`, `events`, `seeds`, `warnings`, ...
    #[arg(long)]
    json: bool,
    /// Say nothing but results, warnings and errors
    #[arg(short, long)]
    quiet: bool,
}

/// How frames are written.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Frames {
    /// Numbered pictures in a folder
    Png,
    /// An image sequence with the pose of each frame
    Mha,
}

/// The summary with where it came from.
#[derive(Serialize)]
struct Report<'a> {
    scenario: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    quality: Vec<Picked>,
    #[serde(flatten)]
    summary: &'a Summary,
}

impl Insert {
    pub fn run(&self) -> Result<(), Failure> {
        let (Some(path), Some(output)) = (&self.scenario, &self.output) else {
            let named = scenario::EXAMPLES
                .iter()
                .find(|(name, _)| self.example.as_deref() == Some(*name));
            return terminal::emit(named.map_or("", |(_, text)| *text));
        };
        self.backend.check()?;
        let folder = self.force.folder(output, "insert", FILES, &inputs(path))?;
        let (mut scenario, picked) = self.scenario(path)?;
        let mut picked: Vec<Picked> = picked.into_iter().collect();
        let asked = Asked {
            frames: self.frames.is_some() || self.preview,
            mesh_s: self.vtu.map(|ms| ms * 1e-3),
        };
        if asked.frames {
            picked.extend(self.quality.frames_of(&mut scenario, &self.backend, self.quiet)?);
        }
        let bar = terminal::share(self.quiet);
        bar.set_message("preparing the model");
        let model = scenario.model(|done, of| {
            bar.set_position(terminal::SHARES * done as u64 / of.max(1) as u64);
        });
        bar.finish_and_clear();
        let mut model = model?;
        let mut writer = Writer::new(&scenario, folder.path(), asked, self.quiet)?;
        if asked.frames {
            let anatomy = scenario.scene.anatomy.clone();
            let chosen = self.backend.synthesizer(anatomy, scenario.scene.settings.clone())?;
            writer.render(chosen, self.frames.map(|kind| kind == Frames::Mha), self.preview)?;
        }
        let mut summary = run(&scenario, model.as_mut(), asked, &mut writer)?;
        let name = path.display().to_string();
        summary.warnings.extend(writer.warnings());
        let report = Report {
            scenario: name.clone(),
            quality: picked,
            summary: &summary,
        };
        writer.finish(&name, &summary, &report)?;
        folder.install()?;

        summary.warnings[scenario.warnings.len()..]
            .iter()
            .for_each(terminal::warn);
        if self.json {
            return terminal::emit_json(&report);
        }
        if !self.quiet {
            terminal::say(told(&summary, output));
        }
        Ok(())
    }

    /// Reads the scenario and all that it names, and tells what was assumed and what is odd.
    fn scenario(&self, path: &Path) -> Result<(Scenario, Option<Picked>), Failure> {
        let name = path.to_str().unwrap_or_default();
        let ready = scenario::EXAMPLES
            .iter()
            .find(|(known, _)| *known == name && !path.is_file());
        let mut file = match ready {
            Some((name, text)) => ScenarioFile::parse(text, name)?,
            None if path.extension().is_none() && !path.exists() => {
                let known: Vec<&str> = scenario::EXAMPLES.iter().map(|(name, _)| *name).collect();
                let found = format!("{name}: neither a file nor a scenario that comes with the program");
                return Err(Failure::usage(
                    found,
                    format!("name a file, or one of {}", known.join(", ")),
                ));
            }
            None => ScenarioFile::read(path)?,
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        let picked = self.quality.steps(&mut file, folder, self.quiet)?;
        let bar = terminal::share(self.quiet);
        bar.set_message("making the mesh");
        let scenario = file.resolve(folder, |share| {
            bar.set_position((f64::from(share) * terminal::SHARES as f64) as u64);
        });
        bar.finish_and_clear();
        let scenario = scenario?;
        if !self.quiet {
            scenario.notes.iter().for_each(terminal::note);
        }
        scenario.warnings.iter().for_each(terminal::warn);
        if scenario.quality.step_ms.is_none() && scenario.scene.quality.step_ms.is_some() {
            terminal::warn("quality.step_ms of the scene's own file is not heeded: state it in the scenario");
        }
        Ok((scenario, picked))
    }
}

fn told(summary: &Summary, output: &Path) -> String {
    let ms = &summary.step_ms;
    let seeds = match summary.seeds.len() {
        0 => String::new(),
        left => format!(", {left} seeds"),
    };
    format!(
        "wrote {}: {} steps ({:.2} s), force on the hand up to {:.2} N, tip deflection up to {:.2} mm, {} remeshes{seeds}; \
         a step takes {:.3} ms (99 %: {:.3}, longest {:.3}); open {}",
        output.display(),
        summary.steps,
        summary.simulated_s,
        summary.max_base_force_n,
        summary.tip_deflection_mm,
        summary.remeshes,
        ms.median,
        ms.p99,
        ms.max,
        output.join("index.html").display()
    )
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(scenario::EXAMPLES.iter().map(|(name, _)| *name))
}

/// Parses a period, ms.
fn period(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(ms) if (0.01..=1e7).contains(&ms) => Ok(ms),
        _ => Err("expected milliseconds from 0.01 to 1e7".to_owned()),
    }
}
