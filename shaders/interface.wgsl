// Specular echoes where the label changes along a scanline. Twin of src/imaging/effects/interface.rs.
struct Params {
    world_to_index: array<vec4<f32>, 3>,
    size: vec3<u32>,
    mirrored: u32,
    stride: vec3<u32>,
    samples: u32,
    seed: vec2<u32>,
    mirror: f32,
    directivity: f32,
    steady: f32,
    diffuse: f32,
    per_mm: f32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(4) var<storage, read> voxels: array<u32>;

// main
@group(0) @binding(5) var<storage, read_write> amplitudes: array<f32>;

// before_speckle
@group(0) @binding(5) var<storage, read_write> specular: array<vec2<f32>>;

const REACH = 3;

fn voxel_index(position: vec3<f32>) -> vec3<f32> {
    let m = params.world_to_index;
    let p = vec4<f32>(position, 1.0);
    return vec3<f32>(dot(m[0], p), dot(m[1], p), dot(m[2], p));
}

// Gradient, in voxels, of how far the label `far` outweighs `near` around a position.
fn gradient(near: u32, far: u32, position: vec3<f32>) -> vec3<f32> {
    let place = place_within(voxel_index(position) + 0.5, params.size, params.mirrored);
    if !place.known {
        return vec3<f32>(0.0);
    }
    let stride = vec3<f32>(params.stride);
    let at = (place.shifted - 0.5) / stride;
    let base = vec3<i32>(at + 1.0) - 1;
    let fraction = at - vec3<f32>(base);
    let step = vec3<i32>(params.stride);
    var sum = vec3<f32>(0.0);
    for (var k = 1 - REACH; k <= REACH; k++) {
        for (var j = 1 - REACH; j <= REACH; j++) {
            for (var i = 1 - REACH; i <= REACH; i++) {
                let tap = vec3<i32>(i, j, k);
                let label = voxel((base + tap) * step, params.size);
                if label == far || label == near {
                    let x = vec3<f32>(tap) - fraction;
                    let rest = 1.0 - x * x * (1.0 / f32(REACH * REACH));
                    let w = rest * rest;
                    let slope = x * rest;
                    let all = vec3<f32>(slope.x * w.y * w.z, w.x * slope.y * w.z, w.x * w.y * slope.z);
                    sum += select(-all, all, label == far);
                }
            }
        }
    }
    return select(sum, -sum, place.mirrored) / stride;
}

// Cosine of the angle between the normal of a boundary and the beam.
fn cosine(near: u32, far: u32, before: vec3<f32>, after: vec3<f32>) -> f32 {
    let slope = gradient(near, far, after);
    let m = params.world_to_index;
    let along = dot(slope, voxel_index(after) - voxel_index(before));
    let steep = m[0].xyz * slope.x + m[1].xyz * slope.y + m[2].xyz * slope.z;
    let step = after - before;
    let product = sqrt(dot(steep, steep) * dot(step, step));
    return select(0.0, min(abs(along) / product, 1.0), product > 0.0);
}

fn coefficient(near: u32, far: u32) -> f32 {
    let a = label_rows[near];
    let b = label_rows[far];
    let total = a.impedance + b.impedance;
    let step = select(0.0, abs(a.impedance - b.impedance) / total, total > 0.0);
    return max(step, abs(a.capsule - b.capsule));
}

fn is_step(line: u32, below: u32) -> bool {
    let index = line * params.samples + below;
    return below > 0u && below < params.samples && labels[index - 1u] != labels[index];
}

// Half the echo of the step of labels between a sample and the one above.
fn echo(line: u32, below: u32) -> vec2<f32> {
    if !is_step(line, below) {
        return vec2<f32>(0.0);
    }
    let index = line * params.samples + below;
    let near = labels[index - 1u];
    let far = labels[index];
    let reflected = coefficient(near, far);
    if reflected == 0.0 {
        return vec2<f32>(0.0);
    }
    let at = positions[index].xyz;
    let square = cosine(near, far, positions[index - 1u].xyz, at);
    let size = 0.5 * params.mirror * reflected * power(square, params.directivity);
    let rough = scatterer(at * params.per_mm, params.seed);
    return size * (vec2<f32>(params.steady, 0.0) + params.diffuse * rough);
}

// The halves of a sample, of the step above and the one below. Few have both; invocations with either run together.
fn halves(line: u32, sample: u32) -> vec4<f32> {
    let above = is_step(line, sample);
    let first = echo(line, select(sample + 1u, sample, above));
    var second = vec2<f32>(0.0);
    if above {
        second = echo(line, sample + 1u);
    }
    return vec4<f32>(first, second);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        let both = halves(id.y, id.x);
        amplitudes[id.y * params.samples + id.x] += length(both.xy) + length(both.zw);
    }
}

@compute @workgroup_size(64)
fn before_speckle(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        let both = halves(id.y, id.x);
        specular[id.y * params.samples + id.x] = both.xy + both.zw;
    }
}
