// Echo amplitude of the tissue's solid texture. Twin of src/imaging/effects/texture.rs.
#import label_row
#import texture

struct Params {
    lines: u32,
    samples: u32,
    strength: f32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(4) var<storage, read> entries: array<TextureEntry>;
@group(0) @binding(5) var<storage, read> atlas: array<f32>;
@group(0) @binding(6) var<storage, read_write> amplitudes: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    let texture = label_rows[labels[index]].texture;
    if texture > 0u {
        let value = sample_texture(entries[texture - 1u], positions[index].xyz);
        amplitudes[index] *= 1.0 + params.strength * (value - 1.0);
    }
}
