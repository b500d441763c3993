//! Whether a scan plane meets what is imaged.

use insonify::synth::layers::world_position;
use insonify::synth::tables::Tables;
use nalgebra::Matrix4;

/// What is odd about where the probe is: nothing where it sees tissue, nor where it lies outside the volume and the user
/// was told so.
pub fn warning(tables: &Tables, probe_to_world: &Matrix4<f64>, told: bool) -> Option<String> {
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
    if told && !inside {
        return None;
    }
    Some(if inside {
        "the field of view meets no labelled voxel".to_owned()
    } else {
        "the field of view lies wholly outside the volume".to_owned()
    })
}
