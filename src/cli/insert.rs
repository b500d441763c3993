//! `insonify insert`: needle insertion.

mod writer;

use std::path::{Path, PathBuf};

use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use insonify::input::scenario::{self, Scenario, ScenarioFile};
use insonify::run::{Requests, run};
use insonify::{Model, Summary};
use insonify_base::document::{self, Setting, Table};
use insonify_base::read;
use insonify_imaging::quality::Picked;
use insonify_imaging::scene::Version;
use insonify_imaging::synth::FrameState;
use insonify_mechanics::insertion::Recording;
use insonify_study::score::hands::{HANDS, hand};
use serde::Serialize;

use super::backend::BackendArgs;
use super::failure::{Error, usage};
use super::input::here;
use super::output::{Force, inputs};
use super::quality::QualityArgs;
use super::render::extras::Extras;
use super::settings::{self, Settings};
use super::terminal;
use super::variants::ranged;
use writer::{FILES, Writer};

const EXAMPLES: &str = "\
A scenario file names a scene (the anatomy and the pose or motion of the probe) and describes the needle, its motion and the tissue:
  version = 2
  scene = \"prostate-trus\"
  [[tissue.material]]
  region = \"prostate_peripheral\"
  friction_n_per_mm = 0.03
  [needle]
  model = \"springs\"
  bevel = { r_mm = 0.6 }
  [[needle.motion.keyframes]]
  time_s = 0.0
  tip_mm = [0.0, -5.0, -62.0]
  direction = [0.0, 0.0, 1.0]
  [[needle.motion.keyframes]]
  time_s = 6.0
  tip_mm = [0.0, -5.0, 0.0]
  direction = [0.0, 0.0, 1.0]

Examples:
  insonify insert --labels labels.nii.gz --target kidney_right -o out   a label file alone: probe and path are chosen, and printed
  insonify insert liver-biopsy -o out               a scenario that comes with the program
  insonify insert --example segmentation-biopsy > my.toml   as a file; this one needs the path of your label file in `file`
  insonify insert --reference                       every key with its unit, range and default
  insonify insert my.toml -o out --set needle.bevel.r_mm=0.4 --set scene.effects.refraction=false   keys changed for one run
  insonify insert my.toml -o out --images           numbered pictures in out/frames
  insonify insert my.toml -o out --images=mha       an image sequence with the pose of each image, out/frames.mha
  insonify insert my.toml -o out --images --layers label-value,needle --sidecar --overview
                                                    ground truth beside each image, with the needle and the displaced tissue
  insonify insert my.toml -o out --preview          an animated picture, out/preview.gif
  insonify insert my.toml -o out --vtu 100          the deformed mesh every 100 ms, out/mesh/mesh.pvd for ParaView,
                                                    with needle.pvd, probe.pvd and seeds.pvd beside it
  insonify insert my.toml --replay session.json -o out --images    a session of a simulator, to score it
  insonify insert my.toml -o out --json | jq .step_ms

Writes out/index.html (images, plots, events), out/plots, out/summary.json and out/steps.csv, a line a step. Its columns carry their unit
(_mm, _n, _nmm, _s, _ms) but for directions (base_dx, base_dy, base_dz), the quaternion of a probe in contact (probe_qx to probe_qw),
counts and flags. base_* is in the needle's base frame, whose z axis points into the body, world_* in the world (LPS). Forces on the hand
are what the needle does to it: along z negative while it is pushed in. docs/insertion.md explains each column, event and key of the summary.
Files of the previous run, listed in out/insonify.json, are replaced only when the run is complete; other files are kept.
Exit status: 0 success; 2 the scenario or a file is wrong; 1 a failure of the machine.";

/// Moves a needle through tissue: forces, deformation and, on request, the ultrasound frames that follow
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Insert {
    /// Scenario file (TOML), or the name of a built-in one
    #[arg(value_name = "SCENARIO.toml", required_unless_present_any = ["example", "reference", "labels"])]
    scenario: Option<PathBuf>,
    /// In place of a scenario: a label file; the probe is placed over the target
    #[arg(long, value_name = "FILE", conflicts_with = "scenario", requires = "target")]
    labels: Option<PathBuf>,
    /// With --labels: target label or tissue, or a part of its name; the needle goes to it from beside the probe, and
    /// back
    #[arg(long, value_name = "NAME", requires = "labels")]
    target: Option<String>,
    /// CT that the labels were made from: unlabelled voxels of the body are gas, fat, muscle, soft tissue or bone by
    /// their grey value
    #[arg(long, value_name = "FILE")]
    ct: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
    /// Print a built-in scenario
    #[arg(long, value_name = "NAME", value_parser = names(), exclusive = true)]
    example: Option<String>,
    /// Print every key of a scenario with its unit, range and default
    #[arg(long, exclusive = true)]
    reference: bool,
    /// Folder to write to
    #[arg(short, long, value_name = "DIR", required_unless_present_any = ["example", "reference"])]
    output: Option<PathBuf>,
    /// Render images at the scenario's rate: `png` for numbered pictures, `mha` for an image sequence; also called
    /// --frames
    #[arg(long, alias = "frames", value_enum, value_name = "KIND", num_args = 0..=1, require_equals = true, default_missing_value = "png")]
    images: Option<Images>,
    #[command(flatten)]
    extras: Extras,
    /// Simulate an operator with errors in aim, depth, entry point and image plane, and with tremor (docs/metrics.md)
    #[arg(long, value_name = "NAME", value_parser = hands())]
    hand: Option<String>,
    /// With --hand: seed of its errors
    #[arg(long, value_name = "N", default_value_t = 0, requires = "hand")]
    hand_seed: u64,
    /// Repeat a recorded session in place of the scenario's motions: JSON of `Recording`, which
    /// `Haptic::take_recording` of a simulator of the same scenario gives
    #[arg(long, value_name = "FILE.json", conflicts_with = "hand")]
    replay: Option<PathBuf>,
    /// Write a small animated picture of the frames: preview.gif
    #[arg(long)]
    preview: bool,
    /// Write the deformed mesh, the needle with the forces along it, the probe and the seeds at this interval, in
    /// milliseconds of simulated time
    #[arg(long, value_name = "MS", value_parser = period)]
    vtu: Option<f64>,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    backend: BackendArgs,
    #[command(flatten)]
    quality: QualityArgs,
    /// Print the summary as one JSON object: `steps`, `max_base_force_n`, `tip_deflection_mm`, `remeshes`, `step_ms`,
    /// `events`, `seeds`, `misplacement`, `warnings`, ...
    #[arg(long)]
    json: bool,
}

/// File format of images.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Images {
    /// Numbered pictures in a folder
    Png,
    /// Image sequence with the pose of each frame
    Mha,
}

/// Summary with its provenance.
#[derive(Serialize)]
struct InsertReport<'a> {
    scenario: String,
    /// Keys that options set in it, as lines of TOML.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    set: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    quality: Vec<Picked>,
    #[serde(flatten)]
    summary: &'a Summary,
}

impl Insert {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (Some(path), Some(output)) = (self.scenario.as_ref().or(self.labels.as_ref()), &self.output) else {
            let named = scenario::EXAMPLES
                .iter()
                .find(|(name, _)| self.example.as_deref() == Some(*name));
            return terminal::emit(named.map_or(scenario::REFERENCE, |(_, text)| *text));
        };
        self.backend.check()?;
        let mut read = inputs(path);
        read.extend(self.replay.iter().chain(&self.ct).cloned());
        read.extend(settings::files(&self.settings.of_scenario(), self.folder(path)));
        let folder = self.force.folder(output, "insert", FILES, &read)?;
        let (mut scenario, picked) = self.scenario(path)?;
        let mut picked: Vec<Picked> = picked.into_iter().collect();
        let requests = Requests {
            frames: self.images().is_some() || self.preview,
            mesh_s: self.vtu.map(|ms| ms * 1e-3),
        };
        if requests.frames {
            picked.extend(self.quality.frames_of(&mut scenario, &self.backend)?);
        }
        if let Some(hand) = self.hand.as_deref().and_then(hand) {
            scenario = hand.perform(&scenario, self.hand_seed)?;
        }
        if let Some(file) = &self.replay {
            scenario = replaying(scenario, file)?;
        }
        // Before the model is made: a history of stress in viscous tissue has to begin with the tissue at
        // rest.
        if self.vtu.is_some() {
            scenario.follow_stress();
        }
        let mut model = prepared(&scenario)?;
        let mut writer = Writer::new(&scenario, folder.path(), requests)?;
        if requests.frames {
            self.extras.check(&scenario.scene)?;
            let (anatomy, mut settings) = (scenario.scene.anatomy.clone(), scenario.scene.settings.clone());
            settings.layers = self.extras.layers();
            let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
            let state = FrameState::at(*pose.probe_to_world());
            let chosen = self.backend.synthesizer(anatomy, settings, Some(&state))?;
            chosen.tell();
            writer.render(chosen, self.images(), &self.extras, self.preview)?;
        }
        let mut summary = run(&scenario, model.as_mut(), requests, &mut writer)?;
        let name = path.display().to_string();
        summary.warnings.extend(writer.warnings());
        let report = InsertReport {
            scenario: name.clone(),
            set: self.set()?.iter().map(Setting::line).collect(),
            quality: picked,
            summary: &summary,
        };
        writer.finish(&name, &summary, &report)?;
        folder.install()?;

        // Those of the scenario were told when it was read.
        summary.warnings[scenario.warnings.len()..]
            .iter()
            .for_each(terminal::warn);
        if self.json {
            return terminal::emit_json(&report);
        }
        terminal::say(summary_line(&summary, output));
        Ok(())
    }

    /// Format of images; companion files and overlays require pictures.
    fn images(&self) -> Option<Images> {
        let Extras {
            sidecar,
            overview,
            overlay,
            uncompressed,
            ..
        } = self.extras;
        let beside = sidecar || overview || overlay || !self.extras.layers().is_empty();
        let implied = beside.then_some(Images::Png);
        self.images.or(implied).or(uncompressed.then_some(Images::Mha))
    }

    /// Folder of the paths in the scenario.
    fn folder<'a>(&self, path: &'a Path) -> &'a Path {
        let folder = path.parent().filter(|_| self.labels.is_none());
        folder.unwrap_or(Path::new(""))
    }

    /// Keys that the options set.
    fn set(&self) -> Result<Vec<Setting>, Error> {
        let mut set = Vec::new();
        if let Some(labels) = &self.labels {
            set.push(Setting::new("version", Version::NEWEST.number()));
            set.push(settings::path("scene.volume.file", labels)?);
            set.extend(
                self.target
                    .as_deref()
                    .map(|target| Setting::new("needle.target", target)),
            );
        }
        if let Some(ct) = &self.ct {
            set.push(settings::path("scene.volume.ct", &here(ct))?);
        }
        set.extend(self.settings.of_scenario());
        Ok(set)
    }

    /// Returns the scenario as written, or the one for a label file.
    fn file(&self, path: &Path) -> Result<ScenarioFile, Error> {
        let set = self.set()?;
        if self.labels.is_some() {
            return Ok(ScenarioFile::parse_with("", "", &set)?);
        }
        Ok(match scenario::bundled(path) {
            Some((name, text)) => ScenarioFile::parse_with(text, name, &set)?,
            None if path.extension().is_none() && !path.exists() => {
                let known: Vec<&str> = scenario::EXAMPLES.iter().map(|(name, _)| *name).collect();
                let found = format!(
                    "{}: neither a file nor a scenario that comes with the program",
                    path.display()
                );
                return Err(usage(found, format!("name a file, or one of {}", known.join(", "))));
            }
            None => ScenarioFile::parse_with(&document::read(path)?, &path.display().to_string(), &set)?,
        })
    }

    /// Reads the scenario and all files that it names, and prints notes and warnings.
    fn scenario(&self, path: &Path) -> Result<(Scenario, Option<Picked>), Error> {
        let mut file = self.file(path)?;
        let folder = self.folder(path);
        file.adapter = Some(self.backend.choice());
        let picked = self.quality.steps(&mut file, folder)?;
        let scenario = resolve(&file, folder)?;
        self.settings.check(&scenario.scene.file)?;
        terminal::notes(&scenario.notes);
        scenario.warnings.iter().for_each(terminal::warn);
        if scenario.quality.step_ms.is_none() && scenario.scene.quality.step_ms.is_some() {
            terminal::warn("quality.step_ms of the scene's own file is ignored: state it in the scenario");
        }
        Ok((scenario, picked))
    }
}

/// Makes the model of a scenario, showing progress.
pub(crate) fn prepared(scenario: &Scenario) -> Result<Box<dyn Model>, Error> {
    Ok(terminal::with_share("preparing the model", |share| {
        scenario.model(|done, count| share(done as f64 / count.max(1) as f64))
    })?)
}

/// Resolves a scenario, showing progress.
pub(crate) fn resolve(file: &ScenarioFile, folder: &Path) -> Result<Scenario, Error> {
    Ok(terminal::with_share("making the mesh", |progress| {
        file.resolve(folder, |share| progress(f64::from(share)))
    })?)
}

fn replaying(scenario: Scenario, file: &Path) -> Result<Scenario, Error> {
    let expected = "a recording as JSON: `start` and `inputs`, of a simulator of this scenario";
    let wrong = |found: String| usage(format!("{}: {found}", file.display()), expected);
    let text = read::text(file, read::RECORDING).map_err(|cause| wrong(cause.to_string()))?;
    let Table(recording): Table<Recording> = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    scenario.replaying(recording).map_err(wrong)
}

fn summary_line(summary: &Summary, output: &Path) -> String {
    let ms = &summary.step_ms;
    let seeds = match summary.seeds.len() {
        0 => String::new(),
        left => format!(", {left} seeds"),
    };
    let misplaced = summary
        .misplacement
        .map_or(String::new(), |misplacement| format!(" ({misplacement})"));
    let changes = summary.level_changes.iter().map(|change| {
        let (level, time_s, jump_n, seconds) = (&change.to, change.time_s, change.force_jump_n, change.seconds);
        format!(", level {level} from {time_s:.3} s (took {seconds:.3} s, force on the hand {jump_n:.1e} N apart)")
    });
    let changes: String = changes.collect();
    let longest = match ms.shares_of_longest().first() {
        Some((work, share)) => format!("; the ten longest spent {:.0} % on {work}", 100.0 * share),
        None => String::new(),
    };
    let targets = summary.targets.iter();
    let targets: String = targets
        .map(|target| {
            format!(
                ", tip within {:.1} mm of the target in the tissue at rest ({})",
                target.nearest_tip_mm, target.name
            )
        })
        .collect();
    let images = summary.images.iter();
    let images: String = images
        .map(|image| format!(", image {} to {:.1} mm", image.name, image.rms_mm))
        .collect();
    format!(
        "wrote {}: {} steps ({:.2} s), force on the hand up to {:.2} N, tip deflection up to {:.2} mm{targets}, {} \
         remeshes{changes}{seeds}{misplaced}{images}; a step takes {:.3} ms (99 %: {:.3}, 99.9 %: {:.3}, longest {:.3}{longest}); open {}",
        output.display(),
        summary.steps,
        summary.simulated_s,
        summary.max_base_force_n,
        summary.tip_deflection_mm,
        summary.remeshes,
        ms.wall.median,
        ms.wall.p99,
        ms.wall.p999,
        ms.wall.max,
        output.join("index.html").display()
    )
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(scenario::EXAMPLES.iter().map(|(name, _)| *name))
}

fn hands() -> PossibleValuesParser {
    PossibleValuesParser::new(HANDS.iter().map(|(name, _)| *name))
}

/// Parses a period, ms.
fn period(text: &str) -> Result<f64, String> {
    ranged(text, 0.01..=1e7, "milliseconds from 0.01 to 1e7")
}
