// Electronic noise and acoustic clutter. Twin of src/imaging/effects/receiver.rs.
#import hash

struct Params {
    seed: vec2<u32>,
    samples: u32,
    frame: u32,
    noise: f32,
    unused: array<u32, 3>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> clutter: array<f32>;
@group(0) @binding(3) var<storage, read_write> amplitudes: array<f32>;

fn six_bytes(words: vec3<u32>) -> i32 {
    let pairs = (words >> vec3<u32>(24u)) + ((words >> vec3<u32>(16u)) & vec3<u32>(0xffu));
    return i32(pairs.x + pairs.y + pairs.z) - 765;
}

fn white(line: u32, sample: i32) -> vec2<i32> {
    let first = hash3(vec3<i32>(i32(line), sample, i32(params.frame)), params.seed);
    return vec2<i32>(six_bytes(first), six_bytes(pcg3d(first)));
}

fn smoothed(line: u32, sample: i32) -> vec2<i32> {
    return white(line, sample - 1) + 2 * white(line, sample) + white(line, sample + 1);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    if labels[index] == 0u {
        return;
    }
    let sample = i32(id.x);
    let signal = smoothed(id.y, sample) + smoothed(id.y + 1u, sample);
    let drawn = f32(signal.x * signal.x + signal.y * signal.y);
    let echo = amplitudes[index];
    amplitudes[index] = sqrt(echo * echo + (clutter[index] + params.noise * drawn));
}
