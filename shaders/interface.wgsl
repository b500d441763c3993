// Specular echoes where the label changes along a scanline. Twin of src/imaging/effects/interface.rs.
#import label_row
#import power
#import scatterer
#import voxels

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
    steered: u32,
    elevation: vec4<f32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(4) var<storage, read> voxels: array<u32>;

// main
@group(0) @binding(5) var<storage, read_write> amplitudes: array<f32>;

// before_speckle and of_looks
@group(0) @binding(5) var<storage, read_write> specular: array<vec2<f32>>;

// of_looks
@group(0) @binding(6) var<storage, read> directions: array<vec2<f32>>;
// Per scanline, look and sample: by how much its echo exceeds that of the middle look.
@group(0) @binding(7) var<storage, read_write> look_specular: array<vec2<f32>>;

const REACH = 3;
const PER_SQUARE = 1.0 / f32(REACH * REACH);
// The voxels around a place along an axis, by their distance from the one below it.
const LOW = vec3<f32>(-2.0, -1.0, 0.0);
const HIGH = vec3<f32>(1.0, 2.0, 3.0);

fn voxel_index(position: vec3<f32>) -> vec3<f32> {
    let m = params.world_to_index;
    let p = vec4<f32>(position, 1.0);
    return vec3<f32>(dot(m[0], p), dot(m[1], p), dot(m[2], p));
}

// 1 for the label `far`, -1 for `near`, 0 for others.
fn signs(held: vec3<u32>, near: u32, far: u32) -> vec3<f32> {
    return vec3<f32>(held == vec3<u32>(far)) - vec3<f32>(held == vec3<u32>(near));
}

fn labels_at(indices: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(label_of(indices.x), label_of(indices.y), label_of(indices.z));
}

// Columns of a neighbourhood in halves, with their weights and the slopes of these.
struct Columns {
    at: array<vec3<u32>, 2>,
    weights: array<vec3<f32>, 2>,
    slopes: array<vec3<f32>, 2>,
}

// Sums over a row of how far the label `far` outweighs `near`: of slopes, and of weights.
fn row_sums(columns: Columns, row: u32, near: u32, far: u32) -> vec2<f32> {
    let a = signs(labels_at(columns.at[0] + row), near, far);
    let b = signs(labels_at(columns.at[1] + row), near, far);
    return vec2<f32>(
        dot(columns.slopes[0], a) + dot(columns.slopes[1], b),
        dot(columns.weights[0], a) + dot(columns.weights[1], b),
    );
}

fn row_share(sums: vec2<f32>, y: f32) -> vec3<f32> {
    let rest = 1.0 - y * y * PER_SQUARE;
    return vec3<f32>(sums.x * (rest * rest), sums.y * (y * rest), sums.y * (rest * rest));
}

// Gradient, in voxels, of how far the label `far` outweighs `near` around a position. The rows of a slab without a loop, so that reads need
// not wait for one another.
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
    let last = vec3<i32>(params.size) - 1;
    let x = array<vec3<f32>, 2>(LOW - fraction.x, HIGH - fraction.x);
    let rest = array<vec3<f32>, 2>(1.0 - x[0] * x[0] * PER_SQUARE, 1.0 - x[1] * x[1] * PER_SQUARE);
    let columns = Columns(
        array<vec3<u32>, 2>(
            vec3<u32>(clamp((base.x + vec3<i32>(LOW)) * step.x, vec3<i32>(0), last.xxx)),
            vec3<u32>(clamp((base.x + vec3<i32>(HIGH)) * step.x, vec3<i32>(0), last.xxx)),
        ),
        array<vec3<f32>, 2>(rest[0] * rest[0], rest[1] * rest[1]),
        array<vec3<f32>, 2>(x[0] * rest[0], x[1] * rest[1]),
    );
    let low = vec3<u32>(clamp((base.y + vec3<i32>(LOW)) * step.y, vec3<i32>(0), last.yyy)) * params.size.x;
    let high = vec3<u32>(clamp((base.y + vec3<i32>(HIGH)) * step.y, vec3<i32>(0), last.yyy)) * params.size.x;
    var sum = vec3<f32>(0.0);
    for (var k = 1 - REACH; k <= REACH; k++) {
        let slab = u32(clamp((base.z + k) * step.z, 0, last.z)) * (params.size.x * params.size.y);
        let over_rows = row_share(row_sums(columns, slab + low.x, near, far), LOW.x - fraction.y)
            + row_share(row_sums(columns, slab + low.y, near, far), LOW.y - fraction.y)
            + row_share(row_sums(columns, slab + low.z, near, far), LOW.z - fraction.y)
            + row_share(row_sums(columns, slab + high.x, near, far), HIGH.x - fraction.y)
            + row_share(row_sums(columns, slab + high.y, near, far), HIGH.y - fraction.y)
            + row_share(row_sums(columns, slab + high.z, near, far), HIGH.z - fraction.y);
        let z = f32(k) - fraction.z;
        let rest = 1.0 - z * z * PER_SQUARE;
        sum += over_rows * vec3<f32>(rest * rest, rest * rest, z * rest);
    }
    return select(sum, -sum, place.mirrored) / stride;
}

// Cosines of the angles of the normal of a boundary with the beam and with the direction across it.
fn incidence_of(near: u32, far: u32, before: vec3<f32>, after: vec3<f32>) -> vec2<f32> {
    let slope = gradient(near, far, after);
    let m = params.world_to_index;
    let along = dot(slope, voxel_index(after) - voxel_index(before));
    let steep = m[0].xyz * slope.x + m[1].xyz * slope.y + m[2].xyz * slope.z;
    let step = after - before;
    let product = sqrt(dot(steep, steep) * dot(step, step));
    let both = vec2<f32>(along, dot(steep, cross(step, params.elevation.xyz))) / product;
    return select(vec2<f32>(0.0), both, product > 0.0);
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

// The surface at a step of labels: half its echo at perpendicular incidence, its complex multiplier, and the cosines of its incidence.
struct Surface {
    size: f32,
    rough: vec2<f32>,
    incidence: vec2<f32>,
}

// The surface between a sample and the one above.
fn surface(line: u32, below: u32) -> Surface {
    let none = Surface(0.0, vec2<f32>(0.0), vec2<f32>(0.0));
    if !is_step(line, below) {
        return none;
    }
    let index = line * params.samples + below;
    let near = labels[index - 1u];
    let far = labels[index];
    let reflected = coefficient(near, far);
    if reflected == 0.0 {
        return none;
    }
    let at = positions[index].xyz;
    let rough = vec2<f32>(params.steady, 0.0) + params.diffuse * scatterer(at * params.per_mm, params.seed);
    return Surface(0.5 * params.mirror * reflected, rough, incidence_of(near, far, positions[index - 1u].xyz, at));
}

// Half the echo of a surface met along a direction: cosine and sine of its angle with the scanline.
fn echo(met: Surface, direction: vec2<f32>) -> vec2<f32> {
    if met.size == 0.0 {
        return vec2<f32>(0.0);
    }
    let square = min(abs(met.incidence.x * direction.x + met.incidence.y * direction.y), 1.0);
    return met.size * power(square, params.directivity) * met.rough;
}

const MIDDLE = vec2<f32>(1.0, 0.0);

// The surfaces of a sample, at the step above and at the one below. Few have both; invocations with either run together.
fn surfaces(line: u32, sample: u32) -> array<Surface, 2> {
    let above = is_step(line, sample);
    let first = surface(line, select(sample + 1u, sample, above));
    var second = Surface(0.0, vec2<f32>(0.0), vec2<f32>(0.0));
    if above {
        second = surface(line, sample + 1u);
    }
    return array<Surface, 2>(first, second);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        let both = surfaces(id.y, id.x);
        amplitudes[id.y * params.samples + id.x] += length(echo(both[0], MIDDLE)) + length(echo(both[1], MIDDLE));
    }
}

@compute @workgroup_size(64)
fn before_speckle(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        let both = surfaces(id.y, id.x);
        specular[id.y * params.samples + id.x] = echo(both[0], MIDDLE) + echo(both[1], MIDDLE);
    }
}

// Direction of a look at a sample.
fn direction_of(look: u32, sample: u32) -> vec2<f32> {
    let towards = directions[look / 2u * params.samples + min(sample, params.samples - 1u)];
    return select(vec2<f32>(towards.x, -towards.y), towards, (look & 1u) == 1u);
}

@compute @workgroup_size(64)
fn of_looks(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let both = surfaces(id.y, id.x);
    let middle = array<vec2<f32>, 2>(echo(both[0], MIDDLE), echo(both[1], MIDDLE));
    specular[id.y * params.samples + id.x] = middle[0] + middle[1];
    // The first is the step above if there is one.
    let above = is_step(id.y, id.x);
    for (var look = 0u; look < params.steered; look++) {
        let first = echo(both[0], direction_of(look, select(id.x + 1u, id.x, above)));
        let second = echo(both[1], direction_of(look, id.x + 1u));
        let more = (first - middle[0]) + (second - middle[1]);
        look_specular[(id.y * params.steered + look) * params.samples + id.x] = more;
    }
}
