//! `[[plan.image]]` of a scenario: images of a planning study that the probe is to show again, and how well it does.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use serde::Serialize;

use super::file::ScenarioFile;
use super::probe::rigid;
use super::regions::Regions;
use insonify_base::document::{InputError, RegionName};
use insonify_imaging::scene::Scene;
use insonify_tracking::pose::{PoseSpec, pose_table};
use insonify_tracking::probe::BeamGrid;

/// Distance between points of the image, mm.
const POINT_MM: f64 = 1.0;

pose_table! {
    /// An image of the planning study, by its pose in the anatomy at rest.
    pub struct PlannedImageSpec {
        /// Name in the report.
        name: String;
        /// Regions whose section in the image is compared with that in the planned one: their names, parts of them, or
        /// their numbers. Default none.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        organ: Vec<RegionName>;
    }
}

/// Images of a planning study.
#[derive(Clone, Debug, Default)]
pub struct PlanningStudy {
    images: Vec<PlannedImage>,
    /// Points of the sector in the frame of the probe, mm.
    points: Vec<Point3<f64>>,
    /// Mean of the points and of their outer products.
    mean_mm: Vector3<f64>,
    square_mm2: Matrix3<f64>,
}

#[derive(Clone, Debug)]
struct PlannedImage {
    name: String,
    pose: Isometry3<f64>,
    /// Whether each label belongs to the organ.
    is_organ: Option<Vec<bool>>,
}

/// The image of a run that is nearest to one of the planning study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageMatch {
    /// Name of the planned image.
    pub name: String,
    /// Time of the image, s from the start of the run.
    pub time_s: f64,
    /// Root mean square, over the sector, of the distance of a point of the image from the same point of the planned
    /// one, mm.
    pub rms_mm: f64,
    /// Position of the array in the frame of the planned image, mm.
    pub lateral_mm: f64,
    /// Along the planned image's axis, mm.
    pub axial_mm: f64,
    /// Out of the planned image, mm.
    pub elevational_mm: f64,
    /// Angle between both poses, degrees.
    pub turn_deg: f64,
    /// Dice coefficient of the organ's sections in both images, in the anatomy at rest; `None` without an organ, or if
    /// neither shows it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dice: Option<f64>,
}

/// Image nearest so far to one of the study: mean square of the distance, time (s) and pose.
pub(crate) type Nearest = (f64, f64, Isometry3<f64>);

impl PlanningStudy {
    /// A study with images of a probe.
    fn new(images: Vec<PlannedImage>, grid: &BeamGrid) -> Self {
        let bounds = grid.bounds_mm();
        let steps = |axis: usize| {
            let [low, high] = [bounds.min[axis], bounds.max[axis]].map(|edge| (edge / POINT_MM).round() as i32);
            (low..=high).map(|step| f64::from(step) * POINT_MM)
        };
        let is_shown = |point: &Point3<f64>| grid.to_beam(point.x, point.y).is_some();
        let points = steps(1).flat_map(|y| steps(0).map(move |x| Point3::new(x, y, 0.0)));
        let points: Vec<_> = points.filter(is_shown).collect();
        let count = points.len().max(1) as f64;
        Self {
            mean_mm: points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / count,
            square_mm2: points
                .iter()
                .map(|point| point.coords * point.coords.transpose())
                .sum::<Matrix3<f64>>()
                / count,
            images,
            points,
        }
    }

    /// Takes an image into account.
    pub(crate) fn look(&self, time_s: f64, pose: &Isometry3<f64>, nearest: &mut Vec<Nearest>) {
        nearest.resize(self.images.len(), (f64::INFINITY, 0.0, Isometry3::identity()));
        for (image, nearest) in self.images.iter().zip(nearest) {
            let square_mm2 = self.mean_square_mm2(&image.pose, pose);
            if square_mm2 < nearest.0 {
                *nearest = (square_mm2, time_s, *pose);
            }
        }
    }

    /// Mean square of the distance between the same points of two images, from the moments of the points.
    fn mean_square_mm2(&self, planned: &Isometry3<f64>, pose: &Isometry3<f64>) -> f64 {
        let turned =
            pose.rotation.to_rotation_matrix().into_inner() - planned.rotation.to_rotation_matrix().into_inner();
        let moved = pose.translation.vector - planned.translation.vector;
        let of_turn = (turned * self.square_mm2 * turned.transpose()).trace();
        (of_turn + 2.0 * moved.dot(&(turned * self.mean_mm)) + moved.norm_squared()).max(0.0)
    }

    /// Matches of the nearest images.
    pub(crate) fn matches(
        &self,
        label_at: impl Fn(&Point3<f64>) -> Option<u8>,
        nearest: &[Nearest],
    ) -> Vec<ImageMatch> {
        let matched = self
            .images
            .iter()
            .zip(nearest)
            .map(|(image, (square_mm2, time_s, pose))| {
                let seen = image
                    .pose
                    .inverse_transform_point(&Point3::from(pose.translation.vector));
                let dice = image.is_organ.as_ref().and_then(|is_organ| {
                    let shows = |point: &Point3<f64>| belongs(label_at(point), is_organ);
                    dice(&self.points, [&image.pose, pose], shows)
                });
                ImageMatch {
                    name: image.name.clone(),
                    time_s: *time_s,
                    rms_mm: square_mm2.sqrt(),
                    lateral_mm: seen.x,
                    axial_mm: seen.y,
                    elevational_mm: seen.z,
                    turn_deg: image.pose.rotation.angle_to(&pose.rotation).to_degrees(),
                    dice,
                }
            });
        matched.collect()
    }
}

fn belongs(label: Option<u8>, is_organ: &[bool]) -> bool {
    label.is_some_and(|label| is_organ.get(usize::from(label)) == Some(&true))
}

/// Dice coefficient of what two images show of a solid; `None` if neither shows it.
fn dice(points: &[Point3<f64>], poses: [&Isometry3<f64>; 2], is_inside: impl Fn(&Point3<f64>) -> bool) -> Option<f64> {
    let (mut both, mut either) = (0_u64, 0_u64);
    for point in points {
        let [first, second] = poses.map(|pose| is_inside(&(pose * point)));
        both += u64::from(first && second);
        either += u64::from(first) + u64::from(second);
    }
    (either > 0).then(|| 2.0 * both as f64 / either as f64)
}

impl ScenarioFile {
    /// Images of the planning study.
    pub(crate) fn planning_study(&self, scene: &Scene) -> Result<PlanningStudy, InputError> {
        let specs = self.plan.as_ref().map_or(&[][..], |plan| &plan.image);
        let grid = BeamGrid::new(&scene.settings.probe);
        let Some(grid) = grid.ok().filter(|_| !specs.is_empty()) else {
            return Ok(PlanningStudy::default());
        };
        let mut study = PlanningStudy::new(Vec::new(), &grid);
        let (volume, named) = (&scene.anatomy.volume, BTreeMap::new());
        let regions = Regions::new(self, scene, &named);
        for (index, spec) in specs.iter().enumerate() {
            let table = format!("plan.image[{index}]");
            if study.images.iter().any(|image| image.name == spec.name) {
                let found = format!("a second image \"{}\"", spec.name);
                return Err(self.wrong_keys(format!("{table}.name"), found, "each name once"));
            }
            let pose = PoseSpec::from(spec).pose(None).map_err(|error| {
                let key = error.key().map_or(table.clone(), |key| format!("{table}.{key}"));
                self.fault(key, error)
            })?;
            let mut image = PlannedImage {
                name: spec.name.clone(),
                pose: rigid(&pose),
                is_organ: None,
            };
            if !spec.organ.is_empty() {
                let mut numbers = Vec::new();
                for (region, name) in spec.organ.iter().enumerate() {
                    numbers.extend(regions.numbers(&format!("{table}.organ[{region}]"), name)?);
                }
                let labels = volume.labels().iter();
                let is_organ: Vec<bool> = labels
                    .map(|label| numbers.iter().any(|number| i64::from(*number) == label.value))
                    .collect();
                let shown = |point: &Point3<f64>| belongs(volume.label_index_at(&(image.pose * point)), &is_organ);
                if !study.points.iter().any(shown) {
                    let expected = "an organ that the planned image crosses";
                    return Err(self.wrong_keys(
                        format!("{table}.organ"),
                        "an organ that this image does not show",
                        expected,
                    ));
                }
                image.is_organ = Some(is_organ);
            }
            study.images.push(image);
        }
        Ok(study)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion};

    use super::*;
    use insonify_tracking::probe::ProbeKind;

    /// A study of one image at an arbitrary pose.
    fn study() -> PlanningStudy {
        let turn = UnitQuaternion::from_euler_angles(0.3, -1.1, 0.7);
        let image = PlannedImage {
            name: "base".to_owned(),
            pose: Isometry3::from_parts(Translation3::new(10.0, -20.0, 30.0), turn),
            is_organ: None,
        };
        PlanningStudy::new(
            vec![image],
            &BeamGrid::new(&ProbeKind::Linear.usual()).expect("a probe"),
        )
    }

    #[test]
    fn shifts_and_turns_are_measured_as_geometry_has_them() {
        let study = study();
        let planned = study.images[0].pose;
        let moved = |by: Isometry3<f64>| {
            let mut nearest = Vec::new();
            study.look(1.0, &(planned * Isometry3::translation(0.0, 0.0, 9.0)), &mut nearest);
            study.look(2.0, &(planned * by), &mut nearest);
            study.look(3.0, &(planned * Isometry3::translation(0.0, 0.0, 8.0)), &mut nearest);
            let mut matches = study.matches(|_| None, &nearest);
            matches.remove(0)
        };
        let shifted = moved(Isometry3::translation(1.0, -2.0, 2.0));
        assert!(
            (shifted.rms_mm - 3.0).abs() < 1e-9 && shifted.turn_deg < 1e-9,
            "{shifted:?}"
        );
        let offset = [shifted.lateral_mm, shifted.axial_mm, shifted.elevational_mm];
        for (found, expected) in offset.into_iter().zip([1.0, -2.0, 2.0]) {
            assert!((found - expected).abs() < 1e-9, "{shifted:?}");
        }
        assert_eq!((shifted.time_s, shifted.dice), (2.0, None));
        // Turned about the axis of the image, a point moves by 2 sin(5 degrees) times its distance from the axis.
        let turned = moved(Isometry3::rotation(Vector3::y() * 10_f64.to_radians()));
        let squares: f64 = study.points.iter().map(|point| point.x * point.x).sum();
        let expected = 2.0 * 5_f64.to_radians().sin() * (squares / study.points.len() as f64).sqrt();
        assert!((turned.rms_mm - expected).abs() < 1e-9 && expected > 1.0, "{turned:?}");
        assert!((turned.turn_deg - 10.0).abs() < 1e-9, "{turned:?}");
    }

    /// Sections of a ball, d from its middle: concentric discs with squares of their radii R^2 - d^2.
    #[test]
    fn the_dice_coefficient_of_sections_of_a_ball_is_that_of_its_discs() {
        let study = study();
        let planned = study.images[0].pose;
        let (middle, radius) = (planned * Point3::new(0.0, 20.0, 0.0), 15.0_f64);
        let is_inside = |point: &Point3<f64>| (point - middle).norm() < radius;
        for away in [0.0, 6.0, 12.0, 14.0] {
            let pose = planned * Isometry3::translation(0.0, 0.0, away);
            let small = radius.powi(2) - away.powi(2);
            let expected = 2.0 * small / (radius.powi(2) + small);
            let found = dice(&study.points, [&planned, &pose], is_inside).expect("a section");
            assert!((found - expected).abs() < 0.02, "{away}: {found}, {expected}");
        }
        let aside = planned * Isometry3::translation(0.0, 0.0, 16.0);
        assert_eq!(dice(&study.points, [&aside, &aside], is_inside), None);
    }
}
