//! Placement of a probe in the middle of a vessel, an airway or a duct.

use insonify_anatomy::volume::LabelVolume;
use insonify_anatomy::volume::distance::Grid;
use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use super::{Placement, PlacementOptions};
use crate::TrackingError;
use crate::probe::{BeamGrid, Probe};

/// Radius of the part of the target that gives its axis, in radii of the lumen.
const ALONG: f64 = 3.0;

/// Places a probe where the target is widest, its axis along it; image rows run towards the back as far as the axis
/// allows, columns towards the patient's left.
pub(super) fn place(
    volume: &LabelVolume,
    target: &[u8],
    options: &PlacementOptions,
) -> Result<Placement, TrackingError> {
    if options.plane.is_some() {
        let kind = options.shape.kind();
        let text = format!("the plane of a {kind} probe is across the lumen in which it lies; leave `plane` out");
        return Err(TrackingError::at("plane", text));
    }
    let beam = BeamGrid::new(&Probe::new(options.shape, options.depth_mm)?)?;
    let probe_mm = beam.virtual_apex_mm().unwrap_or_default();
    let wall_mm = walls(volume, target);
    let (widest, radius_mm) = wall_mm
        .iter()
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(b.1))
        .unwrap_or((0, &0.0));
    let radius_mm = f64::from(*radius_mm);
    if radius_mm < probe_mm {
        return Err(TrackingError::new(format!(
            "the probe, of radius {probe_mm} mm, does not fit into the target, whose largest radius is {radius_mm:.1} mm"
        )));
    }
    let [nx, ny, _] = volume.size();
    let world = |voxel: usize| {
        let index = [voxel % nx, voxel / nx % ny, voxel / (nx * ny)].map(|x| x as f64);
        volume.index_to_world().transform_point(&Point3::from(index))
    };
    let centre = world(widest);
    let near = (0..wall_mm.len()).filter(|&voxel| wall_mm[voxel] > 0.0);
    let near = near
        .map(|voxel| world(voxel) - centre)
        .filter(|offset| offset.norm() <= ALONG * radius_mm);
    let spread = near.fold(Matrix3::zeros(), |sum, offset| sum + offset * offset.transpose());
    let eigen = spread.symmetric_eigen();
    let axis: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    // Of a level lumen towards the patient's left, so that rounding does not turn the view.
    let towards = if axis.z.abs() > 0.1 {
        axis.z
    } else {
        axis.x + 0.5 * axis.y
    };
    let axis = if towards < 0.0 { -axis } else { axis };
    // A lumen that runs from front to back is seen with the head up.
    let down = if axis.y.abs() < 0.8 {
        Vector3::y()
    } else {
        -Vector3::z()
    };
    let down = (down - axis * down.dot(&axis)).normalize();
    let (x, origin) = (down.cross(&axis), centre + down * probe_mm);
    let mut probe_to_world = Matrix4::identity();
    for (column, vector) in [x, down, axis, origin.coords].iter().enumerate() {
        probe_to_world.fixed_view_mut::<3, 1>(0, column).copy_from(vector);
    }
    let note = format!(
        "probe at ({:.0}, {:.0}, {:.0}) mm, where the lumen is widest (radius {radius_mm:.1} mm), across its axis ({:.2}, {:.2}, {:.2})",
        centre.x, centre.y, centre.z, axis.x, axis.y, axis.z
    );
    Ok(Placement {
        probe_to_world,
        rays_on_target: 1.0,
        visible: 1.0,
        target_depth_mm: 0.0,
        score: radius_mm,
        note: note.into(),
    })
}

/// Distance of each voxel of the target from the nearest voxel outside it, mm; 0 outside.
fn walls(volume: &LabelVolume, target: &[u8]) -> Vec<f32> {
    let spacing = [0, 1, 2].map(|axis| volume.index_to_world().fixed_view::<3, 1>(0, axis).norm());
    let outside: Vec<bool> = volume.voxels().iter().map(|label| !target.contains(label)).collect();
    let mut squares = Grid::squared_distances(&outside, volume.size(), spacing, &[0, 1, 2]).values;
    squares.iter_mut().for_each(|square| *square = square.sqrt());
    squares
}
