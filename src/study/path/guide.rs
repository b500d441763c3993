//! Ranges of a needle guide on the probe as conditions of a path.

use nalgebra::{Point3, Vector3};

use super::Candidate;
use super::insertion::Course;
use insonify::input::scenario::Scenario;
use insonify_tracking::TrackingError;
use insonify_tracking::manipulator::{Guide, INSERTION_MM, InPlane, POSITION_MM, POSTURE_DEG, Posture};
use insonify_tracking::pose::Pose;

/// Distance kept from the ends of the ranges, mm and degrees: more than the rounding of what is written.
const MARGIN: f64 = 1e-3;
/// Share of the range of angles that is left out at either end.
const INSIDE: f64 = 0.05;

const OUT_OF_PLANE: &str = "leaves the image plane, in which the guide holds the needle";
const WITHDRAWN: &str = "the withdrawn needle of the guide would lie in tissue";

/// Degree of freedom of a guide.
struct Axis {
    /// Key of its coordinate.
    key: &'static str,
    /// Reason of exclusion of a line beyond its range.
    reason: &'static str,
    unit: &'static str,
    range: [f64; 2],
    coordinate: fn(&Posture) -> f64,
}

const AXES: [Axis; 3] = [
    Axis {
        key: "position_mm",
        reason: "beyond the guide's horizontal positioning (A)",
        unit: "mm",
        range: POSITION_MM,
        coordinate: |posture| posture.position_mm,
    },
    Axis {
        key: "posture_deg",
        reason: "beyond the guide's posture (B)",
        unit: "degrees",
        range: POSTURE_DEG,
        coordinate: |posture| posture.posture_deg,
    },
    Axis {
        key: "insertion_mm",
        reason: "beyond the guide's insertion (C)",
        unit: "mm",
        range: INSERTION_MM,
        coordinate: |posture| posture.insertion_mm,
    },
];

fn guide(scenario: &Scenario) -> Option<&Guide> {
    scenario.file.manipulator.as_ref().map(|spec| &spec.guide)
}

fn in_plane(scenario: &Scenario, course: &Course, depth_mm: f64) -> Result<InPlane, TrackingError> {
    let probe = scenario.scene.probe_path().at(scenario.timing.start_s);
    let tip = Pose::from_direction(course.at_depth(depth_mm), course.along, None)?;
    InPlane::of(&Pose::from_matrix(&(probe.world_to_probe() * tip.probe_to_world()))?)
}

/// An aim as near as the guide comes to it: in the image plane.
pub(super) fn aim(scenario: &Scenario, aim: Point3<f64>) -> Point3<f64> {
    if guide(scenario).is_none() {
        return aim;
    }
    let probe = scenario.scene.probe_path().at(scenario.timing.start_s);
    let mut in_probe = probe.world_to_probe().transform_point(&aim);
    in_probe.z = 0.0;
    probe.probe_to_world().transform_point(&in_probe)
}

/// Part of a miss across the image plane, in which the guide holds the needle, mm; `None` without a guide.
pub(super) fn across_mm(scenario: &Scenario, miss: &Vector3<f64>) -> Option<f64> {
    guide(scenario)?;
    let probe = scenario.scene.probe_path().at(scenario.timing.start_s);
    Some(miss.dot(&probe.lateral().cross(&probe.axial())).abs())
}

/// Whether the scenario has a guide.
pub(super) fn holds(scenario: &Scenario) -> bool {
    guide(scenario).is_some()
}

/// Posture of the guide with the tip at a distance beyond the entry of a course, mm, whatever its ranges; `None`
/// without a guide, or for a needle out of its plane.
pub(super) fn posture(scenario: &Scenario, course: &Course, depth_mm: f64) -> Option<Posture> {
    Some(guide(scenario)?.placing(&in_plane(scenario, course, depth_mm).ok()?))
}

/// Distance from the withdrawn needle to the entry, mm; `None` without a guide.
pub(super) fn withdrawn_mm(scenario: &Scenario, course: &Course) -> Option<f64> {
    Some(posture(scenario, course, 0.0)?.insertion_mm - INSERTION_MM[0] - MARGIN)
}

/// Farthest depth that the guide reaches along a course, mm; infinite without a guide.
pub(super) fn reach_mm(scenario: &Scenario, course: &Course) -> f64 {
    posture(scenario, course, 0.0).map_or(f64::INFINITY, |at_entry| {
        INSERTION_MM[1] - MARGIN - at_entry.insertion_mm
    })
}

/// Reason why the guide cannot make a course, if there is one.
pub(super) fn beyond(scenario: &Scenario, course: &Course) -> Option<&'static str> {
    guide(scenario)?;
    let (Some(at_entry), Some(deepest)) = (
        posture(scenario, course, 0.0),
        posture(scenario, course, course.depth_mm),
    ) else {
        return Some(OUT_OF_PLANE);
    };
    let outward = |coordinate: f64| coordinate + MARGIN.copysign(coordinate);
    let error = Posture {
        position_mm: outward(deepest.position_mm),
        posture_deg: outward(deepest.posture_deg),
        insertion_mm: outward(deepest.insertion_mm),
    }
    .check()
    .err();
    let axis = error.and_then(|error| AXES.iter().find(|axis| error.key() == Some(axis.key)));
    let withdrawn = (at_entry.insertion_mm < INSERTION_MM[0] + MARGIN).then_some(WITHDRAWN);
    axis.map(|axis| axis.reason).or(withdrawn)
}

/// Angles to the beam at which the guide reaches a point, less what a correction may turn, degrees.
pub(super) fn angles_deg(scenario: &Scenario, target: &Point3<f64>) -> Option<[f64; 2]> {
    let probe = scenario.scene.probe_path().at(scenario.timing.start_s);
    let in_probe = probe.world_to_probe().transform_point(target);
    let [low, high] = guide(scenario)?.angles_deg([in_probe.x, in_probe.y])?;
    let inward = INSIDE * (high - low);
    Some([low + inward, high - inward])
}

/// The reasons of excluded lines with their numbers, the most frequent first; those of a guide with the coordinates
/// that it would take.
pub(super) fn reasons(lines: &[Candidate]) -> Vec<(&'static str, usize, String)> {
    let mut counted: Vec<(&'static str, usize, String)> = Vec::new();
    for reason in lines.iter().filter_map(|line| line.excluded) {
        match counted.iter_mut().find(|(known, ..)| *known == reason) {
            Some((_, number, _)) => *number += 1,
            None => counted.push((reason, 1, String::new())),
        }
    }
    for (reason, _, taken) in &mut counted {
        let Some(axis) = AXES.iter().find(|axis| axis.reason == *reason) else {
            continue;
        };
        let coordinates = lines
            .iter()
            .filter(|line| line.excluded == Some(*reason))
            .filter_map(|line| line.guide.as_ref().map(axis.coordinate));
        let [low, high] = coordinates.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], coordinate| {
            [low.min(coordinate), high.max(coordinate)]
        });
        let [least, most] = axis.range;
        // The coordinates are those of the straight lines.
        let deeper = if low >= least && high <= most {
            ", more as the tissue gives way"
        } else {
            ""
        };
        *taken = format!(" of {least} to {most} {}: {low:.1} to {high:.1}{deeper}", axis.unit);
    }
    counted.sort_by_key(|(_, number, _)| std::cmp::Reverse(*number));
    counted
}
