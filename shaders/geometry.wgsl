// Place of every sample in the world. Twin of src/imaging/effects/geometry.rs.
struct Params {
    probe_to_world: array<vec4<f32>, 3>,
    samples: u32,
    sample_mm: f32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> positions: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let ray = rays[id.y];
    let s = (f32(id.x) + 0.5) * params.sample_mm;
    let point = vec4<f32>(ray.xy + ray.zw * s, 0.0, 1.0);
    let m = params.probe_to_world;
    positions[id.y * params.samples + id.x] = vec4<f32>(dot(m[0], point), dot(m[1], point), dot(m[2], point), 0.0);
}
