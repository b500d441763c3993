//! Lines to a target: from the places where needles may enter, without those that lead too near to what must not be
//! hit.

use nalgebra::{Point3, Vector3};

use super::correct::{Fault, correct};
use super::insertion::{APPROACH_MM, Course};
use super::{Candidate, Entry, PathOptions, guide, no_path, pixel, unknown};
use crate::StudyError;
use insonify::Error;
use insonify::input::scenario::Scenario;
use insonify::input::scenario::aim::box_around;
use insonify::input::scenario::aim::place::array_end_mm;
use insonify::input::scenario::clearance::Surroundings;
use insonify_anatomy::volume::{Label, LabelVolume};
use insonify_base::document::{Names, RegionName};
use insonify_imaging::scene::Body;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::Site;

/// Step of the search for the skin, mm.
const SKIN_MM: f64 = 0.25;
/// Distance from the centre of a voxel of the skin from which on a needle is tried against the voxels before it, in
/// voxels: nearer, the steps between voxels are in its way.
const STEPS: f64 = 3.0;
/// Angles of entries in the image plane to the beam by default, degrees.
const ANGLES_DEG: [f64; 2] = [-60.0, 60.0];
/// Distance that needles keep from the probe, and half its thickness, mm.
const PROBE_MM: [f64; 2] = [5.0, 10.0];
/// Length of a needle before the skin that is kept from the probe, mm.
const BEFORE_MM: f64 = 60.0;
/// Largest distance of a target from the image plane in which it counts as lying, mm.
const IN_PLANE_MM: f64 = 0.05;

const BEFORE: &str = "the needle before the entry would lie in tissue";
const CAVITY: &str = "the entry is the wall of a cavity";
const TOO_SHORT: &str = "the needle is too short";
const AT_PROBE: &str = "the needle would run into the probe";
const UNMESHED: &str = "the line leaves the tissue that is simulated, `tissue.box_mm`";
const LEAVES: &str = "the line leaves the body";
const GAS: &str = "the line meets gas or lung";
const BONE: &str = "too near to bone";
const CRITICAL: &str = "too near to a critical structure";
pub(crate) const DEFORMED_BONE: &str = "too near to bone as the tissue deforms";
const DEFORMED_CRITICAL: &str = "too near to a critical structure as the tissue deforms";

/// A direction to the target, with its entry or the reason why there is none.
pub(super) struct Line {
    along: Vector3<f64>,
    entry: Result<Skin, &'static str>,
}

#[cfg(test)]
impl Line {
    pub(super) fn entry_mm(&self) -> Option<[f64; 3]> {
        self.entry.ok().map(|skin| skin.entry.into())
    }
}

/// Place where a line enters the body.
#[derive(Clone, Copy)]
struct Skin {
    entry: Point3<f64>,
    /// Whether the volume ends there.
    at_end: bool,
}

fn wrong_target(fault: &str, expected: &str) -> Error {
    StudyError::refused(format!("the target {fault}; expected {expected}"))
}

/// Refuses a target outside the body, in bone or in a critical structure.
pub(super) fn permitted(scenario: &Scenario, name: &str, target: &Point3<f64>) -> Result<(), Error> {
    let body = scenario.scene.body();
    let position = format!("({:.1}, {:.1}, {:.1}) mm", target.x, target.y, target.z);
    let refuse = |fault: String| {
        let fault = match name {
            "the target" => format!("at {position} {fault}"),
            name => format!("\"{name}\" at {position} {fault}"),
        };
        let expected = "a point of soft tissue within the body, in LPS millimetres, or the name of a label";
        Err(wrong_target(&fault, expected))
    };
    let Some(label) = body.label_at(target) else {
        return refuse("lies outside the body".to_owned());
    };
    if body.is_bone(label) {
        return refuse(format!("lies in bone ({})", body.name(label)));
    }
    let value = body.volume.labels()[usize::from(label)].value;
    let is_critical = |(region, interaction): &(i32, insonify_mechanics::insertion::Interaction)| {
        i64::from(*region) == value && interaction.critical
    };
    if scenario.interactions.iter().any(is_critical) {
        refuse(format!("lies in {}, which is marked `critical`", body.name(label)))
    } else {
        Ok(())
    }
}

/// Refuses a target outside the image plane.
pub(super) fn in_plane(scenario: &Scenario, target: &Point3<f64>) -> Result<(), Error> {
    let pose = scenario.scene.probe_path().at(scenario.timing.start_s);
    let aside_mm = pose.world_to_probe().transform_point(target).z;
    if aside_mm.abs() <= IN_PLANE_MM {
        Ok(())
    } else {
        Err(wrong_target(
            &format!("lies {:.1} mm beside the image plane", aside_mm.abs()),
            "a target in the plane of a model of two dimensions",
        ))
    }
}

/// Axes of the faces across each axis of a volume.
const ACROSS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// The voxels of the first or last face of a volume on an axis whose air reaches the rim of the face.
fn open(volume: &LabelVolume, is_tissue: &[bool], axis: usize, is_last: bool) -> Vec<bool> {
    let (size, [u, v]) = (volume.size(), ACROSS[axis]);
    let is_air = |[i, j]: [usize; 2]| {
        let mut index = [0; 3];
        (index[u], index[v]) = (i, j);
        index[axis] = if is_last { size[axis] - 1 } else { 0 };
        !is_tissue[usize::from(volume.voxels()[volume.offset(index)])]
    };
    let ends = |count: usize| [0, count - 1];
    let rows = (0..size[v]).flat_map(|j| ends(size[u]).map(|i| [i, j]));
    let mut next: Vec<[usize; 2]> = rows
        .chain((0..size[u]).flat_map(|i| ends(size[v]).map(|j| [i, j])))
        .collect();
    let mut open = vec![false; size[u] * size[v]];
    while let Some([i, j]) = next.pop() {
        if i >= size[u] || j >= size[v] || open[j * size[u] + i] || !is_air([i, j]) {
            continue;
        }
        open[j * size[u] + i] = true;
        next.extend([[i + 1, j], [i, j + 1], [i.wrapping_sub(1), j], [i, j.wrapping_sub(1)]]);
    }
    open
}

/// Lines to one target and what surrounds them.
pub(super) struct Entries<'a> {
    scenario: &'a Scenario,
    body: Body<'a>,
    pose: Pose,
    options: &'a PathOptions,
    speed_mm_s: f64,
    /// Whether a needle meets the tissue of each label.
    is_tissue: Vec<bool>,
    /// Voxels of both faces of the volume on each axis whose air reaches the rim of the face: it is that around the body,
    /// not that of a cavity which the volume cuts.
    open: [[Vec<bool>; 2]; 3],
    pub target: Point3<f64>,
}

impl<'a> Entries<'a> {
    pub(super) fn new(
        scenario: &'a Scenario,
        target: Point3<f64>,
        options: &'a PathOptions,
        speed_mm_s: f64,
    ) -> Result<Self, Error> {
        if options.section_mm.is_some() && !matches!(options.entry, Entry::Plane(_) | Entry::Pixel(_)) {
            let wrong = "in a model of two dimensions with entries outside the image plane";
            return Err(wrong_target(wrong, "entries in the plane: `plane`, with `--angles`"));
        }
        let (body, left_out) = (scenario.scene.body(), scenario.left_out()?);
        let is_tissue = |(label, entry): (u8, &Label)| {
            label > 0 && !body.is_outside(label) && !left_out.iter().any(|region| i64::from(*region) == entry.value)
        };
        let is_tissue: Vec<bool> = (0..=u8::MAX).zip(body.volume.labels()).map(is_tissue).collect();
        let open = [0, 1, 2].map(|axis| [false, true].map(|is_last| open(body.volume, &is_tissue, axis, is_last)));
        Ok(Self {
            scenario,
            body,
            pose: scenario.scene.probe_path().at(scenario.timing.start_s),
            options,
            speed_mm_s,
            is_tissue,
            open,
            target,
        })
    }

    /// The lines, in the order of their angles, or from the entry nearest to the target on.
    pub(super) fn lines(&self) -> Result<Vec<Line>, Error> {
        let directions: Vec<Vector3<f64>> = match &self.options.entry {
            Entry::Plane(angles_deg) => {
                let [low, high] = angles_deg
                    .or_else(|| guide::angles_deg(self.scenario, &self.target))
                    .unwrap_or(ANGLES_DEG);
                let intervals = (self.options.lines - 1).max(1) as f64;
                let angles = (0..self.options.lines).map(|index| low + (high - low) * index as f64 / intervals);
                let [lateral, axial] = [self.pose.lateral().into_inner(), self.pose.axial().into_inner()];
                angles
                    .map(|deg| lateral * deg.to_radians().sin() + axial * deg.to_radians().cos())
                    .collect()
            }
            Entry::Pixel(at_px) => {
                let along = self.target - pixel(self.scenario, *at_px)?;
                let expected = "another pixel, on the way of the needle before the target";
                let along = along.try_normalize(1e-6);
                vec![along.ok_or_else(|| wrong_target("is at the pixel of the entry", expected))?]
            }
            Entry::Box(corners) => {
                let in_box = |point: &Point3<f64>| {
                    let sides = |axis: usize| [corners[0][axis], corners[1][axis]];
                    (0..3).all(|axis| {
                        let [a, b] = sides(axis);
                        (a.min(b)..=a.max(b)).contains(&point[axis])
                    })
                };
                self.spread(self.surface(|_, point| in_box(point)), "the box of entries")?
            }
            Entry::Named(name) => {
                let wanted = Names::new(self.body.entries()).all(&RegionName::Name(name.clone()));
                if wanted.is_empty() {
                    return Err(unknown(self.scenario, name));
                }
                self.spread(self.surface(|label, _| wanted.contains(&label)), name)?
            }
        };
        let line = |direction: Vector3<f64>| Line {
            along: direction,
            entry: self.skin(&direction),
        };
        Ok(directions.into_iter().map(line).collect())
    }

    /// Voxels of the body beside air, or at the end of the volume, for which `wanted` holds, within the needle's reach
    /// and free of tissue behind a needle that enters there, mm.
    fn surface(&self, wanted: impl Fn(u8, &Point3<f64>) -> bool) -> Vec<Point3<f64>> {
        let volume = self.body.volume;
        let size = volume.size();
        let is_body = |label: u8| self.is_tissue[usize::from(label)];
        let reach = self.scenario.needle.length_mm - APPROACH_MM;
        // Beyond the volume, the index of a voxel before the first wraps round to one after the last.
        let beside = |[i, j, k]: [usize; 3]| {
            let [before, after] = [usize::wrapping_sub, usize::wrapping_add]
                .map(|step| [[step(i, 1), j, k], [i, step(j, 1), k], [i, j, step(k, 1)]]);
            before.into_iter().chain(after)
        };
        let is_inside = |index: [usize; 3]| {
            (0..3).all(|axis| index[axis] < size[axis]) && is_body(volume.voxels()[volume.offset(index)])
        };
        let mut surface = Vec::new();
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    let label = volume.voxels()[volume.offset([i, j, k])];
                    if !is_body(label) || beside([i, j, k]).all(is_inside) {
                        continue;
                    }
                    let index = Point3::new(i as f64, j as f64, k as f64);
                    let point = volume.index_to_world().transform_point(&index);
                    if (point - self.target).norm() <= reach && wanted(label, &point) && self.is_free(&point) {
                        surface.push(point);
                    }
                }
            }
        }
        surface
    }

    /// Whether the voxels behind a needle that enters at the centre of a voxel, up to its base, are free of tissue.
    fn is_free(&self, entry: &Point3<f64>) -> bool {
        let outward = (entry - self.target).try_normalize(1e-6).unwrap_or(Vector3::zeros());
        let voxel_mm = self.body.volume.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        let steps = ((self.scenario.needle.length_mm + APPROACH_MM) / voxel_mm) as usize;
        let behind = (STEPS as usize..=steps).map(|step| entry + outward * (step as f64 * voxel_mm));
        let meets = |point: &Point3<f64>| Some(self.is_tissue[usize::from(self.body.volume.label_index_at(point)?)]);
        self.no_skin(behind, meets).is_none()
    }

    /// Whether a needle meets tissue at a point, with the smooth borders of the labels that it meets in an insertion;
    /// `None` beyond the volume.
    fn meets_tissue(&self, point: &Point3<f64>) -> Option<bool> {
        let label = self
            .body
            .volume
            .smoothed_label_at(point, |label| self.is_tissue[usize::from(label)])?;
        Some(self.is_tissue[usize::from(label)])
    }

    /// Reason why a straight course does not enter by the skin, by what lies behind its entry up to the needle's base
    /// at the start.
    fn no_skin_behind(&self, course: &Course) -> Option<&'static str> {
        let behind_mm = self.scenario.needle.length_mm + course.approach_mm(self.scenario);
        let behind = (1..=(behind_mm / SKIN_MM) as usize).map(|step| course.at_depth(-(step as f64) * SKIN_MM));
        self.no_skin(behind, |point| self.meets_tissue(point))
    }

    /// Reason why points outwards from an entry do not lie outside the body; `meets` says whether there is tissue,
    /// `None` beyond the volume.
    fn no_skin(
        &self,
        behind: impl Iterator<Item = Point3<f64>>,
        meets: impl Fn(&Point3<f64>) -> Option<bool>,
    ) -> Option<&'static str> {
        let mut last = None;
        for point in behind {
            match meets(&point) {
                Some(true) => return Some(BEFORE),
                Some(false) => last = Some(point),
                None => return last.filter(|last| !self.opens(last)).map(|_| CAVITY),
            }
        }
        None
    }

    /// Whether the air at a point beside the end of the volume is that around the body.
    fn opens(&self, point: &Point3<f64>) -> bool {
        let volume = self.body.volume;
        let (size, index) = (volume.size(), volume.world_to_index().transform_point(point));
        let to_end = |axis: usize| (index[axis], size[axis] as f64 - 1.0 - index[axis]);
        let near = |axis: usize| to_end(axis).0.min(to_end(axis).1);
        let axis = (0..3).min_by(|a, b| near(*a).total_cmp(&near(*b))).unwrap_or(0);
        let [u, v] = ACROSS[axis].map(|across| (index[across].round().max(0.0) as usize).min(size[across] - 1));
        let is_last = to_end(axis).1 < to_end(axis).0;
        self.open[axis][usize::from(is_last)][v * size[ACROSS[axis][0]] + u]
    }

    /// Directions from entries spread evenly: the nearest to the target first, then each the farthest from those before
    /// it.
    fn spread(&self, points: Vec<Point3<f64>>, region_name: &str) -> Result<Vec<Vector3<f64>>, Error> {
        let nearest = points
            .iter()
            .min_by(|a, b| (*a - self.target).norm().total_cmp(&(*b - self.target).norm()));
        let Some(mut next) = nearest.copied() else {
            let reasons = format!("none is left: no skin in {region_name} within the needle's reach");
            return Err(no_path("the target", 0, &reasons));
        };
        let mut distances = vec![f64::INFINITY; points.len()];
        let mut directions = Vec::new();
        while directions.len() < self.options.lines {
            directions.extend((self.target - next).try_normalize(1e-6));
            let mut farthest = (0.0, None);
            for (point, distance) in points.iter().zip(&mut distances) {
                *distance = distance.min((point - next).norm());
                if *distance > farthest.0 {
                    farthest = (*distance, Some(*point));
                }
            }
            match farthest.1 {
                Some(point) => next = point,
                None => break,
            }
        }
        Ok(directions)
    }

    /// Point at which a line to the target enters the body, mm.
    fn skin(&self, direction: &Vector3<f64>) -> Result<Skin, &'static str> {
        let reach = self.scenario.needle.length_mm - APPROACH_MM;
        let mut outermost = self.target;
        for step in 1..=(reach / SKIN_MM) as usize {
            let point = self.target - direction * (step as f64 * SKIN_MM);
            let meets = self.meets_tissue(&point);
            if meets == Some(true) {
                outermost = point;
                continue;
            }
            let entry = outermost.map(|x| (x * 100.0).round() / 100.0);
            if let Some(reason) = self.no_skin_behind(&Course::to(point, &self.target, self.speed_mm_s)) {
                return Err(reason);
            }
            return Ok(Skin {
                entry,
                at_end: meets.is_none(),
            });
        }
        Err(TOO_SHORT)
    }

    /// Reason to exclude a line from `entry` before any simulation, if there is one.
    fn excluded(&self, around: &Surroundings<'_>, straight: &Course) -> Option<&'static str> {
        let entry = &straight.entry;
        let reason = guide::beyond(self.scenario, straight);
        if reason.is_some() {
            return reason;
        }
        if self.meets_probe(entry, &-straight.along) {
            return Some(AT_PROBE);
        }
        let course = around.obstacles(&[*entry, self.target]);
        let least = self.options.clearance_mm;
        [
            (course.leaves, LEAVES),
            (course.bone_mm < least || course.bone_mm == 0.0, BONE),
            (course.critical_mm < least || course.critical_mm == 0.0, CRITICAL),
            (course.gas, GAS),
        ]
        .into_iter()
        .find_map(|(holds, reason)| holds.then_some(reason))
    }

    /// Whether all of a line, from its entry, lies in the tissue that is simulated.
    fn is_meshed(&self, entry: &Point3<f64>) -> bool {
        self.scenario.meshed_mm().is_none_or(|[low, high]| {
            let inside = |point: &Point3<f64>| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]));
            inside(entry) && inside(&self.target)
        })
    }

    /// Box of the mesh around all lines that are to be simulated, with the margin that an aimed needle has, mm; `None`
    /// without such lines.
    pub(super) fn box_mm(&self) -> Result<Option<[[f64; 3]; 2]>, Error> {
        let mut tips = Vec::new();
        for entry in self
            .lines()?
            .iter()
            .filter_map(|line| line.entry.ok())
            .map(|skin| skin.entry)
        {
            let straight = Course::to(entry, &self.target, self.speed_mm_s);
            let around = Surroundings::new(self.scenario, &self.body, &[entry, self.target]);
            if self.excluded(&around, &straight).is_none() {
                tips.extend([straight.at_depth(-APPROACH_MM), self.target]);
            }
        }
        Ok((!tips.is_empty()).then(|| box_around(&tips)))
    }

    /// Whether a needle before the skin comes too near to the probe, taken for a block behind its array.
    fn meets_probe(&self, entry: &Point3<f64>, outward: &Vector3<f64>) -> bool {
        if self.scenario.scene.settings.probe.shape.kind().site() != Site::Skin {
            return false;
        }
        let half = array_end_mm(&self.scenario.scene) + PROBE_MM[0];
        let to_probe = self.pose.world_to_probe();
        (0..=BEFORE_MM as usize).any(|mm| {
            let point = to_probe.transform_point(&(entry + outward * mm as f64));
            point.x.abs() < half && point.y < PROBE_MM[0] && point.z.abs() < PROBE_MM[0] + PROBE_MM[1]
        })
    }

    /// Simulates a line in `tissue`, unless it is excluded.
    pub(super) fn simulated(&self, number: usize, line: &Line, tissue: &Scenario) -> Result<Candidate, Error> {
        let [lateral, axial] = [self.pose.lateral(), self.pose.axial()].map(|axis| axis.dot(&line.along));
        let skin = line.entry.ok();
        let mut candidate = Candidate {
            number,
            angle_deg: lateral.atan2(axial).to_degrees(),
            entry_mm: skin.map(|skin| skin.entry.into()),
            at_end: skin.is_some_and(|skin| skin.at_end),
            depth_mm: skin.map(|skin| (self.target - skin.entry).norm()),
            excluded: line.entry.err(),
            along: line.along,
            guide: None,
            path: None,
        };
        let Some(Skin { entry, .. }) = skin else {
            return Ok(candidate);
        };
        let straight = Course::to(entry, &self.target, self.speed_mm_s);
        candidate.guide = guide::posture(self.scenario, &straight, straight.depth_mm);
        let around = Surroundings::new(self.scenario, &self.body, &[entry, self.target]);
        candidate.excluded = self
            .excluded(&around, &straight)
            .or((!self.is_meshed(&entry)).then_some(UNMESHED));
        if candidate.excluded.is_some() {
            return Ok(candidate);
        }
        let mut path = match correct(tissue, straight, self.target, self.options.tolerance_mm) {
            Ok(path) => path,
            Err(Fault::Failed(error)) => return Err(error),
            Err(Fault::Excluded(reason)) => {
                candidate.excluded = Some(reason);
                return Ok(candidate);
            }
        };
        candidate.guide = guide::posture(self.scenario, &path.course, path.insertion_mm - path.back_mm);
        // Where the needle cut the tissue, in the tissue at rest: that is where the deformed needle lies in it.
        let mut cut = vec![entry];
        cut.extend(path.last.samples.iter().filter_map(|sample| sample.tip_at_rest_mm));
        let [straight, cut] = [&[entry, self.target][..], &cut].map(|points| around.obstacles(points));
        let least = self.options.clearance_mm;
        // The entry lies within the tissue by a step at most.
        let turned = Course {
            entry: path.course.at_depth(-SKIN_MM),
            ..path.course
        };
        let near_bone = cut.bone_mm < least || cut.bone_mm == 0.0;
        let near_critical = cut.critical_mm < least || cut.critical_mm == 0.0;
        candidate.excluded = self
            .no_skin_behind(&turned)
            .or(near_bone.then_some(DEFORMED_BONE))
            .or(near_critical.then_some(DEFORMED_CRITICAL));
        let nearest = [straight, cut].map(|clearance| clearance.bone_mm.min(clearance.critical_mm));
        path.clearance_mm = Some(nearest[0].min(nearest[1])).filter(|mm| mm.is_finite());
        candidate.path = Some(path).filter(|_| candidate.excluded.is_none());
        Ok(candidate)
    }
}
