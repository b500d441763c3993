//! `insonify path`: needle paths to a target that allow for the deformation of tissue.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use insonify::input::scenario::ScenarioFile;
use insonify_anatomy::registration::surface;
use insonify_base::output::png;
use insonify_base::range::numbers;
use insonify_base::text::some_of;
use insonify_imaging::overview::overview;
use insonify_imaging::synth::FrameState;
use insonify_mesh::file::Unit;
use insonify_study::path::{Entry, FILES, Goal, PathOptions, plan, resolved};
use insonify_tracking::world::World;

use super::backend::BackendArgs;
use super::exercise::{relocated, source};
use super::failure::{Error, usage};
use super::insert::resolve;
use super::output::{self, Force, inputs};
use super::terminal;

const EXAMPLES: &str = "\
Lines through the target are tried: in the image plane at angles to the beam, or from the skin. A line is excluded that comes too near
to bone or critical structures, at rest or as the tissue deforms, meets gas, hits the probe, or is beyond the ranges of the scenario's guide
([manipulator]). The others are simulated with the scenario's own model, each aimed at the displaced target, until the tip reaches it.
Paths are ranked by miss, clearance and force.

Examples:
  insonify path liver-puncture --target vessel -o plan                the middle of the vein, at 12 angles in the image plane
  insonify path liver-puncture --target -4,28,0 --model 2d -o plan    the same in a section by the image plane, which is quicker
  insonify path liver-puncture --target vessel --angles=-45,-10 --candidates 8 -o plan
  insonify path liver-puncture --target-px 360,208 --entry-px 440,80 -o plan     target and entry clicked in the image
  insonify path my.toml --target lesion --entry -60,-120,-40,20,-60,40 -o plan   entries on the skin within a box, two corners in mm (LPS)
  insonify path my.toml --target lesion --entry skin_abdomen -o plan             entries on a label of the skin
  insonify insert plan/scenario.toml -o out --images                  the best path, step by step

Writes plan/index.html, scenario.toml (the best path), lines.csv, lines.png and lines.svg (all lines), overview.png, target.csv and target.svg (where
the target goes while the needle advances) and summary.json.
Source: Y. Kobayashi et al., \"Development of an integrated needle insertion system with image guidance and deformation simulation\",
Computerized Medical Imaging and Graphics 34 (2010) 9-18.
Exit status: 0 done, also if the best path misses by more than the tolerance (a warning); 2 no path, or the scenario or an argument is wrong.";

/// Plans a needle's path to a target, allowing for the deformation of tissue
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct PathArgs {
    /// Scenario file (TOML), or the name of a built-in one; needle, tissue and speed are used; its motion is ignored
    #[arg(value_name = "SCENARIO.toml")]
    scenario: PathBuf,
    /// Target: a point in the anatomy at rest (LPS), mm, the one point in a file of 3D Slicer (.fcsv, .mrk.json), or the
    /// name of a target of the scenario's plan, a label or a tissue
    #[arg(
        long,
        value_name = "X,Y,Z|FILE|NAME",
        allow_hyphen_values = true,
        required_unless_present = "target_px"
    )]
    target: Option<String>,
    /// Target: a pixel of the image at the start, as column and row counted from 0 at the upper left
    #[arg(long, value_name = "COLUMN,ROW", value_parser = numbers::<2>, conflicts_with = "target")]
    target_px: Option<[f64; 2]>,
    /// Entries of the needle: `plane` (in the image plane), a box as two corners in mm, or a label or tissue of the
    /// skin
    #[arg(
        long,
        value_name = "plane|X,Y,Z,X,Y,Z|NAME",
        default_value = "plane",
        allow_hyphen_values = true
    )]
    entry: String,
    /// Entry: the needle goes through this pixel of the image at the start
    #[arg(long, value_name = "COLUMN,ROW", value_parser = numbers::<2>, conflicts_with_all = ["entry", "angles"])]
    entry_px: Option<[f64; 2]>,
    /// With --entry plane: least and largest angle to the beam's axis, degrees, positive where the needle goes towards
    /// the marked side [default: -60,60, or those at which the scenario's guide reaches the target]
    #[arg(long, value_name = "MIN,MAX", value_parser = numbers::<2>, allow_hyphen_values = true)]
    angles: Option<[f64; 2]>,
    /// Number of lines to try
    #[arg(long, value_name = "N", default_value_t = 12)]
    candidates: usize,
    /// Least distance of a path from bone and critical structures, mm
    #[arg(long, value_name = "MM", default_value_t = 3.0)]
    clearance_mm: f64,
    /// Distance of the tip from the target at which it counts as reached, mm
    #[arg(long, value_name = "MM", default_value_t = 0.1)]
    tolerance_mm: f64,
    /// Speed of the needle, mm/s [default: that of the scenario's first inward stroke]
    #[arg(long, value_name = "MM_S")]
    speed_mm_s: Option<f64>,
    /// Tissue model: the scenario's three-dimensional one, or its section by the image plane in plane strain
    #[arg(long, value_enum, default_value = "scenario")]
    model: ModelName,
    /// With --model 2d: thickness of the section, mm
    #[arg(long, value_name = "MM", default_value_t = 20.0)]
    thickness_mm: f64,
    /// Folder to write to
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    backend: BackendArgs,
    /// Print the plan as one JSON object: `target_mm`, `lines` (the best first), `excluded`, `notes`, `warnings`, ...
    #[arg(long)]
    json: bool,
}

/// Tissue in which the needle goes.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ModelName {
    /// The scenario's own, in three dimensions
    Scenario,
    /// A section by the image plane, in plane strain
    #[value(name = "2d")]
    Section,
}

impl PathArgs {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.backend.check()?;
        let options = self.options()?;
        let folder = self
            .force
            .folder(&self.output, "path", FILES, &inputs(&self.scenario))?;
        let (text, base) = source(&self.scenario)?;
        let mut file = ScenarioFile::parse(&text, &self.scenario.display().to_string())?;
        if file.tissue.mesh.is_none() && file.tissue.model.is_finer_along_path() {
            terminal::note("all lines share a mesh that is not finer along a path (`tissue.along_path = false`)");
        }
        file.adapter = Some(self.backend.choice());
        let scenario = resolved(file, &options, |file| resolve(file, &base))?;
        let plan = terminal::with_share("simulating lines", |share| {
            plan(&scenario, &options, &|done, count| {
                share(done as f64 / count.max(1) as f64);
                ControlFlow::Continue(())
            })
        })?;
        let written = plan
            .scenario(&text, &scenario)
            .and_then(|text| relocated(&text, &base, &self.output));
        let written = written.map_err(|error| {
            let expected = "a scenario whose parts are tables";
            usage(format!("{}: {error}", self.scenario.display()), expected)
        })?;
        let path_of = |name: &str| folder.path().join(name);
        output::text(&path_of("scenario.toml"), &written)?;
        output::text(&path_of("lines.csv"), &plan.csv())?;
        output::text(&path_of("target.csv"), &plan.series())?;
        output::plot(&path_of("target.svg"), &plan.target_plot())?;
        output::plot(&path_of("lines.svg"), &plan.lines_plot())?;
        let anatomy = &scenario.scene.anatomy;
        let mut chosen = self
            .backend
            .synthesizer(anatomy.clone(), scenario.scene.settings.clone(), None)?;
        let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
        chosen.synth.render(&FrameState::at(*pose.probe_to_world()))?;
        let picture = plan.picture(&chosen.synth, &scenario);
        let colours: Vec<[u8; 3]> = (0..anatomy.volume.labels().len())
            .map(|label| anatomy.tissues.tissue(label as u8).colour)
            .collect();
        let needle = plan.needle(&scenario);
        let beam = &chosen.synth.tables().grid;
        let overview = overview(&anatomy.volume, &colours, &pose, beam, needle.as_ref());
        for (name, picture) in [("lines.png", &picture), ("overview.png", &overview)] {
            let [width, height] = [picture.width(), picture.height()].map(|side| side as usize);
            png::write_rgb(&path_of(name), width, height, picture.as_raw())?;
        }
        output::text(&path_of("index.html"), &plan.page(&picture, &overview)?)?;
        let json = terminal::pretty(&plan)?;
        output::text(&path_of("summary.json"), &format!("{json}\n"))?;
        folder.install()?;
        plan.notes.iter().for_each(terminal::note);
        plan.warnings.iter().for_each(terminal::warn);
        if self.json {
            return terminal::emit_json(&plan);
        }
        terminal::emit(&plan.table().text("  ", &[]))?;
        let page = self.output.join("index.html");
        terminal::say(format!("{}; open {}", plan.text(), page.display()));
        Ok(())
    }

    fn options(&self) -> Result<PathOptions, Error> {
        Ok(PathOptions {
            target: match (self.target_px, self.target.as_deref().unwrap_or_default()) {
                (Some(at_px), _) => Goal::Pixel(at_px),
                (None, target) if is_points(target) => Goal::At(point_in(Path::new(target))?),
                (None, target) => numbers::<3>(target).map_or_else(|_| Goal::Named(target.to_owned()), Goal::At),
            },
            entry: match (self.entry_px, self.entry.as_str(), numbers::<6>(&self.entry)) {
                (Some(at_px), ..) => Entry::Pixel(at_px),
                (None, "plane", _) => Entry::Plane(self.angles),
                (None, _, Ok([a, b, c, d, e, f])) => Entry::Box([[a, b, c], [d, e, f]]),
                (None, name, Err(_)) => Entry::Named(name.to_owned()),
            },
            lines: self.candidates,
            clearance_mm: self.clearance_mm,
            tolerance_mm: self.tolerance_mm,
            section_mm: (self.model == ModelName::Section).then_some(self.thickness_mm),
            speed_mm_s: self.speed_mm_s,
        })
    }
}

/// Returns whether a name is that of a file of points of 3D Slicer.
fn is_points(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    [".fcsv", ".mrk.json"].iter().any(|ending| name.ends_with(ending))
}

/// Reads the only point of a file of 3D Slicer, LPS, mm.
fn point_in(path: &Path) -> Result<[f64; 3], Error> {
    let read = surface::read(path, Unit::Mm)?;
    let [point] = read.points[..] else {
        let found = format!("{}: found {} points", path.display(), read.points.len());
        return Err(usage(found, "save the target alone, or give it as X,Y,Z"));
    };
    let name = path.display();
    if !read.left_out.is_empty() {
        let kinds = some_of(&read.left_out);
        terminal::note(format_args!("{name}: markups of other kinds are left out: {kinds}"));
    }
    if read.guessed_ras {
        terminal::note(format_args!(
            "{name} does not state its axes: guessed as RAS, which 3D Slicer before 5 wrote"
        ));
    }
    let is_ras = read.is_ras.unwrap_or(read.guessed_ras);
    let world = if is_ras { World::Ras } else { World::Lps };
    Ok(world.vector(point.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_is_the_one_point_of_a_file_in_its_axes() {
        let folder = tempfile::tempdir().unwrap();
        let read = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            assert!(is_points(&path.display().to_string()));
            point_in(&path).map_err(|error| error.to_string())
        };
        let json = |system: &str, points: &str| {
            format!("{{\"markups\": [{{\"coordinateSystem\": \"{system}\", \"controlPoints\": [{points}]}}]}}")
        };
        let point = "{\"position\": [4, 3, -2]}";
        assert_eq!(
            read("a.fcsv", "# CoordinateSystem = 0\nF,4,3,-2\n"),
            Ok([-4.0, -3.0, -2.0])
        );
        assert_eq!(
            read("b.FCSV", "# CoordinateSystem = LPS\nF,4,3,-2\n"),
            Ok([4.0, 3.0, -2.0])
        );
        assert_eq!(read("a.mrk.json", &json("RAS", point)), Ok([-4.0, -3.0, -2.0]));
        let two = read(
            "b.mrk.json",
            &json("LPS", &format!("{point}, {{\"position\": [9, 9, 9]}}")),
        );
        assert!(two.expect_err("two points").contains("found 2 points"));
        assert!(!is_points("vessel") && !is_points("a.json"));
    }
}
