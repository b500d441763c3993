// Ground truth at each sample. Twin of src/imaging/effects/truth.rs.
#import prefix_sum

struct Params {
    probe_to_world: array<vec4<f32>, 3>,
    world_to_index: array<vec4<f32>, 3>,
    // Place of each layer among those asked for.
    places: array<vec4<u32>, 3>,
    size: vec3<u32>,
    sample_mm: f32,
    lines: u32,
    samples: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read_write> layers: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> needle_mask: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> losses: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read> positions: array<vec4<f32>>;

const LABEL_VALUE = 0u;
const LABEL_INDEX = 1u;
const BEYOND = 3u;
const DISPLACEMENT = 4u;
const DEPTH = 5u;
const NEEDLE = 6u;
const LOSS = 7u;
const ORGAN = 8u;

fn put(layer: u32, line: u32, sample: u32, value: u32) {
    let place = params.places[layer >> 2u][layer & 3u];
    layers[(place * params.lines + line) * params.samples + sample] = min(value, 65535u);
}

fn rounded(value: f32) -> u32 {
    return u32(min(value + 0.5, 65535.0));
}

@compute @workgroup_size(64)
fn label_value(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        put(LABEL_VALUE, id.y, id.x, values[labels[id.y * params.samples + id.x]]);
    }
}

@compute @workgroup_size(64)
fn organ(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        put(ORGAN, id.y, id.x, values[labels[id.y * params.samples + id.x]]);
    }
}

@compute @workgroup_size(64)
fn label_index(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        put(LABEL_INDEX, id.y, id.x, labels[id.y * params.samples + id.x]);
    }
}

@compute @workgroup_size(64)
fn beyond(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    let p = vec4<f32>(positions[index].xyz, 1.0);
    let m = params.world_to_index;
    let voxel = floor(vec3<f32>(dot(m[0], p), dot(m[1], p), dot(m[2], p)) + 0.5);
    let inside = all(voxel >= vec3<f32>(0.0)) && all(voxel < vec3<f32>(params.size));
    put(BEYOND, id.y, id.x, select(0u, 1u, labels[index] > 0u && !inside));
}

@compute @workgroup_size(64)
fn displacement(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let ray = rays[id.y];
    let s = (f32(id.x) + 0.5) * params.sample_mm;
    let point = vec4<f32>(ray.xy + ray.zw * s, 0.0, 1.0);
    let m = params.probe_to_world;
    let world = vec3<f32>(dot(m[0], point), dot(m[1], point), dot(m[2], point));
    put(DISPLACEMENT, id.y, id.x, rounded(100.0 * distance(world, positions[id.y * params.samples + id.x].xyz)));
}

@compute @workgroup_size(256)
fn depth(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    var sum = 0u;
    for (var i = start; i < end; i++) {
        sum += min(labels[line + i], 1u);
    }
    var passed = exclusive(thread, sum);
    for (var i = start; i < end; i++) {
        passed += min(labels[line + i], 1u);
        put(DEPTH, group.y, i, rounded(10.0 * f32(passed) * params.sample_mm));
    }
}

@compute @workgroup_size(64)
fn needle(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        put(NEEDLE, id.y, id.x, rounded(255.0 * needle_mask[id.y * params.samples + id.x].x));
    }
}

// Units of a loss per decibel, a power of 2.
const UNITS_SHIFT = 20u;

@compute @workgroup_size(64)
fn loss(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let units = losses[id.y * params.samples + id.x];
    let rest = units & ((1u << UNITS_SHIFT) - 1u);
    put(LOSS, id.y, id.x, 100u * (units >> UNITS_SHIFT) + ((100u * rest + (1u << (UNITS_SHIFT - 1u))) >> UNITS_SHIFT));
}
