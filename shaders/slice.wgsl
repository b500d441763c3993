// Label and constant echo of every sample. Twin of src/imaging/effects/slice.rs.
#import label_row
#import labels

struct Params {
    world_to_index: array<vec4<f32>, 3>,
    size: vec3<u32>,
    boundary: u32,
    samples: u32,
    mirrored: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> voxels: array<u32>;
@group(0) @binding(3) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(4) var<storage, read_write> labels: array<u32>;
@group(0) @binding(5) var<storage, read_write> amplitudes: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    let position = positions[index];
    var label = 0u;
    if position.w != 1.0 {
        label = label_at(position.xyz);
    }
    labels[index] = label;
    amplitudes[index] = label_rows[label].echo;
}
