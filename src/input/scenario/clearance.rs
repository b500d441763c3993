//! Tissues along a planned needle path, and its distance from bone.

use nalgebra::{Point3, Vector3};

use super::guidance::Critical;
use super::resolve::Scenario;
use insonify_base::note::Notes;
use insonify_imaging::scene::{Body, Scene};
use insonify_tracking::trajectory::Trajectory;

/// Largest distance at which bone is searched for, mm.
const LOOKED_MM: f64 = 30.0;
/// Distance between samples of a path, mm.
const STEP_MM: f64 = 0.5;
/// Points of a path closer than this count as one, mm.
const NEAR_MM: f64 = 0.5;

/// A label with a distance, mm: its depth along a path, or its distance from one.
pub type At = (u8, f64);

/// Course of a path through the body, from its entry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Course {
    /// Labels in the order of traversal, with the length in each, mm; 0 outside the body.
    pub layers: Vec<At>,
    /// First bone on the path.
    pub bone: Option<At>,
    /// First gas or lung on the path.
    pub gas: Option<At>,
    /// Nearest bone within `LOOKED_MM`.
    pub nearest: Option<At>,
}

/// Obstacles on a path and their distances from it.
#[derive(Clone, Copy, Debug)]
pub struct Obstacles {
    /// Whether the path leaves the body.
    pub leaves: bool,
    /// Whether the path meets gas or lung.
    pub gas: bool,
    /// Distance of the nearest bone, mm; infinite beyond 30 mm.
    pub bone_mm: f64,
    /// Distance of the nearest critical structure, mm; infinite beyond 30 mm.
    pub critical_mm: f64,
}

/// Obstacles around a set of points.
pub struct Surroundings<'a> {
    bones: Bones<'a>,
    critical: Option<Critical>,
}

impl<'a> Surroundings<'a> {
    /// Collects obstacles within 30 mm of the points (mm).
    pub fn new(scenario: &Scenario, body: &'a Body<'a>, points: &[Point3<f64>]) -> Self {
        Self {
            bones: Bones::around(body, points),
            critical: Critical::around(scenario, points),
        }
    }

    /// Obstacles of a path through `points` (mm) from the skin.
    pub fn obstacles(&self, points: &[Point3<f64>]) -> Obstacles {
        let course = self.bones.course(points);
        let points_on_path = points.windows(2).flat_map(|pair| {
            let segment = pair[1] - pair[0];
            let steps = (segment.norm() / STEP_MM).ceil().max(1.0);
            (0..=steps as usize).map(move |step| pair[0] + segment * (step as f64 / steps))
        });
        let critical = self.critical.as_ref();
        Obstacles {
            leaves: course.leaves(),
            gas: course.gas.is_some(),
            bone_mm: course.nearest.map_or(f64::INFINITY, |(_, away)| away),
            critical_mm: points_on_path
                .filter_map(|point| critical?.distance(&point))
                .fold(f64::INFINITY, f64::min),
        }
    }
}

/// Bone around a set of paths.
pub struct Bones<'a> {
    body: &'a Body<'a>,
    voxels: Vec<(Point3<f64>, u8)>,
    /// Mean half edge of a voxel, mm: bone is assumed to begin this far before the centres of its voxels.
    half_mm: f64,
}

impl<'a> Bones<'a> {
    /// Collects bone within [`LOOKED_MM`] of the bounding box of `points` (mm).
    pub(crate) fn around(body: &'a Body<'a>, points: &[Point3<f64>]) -> Self {
        let volume = body.volume;
        let corner = |fold: fn(f64, f64) -> f64, start: f64, margin: f64| {
            let points = points.iter();
            [0, 1, 2].map(|axis| points.clone().map(|point| point[axis]).fold(start, fold) + margin)
        };
        let ends = [
            corner(f64::min, f64::INFINITY, -LOOKED_MM),
            corner(f64::max, f64::NEG_INFINITY, LOOKED_MM),
        ];
        // The volume may be turned in the world: all corners of the box bound the range of its indices.
        let corners = (0..8).map(|corner| Point3::from([0, 1, 2].map(|axis| ends[corner >> axis & 1][axis])));
        let corners: Vec<_> = corners
            .map(|corner| volume.world_to_index().transform_point(&corner))
            .collect();
        let range = |axis: usize| {
            let indices = corners.iter().map(|corner| corner[axis]);
            let low = indices.clone().fold(f64::INFINITY, f64::min).floor().max(0.0) as usize;
            let high = indices.fold(-1.0, f64::max).ceil() + 1.0;
            low..(high.max(0.0) as usize).min(volume.size()[axis])
        };
        let is_bone: Vec<bool> = (0..volume.labels().len())
            .map(|index| body.is_bone(index as u8))
            .collect();
        let mut voxels = Vec::new();
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    let label = volume.voxels()[volume.offset([i, j, k])];
                    if is_bone[usize::from(label)] {
                        let index = Point3::new(i as f64, j as f64, k as f64);
                        voxels.push((volume.index_to_world().transform_point(&index), label));
                    }
                }
            }
        }
        let half_mm = volume.spacing_mm().iter().sum::<f64>() / 6.0;
        Self { body, voxels, half_mm }
    }

    /// Course of a path through `points`.
    pub(crate) fn course(&self, points: &[Point3<f64>]) -> Course {
        let mut course = Course::default();
        let mut depth = 0.0;
        for pair in points.windows(2) {
            self.pass(&mut course, &mut depth, [&pair[0], &pair[1]]);
            for (voxel_mm, label) in &self.voxels {
                let away = (distance(voxel_mm, &pair[0], &pair[1]) - self.half_mm).max(0.0);
                if away <= LOOKED_MM && course.nearest.is_none_or(|(_, least)| away < least) {
                    course.nearest = Some((*label, away));
                }
            }
        }
        if let Some((label, _)) = course.bone {
            course.nearest = Some((label, 0.0));
        }
        course
    }

    fn pass(&self, course: &mut Course, depth: &mut f64, [from, to]: [&Point3<f64>; 2]) {
        let segment = to - from;
        let steps = (segment.norm() / STEP_MM).ceil().max(1.0);
        let step = segment.norm() / steps;
        for index in 0..steps as usize {
            let point = from + segment * ((index as f64 + 0.5) / steps);
            let label = self.body.volume.label_index_at(&point);
            let label = label.filter(|label| !self.body.is_outside(*label)).unwrap_or(0);
            if label == 0 && course.layers.is_empty() {
                continue;
            }
            match course.layers.last_mut() {
                Some((last, length)) if *last == label => *length += step,
                _ => course.layers.push((label, step)),
            }
            if self.body.is_bone(label) {
                course.bone.get_or_insert((label, *depth));
            } else if label > 0 && self.body.tissues.tissue(label).is_occluder() {
                course.gas.get_or_insert((label, *depth));
            }
            *depth += step;
        }
    }
}

impl Course {
    /// Whether the path leaves the body.
    pub(crate) fn leaves(&self) -> bool {
        self.layers.iter().any(|(label, _)| *label == 0)
    }

    /// Lists the tissues along the path in words.
    pub(crate) fn layers_in_words(&self, body: &Body<'_>) -> String {
        let layer = |(label, mm): &At| match label {
            0 => format!("outside {mm:.0}"),
            label => format!("{} {mm:.0}", body.name(*label)),
        };
        // Steps between voxels are not layers.
        let layers = self.layers.iter().filter(|(_, mm)| *mm >= 1.0);
        layers.map(layer).collect::<Vec<_>>().join(", ") + " mm"
    }
}

/// Reports the clearance of the needle tip's path from bone, and warns of bone, gas and lung on it.
pub fn tell(scene: &Scene, tip: &Trajectory, notes: &mut Notes, warnings: &mut Vec<String>) {
    let mut points: Vec<Point3<f64>> = Vec::new();
    for key in tip.keys() {
        let tip = key.pose.position_mm();
        if points.last().is_none_or(|last| (tip - last).norm() > NEAR_MM) {
            points.push(tip);
        }
    }
    let body = scene.body();
    let course = Bones::around(&body, &points).course(&points);
    let mut warn = |what: &str, (label, depth): At| {
        let name = body.name(label);
        warnings.push(format!(
            "the planned path meets {what} ({name}) {depth:.0} mm below the surface"
        ));
    };
    course.gas.into_iter().for_each(|entry| warn("gas or lung", entry));
    match (course.bone, course.nearest) {
        (Some(entry), _) => warn("bone", entry),
        (None, Some((label, away))) => {
            let name = body.name(label);
            notes.push(format!(
                "the planned path passes {name}, the nearest bone, at {away:.0} mm"
            ));
        }
        (None, None) => notes.push(format!("the planned path has no bone within {LOOKED_MM:.0} mm")),
    }
}

/// Distance of a point from a segment, mm.
fn distance(point: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    let (along, offset): (Vector3<f64>, Vector3<f64>) = (b - a, point - a);
    let share = (offset.dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (offset - along * share).norm()
}
