// Gain and log compression to grey levels. Twin of src/effects/tone.rs.
struct Params {
    samples: u32,
    compress: u32,
    per_octave: f32,
    middle: f32,
    gamma: f32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> gain: array<f32>;
@group(0) @binding(2) var<storage, read_write> amplitudes: array<f32>;

fn grey(amplitude: f32) -> f32 {
    if params.compress == 0u {
        return clamp(amplitude * 255.0, 0.0, 255.0);
    }
    let share = clamp(params.middle + params.per_octave * log2(max(amplitude, 1e-10)), 0.0, 1.0);
    if params.gamma == 1.0 {
        return 255.0 * share;
    }
    return 255.0 * power(share, params.gamma);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    amplitudes[index] = grey(amplitudes[index] * gain[id.x]);
}
