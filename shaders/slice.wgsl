// Label and constant echo of every sample. Twin of src/effects/slice.rs.
struct Params {
    world_to_index: array<vec4<f32>, 3>,
    size: vec3<u32>,
    vote: u32,
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

fn voxel(at: vec3<i32>) -> u32 {
    let p = vec3<u32>(clamp(at, vec3<i32>(0), vec3<i32>(params.size) - 1));
    let index = p.x + params.size.x * (p.y + params.size.y * p.z);
    return (voxels[index >> 2u] >> (8u * (index & 3u))) & 0xffu;
}

fn majority(corners: array<u32, 8>, fraction: vec3<f32>) -> u32 {
    var held = corners;
    var weights: array<f32, 8>;
    for (var c = 0u; c < 8u; c++) {
        let upper = vec3<bool>((c & 1u) == 1u, ((c >> 1u) & 1u) == 1u, (c >> 2u) == 1u);
        let w = select(1.0 - fraction, fraction, upper);
        weights[c] = w.x * w.y * w.z;
    }
    var best = held[0];
    var best_share = 0.0;
    for (var c = 0u; c < 8u; c++) {
        let candidate = held[c];
        var share = 0.0;
        for (var d = 0u; d < 8u; d++) {
            if held[d] == candidate {
                share += weights[d];
            }
        }
        if share > best_share || (share == best_share && candidate < best) {
            best = candidate;
            best_share = share;
        }
    }
    return best;
}

fn holds(shifted: vec3<f32>) -> bool {
    return all(shifted >= vec3<f32>(0.0)) && all(shifted < vec3<f32>(params.size));
}

fn label_at(position: vec3<f32>) -> u32 {
    let m = params.world_to_index;
    let p = vec4<f32>(position, 1.0);
    var index = vec3<f32>(dot(m[0], p), dot(m[1], p), dot(m[2], p));
    var shifted = index + 0.5;
    if !holds(shifted) {
        let size = vec3<f32>(params.size);
        if params.mirrored == 0u || voxel(vec3<i32>(clamp(shifted, vec3<f32>(0.0), size - 1.0))) == 0u {
            return 0u;
        }
        let beyond = min(2.0 * size - shifted, size - 1e-3);
        shifted = select(select(shifted, beyond, shifted >= size), -shifted, shifted < vec3<f32>(0.0));
        if !holds(shifted) {
            return 0u;
        }
        index = shifted - 0.5;
    }
    if params.vote == 0u {
        return voxel(vec3<i32>(shifted));
    }
    let base = vec3<i32>(index + 1.0) - 1;
    var corners: array<u32, 8>;
    var same = true;
    for (var c = 0u; c < 8u; c++) {
        corners[c] = voxel(base + vec3<i32>(vec3<u32>(c & 1u, (c >> 1u) & 1u, c >> 2u)));
        same = same && corners[c] == corners[0];
    }
    if same {
        return corners[0];
    }
    return majority(corners, index - vec3<f32>(base));
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
