//! Straight needle paths to a target in tissue that deforms: candidates, each simulated and aimed again at the
//! displaced target.
//!
//! Kobayashi et al. 2010 (sections 1 and 2.1) plan position and orientation of a needle so that it meets a target that
//! tissue carries away, and state no method; the one used here is that of `correct`.

mod candidates;
mod correct;
mod guide;
mod insertion;
mod report;
#[cfg(test)]
mod tests;

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering as Memory};

use nalgebra::{Point3, Vector3};
use serde::Serialize;

use crate::StudyError;
pub(super) use candidates::DEFORMED_BONE;
use candidates::Entries;
pub use correct::Corrected;
use insertion::Until;
pub use insertion::{Course, Sample, Trial};
use insonify::Error;
use insonify::input::scenario::aim::middle;
use insonify::input::scenario::{EXAMPLES, Scenario, ScenarioFile};
use insonify_base::parallel;
use insonify_base::range::check;
use insonify_base::text::some_of;
use insonify_imaging::sidecar::image_to_world;
use insonify_tracking::manipulator::Posture;
use insonify_tracking::trajectory::Trajectory;
pub use report::FILES;

/// Speed of a needle whose scenario states none, mm/s: that of Kobayashi et al. 2010.
const USUAL_MM_S: f64 = 5.0;

/// Target of the needle.
#[derive(Clone, Debug, PartialEq)]
pub enum Goal {
    /// A point in the anatomy at rest (LPS), mm.
    At([f64; 3]),
    /// Column and row of a pixel of the image at the start.
    Pixel([f64; 2]),
    /// A target of the scenario's plan, or a label or tissue, whose innermost point in the image counts.
    Named(String),
}

/// Domain of entries.
#[derive(Clone, Debug, PartialEq)]
pub enum Entry {
    /// In the image plane, at angles to the beam's axis from the first to the last, degrees; `None` for those at which
    /// the guide reaches the target, or without one -60 to 60.
    Plane(Option<[f64; 2]>),
    /// In the image plane, on the line through a pixel (column and row) of the image at the start.
    Pixel([f64; 2]),
    /// On the skin within a box (LPS), as two opposite corners, mm.
    Box([[f64; 3]; 2]),
    /// On the skin where it is of this label or tissue.
    Named(String),
}

/// Conditions of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct PathOptions {
    /// Target of the needle.
    pub target: Goal,
    /// Domain of its entries.
    pub entry: Entry,
    /// Number of lines (1 to 1000).
    pub lines: usize,
    /// Least distance of a path from bone and critical structures, mm (0 to 30).
    pub clearance_mm: f64,
    /// Distance of the tip from the target at which it counts as reached, mm (0.001 to 10).
    pub tolerance_mm: f64,
    /// Thickness of the section by the image plane in which the needle goes, mm; `None` for the scenario's own tissue.
    pub section_mm: Option<f64>,
    /// Speed of the needle, mm/s (above 0 to 1000); `None` for that of the scenario's first inward stroke.
    pub speed_mm_s: Option<f64>,
}

/// A line to the target, with its result or the reason of its exclusion.
#[derive(Clone, Debug, Serialize)]
pub struct Candidate {
    /// Number of the line, from 1.
    pub number: usize,
    /// Angle to the beam's axis, degrees, positive where the needle goes towards the marked side.
    pub angle_deg: f64,
    /// Entry on the skin, mm; `None` where the line has none.
    pub entry_mm: Option<[f64; 3]>,
    /// Whether the volume ends at the entry.
    #[serde(skip)]
    pub at_end: bool,
    /// Distance from the entry to the target at rest, mm.
    pub depth_mm: Option<f64>,
    /// Reason of its exclusion; `None` for a line that was simulated.
    pub excluded: Option<&'static str>,
    /// Direction of the needle before any correction.
    #[serde(skip)]
    pub along: Vector3<f64>,
    /// Posture of the guide with the tip at the end of the path, or at the target at rest for an excluded line; absent
    /// without a guide, or for a line out of its plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guide: Option<Posture>,
    /// Result of the simulations.
    #[serde(flatten)]
    pub path: Option<Corrected>,
}

/// Planned paths.
#[derive(Clone, Debug, Serialize)]
pub struct PathPlan {
    /// Name of the target.
    pub target: String,
    /// The target at rest, mm.
    pub target_mm: [f64; 3],
    /// Tissue: `scenario` or `2d`.
    pub model: &'static str,
    /// Thickness of a section, mm.
    pub thickness_mm: Option<f64>,
    /// Speed of the needle, mm/s.
    pub speed_mm_s: f64,
    /// Least distance from bone and critical structures demanded, mm.
    pub least_clearance_mm: f64,
    /// Distance from the target at which it counts as reached, mm.
    pub tolerance_mm: f64,
    /// Number of excluded lines for each reason.
    pub excluded: BTreeMap<&'static str, usize>,
    /// All lines: the simulated ones first, the best of them first.
    pub lines: Vec<Candidate>,
    /// Assumptions made, for the user.
    pub notes: Vec<String>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

impl PathOptions {
    fn check(&self) -> Result<(), Error> {
        let lines = self.lines as f64;
        check("candidates", lines, (1.0..=1000.0).contains(&lines), "1 to 1000")?;
        let clearance = self.clearance_mm;
        check("clearance_mm", clearance, (0.0..=30.0).contains(&clearance), "0 to 30")?;
        let tolerance = self.tolerance_mm;
        check(
            "tolerance_mm",
            tolerance,
            (0.001..=10.0).contains(&tolerance),
            "0.001 to 10",
        )?;
        if let Some(thickness) = self.section_mm {
            check(
                "thickness_mm",
                thickness,
                (0.1..=500.0).contains(&thickness),
                "0.1 to 500",
            )?;
        }
        if let Some(speed) = self.speed_mm_s {
            check("speed_mm_s", speed, speed > 0.0 && speed <= 1000.0, "above 0 to 1000")?;
        }
        if let Entry::Plane(Some([low, high])) = self.entry {
            let ascending = -85.0 <= low && low <= high && high <= 85.0;
            check("angles", low, ascending, "two ascending angles from -85 to 85")?;
        }
        Ok(())
    }
}

/// Resolves a scenario file for plans: its mesh is not finer along one path, which that would favour, its own motion
/// may be beyond its guide, and where that would choose the part of the volume that is meshed, the lines do.
///
/// # Errors
/// Those of `resolve`, and [`Error`] for options out of range and a target that [`plan`] refuses.
pub fn resolved<E: From<Error>>(
    mut file: ScenarioFile,
    options: &PathOptions,
    resolve: impl Fn(&ScenarioFile) -> Result<Scenario, E>,
) -> Result<Scenario, E> {
    if file.tissue.mesh.is_none() && file.tissue.model.is_finer_along_path() {
        file.tissue.along_path = Some(false);
    }
    let guide = file.manipulator.take_if(|spec| spec.keyframes.is_empty());
    let for_plans = |file: &ScenarioFile| -> Result<Scenario, E> {
        let mut scenario = resolve(file)?;
        scenario.file.manipulator = guide.clone().or(scenario.file.manipulator);
        Ok(scenario)
    };
    let scenario = for_plans(&file)?;
    let (Some([low, high]), None) = (scenario.meshed_mm(), file.tissue.box_mm) else {
        return Ok(scenario);
    };
    let (_, target) = permitted(&scenario, options)?;
    let around = Entries::new(&scenario, target, options, USUAL_MM_S)?.box_mm()?;
    let holds =
        |corners: &[[f64; 3]; 2]| (0..3).all(|axis| low[axis] <= corners[0][axis] && corners[1][axis] <= high[axis]);
    match around.filter(|corners| !holds(corners)) {
        Some(corners) => {
            file.tissue.box_mm = Some(corners);
            for_plans(&file)
        }
        None => Ok(scenario),
    }
}

/// Plans paths to a target. `progress` receives the number of completed lines, and of all, and may say stop.
///
/// # Errors
/// [`Error`] for options out of range, a target in bone or outside, and if no line fulfils the conditions.
pub fn plan(
    scenario: &Scenario,
    options: &PathOptions,
    progress: &(dyn Fn(usize, usize) -> ControlFlow<()> + Sync),
) -> Result<PathPlan, Error> {
    scenario.check_path_independent()?;
    if scenario.file.manipulator.is_some() {
        scenario.file.guide()?;
    }
    let (name, target) = permitted(scenario, options)?;
    let mut notes = Vec::new();
    let speed_mm_s = options
        .speed_mm_s
        .or_else(|| insertion::speed_mm_s(scenario))
        .unwrap_or_else(|| {
            notes.push(format!(
                "the scenario's needle has no inward stroke: speed {USUAL_MM_S} mm/s (`--speed-mm-s`)"
            ));
            USUAL_MM_S
        });
    let meshed_mm = scenario
        .meshed_mm()
        .filter(|corners| corners.as_flattened().iter().all(|x| x.is_finite()));
    if let (Some([low, high]), None) = (meshed_mm, options.section_mm) {
        let [x, y, z] = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        let nodes = scenario.mesh.nodes().len();
        notes.push(format!(
            "tissue is simulated within {x} x {y} x {z} mm around the lines, by {nodes} nodes (`tissue.box_mm`)"
        ));
    }
    let section = options
        .section_mm
        .map(|thickness| scenario.section(thickness))
        .transpose()?;
    let mut tissue = section.unwrap_or_else(|| scenario.clone());
    // Guides, deposits and changes of level belong to the insertion of
    // the scenario; each line is one of its own.
    tissue.guides.clear();
    tissue.deposits.clear();
    tissue.keep_level();
    tissue.targets.clear();
    if scenario.scene.probe_path().keys().len() > 1 {
        notes.push("the probe stays where it is at the start".to_owned());
        let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
        tissue.scene.move_probe(Trajectory::fixed(pose));
    }
    let entries = Entries::new(scenario, target, options, speed_mm_s)?;
    let lines = entries.lines()?;
    let (done, count) = (AtomicUsize::new(0), lines.len());
    StudyError::unless_stopped(progress(0, count))?;
    let mut lines: Vec<Candidate> = parallel::try_map((0.., &lines[..]), &|(index, line)| {
        let candidate = entries.simulated(index + 1, line, &tissue);
        StudyError::unless_stopped(progress(done.fetch_add(1, Memory::Relaxed) + 1, count))?;
        candidate
    })?;
    lines.sort_by(|a, b| rank(a, b, options.tolerance_mm).then(a.number.cmp(&b.number)));
    let reasons = guide::reasons(&lines);
    let told = |with: fn(&(&'static str, usize, String)) -> bool| {
        let reasons = reasons.iter().filter(|reason| with(reason));
        let words = reasons.map(|(reason, number, taken)| format!("{number} {reason}{taken}"));
        words.collect::<Vec<_>>().join("; ")
    };
    if lines.iter().all(|line| line.excluded.is_some()) {
        return Err(no_path(&name, count, &told(|_| true)));
    }
    let by_guide = told(|(.., taken)| !taken.is_empty());
    if !by_guide.is_empty() {
        notes.push(format!("of {count} lines {by_guide}"));
    }
    let at_end = lines.iter().filter(|line| line.at_end).count();
    if at_end > 0 {
        notes.push(format!(
            "tissue reaches the end of the volume on {at_end} of {count} lines: that end is a surface there"
        ));
    }
    if options.section_mm.is_some() {
        notes.push(
            "a section knows no motion across its plane: `insonify insert` of the plan tells the miss in three dimensions".to_owned(),
        );
    }
    let mut warnings = Vec::new();
    if let Some(path) = lines[0].path.as_ref() {
        warnings.extend(path.warnings(options.tolerance_mm));
    }
    if lines[0].at_end && lines.iter().any(|line| line.entry_mm.is_some() && !line.at_end) {
        warnings.push("the best path enters at the end of the volume: the skin may lie beyond it".to_owned());
    }
    Ok(PathPlan {
        target: name,
        target_mm: target.into(),
        model: if options.section_mm.is_some() { "2d" } else { "scenario" },
        thickness_mm: options.section_mm,
        speed_mm_s,
        least_clearance_mm: options.clearance_mm,
        tolerance_mm: options.tolerance_mm,
        excluded: reasons
            .into_iter()
            .map(|(reason, number, _)| (reason, number))
            .collect(),
        lines,
        notes,
        warnings,
    })
}

/// The built-in scenario `liver-puncture` with `nodes` nodes and parts of its text replaced.
///
/// # Errors
/// [`Error`] if the changed scenario is not valid.
pub(super) fn liver(nodes: usize, changes: &[(&str, &str)]) -> Result<Scenario, Error> {
    let text = EXAMPLES.iter().find(|(name, _)| *name == "liver-puncture");
    let text = text.map_or(String::new(), |(_, text)| {
        text.replace("nodes = 3300", &format!("nodes = {nodes}"))
    });
    let text = changes.iter().fold(text, |text, (from, to)| text.replace(from, to));
    Ok(ScenarioFile::parse(&text, "liver-puncture")?.resolve(Path::new(""), |_| ())?)
}

/// Distance of the tip from a target at the end of a motion in some tissue, mm; `None` where the needle meets bone
/// before.
///
/// # Errors
/// [`Error`] if the motion cannot be simulated.
pub(super) fn miss_mm(scenario: &Scenario, course: &Course, target: &Point3<f64>) -> Result<Option<f64>, Error> {
    let trial = course.run(scenario, target, Until::End)?;
    Ok(trial
        .samples
        .last()
        .filter(|_| !trial.bone)
        .map(|sample| sample.miss.norm()))
}

/// Name and place of the target, which has to be one that a needle may reach.
fn permitted(scenario: &Scenario, options: &PathOptions) -> Result<(String, Point3<f64>), Error> {
    options.check()?;
    let (name, target) = goal(scenario, &options.target)?;
    candidates::permitted(scenario, &name, &target)?;
    if options.section_mm.is_some() {
        candidates::in_plane(scenario, &target)?;
    }
    Ok((name, target))
}

/// Name and place of a target.
fn goal(scenario: &Scenario, goal: &Goal) -> Result<(String, Point3<f64>), Error> {
    let name = match goal {
        Goal::At(point) => return Ok(("the target".to_owned(), (*point).into())),
        Goal::Pixel(at_px) => return Ok(("the target".to_owned(), pixel(scenario, *at_px)?)),
        Goal::Named(name) => name,
    };
    if let Some(target) = scenario.targets.iter().find(|target| target.name == *name) {
        return Ok((target.name.clone(), target.at_mm));
    }
    let body = scenario.scene.body();
    let label = body.named(name).ok_or_else(|| unknown(scenario, name))?;
    let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
    let (centre, _) = middle(&scenario.scene, &pose, label).ok_or_else(|| unknown(scenario, name))?;
    Ok((body.name(label), centre))
}

/// Point of the image plane at the start that a pixel (column and row) shows, to 0.01 mm.
fn pixel(scenario: &Scenario, [column, row]: [f64; 2]) -> Result<Point3<f64>, Error> {
    let grid = scenario.scene.settings.image_grid()?;
    let is_in = |pixel: f64, count: usize| (-0.5..count as f64 - 0.5).contains(&pixel);
    if !(is_in(column, grid.width()) && is_in(row, grid.height())) {
        return Err(StudyError::refused(format!(
            "pixel ({column}, {row}) is not in the image; expected a column and a row of {} x {} pixels, counted from 0 at the upper left",
            grid.width(),
            grid.height()
        )));
    }
    let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
    let to_world = image_to_world(&grid, &pose);
    let point = to_world.transform_point(&Point3::new(column, row, 0.0));
    Ok(point.map(|x| (x * 100.0).round() / 100.0))
}

/// Error if no line to a target is left of those tried.
fn no_path(target: &str, tried: usize, reasons: &str) -> Error {
    StudyError::refused(format!("no path to {target}: of {tried} lines {reasons}"))
}

/// Error if no label or tissue of a scenario has a name.
pub(super) fn unknown(scenario: &Scenario, name: &str) -> Error {
    let entries = scenario.scene.body().entries();
    let known_names: Vec<String> = entries
        .iter()
        .filter_map(|(_, _, names)| names.first().cloned())
        .collect();
    let examples = some_of(&known_names);
    StudyError::refused(format!(
        "no label or tissue is named {name:?}; expected one of {examples}"
    ))
}

/// Order of lines: simulated before excluded, then by miss (those within the tolerance are equal), clearance (to 1 mm)
/// and peak force.
fn rank(a: &Candidate, b: &Candidate, tolerance_mm: f64) -> Ordering {
    let Some([a, b]) = a.path.as_ref().zip(b.path.as_ref()).map(|(a, b)| [a, b]) else {
        return a.path.is_none().cmp(&b.path.is_none());
    };
    let miss = |path: &Corrected| {
        if path.miss_mm <= tolerance_mm {
            0.0
        } else {
            path.miss_mm
        }
    };
    let clear = |path: &Corrected| path.clearance_mm.map_or(f64::INFINITY, f64::round);
    miss(a)
        .total_cmp(&miss(b))
        .then(clear(b).total_cmp(&clear(a)))
        .then(a.max_force_n.total_cmp(&b.max_force_n))
}
