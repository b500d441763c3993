// Skin conforms to the array. Twin of src/imaging/effects/contact.rs.
struct Params {
    probe_to_world: array<vec4<f32>, 3>,
    lines: u32,
    samples: u32,
    sample_mm: f32,
    per_fade: f32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> gaps: array<f32>;
@group(0) @binding(3) var<storage, read_write> positions: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let gap = gaps[id.y];
    let direction = rays[id.y].zw;
    let m = params.probe_to_world;
    let step = vec3<f32>(dot(m[0].xy, direction), dot(m[1].xy, direction), dot(m[2].xy, direction)) * gap;
    let s = (f32(id.x) + 0.5) * params.sample_mm;
    let left = max(1.0 - s * params.per_fade, 0.0);
    let index = id.y * params.samples + id.x;
    positions[index] += vec4<f32>(step * (left * left), 0.0);
}
