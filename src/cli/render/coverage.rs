//! Whether a scan plane meets what is imaged.

use insonify::synth::layers::world_position;
use insonify::synth::tables::Tables;
use nalgebra::Matrix4;

/// Longest way without tissue that a convex array on flat skin leaves under its outermost elements, mm: about the sagitta
/// of 60 mm at 30 degrees.
const GAP_MM: f64 = 10.0;

/// What is odd about where the probe is: nothing where it sees tissue from the skin on, nor where it lies outside the volume
/// and the user was told so.
pub fn warning(tables: &Tables, probe_to_world: &Matrix4<f64>, told: bool) -> Option<String> {
    let (mut inside, mut seeing, mut apart) = (false, 0, 0);
    for line in 0..tables.lines() {
        let first = (0..tables.samples()).find(|&sample| {
            let point = world_position(tables, probe_to_world, line, sample);
            let label = tables.anatomy.volume.label_index_at(&point);
            inside |= label.is_some();
            label.is_some_and(|label| label > 0)
        });
        if let Some(sample) = first {
            seeing += 1;
            apart += usize::from(tables.grid.sample_depth_mm(sample) > GAP_MM);
        }
    }
    match (seeing, inside) {
        (0, true) => Some("the field of view meets no labelled voxel".to_owned()),
        (0, false) => (!told).then(|| "the field of view lies wholly outside the volume".to_owned()),
        _ if 4 * apart > tables.lines() => Some(format!(
            "{apart} of {} scanlines pass more than {GAP_MM} mm before they meet tissue: the probe is off the skin, and the \
             way is taken for gel, which neither echoes nor attenuates",
            tables.lines()
        )),
        _ => None,
    }
}
