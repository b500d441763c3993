//! `insonify manipulator`: a needle guide mounted on the probe.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use insonify::input::scenario::ScenarioFile;
use insonify::input::scenario::manipulator::GuideMotion;
use insonify_base::csv::{Csv, CsvError};
use insonify_base::output::png;
use insonify_base::table::{Cell, Table};
use insonify_imaging::overlay;
use insonify_imaging::synth::FrameState;
use insonify_report::plot::{Axis, Plot, Series};
use insonify_tracking::TrackingError;
use insonify_tracking::manipulator::drive::{Control, PERIOD_S};
use insonify_tracking::manipulator::{Guide, InPlane, Posture};
use serde::Serialize;
use serde_json::json;

use super::backend::BackendArgs;
use super::output::{self, Force, inputs};
use super::terminal;
use super::variants::variants;
use insonify::Error;

/// Slides of a table, and its poses.
const SLIDES: [&str; 3] = ["slide_1_mm", "slide_2_mm", "slide_3_mm"];
const NEEDLE: [&str; 3] = ["tip_x_mm", "tip_y_mm", "angle_deg"];
/// Most rows of a motion in JSON: every n-th period of the controller is written.
const MAX_ROWS: usize = 1000;

const EXAMPLES: &str = "\
The guide holds the needle in the image plane and moves it in three degrees of freedom: horizontal positioning (A, 40 mm), posture (B,
+-30 degrees) and insertion (C, 60 mm). Slides I and II together make A, II alone makes B through a slider-crank, III makes C.
In the frame of the probe, x is lateral to the marked side, y axial into the body; the angle of the needle is that to y, positive towards x.

FILE.csv of `forward` has the columns slide_1_mm, slide_2_mm, slide_3_mm, that of `inverse` tip_x_mm, tip_y_mm, angle_deg; other columns are
ignored. `inverse` of a scenario gives the slides along the path of its needle. The dimensions are those of [manipulator.guide] of the scenario, or of
--scenario, or the defaults. docs/manipulator.md has the model.

Examples:
  insonify manipulator forward slides.csv --json
  insonify manipulator inverse poses.csv --scenario my.toml
  insonify manipulator inverse my.toml --json              a planned path in the coordinates of the slides
  insonify manipulator follow my.toml -o motion            commanded motion, actual motion and lost motion of the slides
  insonify manipulator workspace my.toml -o reach.png      what the tip can reach, over the first image
  insonify insert my.toml -o out --images                  the insertion itself

Source: Y. Kobayashi et al., \"Development of an integrated needle insertion system with image guidance and deformation
simulation\", Computerized Medical Imaging and Graphics 34 (2010) 9-18.
Exit status: 0 success; 2 a file is wrong, or a pose out of reach; 1 a failure of the machine.";

/// Computes the motion of a needle guide mounted on the probe: kinematics, drive, reach
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Manipulator {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Computes postures and needles from places of the slides
    Forward(Kinematics),
    /// Computes places of the slides from needles, or along the path of a scenario
    Inverse(Kinematics),
    Follow(Follow),
    Workspace(Box<Workspace>),
}

impl Manipulator {
    pub(crate) fn run(&self) -> Result<(), Error> {
        match &self.task {
            Task::Forward(table) => table.run(true),
            Task::Inverse(table) => table.run(false),
            Task::Follow(follow) => follow.run(),
            Task::Workspace(workspace) => workspace.run(),
        }
    }
}

// `insonify manipulator forward`, `insonify manipulator inverse`.

#[derive(Args)]
pub(crate) struct Kinematics {
    /// Table (CSV); with `inverse` also a scenario (TOML)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Scenario whose [manipulator.guide] has the dimensions
    #[arg(long, value_name = "SCENARIO.toml")]
    scenario: Option<PathBuf>,
    /// Print a JSON list of objects: `slides_mm`, `position_mm`, `posture_deg`, `insertion_mm`, `tip_mm`, `angle_deg`,
    /// `turn_deg_per_mm`
    #[arg(long)]
    json: bool,
}

/// Guide at one place.
#[derive(Serialize)]
struct Place {
    /// Time, s, along the path of a scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    time_s: Option<f64>,
    slides_mm: [f64; 3],
    #[serde(flatten)]
    posture: Posture,
    #[serde(flatten)]
    needle: InPlane,
    /// Turn of the needle for a millimetre of slide II.
    turn_deg_per_mm: Option<f64>,
}

impl Place {
    fn new(guide: &Guide, posture: Posture, time_s: Option<f64>) -> Result<Self, TrackingError> {
        Ok(Self {
            time_s,
            slides_mm: guide.slides(&posture)?,
            posture,
            needle: guide.needle(&posture),
            turn_deg_per_mm: guide.turn_per_mm(posture.posture_deg.to_radians()).map(f64::to_degrees),
        })
    }
}

impl Kinematics {
    fn run(&self, forward: bool) -> Result<(), Error> {
        let is_scenario = self.file.extension().is_some_and(|ending| ending == "toml");
        let places = if is_scenario && !forward {
            self.along()?
        } else {
            self.table(forward)?
        };
        terminal::show(&places, self.json, || text(&places))
    }

    /// Places along the planned path of a scenario, at its keyframes.
    fn along(&self) -> Result<Vec<Place>, Error> {
        let (guided, times) = guided(&self.file, None)?;
        let place = |time: &f64| Place::new(&guided.guide, guided.at(*time).command, Some(*time));
        Ok(times.iter().map(place).collect::<Result<_, _>>()?)
    }

    fn table(&self, forward: bool) -> Result<Vec<Place>, Error> {
        let guide = match &self.scenario {
            Some(path) => {
                let file = ScenarioFile::read(path)?;
                file.guide()?
            }
            None => Guide::default(),
        };
        let columns = if forward { SLIDES } else { NEEDLE };
        let table = Csv::open(&self.file, &columns)?;
        let place = |row: insonify_base::csv::Row<'_>| -> Result<Place, CsvError> {
            let [a, b, c] = row.numbers(columns)?;
            let posture = if forward {
                guide.posture([a, b, c])
            } else {
                guide.reaching(&InPlane {
                    tip_mm: [a, b],
                    angle_deg: c,
                })
            };
            let place = posture.and_then(|posture| Place::new(&guide, posture, None));
            place.map_err(|error| row.refused(error.to_string()))
        };
        Ok(table.rows().map(place).collect::<Result<_, _>>()?)
    }
}

fn text(places: &[Place]) -> String {
    let timed = places.iter().any(|place| place.time_s.is_some());
    let mut head = vec![
        "I mm",
        "II mm",
        "III mm",
        "A mm",
        "B deg",
        "C mm",
        "tip x mm",
        "tip y mm",
        "angle deg",
        "deg per mm of II",
    ];
    if timed {
        head.insert(0, "time s");
    }
    let rows = places.iter().map(|place| {
        let [a, b, c] = place.slides_mm;
        let Posture {
            position_mm,
            posture_deg,
            insertion_mm,
        } = place.posture;
        let ([x, y], angle) = (place.needle.tip_mm, place.needle.angle_deg);
        let turn = place.turn_deg_per_mm.unwrap_or(f64::NAN);
        let numbers = [a, b, c, position_mm, posture_deg, insertion_mm, x, y, angle, turn];
        let numbers = place.time_s.into_iter().chain(numbers);
        numbers.map(|number| format!("{number:.4}")).collect::<Vec<_>>()
    });
    Table::new(head.into_iter().map(Cell::number))
        .with(rows)
        .text("  ", &[])
}

/// Motion of the guide of a scenario, and the times of its keyframes.
fn guided(path: &Path, control: Option<Control>) -> Result<(GuideMotion, Vec<f64>), Error> {
    let mut file = ScenarioFile::read(path)?;
    if let (Some(control), Some(spec)) = (control, &mut file.manipulator) {
        spec.control = control;
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let (scene, guided) = file.resolve_guided(folder)?;
    let guided = guided?;
    let times = file.guide_times().unwrap_or_else(|| {
        let keys = scene.needle_path().into_iter().flat_map(|path| path.tip().keys());
        keys.map(|key| key.time_s).collect()
    });
    Ok((guided, times))
}

// `insonify manipulator follow`: actual motion of the slides under the commands.

/// Simulates the drive: commands, postures, lost motion and the error of the tip, without tissue
#[derive(Args)]
pub(crate) struct Follow {
    /// Scenario with a [manipulator]
    #[arg(value_name = "SCENARIO.toml")]
    scenario: PathBuf,
    /// Folder to write to: motion.csv, tip-error.svg
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Control of the slides [default: that of the scenario]
    #[arg(long, value_parser = variants::<Control>())]
    control: Option<Control>,
    #[command(flatten)]
    force: Force,
    /// Print JSON: `largest_tip_error_mm`, `final_tip_error_mm`, `lost_mm` (pushing and pulling, of a slide), `motion`
    /// (rows as in motion.csv)
    #[arg(long)]
    json: bool,
}

impl Follow {
    fn run(&self) -> Result<(), Error> {
        let folder = self
            .force
            .folder(&self.output, "manipulator", &[], &inputs(&self.scenario))?;
        let (motion, _) = guided(&self.scenario, self.control)?;
        output::text(&folder.path().join("motion.csv"), &table(&motion, 1).csv())?;
        output::plot(&folder.path().join("tip-error.svg"), &plot(&motion))?;
        folder.install()?;
        let error_mm = |driven| motion.off_mm(driven);
        let largest = motion.driven.iter().map(error_mm).fold(0.0, f64::max);
        let last_mm = motion.driven.last().map_or(0.0, error_mm);
        let lost = motion
            .drive
            .lost_mm(motion.drive.load_n)
            .map(|mm| mm * motion.drive.reduction());
        if self.json {
            let every = motion.driven.len().div_ceil(MAX_ROWS);
            return terminal::emit_json(&json!({
                "largest_tip_error_mm": largest,
                "final_tip_error_mm": last_mm,
                "lost_mm": lost,
                "motion": rows(&motion, every).collect::<Vec<_>>(),
            }));
        }
        terminal::emit(&format!(
            "{} s at {} Hz: the tip is at most {largest:.3} mm from its command, {last_mm:.3} mm at the end; the \
             drive loses {:.3} mm pushing and {:.3} mm pulling; wrote {}",
            (motion.driven.len() - 1) as f64 * PERIOD_S,
            1.0 / PERIOD_S,
            lost[0],
            lost[1],
            self.output.display()
        ))
    }
}

/// Columns of a motion.
const MOTION: [&str; 11] = [
    "time_s",
    "command_position_mm",
    "command_posture_deg",
    "command_insertion_mm",
    "position_mm",
    "posture_deg",
    "insertion_mm",
    "lost_1_mm",
    "lost_2_mm",
    "lost_3_mm",
    "tip_error_mm",
];

/// Rows of a motion, every n-th period of the controller.
fn rows(motion: &GuideMotion, every: usize) -> impl Iterator<Item = [f64; 11]> + '_ {
    motion.driven.iter().step_by(every.max(1)).map(move |driven| {
        let [c, p] = [driven.command, driven.posture]
            .map(|posture| [posture.position_mm, posture.posture_deg, posture.insertion_mm]);
        let [l1, l2, l3] = driven.lost_mm;
        [
            driven.time_s,
            c[0],
            c[1],
            c[2],
            p[0],
            p[1],
            p[2],
            l1,
            l2,
            l3,
            motion.off_mm(driven),
        ]
    })
}

fn table(motion: &GuideMotion, every: usize) -> Table {
    Table::new(MOTION).with(rows(motion, every).map(|row| row.map(|number| format!("{number:.6}"))))
}

fn plot(motion: &GuideMotion) -> Plot {
    let every = motion.driven.len().div_ceil(MAX_ROWS);
    let line = |value: fn(&[f64; 11]) -> f64| rows(motion, every).map(move |row| [row[0], value(&row)]).collect();
    let series = vec![
        Series::line("error of the tip", 0, line(|row| row[10])),
        Series::line("lost motion, I", 1, line(|row| row[7])),
        Series::line("lost motion, II", 2, line(|row| row[8])),
        Series::line("lost motion, III", 3, line(|row| row[9])),
    ];
    Plot::new(
        "Needle guide: error and lost motion",
        Axis::linear("time, s"),
        Axis::linear("mm"),
        series,
    )
}

// `insonify manipulator workspace`: what the tip can reach, over an image.

/// Draws what the tip can reach, and its planned path, over the first image of a scenario
#[derive(Args)]
pub(crate) struct Workspace {
    /// Scenario with a [manipulator]
    #[arg(value_name = "SCENARIO.toml")]
    scenario: PathBuf,
    /// Picture to write
    #[arg(short, long, value_name = "PICTURE.png")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    backend: BackendArgs,
}

impl Workspace {
    fn run(&self) -> Result<(), Error> {
        self.force
            .check_ending([&self.output], "png", "pictures", &inputs(&self.scenario))?;
        let file = ScenarioFile::read(&self.scenario)?;
        let folder = self.scenario.parent().unwrap_or(Path::new(""));
        let guide = file.guide()?;
        let (scene, guided) = file.resolve_guided(folder)?;
        scene.warnings.iter().for_each(terminal::warn);
        let mut settings = scene.settings.clone();
        // The needle would hide its path.
        settings.has_needle = false;
        let state = FrameState::at(*scene.probe_path().at(scene.probe_path().start_s()).probe_to_world());
        let mut chosen = self.backend.synthesizer(scene.anatomy.clone(), settings, None)?;
        let pixels = chosen.synth.render(&state)?.pixels.clone();
        let path = match &guided {
            Ok(guided) => {
                let path = guided.driven.iter().step_by(guided.driven.len().div_ceil(MAX_ROWS));
                path.map(|driven| guide.needle(&driven.command).tip_mm).collect()
            }
            Err(error) => {
                terminal::warn(format_args!("the needle's motion is not drawn: {error}"));
                Vec::new()
            }
        };
        let picture = overlay::workspace(
            &pixels,
            chosen.synth.tables(),
            |posture| guide.angles_deg(posture).is_some(),
            &path,
        );
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        Ok(png::write_rgb(&self.output, width, height, picture.as_raw())?)
    }
}
