// Beam space to pixels. Twin of src/imaging/effects/scan_conversion.rs.
struct Params {
    width: u32,
    lines: u32,
    samples: u32,
    fill: f32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> beam: array<f32>;
@group(0) @binding(2) var<storage, read> scan_map: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read_write> image: array<f32>;

fn bilinear(at: vec2<f32>) -> f32 {
    let l0 = u32(at.x);
    let s0 = u32(at.y);
    let l1 = min(l0 + 1u, params.lines - 1u);
    let s1 = min(s0 + 1u, params.samples - 1u);
    let a = at.x - f32(l0);
    let b = at.y - f32(s0);
    let n0 = beam[l0 * params.samples + s0];
    let n1 = beam[l0 * params.samples + s1];
    let f0 = beam[l1 * params.samples + s0];
    let f1 = beam[l1 * params.samples + s1];
    let near = n0 + b * (n1 - n0);
    let far = f0 + b * (f1 - f0);
    return near + a * (far - near);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.width {
        return;
    }
    let index = id.y * params.width + id.x;
    let at = scan_map[index];
    var grey = params.fill;
    if at.x >= 0.0 {
        grey = bilinear(at);
    }
    image[index] = grey;
}
