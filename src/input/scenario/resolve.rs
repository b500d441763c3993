//! Resolution of a scenario file to a runnable scenario.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use nalgebra::{Isometry3, Point3};

use super::clearance;
use super::file::{RunSpec, ScenarioFile};
use super::labels::unmeshed;
use super::manipulator::GuideMotion;
use super::needle::{Moving, NeedleSettings};
use super::plan::{Deposit, Guide, Target};
use super::planning_study::PlanningStudy;
use super::probe::rigid;
use super::regions::Regions;
use super::reported_points::Reported;
use super::tissue_setup::{Insertion, TissueSetup};
use insonify_base::document::InputError;
use insonify_base::note::Notes;
use insonify_imaging::quality::QualitySpec;
use insonify_imaging::scene::Scene;
use insonify_mechanics::insertion::{Anatomy, Instruments, Interaction, RecordedInput, Recording, Saved};
use insonify_mesh::TetMesh;
use insonify_tracking::needle::NeedlePath;
use insonify_tracking::trajectory::Trajectory;

/// Maximum number of steps of a run: hours of simulated time at a millisecond each.
const MAX_STEPS: f64 = 1e7;
/// Tolerance for reaching a time, as a fraction of a step.
const REACHED: f64 = 1e-6;

/// Times of steps and frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Start of the motions, s.
    pub start_s: f64,
    /// Time step, s.
    pub dt_s: f64,
    /// Number of steps of the run.
    pub steps: u64,
    /// Time between frames, s.
    pub frame_s: f64,
}

impl Timing {
    /// Maximum number of moments in the run at intervals of `every_s`.
    pub fn moments(&self, every_s: f64) -> u64 {
        (self.steps as f64 * self.dt_s / every_s) as u64 + 1
    }

    /// Time at the end of a step, counted from 1, on the clock of the motions, s; 0 is the start of the motions.
    pub fn at(&self, step: u64) -> f64 {
        self.start_s + step as f64 * self.dt_s
    }

    /// First step that reaches a time, s, counted from 1.
    pub fn step_at(&self, time_s: f64) -> u64 {
        ((time_s - self.start_s) / self.dt_s - REACHED).ceil().max(1.0) as u64
    }
}

/// A scenario ready to run: every file read, every number in its range, the mesh made. [`Observer`](crate::Observer)
/// has an example.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Imaged scene, with the deforming mesh.
    pub scene: Scene,
    /// Mesh in the reference state.
    pub mesh: Arc<TetMesh>,
    /// Tissue, by model.
    pub tissue: TissueSetup,
    /// Needle interaction of each region, ascending.
    pub interactions: Vec<(i32, Interaction)>,
    /// Anatomy along the needle: labels of the volume, or regions of a mesh that was read.
    pub anatomy: Arc<dyn Anatomy>,
    /// Name of each region.
    pub region_names: BTreeMap<i32, String>,
    /// Needle settings.
    pub needle: NeedleSettings,
    /// Seeds to deposit, in order of time.
    pub deposits: Vec<Deposit>,
    /// Template holes that constrain the needle, in order of time.
    pub guides: Vec<Guide>,
    /// Places to be reached.
    pub targets: Vec<Target>,
    /// Images that the probe is to show again.
    pub study: PlanningStudy,
    /// Points whose displacement is reported.
    pub reports: Vec<Reported>,
    /// Motion of the needle guide on the probe, if there is one.
    pub manipulator: Option<Arc<GuideMotion>>,
    /// Times of steps and frames.
    pub timing: Timing,
    /// Time budgets of steps and frames; empty where the scenario states none.
    pub quality: QualitySpec,
    /// Assumptions made, for the user.
    pub notes: Notes,
    /// Suspicious settings, for the user.
    pub warnings: Vec<String>,
    /// Planned motion of the needle.
    pub path: NeedlePath,
    /// Recorded inputs, in place of the motions.
    replayed: Option<Arc<Recording>>,
    /// Source file, for errors that point into it.
    pub file: ScenarioFile,
}

impl Scenario {
    /// Poses of the instruments at the end of a step (counted from 1; 0 before the first).
    pub fn instruments(&self, step: u64) -> Instruments {
        if let Some(input) = self.replayed_at(step) {
            return input.instruments;
        }
        let time_s = self.timing.at(step);
        let deposit = self
            .deposits
            .iter()
            .any(|deposit| self.timing.step_at(deposit.time_s) == step);
        Instruments {
            base: self.needle.base(&self.path.tip().at(time_s)),
            probe: self.contact().map(|contact| self.probe(step) * contact.in_probe),
            guide: self.guide_at(time_s),
            deposit,
        }
    }

    fn guide_at(&self, time_s: f64) -> Option<Point3<f64>> {
        let within = |guide: &&Guide| (guide.during_s[0]..=guide.during_s[1]).contains(&time_s);
        self.guides.iter().find(within).map(|guide| guide.at_mm)
    }

    /// Transform from the image's probe frame to world at the end of a step.
    pub fn probe(&self, step: u64) -> Isometry3<f64> {
        if let Some(view) = self.replayed_at(step).and_then(|input| input.view) {
            return view;
        }
        rigid(&self.scene.probe_path().at(self.timing.at(step)))
    }

    /// Planned path of the needle's tip.
    pub fn needle_tip(&self) -> &Trajectory {
        self.path.tip()
    }

    /// Box of the meshed part of the volume, mm, if the file or the aim of the needle restricts it.
    pub fn meshed_mm(&self) -> Option<[[f64; 3]; 2]> {
        let corners = self.file.tissue.box_mm?;
        let corner = |pick: fn(f64, f64) -> f64| [0, 1, 2].map(|axis| pick(corners[0][axis], corners[1][axis]));
        Some([corner(f64::min), corner(f64::max)])
    }

    /// Regions that are left out of the mesh (`tissue.outside`).
    ///
    /// # Errors
    /// [`InputError`] for a name that no region has.
    pub fn left_out(&self) -> Result<Vec<i32>, InputError> {
        self.file
            .outside(&Regions::new(&self.file, &self.scene, &BTreeMap::new()))
    }

    /// Whether elements are finer along the needle's path, as the file states it.
    pub fn along_path(&self) -> Option<bool> {
        self.file.tissue.along_path
    }

    /// Points that the tip is planned to pass, mm.
    pub fn planned_points(&self) -> Vec<Point3<f64>> {
        let keys = self.path.tip().keys();
        let recorded = self.replayed.iter().flat_map(|recording| &recording.inputs);
        let tip = Point3::new(0.0, 0.0, self.needle.length_mm);
        let recorded = recorded.map(|input| input.instruments.base * tip);
        keys.iter().map(|key| key.pose.position_mm()).chain(recorded).collect()
    }

    fn replayed_at(&self, step: u64) -> Option<&RecordedInput> {
        let inputs = &self.replayed.as_ref()?.inputs;
        inputs.get((step.max(1) - 1) as usize)
    }

    /// State in which the model starts, if the run repeats a recording.
    pub fn start(&self) -> Option<&Saved> {
        self.replayed.as_ref().map(|recording| &recording.start.model)
    }

    /// The scenario with recorded instruments and views in place of its motions, from the recorded state on.
    ///
    /// # Errors
    /// The reason if the recording has no step, or steps of another length than the scenario's.
    pub fn replaying(mut self, recording: Recording) -> Result<Self, String> {
        let dt_s = self.timing.dt_s;
        let different = recording
            .inputs
            .iter()
            .position(|input| (input.dt_s - dt_s).abs() > REACHED * dt_s);
        match different {
            _ if recording.inputs.is_empty() => return Err("no step; expected at least one".to_owned()),
            Some(step) => {
                let dt_of_step = recording.inputs[step].dt_s;
                return Err(format!(
                    "step {step} of {dt_of_step} s; expected {dt_s} s, as the scenario's `run.dt_s`"
                ));
            }
            None => {}
        }
        self.timing.steps = recording.inputs.len() as u64;
        self.keep_level();
        self.manipulator = None;
        self.replayed = Some(Arc::new(recording));
        Ok(self)
    }

    /// The scenario with another path of the needle's tip, and of the probe if given, from the start of the needle's to
    /// its end.
    pub fn moved(&self, tip: Trajectory, probe: Option<Trajectory>) -> Self {
        let mut moved = self.clone();
        moved.timing.start_s = tip.start_s();
        moved.timing.steps = ((tip.end_s() - tip.start_s()) / self.timing.dt_s - REACHED)
            .ceil()
            .max(1.0) as u64;
        moved.path = self.path.with_tip(tip);
        moved.manipulator = None;
        if let Some(probe) = probe {
            moved.scene.move_probe(probe);
        }
        moved
    }

    /// Whether a region is skin.
    pub fn is_skin(&self, region: i32) -> bool {
        let anatomy = &self.scene.anatomy;
        let labels = anatomy.volume.labels().iter();
        let label_index = labels.clone().position(|label| label.value == i64::from(region));
        let tissue = label_index.map(|label_index| anatomy.tissues.tissue(label_index as u8).name.as_ref());
        tissue == Some("skin") || self.region_name(region) == "skin"
    }

    /// Name of a region.
    pub fn region_name(&self, region: i32) -> &str {
        self.region_names.get(&region).map_or("", String::as_str)
    }
}

impl ScenarioFile {
    /// Reads or generates everything that the scenario names, including the mesh, and checks it. Relative paths start
    /// at `base_dir`, the folder of the file. `progress` receives the completed fraction of mesh generation.
    ///
    /// # Errors
    /// [`InputError`] with the key and its place in the file.
    pub fn resolve(&self, base_dir: &Path, mut progress: impl FnMut(f32)) -> Result<Scenario, InputError> {
        self.resolved(base_dir, &mut progress)
    }

    fn resolved(&self, base_dir: &Path, progress: &mut dyn FnMut(f32)) -> Result<Scenario, InputError> {
        self.in_ranges("quality", self.quality.as_ref())?;
        self.in_ranges("run", &self.run)?;
        self.check_tissue()?;
        let needle = self.needle_settings()?;
        self.in_ranges("tissue", &self.tissue)?;
        self.motion_key()?;
        let mut targets = self.targets()?;
        let (mut scene, Moving { deposits, guides, .. }, aim) = self.scene_with(&needle, base_dir)?;
        // A needle that is aimed needs no more tissue than lies around its path.
        let file = aim.as_ref().map_or_else(|| self.clone(), |aim| self.boxed(aim));
        targets.extend(aim.map(|super::aim::Aim { name, tip: at_mm, .. }| Target {
            name,
            at_mm,
            radius_mm: 0.0,
        }));
        let still = || self.wrong_keys("needle", "a needle that does not move", "one that does");
        let path = scene.needle_path().cloned().ok_or_else(still)?;
        let timing = self.timing(&scene, &path)?;
        let study = self.planning_study(&scene)?;
        let manipulator = self.guided(path.tip(), scene.probe_path())?;
        self.check_deposits(&deposits, &timing)?;
        let (mut notes, mut warnings) = (std::mem::take(&mut scene.notes), std::mem::take(&mut scene.warnings));
        notes.extend(self.source.iter().flat_map(|source| source.renamed()));
        clearance::tell(&scene, path.tip(), &mut notes, &mut warnings);
        let insertion = Insertion {
            scene: &scene,
            base_dir,
            needle: &needle,
            path: path.tip(),
            timing: &timing,
        };
        let tissue = file.tissue_of(&insertion, progress, &mut notes, &mut warnings)?;
        let from_file = file.tissue.mesh.is_some();
        warnings.extend(unmeshed(&scene, path.tip(), tissue.anatomy.as_ref(), from_file));
        tissue.warn(&mut warnings);
        scene.anatomy.mesh = Some(Arc::clone(&tissue.mesh));
        Ok(Scenario {
            path: self.through_guide(path, manipulator.as_ref(), scene.probe_path())?,
            manipulator: manipulator.map(Arc::new),
            reports: file.reports(&tissue.mesh)?,
            mesh: tissue.mesh,
            tissue: tissue.setup,
            interactions: tissue.interactions,
            anatomy: tissue.anatomy,
            region_names: tissue.region_names,
            quality: self.quality(),
            needle,
            deposits,
            guides,
            targets,
            study,
            timing,
            notes,
            warnings,
            replayed: None,
            scene,
            file,
        })
    }

    /// Checks that each seed is deposited within the run, in a step of its own.
    fn check_deposits(&self, deposits: &[Deposit], timing: &Timing) -> Result<(), InputError> {
        if let Some(index) = deposits.iter().position(|deposit| !self.during(timing, deposit.time_s)) {
            let key = if self.needle_table()?.deposit_s.is_empty() {
                "plan.needle"
            } else {
                "needle.deposit_s"
            };
            let found = format!("a seed at {} s", deposits[index].time_s);
            return Err(self.wrong_keys(
                key,
                found,
                "times within the run, of which each step leaves one seed at most",
            ));
        }
        if let Some(pair) = deposits
            .windows(2)
            .find(|pair| timing.step_at(pair[0].time_s) == timing.step_at(pair[1].time_s))
        {
            let found = format!("two seeds in one step, at {} s", pair[1].time_s);
            return Err(self.wrong_keys("run.dt_ms", found, "shorter steps, or seeds farther apart"));
        }
        Ok(())
    }

    /// True if a time (s, on the clock of the motions) lies within the run.
    pub(crate) fn during(&self, timing: &Timing, time_s: f64) -> bool {
        time_s >= timing.start_s && timing.step_at(time_s) <= timing.steps
    }

    /// Text of the complete scenario, its scene and the base of its paths: equal texts mean equal scenarios, unless
    /// other files that they name have changed.
    ///
    /// # Errors
    /// [`InputError`] if a scene cannot be read.
    pub fn described(&self, base_dir: &Path) -> Result<String, InputError> {
        let (scene, folder, _) = self.scene_file(base_dir)?;
        Ok(format!("{self:?} {scene:?} {folder:?}"))
    }

    fn timing(&self, scene: &Scene, path: &NeedlePath) -> Result<Timing, InputError> {
        let RunSpec {
            dt_ms,
            duration_s,
            frame_rate_hz,
            ..
        } = self.run;
        let dt_s = dt_ms * 1e-3;
        let (needle, probe) = (path.tip(), scene.probe_path());
        let moves = probe.keys().len() > 1;
        // A probe at rest has a time, but no duration.
        let spans = [(needle, true), (probe, moves)].into_iter().filter(|(_, moves)| *moves);
        let spans: Vec<[f64; 2]> = spans.map(|(path, _)| [path.start_s(), path.end_s()]).collect();
        let start_s = spans.iter().map(|span| span[0]).fold(f64::INFINITY, f64::min);
        let end_s = spans.iter().map(|span| span[1]).fold(f64::NEG_INFINITY, f64::max);
        let duration = duration_s.unwrap_or(end_s - start_s);
        let key = if duration_s.is_some() { "run.duration_s" } else { "run" };
        let range = |x: f64| x > 0.0 && x <= MAX_STEPS * dt_s;
        let expected = "a duration above 0 s, of at most 1e7 steps";
        let duration = self.number(key, duration, range, expected)?;
        Ok(Timing {
            start_s,
            dt_s,
            steps: (duration / dt_s - REACHED).ceil().max(1.0) as u64,
            frame_s: 1.0 / frame_rate_hz,
        })
    }
}
