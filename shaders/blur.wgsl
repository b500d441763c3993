// Lateral Gaussian along arcs of constant depth. Twin of src/imaging/effects/blur.rs.
struct Params {
    lines: u32,
    samples: u32,
    reach: u32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> amplitudes: array<f32>;
// Rows over the samples: reach on each side, then the weight of each tap.
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read_write> blurred: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let sample = id.x;
    let line = id.y;
    if sample >= params.samples {
        return;
    }
    let reach = u32(weights[sample]);
    let first = line - min(line, reach);
    let last = min(line + reach, params.lines - 1u);
    var sum = 0.0;
    var norm = 0.0;
    for (var other = first; other <= last; other++) {
        let weight = weights[(1u + other + params.reach - line) * params.samples + sample];
        sum += weight * amplitudes[other * params.samples + sample];
        norm += weight;
    }
    if last - first == 2u * reach {
        norm = 1.0;
    }
    blurred[line * params.samples + sample] = sum / norm;
}
