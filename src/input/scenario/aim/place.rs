//! Points in the image plane: the innermost point of a target, and the skin beside the array.

use nalgebra::Point3;

use insonify_imaging::scene::{Body, Scene};
use insonify_tracking::pose::Pose;
use insonify_tracking::probe::BeamGrid;

/// Spacing of the search grid for the innermost point of a target, mm.
const GRID_MM: f64 = 2.0;
/// Maximum number of grid points along an axis.
const MAX: f64 = 100.0;
/// Start of the search for the skin beside the array, as a distance before the array, mm, and the search step.
const BEFORE_MM: f64 = 60.0;
const SKIN_STEP_MM: f64 = 0.5;

/// Innermost point of the visible cross-section of a label in the image plane, mm.
pub fn innermost(scene: &Scene, pose: &Pose, label: u8) -> Option<Point3<f64>> {
    let grid = BeamGrid::new(&scene.settings.probe).ok()?;
    let bounds = grid.bounds_mm();
    let centres = |axis: usize| {
        let (low, extent) = (bounds.min[axis], bounds.max[axis] - bounds.min[axis]);
        let count = (extent / GRID_MM).ceil().min(MAX);
        (0..count as usize).map(move |index| low + (index as f64 + 0.5) * extent / count)
    };
    let world = |[x, y]: [f64; 2]| pose.probe_to_world().transform_point(&Point3::new(x, y, 0.0));
    let is_target = |point: &[f64; 2]| {
        let label_there = scene.anatomy.volume.label_index_at(&world(*point));
        grid.to_beam(point[0], point[1]).is_some() && label_there == Some(label)
    };
    let points = centres(1).flat_map(|y| centres(0).map(move |x| [x, y]));
    let (inside, outside): (Vec<_>, Vec<_>) = points.partition(is_target);
    let depth = |point: &[f64; 2]| {
        let squares = outside
            .iter()
            .map(|other| (point[0] - other[0]).powi(2) + (point[1] - other[1]).powi(2));
        squares.fold(f64::INFINITY, f64::min)
    };
    let mut best: Option<(f64, [f64; 2])> = None;
    for point in inside {
        let depth = depth(&point);
        if best.is_none_or(|(deepest, _)| depth > deepest) {
            best = Some((depth, point));
        }
    }
    best.map(|(_, point)| world(point))
}

/// Lateral position of the array's end on its marked side, mm.
pub fn array_end_mm(scene: &Scene) -> f64 {
    let grid = BeamGrid::new(&scene.settings.probe).ok();
    let last_ray = grid.as_ref().and_then(|grid| grid.rays().last());
    last_ray.map_or(0.0, |ray| ray.origin[0])
}

/// Skin point on a line of the image plane along the beam's axis, mm; `None` where the line starts in the body.
pub fn skin(body: &Body<'_>, pose: &Pose, lateral_mm: f64, depth_mm: f64) -> Option<Point3<f64>> {
    let steps = ((BEFORE_MM + depth_mm) / SKIN_STEP_MM) as usize;
    let point = |step: usize| Point3::new(lateral_mm, step as f64 * SKIN_STEP_MM - BEFORE_MM, 0.0);
    let mut points = (0..steps).map(|step| pose.probe_to_world().transform_point(&point(step)));
    let is_body = |point: &Point3<f64>| body.label_at(point).is_some();
    let start = points.next().filter(|start| !is_body(start));
    start.and_then(|_| points.find(is_body))
}
