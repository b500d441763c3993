// Label and constant echo of every sample. Twin of src/imaging/effects/slice.rs.
#import label_row
#import voxels

struct Params {
    world_to_index: array<vec4<f32>, 3>,
    size: vec3<u32>,
    boundary: u32,
    samples: u32,
    mirrored: u32,
    unused: vec2<u32>,
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

// Indices of the four voxels around a place along each axis, in voxels of the volume.
struct Around {
    columns: vec4<u32>,
    rows: vec4<u32>,
    slabs: vec4<u32>,
}

fn around(base: vec3<i32>) -> Around {
    const STEPS = vec4<i32>(-1, 0, 1, 2);
    let size = vec3<i32>(params.size);
    let x = clamp(base.x + STEPS, vec4<i32>(0), vec4<i32>(size.x - 1));
    let y = clamp(base.y + STEPS, vec4<i32>(0), vec4<i32>(size.y - 1));
    let z = clamp(base.z + STEPS, vec4<i32>(0), vec4<i32>(size.z - 1));
    return Around(vec4<u32>(x), vec4<u32>(y * size.x), vec4<u32>(z * (size.x * size.y)));
}

fn row_share(columns: vec4<u32>, row: u32, x: vec4<f32>, candidate: u32) -> f32 {
    let at = columns + row;
    let held = vec4<u32>(label_of(at.x), label_of(at.y), label_of(at.z), label_of(at.w));
    return dot(select(vec4<f32>(0.0), x, held == vec4<u32>(candidate)), vec4<f32>(1.0));
}

fn slab_share(at: Around, slab: u32, x: vec4<f32>, y: vec4<f32>, candidate: u32) -> f32 {
    let rows = at.rows + slab;
    return y.x * row_share(at.columns, rows.x, x, candidate) + y.y * row_share(at.columns, rows.y, x, candidate)
        + y.z * row_share(at.columns, rows.z, x, candidate) + y.w * row_share(at.columns, rows.w, x, candidate);
}

// B-spline weights of the voxels of a label around a cell. Without loops, so that reads need not wait for one another.
fn share(at: Around, fraction: vec3<f32>, candidate: u32) -> f32 {
    let x = spline(fraction.x);
    let y = spline(fraction.y);
    let z = spline(fraction.z);
    return z.x * slab_share(at, at.slabs.x, x, y, candidate) + z.y * slab_share(at, at.slabs.y, x, y, candidate)
        + z.z * slab_share(at, at.slabs.z, x, y, candidate) + z.w * slab_share(at, at.slabs.w, x, y, candidate);
}

// Labels of four corners of a cell, packed.
fn corners(at: Around, slab: u32) -> u32 {
    let near = at.columns.yz + (at.rows.y + slab);
    let far = at.columns.yz + (at.rows.z + slab);
    return label_of(near.x) | (label_of(near.y) << 8u) | (label_of(far.x) << 16u) | (label_of(far.y) << 24u);
}

// Of the labels of a cell, the one with the largest share, from the nearest corner on.
fn smooth_label(at: Around, held: vec2<u32>, fraction: vec3<f32>) -> u32 {
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
        let own = share(at, fraction, candidate);
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
    let at = around(base);
    let held = vec2<u32>(corners(at, at.slabs.y), corners(at, at.slabs.z));
    let first = corner(held, 0u);
    if all(held == vec2<u32>(first * 0x01010101u)) {
        return first;
    }
    let fraction = index - vec3<f32>(base);
    if params.boundary == 1u {
        return majority(held, fraction);
    }
    return smooth_label(at, held, fraction);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    let position = positions[index];
    var label = 0u;
    if position.w != 1.0 {
        label = label_at(position.xyz);
    }
    labels[index] = label;
    amplitudes[index] = label_rows[label].echo;
}
