// Place of every sample in the world. Twin of src/imaging/effects/geometry.rs.
struct Params {
    probe_to_world: array<vec4<f32>, 3>,
    lines: u32,
    samples: u32,
    sample_mm: f32,
    plane_mm: f32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> positions: array<vec4<f32>>;

fn plane_step(plane: u32) -> i32 {
    let away = i32((plane + 1u) / 2u);
    return select(-away, away, plane % 2u == 1u);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let ray = rays[id.y];
    let s = (f32(id.x) + 0.5) * params.sample_mm;
    let z = f32(plane_step(id.z)) * params.plane_mm;
    let point = vec4<f32>(ray.xy + ray.zw * s, z, 1.0);
    let m = params.probe_to_world;
    let index = (id.z * params.lines + id.y) * params.samples + id.x;
    positions[index] = vec4<f32>(dot(m[0], point), dot(m[1], point), dot(m[2], point), 0.0);
}
