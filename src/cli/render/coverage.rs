//! Warnings about the position of the scan plane in the volume.

use insonify_imaging::effects::slice::Beyond;
use insonify_imaging::synth::layers::world_position;
use insonify_imaging::synth::tables::Tables;
use insonify_tracking::probe::Site;
use nalgebra::{Matrix4, Point3};

/// Largest gap without tissue under the outermost elements of a convex array on flat skin, mm: about the sagitta of 60
/// mm at 30 degrees.
const GAP_MM: f64 = 10.0;

/// Depth of tissue behind the array from which the array is inside the body, mm: more than indented skin.
const BEHIND_MM: f64 = 20.0;

/// Fraction of the samples beyond the skin that may lie outside the volume.
const BEYOND: f64 = 0.05;
/// Stride in scanlines and samples for this check.
const STRIDE: usize = 8;

/// Warnings about a pose: the probe off the skin or inside the body, or a field of view that leaves the volume. None
/// for a view completely outside, if the user has already been warned (`outside_was_reported`).
pub(super) fn warnings(tables: &Tables, probe_to_world: &Matrix4<f64>, outside_was_reported: bool) -> Vec<String> {
    let volume = &tables.anatomy.volume;
    let label = |line, sample| volume.label_index_at(&world_position(tables, probe_to_world, line, sample));
    let (mut inside, mut seeing, mut across_gap) = (false, 0, 0);
    let (mut samples, mut beyond) = (0, 0);
    for line in 0..tables.lines() {
        let first_tissue = (0..tables.samples()).find(|&sample| {
            let label = label(line, sample);
            inside |= label.is_some();
            label.is_some_and(|label| label > 0)
        });
        if let Some(first_tissue) = first_tissue {
            seeing += 1;
            across_gap += usize::from(tables.grid.sample_depth_mm(first_tissue) > GAP_MM);
            // Some of the samples suffice for a share; the gap before the skin needs the first of each line.
            if line % STRIDE == 0 {
                let behind = (first_tissue..tables.samples()).step_by(STRIDE);
                samples += behind.len();
                beyond += behind.filter(|&sample| label(line, sample).is_none()).count();
            }
        }
    }
    if seeing == 0 {
        return match inside {
            true => vec!["the field of view meets no labelled voxel".to_owned()],
            false if outside_was_reported => Vec::new(),
            false => vec!["the field of view lies wholly outside the volume".to_owned()],
        };
    }
    let mut warnings = Vec::new();
    if 4 * across_gap > tables.lines() {
        warnings.push(format!(
            "more than a quarter of the scanlines pass {GAP_MM} mm or more before they meet tissue: the probe is off the skin, and the \
             gap counts as gel, which neither echoes nor attenuates"
        ));
    }
    let [ox, oy, dx, dy] = tables.rays[tables.lines() / 2];
    let behind = Point3::new(ox - BEHIND_MM * dx, oy - BEHIND_MM * dy, 0.0);
    let is_tissue = |point| volume.label_index_at(&point).is_some_and(|label| label > 0);
    if tables.settings.probe.shape.kind().site() == Site::Skin && is_tissue(probe_to_world.transform_point(&behind)) {
        warnings.push(format!(
            "the probe lies inside the body: there is tissue {BEHIND_MM} mm behind the array"
        ));
    }
    if beyond as f64 > BEYOND * samples as f64 {
        let shown = match tables.settings.effects.slice.beyond {
            Beyond::Void => "stays black",
            Beyond::Continue => {
                "is invented, as in a mirror (layer `beyond`; `effects.slice.beyond = \"void\"` leaves it black)"
            }
        };
        warnings.push(format!(
            "more than {:.0} % of the field of view behind the skin lies outside the volume and {shown}",
            100.0 * BEYOND
        ));
    }
    warnings
}

/// Returns the share of the field of view, by area, that shows a label.
pub(super) fn share(tables: &Tables, probe_to_world: &Matrix4<f64>, wanted: u8) -> f64 {
    let volume = &tables.anatomy.volume;
    let (mut shown, mut all) = (0.0, 0.0);
    for line in 1..tables.lines() {
        for sample in (0..tables.samples()).step_by(STRIDE) {
            let [before, point] = [line - 1, line].map(|line| world_position(tables, probe_to_world, line, sample));
            // Lines of a fan lie closer together near the array.
            let width = (point - before).norm();
            all += width;
            if volume.label_index_at(&point) == Some(wanted) {
                shown += width;
            }
        }
    }
    if all > 0.0 { shown / all } else { 0.0 }
}
