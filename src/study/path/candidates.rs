//! Lines to a target: from the places where needles may enter, without those that lead too near to what must not be
//! hit.

use nalgebra::{Point3, Vector3};

use super::correct::correct;
use super::insertion::APPROACH_MM;
use super::{Candidate, Entry, PathOptions, no_path, unknown};
use crate::StudyError;
use insonify::Error;
use insonify::input::scenario::Scenario;
use insonify::input::scenario::aim::place::array_end_mm;
use insonify::input::scenario::clearance::Surroundings;
use insonify_base::document::{Names, RegionName};
use insonify_imaging::scene::Body;
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::Site;

/// Step of the search for the skin, mm.
const SKIN_MM: f64 = 0.25;
/// Distance that needles keep from the probe, and half its thickness, mm.
const PROBE_MM: [f64; 2] = [5.0, 10.0];
/// Length of a needle before the skin that is kept from the probe, mm.
const BEFORE_MM: f64 = 60.0;
/// Largest distance of a target from the image plane in which it counts as lying, mm.
const IN_PLANE_MM: f64 = 0.05;

const NO_SKIN: &str = "the volume ends before the skin";
const TOO_SHORT: &str = "the needle is too short";
const AT_PROBE: &str = "the needle would run into the probe";
const UNMESHED: &str = "the line leaves the tissue that is simulated (`tissue.box_mm`)";
const LEAVES: &str = "the line leaves the body";
const GAS: &str = "the line meets gas or lung";
const BONE: &str = "too near to bone";
const CRITICAL: &str = "too near to a critical structure";
pub(crate) const DEFORMED_BONE: &str = "too near to bone as the tissue deforms";
const DEFORMED_CRITICAL: &str = "too near to a critical structure as the tissue deforms";

/// A direction to the target, with its entry or the reason why there is none.
pub(super) struct Line {
    along: Vector3<f64>,
    entry: Result<Point3<f64>, &'static str>,
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

/// Lines to one target and what surrounds them.
pub(super) struct Entries<'a> {
    scenario: &'a Scenario,
    body: Body<'a>,
    pose: Pose,
    options: &'a PathOptions,
    pub target: Point3<f64>,
}

impl<'a> Entries<'a> {
    pub(super) fn new(scenario: &'a Scenario, target: Point3<f64>, options: &'a PathOptions) -> Result<Self, Error> {
        if options.section_mm.is_some() && !matches!(options.entry, Entry::Plane(_)) {
            let wrong = "in a model of two dimensions with entries outside the image plane";
            return Err(wrong_target(wrong, "entries in the plane: `plane`, with `--angles`"));
        }
        Ok(Self {
            scenario,
            body: scenario.scene.body(),
            pose: scenario.scene.probe_path().at(scenario.timing.start_s),
            options,
            target,
        })
    }

    /// The lines, in the order of their angles, or from the entry nearest to the target on.
    pub(super) fn lines(&self) -> Result<Vec<Line>, Error> {
        let directions: Vec<Vector3<f64>> = match &self.options.entry {
            Entry::Plane([low, high]) => {
                let intervals = (self.options.lines - 1).max(1) as f64;
                let angles = (0..self.options.lines).map(|index| low + (high - low) * index as f64 / intervals);
                let [lateral, axial] = [self.pose.lateral().into_inner(), self.pose.axial().into_inner()];
                angles
                    .map(|deg| lateral * deg.to_radians().sin() + axial * deg.to_radians().cos())
                    .collect()
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

    /// Voxels of the body beside air for which `wanted` holds, within the needle's reach, mm.
    fn surface(&self, wanted: impl Fn(u8, &Point3<f64>) -> bool) -> Vec<Point3<f64>> {
        let volume = self.body.volume;
        let [nx, ny, nz] = volume.size();
        let is_body = |label: u8| label > 0 && !self.body.is_outside(label);
        let reach = self.scenario.needle.length_mm - APPROACH_MM;
        let mut surface = Vec::new();
        // At the rim of the volume the field of view ends the body, not its skin.
        for k in 1..nz.saturating_sub(1) {
            for j in 1..ny.saturating_sub(1) {
                for i in 1..nx.saturating_sub(1) {
                    let label = volume.voxels()[volume.offset([i, j, k])];
                    if !is_body(label) {
                        continue;
                    }
                    let neighbours = [
                        [i - 1, j, k],
                        [i + 1, j, k],
                        [i, j - 1, k],
                        [i, j + 1, k],
                        [i, j, k - 1],
                        [i, j, k + 1],
                    ];
                    if neighbours
                        .iter()
                        .all(|index| is_body(volume.voxels()[volume.offset(*index)]))
                    {
                        continue;
                    }
                    let point = volume
                        .index_to_world()
                        .transform_point(&Point3::new(i as f64, j as f64, k as f64));
                    if (point - self.target).norm() <= reach && wanted(label, &point) {
                        surface.push(point);
                    }
                }
            }
        }
        surface
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
    fn skin(&self, direction: &Vector3<f64>) -> Result<Point3<f64>, &'static str> {
        let reach = self.scenario.needle.length_mm - APPROACH_MM;
        let mut deepest = self.target;
        for step in 1..=(reach / SKIN_MM) as usize {
            let point = self.target - direction * (step as f64 * SKIN_MM);
            if self.body.label_at(&point).is_none() {
                return match self.body.volume.label_index_at(&point) {
                    Some(_) => Ok(deepest.map(|x| (x * 100.0).round() / 100.0)),
                    None => Err(NO_SKIN),
                };
            }
            deepest = point;
        }
        Err(TOO_SHORT)
    }

    /// Reason to exclude a line from `entry` before any simulation, if there is one.
    fn excluded(&self, around: &Surroundings<'_>, entry: &Point3<f64>) -> Option<&'static str> {
        let outward = (entry - self.target).normalize();
        if self.meets_probe(entry, &outward) {
            return Some(AT_PROBE);
        }
        if let Some([low, high]) = self.scenario.meshed_mm() {
            let inside = |point: &Point3<f64>| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]));
            if !(inside(entry) && inside(&self.target)) {
                return Some(UNMESHED);
            }
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
        let entry = line.entry.ok();
        let mut candidate = Candidate {
            number,
            angle_deg: lateral.atan2(axial).to_degrees(),
            entry_mm: entry.map(Into::into),
            depth_mm: entry.map(|entry| (self.target - entry).norm()),
            excluded: line.entry.err(),
            along: line.along,
            path: None,
        };
        let Some(entry) = entry else { return Ok(candidate) };
        let around = Surroundings::new(self.scenario, &self.body, &[entry, self.target]);
        candidate.excluded = self.excluded(&around, &entry);
        if candidate.excluded.is_some() {
            return Ok(candidate);
        }
        let mut path = match correct(tissue, entry, self.target, self.options.tolerance_mm)? {
            Ok(path) => path,
            Err(reason) => {
                candidate.excluded = Some(reason);
                return Ok(candidate);
            }
        };
        // Where the needle cut the tissue, in the tissue at rest: that is where the deformed needle lies in it.
        let mut cut = vec![entry];
        cut.extend(path.last.samples.iter().filter_map(|sample| sample.tip_at_rest_mm));
        let [straight, cut] = [&[entry, self.target][..], &cut].map(|points| around.obstacles(points));
        let least = self.options.clearance_mm;
        if cut.bone_mm < least || cut.bone_mm == 0.0 {
            candidate.excluded = Some(DEFORMED_BONE);
        } else if cut.critical_mm < least || cut.critical_mm == 0.0 {
            candidate.excluded = Some(DEFORMED_CRITICAL);
        }
        let nearest = [straight, cut].map(|clearance| clearance.bone_mm.min(clearance.critical_mm));
        path.clearance_mm = Some(nearest[0].min(nearest[1])).filter(|mm| mm.is_finite());
        candidate.path = Some(path).filter(|_| candidate.excluded.is_none());
        Ok(candidate)
    }
}
