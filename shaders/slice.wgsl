// Label and constant echo of every sample. Twin of src/imaging/effects/slice.rs.
struct Params {
    world_to_index: array<vec4<f32>, 3>,
    size: vec3<u32>,
    boundary: u32,
    lines: u32,
    samples: u32,
    mirrored: u32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> voxels: array<u32>;
@group(0) @binding(3) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(4) var<storage, read_write> labels: array<u32>;
@group(0) @binding(5) var<storage, read_write> amplitudes: array<f32>;

// Label of a corner of a cell, of which eight are packed into two words: local arrays that loops index may end up in memory.
fn corner(held: vec2<u32>, c: u32) -> u32 {
    return (select(held.x, held.y, c >= 4u) >> (8u * (c & 3u))) & 0xffu;
}

fn corner_weight(fraction: vec3<f32>, c: u32) -> f32 {
    let upper = vec3<bool>((c & 1u) == 1u, ((c >> 1u) & 1u) == 1u, (c >> 2u) == 1u);
    let w = select(1.0 - fraction, fraction, upper);
    return w.x * w.y * w.z;
}

fn majority(held: vec2<u32>, fraction: vec3<f32>) -> u32 {
    var best = corner(held, 0u);
    var best_share = 0.0;
    for (var c = 0u; c < 8u; c++) {
        let candidate = corner(held, c);
        var share = 0.0;
        for (var d = 0u; d < 8u; d++) {
            if corner(held, d) == candidate {
                share += corner_weight(fraction, d);
            }
        }
        if share > best_share || (share == best_share && candidate < best) {
            best = candidate;
            best_share = share;
        }
    }
    return best;
}

// Weights of the cubic B-spline on the four points around a fraction of a step, times 6.
fn spline(t: f32) -> vec4<f32> {
    let u = 1.0 - t;
    return vec4<f32>(u * u * u, 1.0 + 3.0 * u * (1.0 + t * u), 1.0 + 3.0 * t * (1.0 + t * u), t * t * t);
}

// B-spline weights of the voxels of a label around a cell.
fn share(base: vec3<i32>, fraction: vec3<f32>, candidate: u32) -> f32 {
    let x = spline(fraction.x);
    var y = spline(fraction.y);
    var z = spline(fraction.z);
    var sum = 0.0;
    for (var k = 0; k < 4; k++) {
        var slab = 0.0;
        for (var j = 0; j < 4; j++) {
            let at = base + vec3<i32>(-1, j - 1, k - 1);
            let row = vec4<u32>(
                voxel(at, params.size),
                voxel(at + vec3<i32>(1, 0, 0), params.size),
                voxel(at + vec3<i32>(2, 0, 0), params.size),
                voxel(at + vec3<i32>(3, 0, 0), params.size),
            );
            slab += y[j] * dot(select(vec4<f32>(0.0), x, row == vec4<u32>(candidate)), vec4<f32>(1.0));
        }
        sum += z[k] * slab;
    }
    return sum;
}

// Of the labels of a cell, the one with the largest share, from the nearest corner on.
fn smooth_label(base: vec3<i32>, held: vec2<u32>, fraction: vec3<f32>) -> u32 {
    let near = select(vec3<u32>(0u), vec3<u32>(1u, 2u, 4u), fraction > vec3<f32>(0.5));
    let nearest = near.x + near.y + near.z;
    var best = 0u;
    var best_share = -1.0;
    for (var c = 0u; c < 8u; c++) {
        let candidate = corner(held, nearest ^ c);
        var seen = false;
        for (var before = 0u; before < c; before++) {
            seen = seen || corner(held, nearest ^ before) == candidate;
        }
        if seen {
            continue;
        }
        let own = share(base, fraction, candidate);
        if own > best_share || (own == best_share && candidate < best) {
            best = candidate;
            best_share = own;
        }
        // More than half of all weights.
        if own > 108.0 {
            break;
        }
    }
    return best;
}

fn label_at(position: vec3<f32>) -> u32 {
    let m = params.world_to_index;
    let p = vec4<f32>(position, 1.0);
    let place = place_within(vec3<f32>(dot(m[0], p), dot(m[1], p), dot(m[2], p)) + 0.5, params.size, params.mirrored);
    if !place.known {
        return 0u;
    }
    if params.boundary == 0u {
        return voxel(vec3<i32>(place.shifted), params.size);
    }
    let index = place.shifted - 0.5;
    let base = vec3<i32>(index + 1.0) - 1;
    var held = vec2<u32>(0u);
    for (var c = 0u; c < 4u; c++) {
        let at = base + vec3<i32>(vec3<u32>(c & 1u, c >> 1u, 0u));
        held |= vec2<u32>(voxel(at, params.size), voxel(at + vec3<i32>(0, 0, 1), params.size)) << vec2<u32>(8u * c);
    }
    let first = corner(held, 0u);
    if all(held == vec2<u32>(first * 0x01010101u)) {
        return first;
    }
    let fraction = index - vec3<f32>(base);
    if params.boundary == 1u {
        return majority(held, fraction);
    }
    return smooth_label(base, held, fraction);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = (id.z * params.lines + id.y) * params.samples + id.x;
    let position = positions[index];
    var label = 0u;
    if position.w != 1.0 {
        label = label_at(position.xyz);
    }
    labels[index] = label;
    amplitudes[index] = label_rows[label].echo;
}
