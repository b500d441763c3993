//! Training tasks: random reachable targets in an organ, and sessions of simulated hands on them.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Point3, Vector2, Vector3};
use serde::Serialize;

use super::groups::{Comparison, Session, compare};
use super::hands::{Draw, Hand, InsertionPlan, hand};
use super::{Collector, NAMES, NO_TARGET, Score, unscored};
use crate::StudyError;
use crate::path::unknown;
use insonify::Error;
use insonify::input::scenario::clearance::Surroundings;
use insonify::input::scenario::plan::TargetSpec;
use insonify::input::scenario::{Scenario, ScenarioText};
use insonify::run::{Requests, run};
use insonify_base::parallel;
use insonify_base::random::hash3;
use insonify_base::range::{OutOfRange, check};
use insonify_imaging::scene::NeedleKeyframe;
use insonify_mechanics::needle::across;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::BeamGrid;

/// Maximum number of random targets tried for each task.
const TRIES: usize = 2000;
/// Distance of the tip from the skin at the start, mm.
const APPROACH_MM: f64 = 10.0;
/// Largest turn of the probe from its pose in the scenario, degrees: farther, the array would leave the skin.
const TURN_DEG: f64 = 35.0;
/// Least angle between the needle and the scanline at the target, degrees: below it a shaft reflects away from the
/// array.
const TO_BEAM_DEG: f64 = 30.0;
/// Share of the image at its sides and its lower end in which no target lies.
const MARGIN: f64 = 0.1;
/// Standard deviation of the logarithm of a person's errors within a group.
const PERSON: f64 = 0.25;
/// Groups of the study.
pub const GROUPS: [&str; 3] = ["consultant", "registrar", "student"];

/// Conditions of training tasks.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Conditions {
    /// Organ: a label or tissue, or a part of its name.
    pub organ: String,
    /// Least and largest depth of the target along the needle, mm.
    pub depth_mm: [f64; 2],
    /// Least distance of the path from bone and critical structures, mm.
    pub clearance_mm: f64,
    /// Radius about the scenario's own entry within which entries lie, mm.
    pub window_mm: f64,
    /// Least distance of the target from the border of the organ, mm.
    pub margin_mm: f64,
    /// Radius of the target, mm.
    pub radius_mm: f64,
    /// Seed of the random targets.
    pub seed: u64,
}

/// A training task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Task {
    /// Position of the target, mm.
    pub target_mm: [f64; 3],
    /// Entry on the skin, mm.
    pub entry_mm: [f64; 3],
    /// Length of the path in the body, mm.
    pub depth_mm: f64,
    /// Distance of the nearest bone within 30 mm, mm.
    pub bone_mm: Option<f64>,
    /// Distance of the nearest critical structure within 30 mm, mm.
    pub critical_mm: Option<f64>,
    /// Reference run: time (s), tip (mm) and direction of the needle.
    pub keyframes: Vec<(f64, [f64; 3], [f64; 3])>,
    /// Probe of the reference run: centre of the array (mm), axial and lateral directions; the image shows needle and
    /// target.
    pub probe: [[f64; 3]; 3],
}

impl Conditions {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn check(&self) -> Result<(), OutOfRange> {
        let [low, high] = self.depth_mm;
        check(
            "depth_mm",
            low,
            low > 0.0 && low < high && high <= 500.0,
            "two rising depths above 0, at most 500",
        )?;
        let range =
            |key, value: f64, limit: f64| check(key, value, (0.0..=limit).contains(&value), format!("0 to {limit}"));
        range("clearance_mm", self.clearance_mm, 30.0)?;
        range("window_mm", self.window_mm, 200.0)?;
        range("margin_mm", self.margin_mm, 50.0)?;
        range("radius_mm", self.radius_mm, 50.0)
    }

    /// Finds `count` tasks in the anatomy of a scenario, whose needle enters in the middle of the entry window.
    ///
    /// # Errors
    /// [`OutOfRange`]; [`StudyError::Refused`] if there is no such organ, if the scenario's needle does not enter the
    /// body, or, with the reasons, if targets run out.
    pub fn tasks(&self, scenario: &Scenario, count: usize) -> Result<Vec<Task>, Error> {
        self.check()?;
        let plan = InsertionPlan::of(scenario)?;
        let body = scenario.scene.body();
        let label = body.named(&self.organ).ok_or_else(|| unknown(scenario, &self.organ))?;
        let volume = body.volume;
        let voxels: Vec<usize> = (0..volume.voxels().len())
            .filter(|&voxel| volume.voxels()[voxel] == label)
            .collect();
        let [width, height, _] = volume.size();
        let position = |voxel: usize| {
            let index = [voxel % width, voxel / width % height, voxel / width / height].map(|index| index as f64);
            volume.index_to_world().transform_point(&Point3::from(index))
        };
        // A few hundred voxels of the organ and the rim of the entry window bound the box in which distances are
        // computed.
        let mut corners = vec![plan.entry];
        corners.extend(
            [1.0, -1.0]
                .iter()
                .flat_map(|sign| across(&plan.along).map(|axis| plan.entry + axis * (sign * self.window_mm))),
        );
        corners.extend(
            voxels
                .iter()
                .step_by(1 + voxels.len() / 500)
                .map(|&voxel| position(voxel)),
        );
        let surroundings = Surroundings::new(scenario, &body, &corners);
        let mut draw = Draw::new(self.seed);
        let mut reasons: BTreeMap<&'static str, usize> = BTreeMap::new();
        let mut tasks = Vec::new();
        let mut tried = 0;
        while tasks.len() < count {
            if tried == TRIES * count {
                let mut reasons: Vec<_> = reasons.into_iter().collect();
                reasons.sort_by_key(|(_, number)| std::cmp::Reverse(*number));
                let reasons = reasons
                    .iter()
                    .map(|(reason, number)| format!("{number} because {reason}"));
                return Err(StudyError::refused(format!(
                    "none of {tried} random targets in {} fulfils the conditions: {}",
                    self.organ,
                    reasons.collect::<Vec<_>>().join("; ")
                )));
            }
            tried += 1;
            let target = position(voxels[(draw.uniform() * voxels.len() as f64) as usize]);
            match self.task(scenario, &plan, &surroundings, label, target, &mut draw) {
                Ok(task) => tasks.push(task),
                Err(reason) => *reasons.entry(reason).or_default() += 1,
            }
        }
        Ok(tasks)
    }

    /// A task with a given target and a random entry; the error is the reason of the refusal.
    fn task(
        &self,
        scenario: &Scenario,
        plan: &InsertionPlan,
        surroundings: &Surroundings<'_>,
        label: u8,
        target: Point3<f64>,
        draw: &mut Draw,
    ) -> Result<Task, &'static str> {
        let volume = &scenario.scene.anatomy.volume;
        let is_organ = |point: Point3<f64>| volume.label_index_at(&point) == Some(label);
        let around = (0..27).map(|neighbour| {
            Vector3::from([neighbour % 3, neighbour / 3 % 3, neighbour / 9].map(|n| f64::from(n) - 1.0))
        });
        let mut around = around.filter_map(|side| side.try_normalize(0.5));
        if !around.all(|side| {
            [0.5, 1.0]
                .iter()
                .all(|share| is_organ(target + side * (share * self.margin_mm)))
        }) {
            return Err("the target is near the border of the organ");
        }
        // The root makes entries uniform over the disc.
        let [right, up] = across(&plan.along);
        let (radius, angle) = (
            self.window_mm * draw.uniform().sqrt(),
            std::f64::consts::TAU * draw.uniform(),
        );
        let aside = right * (radius * angle.cos()) + up * (radius * angle.sin());
        let entry =
            skin(scenario, &(plan.entry + aside), &plan.along).ok_or("the skin is not found in the entry window")?;
        let depth = (target - entry).norm();
        if !(self.depth_mm[0]..=self.depth_mm[1]).contains(&depth) {
            return Err("the target is not within the depths");
        }
        if depth + APPROACH_MM > plan.length_mm {
            return Err("the needle is too short");
        }
        let direction = (target - entry) / depth;
        let obstacles = surroundings.obstacles(&[entry, target]);
        if obstacles.leaves || obstacles.gas {
            return Err("the path leaves the body, or meets gas or lung");
        }
        if obstacles.bone_mm < self.clearance_mm {
            return Err("the path passes too near to bone");
        }
        if obstacles.critical_mm < self.clearance_mm {
            return Err("the path passes too near to a critical structure");
        }
        let probe = probe(scenario, &entry, &target)?;
        let travel_s = (depth + APPROACH_MM) / plan.speed_mm_s;
        let start = entry - direction * APPROACH_MM;
        let times = [0.0, travel_s, travel_s + plan.pause_s, 2.0 * travel_s + plan.pause_s];
        let tips = [start, target, target, start];
        Ok(Task {
            target_mm: target.into(),
            entry_mm: entry.into(),
            depth_mm: depth,
            bone_mm: Some(obstacles.bone_mm).filter(|mm| mm.is_finite()),
            critical_mm: Some(obstacles.critical_mm).filter(|mm| mm.is_finite()),
            keyframes: times
                .into_iter()
                .zip(tips)
                .map(|(time_s, tip)| (time_s, tip.into(), direction.into()))
                .collect(),
            probe,
        })
    }
}

/// First point of the body on a line through a point near its skin.
fn skin(scenario: &Scenario, point_near: &Point3<f64>, direction: &Vector3<f64>) -> Option<Point3<f64>> {
    let body = scenario.scene.body();
    let inside = |point: &Point3<f64>| body.label_at(point).is_some();
    let mut points = (-200..=200).map(|step| point_near + direction * (0.25 * f64::from(step)));
    let outside = points.next().filter(|point| !inside(point));
    outside.and_then(|_| points.find(inside))
}

/// Pose of the probe whose image shows entry and target: that of the scenario, turned about the centre of the array.
fn probe(scenario: &Scenario, entry: &Point3<f64>, target: &Point3<f64>) -> Result<[[f64; 3]; 3], &'static str> {
    let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
    let array = pose.position_mm();
    let normal = (target - array)
        .cross(&(entry - array))
        .try_normalize(1e-6)
        .ok_or("array, entry and target lie on a line")?;
    let normal = if normal.dot(&pose.elevational()) < 0.0 {
        -normal
    } else {
        normal
    };
    // The beam's axis as near to that of the scenario as the plane allows.
    let axial = pose.axial().into_inner();
    let axial = (axial - normal * axial.dot(&normal))
        .try_normalize(1e-6)
        .ok_or("the image plane cannot hold the target")?;
    let turned = Pose::from_direction(array, axial, Some(axial.cross(&normal)))
        .map_err(|_| "the image plane cannot hold the target")?;
    let angle = turned.rotation().angle_to(&pose.rotation()).to_degrees();
    if angle > TURN_DEG {
        return Err("the probe would have to be turned too far");
    }
    let target_in_probe = turned.world_to_probe().transform_point(target);
    let grid = BeamGrid::new(&scenario.scene.settings.probe).ok();
    let sampled = grid
        .as_ref()
        .and_then(|grid| grid.to_beam(target_in_probe.x, target_in_probe.y));
    let (Some(grid), Some((line, sample))) = (&grid, sampled) else {
        return Err("the target lies outside the sector");
    };
    let probe = &scenario.scene.settings.probe;
    let share = line / (probe.lines - 1) as f64;
    if !(MARGIN..=1.0 - MARGIN).contains(&share) || sample > (1.0 - MARGIN) * probe.samples as f64 {
        return Err("the target lies at the edge of the image");
    }
    let [near, far] = [0.0, sample].map(|sample| Vector2::from(grid.to_plane(line, sample)));
    let needle = turned.world_to_probe().transform_vector(&(target - entry)).xy();
    if needle.angle(&(far - near)).to_degrees() < TO_BEAM_DEG {
        return Err("the needle runs along the beam, where it is not seen");
    }
    Ok([
        array.into(),
        turned.axial().into_inner().into(),
        turned.lateral().into_inner().into(),
    ])
}

impl Task {
    /// The task as a scenario: the text of `base` with target, probe and reference run replaced.
    ///
    /// # Errors
    /// The reason if `base` is no table with an inline scene.
    pub fn scenario(&self, base: &str, conditions: &Conditions, number: usize) -> Result<String, String> {
        let rounded = |values: [f64; 3]| values.map(|value| (value * 1e4).round() / 1e4 + 0.0);
        let keyframes = self.keyframes.iter().map(|&(time_s, tip, direction)| NeedleKeyframe {
            time_s: (time_s * 1e3).round() / 1e3,
            tip_mm: rounded(tip),
            direction: rounded(direction),
            roll_deg: None,
        });
        let target = TargetSpec {
            name: format!("target {number} in {}", conditions.organ),
            at_mm: rounded(self.target_mm),
            radius_mm: conditions.radius_mm,
        };
        let text = ScenarioText::parse(base)?
            .with_probe(self.probe.map(rounded))?
            .with_needle_path(&keyframes.collect::<Vec<_>>(), &target)?
            .text()?;
        let distance = |mm: Option<f64>| mm.map_or("more than 30".to_owned(), |mm| format!("{mm:.0}"));
        let critical = if text.contains("critical = true") {
            format!("{} mm", distance(self.critical_mm))
        } else {
            "none marked".to_owned()
        };
        Ok(format!(
            "# Training task {number}: from the skin {:.0} mm deep to a target of radius {} mm in {}; distance of bone {} mm, of critical\n\
             # structures: {critical}. The task begins when the needle breaks the skin and ends when it is out again. The keyframes are the reference run.\n\n{text}",
            self.depth_mm,
            conditions.radius_mm,
            conditions.organ,
            distance(self.bone_mm),
        ))
    }
}

/// Runs a scenario as performed by a hand.
///
/// # Errors
/// [`Error`] if the run cannot be made or scored.
pub fn perform(scenario: &Scenario, hand: &Hand, seed: u64) -> Result<Score, Error> {
    if scenario.targets.is_empty() {
        return Err(unscored(Path::new("the task"), NO_TARGET));
    }
    let scenario = hand.perform(scenario, seed)?;
    let mut model = scenario.model(|_, _| ())?;
    let mut collector = Collector::default();
    run(&scenario, model.as_mut(), Requests::default(), &mut collector)?;
    collector.score(Path::new("the session"))
}

/// Study of simulated groups.
#[derive(Clone, Debug, Serialize)]
pub struct GroupStudy {
    /// Seed of the hands.
    pub seed: u64,
    /// Comparison of the groups.
    #[serde(flatten)]
    pub comparison: Comparison,
    /// Every session, with the values of its metrics.
    #[serde(skip)]
    pub sessions: Vec<Session>,
}

/// Lets `people` of each group perform every task once. `progress` receives the number of completed sessions, and of
/// all.
///
/// # Errors
/// The first error of a session.
pub fn study(
    tasks: &[(String, Scenario)],
    people: usize,
    seed: u64,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<GroupStudy, Error> {
    let mut performances = Vec::new();
    for (group, name) in GROUPS.into_iter().enumerate() {
        for person in 0..people {
            for (index, task) in tasks.iter().enumerate() {
                performances.push((name, group, person, index, task));
            }
        }
    }
    let done = AtomicUsize::new(0);
    let sessions =
        parallel::try_map::<_, _, Error>(&performances[..], &|&(name, group, person, index, (task, scenario))| {
            let seeded = |stream: i32| {
                let words = hash3(
                    [group as i32, person as i32, stream],
                    [seed as u32, (seed >> 32) as u32],
                );
                u64::from(words[0]) << 32 | u64::from(words[1])
            };
            let skill = (PERSON * Draw::new(seeded(-1)).normal()).exp();
            let scaled_hand = hand(name)
                .map(|hand| hand.scaled(skill))
                .unwrap_or_else(|| super::hands::HANDS[0].1);
            let score = perform(scenario, &scaled_hand, seeded(index as i32))?;
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, performances.len());
            Ok(Session {
                group: name.to_owned(),
                person: format!("{name} {}", person + 1),
                session: task.clone(),
                // As many digits as the table of sessions has.
                values: score.metrics.0.map(|value| (value * 1e6).round() / 1e6),
            })
        });
    let sessions: Vec<Session> = sessions?;
    Ok(GroupStudy {
        seed,
        comparison: compare(&sessions),
        sessions,
    })
}

/// Sessions as a table that [`super::groups::read`] reads.
pub fn csv(sessions: &[Session]) -> String {
    let mut text = format!("group,person,session,{}\n", NAMES.join(","));
    for session in sessions {
        let values = session.values.map(|value| format!("{value:.6}"));
        text += &format!(
            "{},{},{},{}\n",
            session.group,
            session.person,
            session.session,
            values.join(",")
        );
    }
    text
}
