//! Needles aimed by name: a target, an entry, and the straight path between them.

pub mod place;

use insonify_base::note::Note;
use nalgebra::{Point3, Vector3};

use super::clearance::{Bones, Course};
use super::file::{ScenarioFile, SceneSource};
use super::instruments::{BESIDE, EntrySpec};
use super::needle::NeedleSettings;
use insonify_base::document::{InputError, Names, NoRegion, RegionName, Setting};
use insonify_imaging::scene::{Body, NeedleKeyframe, Scene};
use insonify_tracking::placement::aims;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::Site;
use place::{array_end_mm, innermost, skin};

/// Range of tried distances of an entry from the end of the array, mm.
const OFFSETS_MM: [f64; 2] = [10.0, 60.0];
const OFFSET_STEP_MM: f64 = 5.0;
/// Minimum distance of a selected path from bone, mm.
const CLEAR_MM: f64 = 3.0;
/// Largest distance from the skin at which a stated entry is used unchanged, mm.
const ON_SKIN_MM: f64 = 3.0;
/// Step of the search for the skin, mm.
const SKIN_STEP_MM: f64 = 0.25;
/// Initial distance of the tip from the entry, mm.
const APPROACH_MM: f64 = 10.0;
/// Margin of the mesh's box around the path, mm.
const AROUND_MM: f64 = 30.0;

/// A straight path from an entry to a target.
pub struct Aim {
    /// Name of the target.
    pub name: String,
    /// Final position of the tip, mm.
    pub tip: Point3<f64>,
    /// Initial position of the tip, mm.
    start: Point3<f64>,
    direction: Vector3<f64>,
    /// Description of the choice, for the user.
    note: Note,
    /// Warnings, for the user.
    pub warnings: Vec<String>,
    /// Whether the body breathes, which takes tissue far from the path along.
    breathes: bool,
}

/// An entry with its path to the target.
#[derive(Clone)]
struct Candidate {
    entry: Point3<f64>,
    /// Distance from the end of the array, mm, and name of that end; `None` for a stated entry.
    beside: Option<(f64, &'static str)>,
    depth_mm: f64,
    course: Course,
}

/// The target: name of its label, a point in it, and whether that is in view.
struct Goal {
    name: String,
    tip: Point3<f64>,
    in_view: bool,
}

impl ScenarioFile {
    /// Returns the path of a needle that is aimed by name.
    pub(crate) fn aim(&self, scene: &Scene, needle: &NeedleSettings, breathes: bool) -> Result<Aim, InputError> {
        let body = scene.body();
        let pose = scene.probe_path().at(scene.probe_path().start_s());
        let goal = self.goal(scene, &pose)?;
        let mut warnings = Vec::new();
        if !goal.in_view {
            warnings.push(format!(
                "needle.target: {} is not in view, and the needle leaves the image plane (`scene.pose.target` places the probe over it)",
                goal.name
            ));
        }
        let chosen = match &self.needle_table()?.entry {
            Some(EntrySpec::At(entry)) => self.stated(&body, &goal, *entry, needle, &mut warnings)?,
            Some(EntrySpec::Named(other)) if other != BESIDE => {
                let expected = format!("\"{BESIDE}\" or a point [x, y, z] on the skin, mm");
                return Err(self.wrong_keys("needle.entry", format!("\"{other}\""), expected));
            }
            _ => self.beside(scene, &pose, &goal, needle)?,
        };
        let Goal { name, tip, in_view } = goal;
        // Rounded as a file states them. The start lies on the rounded direction through the tip, so that the
        // needle still ends at the target, and rounding moves its entry instead.
        let direction = ((tip - chosen.entry) / chosen.depth_mm * 1e5).map(f64::round) / 1e5;
        let start = hundredths(&(tip - direction * (chosen.depth_mm + APPROACH_MM)));
        let side_in_words = chosen.beside.map_or(String::new(), |(offset, side)| {
            format!(", {offset:.0} mm from the {side} end of the array,")
        });
        let point = |point: &Point3<f64>| format!("({:.1}, {:.1}, {:.1}) mm", point.x, point.y, point.z);
        let aimed_at = if in_view {
            "its innermost point in view"
        } else {
            "its middle"
        };
        let note = Note::new(
            format_args!(
                "needle: {:.0} mm deep{side_in_words} to {aimed_at} of {name}, at {:.0} degrees to the beam",
                chosen.depth_mm,
                direction.angle(&pose.axial()).to_degrees(),
            ),
            format_args!(
                "from the skin at {} to {}; on the way {}",
                point(&chosen.entry),
                point(&tip),
                chosen.course.layers_in_words(&body)
            ),
        );
        Ok(Aim {
            name,
            tip,
            start,
            direction,
            note,
            warnings,
            breathes,
        })
    }

    /// Describes the choice in words, and as the equivalent lines of a scenario.
    pub(crate) fn aimed_in_words(&self, aim: &Aim, pace: [f64; 3]) -> [Note; 2] {
        let file = self.boxed(aim);
        let mut lines = String::new();
        // A scenario without a file was made from options: here it is in full, and its keys are dotted.
        let is_file = self.source.as_ref().is_some_and(|source| source.is_file());
        let mut keys = ["[tissue]\nbox_mm", "[needle.motion]\nkeyframes"];
        if let (false, Some(SceneSource::Inline(scene))) = (is_file, &self.scene)
            && let Some(path) = scene.volume.as_ref().and_then(|volume| volume.file.as_ref())
        {
            keys = ["tissue.box_mm", "needle.motion.keyframes"];
            let stated = [
                Setting::new("version", 2),
                Setting::new("scene.volume.file", path.display().to_string()),
                Setting::new("scene.pose.target", aim.name.as_str()),
            ];
            let told = [
                "version",
                "scene.volume.file",
                "scene.pose.target",
                keys[0],
                "needle.target",
                "needle.entry",
            ];
            let set = self.source.iter().flat_map(|source| source.settings());
            let set = set.filter(|setting| told.iter().all(|key| !setting.concerns(key)));
            stated
                .iter()
                .chain(set)
                .for_each(|setting| lines += &(setting.line() + "\n"));
        }
        if let Some(corners) = file.tissue.box_mm {
            lines += &format!("{} = {corners:?}\n", keys[0]);
        }
        lines += &format!("{} = [\n", keys[1]);
        for key in aim.keyframes(pace) {
            let (time_s, tip, direction) = (key.time_s, key.tip_mm, key.direction);
            lines += &format!("  {{ time_s = {time_s:?}, tip_mm = {tip:?}, direction = {direction:?} }},\n");
        }
        [
            aim.note.clone(),
            Note::new(
                "the needle's way can be stated as lines of a scenario",
                format_args!("as lines of a scenario:\n{lines}]"),
            ),
        ]
    }

    /// Returns the scenario with the mesh restricted to a box around the path, unless it states a box.
    pub(crate) fn boxed(&self, aim: &Aim) -> Self {
        let mut file = self.clone();
        if file.tissue.mesh.is_none() && file.tissue.model.is_meshed() {
            file.tissue.box_mm.get_or_insert(aim.box_mm());
        }
        file
    }

    /// Finds the label of the target and a point in it.
    fn goal(&self, scene: &Scene, pose: &Pose) -> Result<Goal, InputError> {
        let (body, target) = (scene.body(), self.needle_table()?.target.clone().unwrap_or_default());
        let label = body.named(&target).ok_or_else(|| {
            let known = Names::new(body.entries()).known();
            let found = RegionName::Name(target.clone());
            let error = NoRegion::Unknown { found, known };
            let help = error.help();
            self.fault("needle.target", error).with_help(help)
        })?;
        let (tip, in_view) = middle(scene, pose, label).ok_or_else(|| {
            let found = format!("{target}, of which the volume has no voxel");
            self.wrong_keys("needle.target", found, "a label that is in the volume")
        })?;
        Ok(Goal {
            name: body.name(label),
            tip,
            in_view,
        })
    }

    /// Returns a stated entry; one off the skin is moved onto it along the line to the target, with a warning.
    fn stated(
        &self,
        body: &Body<'_>,
        goal: &Goal,
        entry: [f64; 3],
        needle: &NeedleSettings,
        warnings: &mut Vec<String>,
    ) -> Result<Candidate, InputError> {
        let stated = self.place("needle.entry", entry)?;
        let away = stated - goal.tip;
        let refused = |what: &str| format!("an entry {:.0} mm from {}{what}", away.norm(), goal.name);
        let reach = needle.length_mm - APPROACH_MM;
        let expected = format!(
            "1 to {reach:.0} mm, of a needle of {} mm (`length_mm`)",
            needle.length_mm
        );
        if away.norm() < 1.0 {
            return Err(self.wrong_keys("needle.entry", refused(""), expected));
        }
        let outward = away.normalize();
        let is_inside = |mm: f64| body.label_at(&(goal.tip + outward * mm)).is_some();
        // Outwards from a point in the body, towards the target from one outside. A line that reaches the
        // target without meeting the body leaves a depth of 0, which is refused below.
        let step = if is_inside(away.norm()) {
            SKIN_STEP_MM
        } else {
            -SKIN_STEP_MM
        };
        let from_stated = (0..).map(|index| away.norm() + step * f64::from(index));
        let mut distances_mm = from_stated.take_while(|mm| *mm >= 0.0);
        let skin = distances_mm.find(|mm| is_inside(*mm) != (step > 0.0)).unwrap_or(0.0);
        let moved = (skin - away.norm()).abs();
        let (entry, depth_mm) = if moved > ON_SKIN_MM {
            (goal.tip + outward * skin, skin)
        } else {
            (stated, away.norm())
        };
        if !(1.0..=reach).contains(&depth_mm) {
            let skin = format!(", on whose line the skin is {skin:.0} mm from it");
            let refused = refused(if moved > ON_SKIN_MM { &skin } else { "" });
            return Err(self.wrong_keys("needle.entry", refused, expected));
        }
        if moved > ON_SKIN_MM {
            let side = if step > 0.0 { "inside" } else { "outside" };
            warnings.push(format!(
                "needle.entry: the stated point lies {moved:.0} mm {side} the skin; the needle enters where its line meets the skin"
            ));
        }
        Ok(Candidate {
            course: Bones::around(body, &[entry, goal.tip]).course(&[entry, goal.tip]),
            beside: None,
            entry,
            depth_mm,
        })
    }

    /// Returns an entry in the image plane beside the array: the nearest to it from which a straight path to the target
    /// keeps [`CLEAR_MM`] from bone and meets no gas or lung; among equally near ones, that with the shorter path. If
    /// all paths meet gas or lung, they are allowed to.
    fn beside(
        &self,
        scene: &Scene,
        pose: &Pose,
        goal: &Goal,
        needle: &NeedleSettings,
    ) -> Result<Candidate, InputError> {
        let (body, probe) = (scene.body(), &scene.settings.probe);
        if probe.shape.kind().site() != Site::Skin {
            let found = format!("\"{BESIDE}\" of a probe that lies inside the body");
            return Err(self.wrong_keys("needle.entry", found, "a point [x, y, z] on the skin, mm"));
        }
        let end = array_end_mm(scene);
        let offsets = (0..).map(|index| OFFSETS_MM[0] + OFFSET_STEP_MM * f64::from(index));
        let sides = [(1.0, "marked"), (-1.0, "unmarked")];
        let places = offsets
            .take_while(|offset| *offset <= OFFSETS_MM[1])
            .flat_map(|offset| sides.map(|(sign, side)| (sign * (end + offset), (offset, side))));
        let entries: Vec<_> = places
            .filter_map(|(lateral, beside)| Some((skin(&body, pose, lateral, probe.depth_mm)?, beside)))
            .collect();
        // The distances from bone are mapped once for all entries, in a box around them and the target.
        let ends: Vec<_> = entries.iter().map(|(entry, _)| *entry).chain([goal.tip]).collect();
        let bones = Bones::around(&body, &ends);
        let candidates: Vec<Candidate> = entries
            .into_iter()
            .map(|(entry, beside)| Candidate {
                entry,
                beside: Some(beside),
                depth_mm: (goal.tip - entry).norm(),
                course: bones.course(&[entry, goal.tip]),
            })
            .filter(|candidate| candidate.depth_mm + APPROACH_MM <= needle.length_mm && !candidate.course.leaves())
            .collect();
        let clear = |candidate: &&Candidate| candidate.course.nearest.is_none_or(|(_, away)| away >= CLEAR_MM);
        let near = |a: &&Candidate, b: &&Candidate| {
            let key = |candidate: &Candidate| [candidate.beside.map_or(0.0, |(offset, _)| offset), candidate.depth_mm];
            let ([offset, depth], [farther, deeper]) = (key(a), key(b));
            offset.total_cmp(&farther).then(depth.total_cmp(&deeper))
        };
        // Distance from bone, which stops a needle, is never given up; a target in lung has lung on any path.
        let clear = candidates.iter().filter(clear);
        let without_gas = clear
            .clone()
            .filter(|candidate| candidate.course.gas.is_none())
            .min_by(near);
        let chosen = without_gas.or_else(|| clear.min_by(near)).cloned();
        chosen.ok_or_else(|| self.no_path_error(&body, goal, needle, &candidates))
    }

    fn no_path_error(
        &self,
        body: &Body<'_>,
        goal: &Goal,
        needle: &NeedleSettings,
        candidates: &[Candidate],
    ) -> InputError {
        let target = body.volume.label_index_at(&goal.tip);
        if target.is_some_and(|label| body.is_bone(label)) {
            let found = format!("{}, which is bone", goal.name);
            let expected = "a target in soft tissue, or `needle.entry` as a point [x, y, z] on the skin for a path that ends at bone";
            return self.wrong_keys("needle.target", found, expected);
        }
        let passed = candidates.iter().filter_map(|candidate| candidate.course.nearest);
        let found = match passed.max_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((label, away)) => format!(
                "no straight path from beside the probe to {} that keeps {CLEAR_MM} mm from bone; the best passes {} at {away:.1} mm",
                goal.name,
                body.name(label)
            ),
            None => format!(
                "no skin beside the probe from which a needle of {} mm reaches {} without leaving the body",
                needle.length_mm, goal.name
            ),
        };
        let expected = "`needle.entry` as a point [x, y, z] on the skin, another `scene.pose`, or a longer needle";
        self.wrong_keys("needle.entry", found, expected)
    }
}

impl Aim {
    /// Motion to the target and back: start (s), speed (mm/s) and pause at the target (s).
    pub(crate) fn keyframes(&self, [start_s, speed_mm_s, pause_s]: [f64; 3]) -> Vec<NeedleKeyframe> {
        let travel_s = (self.tip - self.start).norm() / speed_mm_s;
        let back_s = start_s + travel_s + pause_s;
        let frame = |(time_s, tip): (f64, Point3<f64>)| NeedleKeyframe {
            time_s: (time_s * 1e3).round() / 1e3,
            tip_mm: tip.into(),
            direction: self.direction.into(),
            roll_deg: None,
        };
        let times = [start_s, start_s + travel_s, back_s, back_s + travel_s];
        times
            .into_iter()
            .zip([self.start, self.tip, self.tip, self.start])
            .map(frame)
            .collect()
    }

    /// Box around the path for the mesh, mm: all of a volume that breathes.
    fn box_mm(&self) -> [[f64; 3]; 2] {
        if self.breathes {
            return [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
        }
        box_around(&[self.start, self.tip])
    }
}

/// Box of the mesh around the ways of straight needles, from the tips at the start on, mm.
pub fn box_around(tips: &[Point3<f64>]) -> [[f64; 3]; 2] {
    let along = |axis: usize| tips.iter().map(move |tip| tip[axis]);
    let [low, high] = [f64::INFINITY, f64::NEG_INFINITY];
    [
        [0, 1, 2].map(|axis| (along(axis).fold(low, f64::min) - AROUND_MM).floor()),
        [0, 1, 2].map(|axis| (along(axis).fold(high, f64::max) + AROUND_MM).ceil()),
    ]
}

/// Innermost point of a label in the image, or else in the volume, to 0.01 mm, and whether it is in the image; `None`
/// for a label without voxels.
pub fn middle(scene: &Scene, pose: &Pose, label: u8) -> Option<(Point3<f64>, bool)> {
    let in_view = innermost(scene, pose, label);
    let anywhere = || aims(&scene.anatomy.volume, &[label]).and_then(|aims| aims.first().copied());
    Some((hundredths(&in_view.or_else(anywhere)?), in_view.is_some()))
}

/// Rounds a point to 0.01 mm, as written in a file.
fn hundredths(point: &Point3<f64>) -> Point3<f64> {
    point.map(|x| (x * 100.0).round() / 100.0)
}
