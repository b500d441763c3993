//! Whether a scan plane meets what is imaged.

use insonify::synth::layers::world_position;
use insonify::synth::tables::Tables;
use nalgebra::Matrix4;

/// What is odd about where the probe is; nothing where it sees tissue.
pub fn warning(tables: &Tables, probe_to_world: &Matrix4<f64>) -> Option<String> {
    let mut inside = false;
    for line in 0..tables.lines() {
        for sample in 0..tables.samples() {
            match tables
                .volume
                .label_index_at(&world_position(tables, probe_to_world, line, sample))
            {
                None => {}
                Some(0) => inside = true,
                Some(_) => return None,
            }
        }
    }
    let [x, y, z] = [0, 1, 2].map(|axis| probe_to_world[(axis, 3)]);
    let [cx, cy, cz]: [f64; 3] = tables.volume.centre_mm().into();
    Some(format!(
        "the field of view {}; the probe is at ({x:.1}, {y:.1}, {z:.1}) mm, the middle of the volume at ({cx:.1}, {cy:.1}, {cz:.1}) mm",
        if inside {
            "meets no labelled voxel"
        } else {
            "lies wholly outside the volume"
        }
    ))
}
