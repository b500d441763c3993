// Power average over the tissues beside the plane. Twin of src/imaging/effects/thickness.rs.
#import voxels

struct Params {
    world_to_index: array<vec4<f32>, 3>,
    elevation: vec4<f32>,
    size: vec3<u32>,
    carries_at: u32,
    mirrored: u32,
    samples: u32,
    on_side: u32,
    unused: u32,
}

const NONE: u32 = 0xffffffffu;

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> voxels: array<u32>;
@group(0) @binding(3) var<storage, read> labels: array<u32>;
// Rows over the samples: weight of the plane, then distance and weight of each sub-plane on either side; then the echo of each label.
@group(0) @binding(4) var<storage, read> sub_planes: array<f32>;
@group(0) @binding(5) var<storage, read_write> amplitudes: array<f32>;
@group(0) @binding(6) var<storage, read> elements: array<u32>;
@group(0) @binding(7) var<storage, read> element_maps: array<vec4<f32>>;

// Power of the echo of a sub-plane at a place, if that of the plane has a label and a power.
fn power_at(place: vec3<f32>, label: u32, power: f32) -> f32 {
    let m = params.world_to_index;
    let p = vec4<f32>(place, 1.0);
    let within = place_within(vec3<f32>(dot(m[0], p), dot(m[1], p), dot(m[2], p)) + 0.5, params.size, params.mirrored);
    var other = 0u;
    if within.known {
        other = voxel(vec3<i32>(within.shifted), params.size);
    }
    if other == label {
        return power;
    }
    let echo = sub_planes[(1u + 2u * params.on_side) * params.samples + other];
    return echo * echo;
}

// Averages over the sub-planes, in a direction in the reference state.
fn average(sample: u32, index: u32, direction: vec3<f32>) {
    let position = positions[index];
    // Background where tissue has moved away is background beside the plane, too.
    if position.w == 1.0 {
        return;
    }
    let label = labels[index];
    let power = amplitudes[index] * amplitudes[index];
    var sum = sub_planes[sample] * power;
    for (var pair = 0u; pair < params.on_side; pair++) {
        let row = (1u + 2u * pair) * params.samples + sample;
        let away = sub_planes[row] * direction;
        let weight = sub_planes[row + params.samples];
        sum += weight * power_at(position.xyz + away, label, power);
        sum += weight * power_at(position.xyz - away, label, power);
    }
    amplitudes[index] = sqrt(sum);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        average(id.x, id.y * params.samples + id.x, params.elevation.xyz);
    }
}

@compute @workgroup_size(64)
fn warped(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    var direction = params.elevation.xyz;
    if elements[index] != NONE {
        let map = params.carries_at + 3u * elements[index];
        direction = vec3<f32>(
            dot(element_maps[map].xyz, direction),
            dot(element_maps[map + 1u].xyz, direction),
            dot(element_maps[map + 2u].xyz, direction),
        );
    }
    average(id.x, index, direction);
}
