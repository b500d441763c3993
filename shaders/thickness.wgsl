// Power average over the sub-planes, into the central one. Twin of src/imaging/effects/thickness.rs.
struct Params {
    weights: array<vec4<f32>, 3>,
    count: u32,
    planes: u32,
    samples: u32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read_write> amplitudes: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    var power = 0.0;
    for (var plane = 0u; plane < params.planes; plane++) {
        let a = amplitudes[plane * params.count + index];
        power += params.weights[plane >> 2u][plane & 3u] * a * a;
    }
    amplitudes[index] = sqrt(power);
}
