// Additive Gaussian noise on grey levels. Twin of src/imaging/effects/noise.rs.
#import hash

struct Params {
    seed: vec2<u32>,
    width: u32,
    first_row: u32,
    frame: u32,
    scale: f32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> scan_map: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> image: array<f32>;

fn upper_bytes(words: vec3<u32>) -> u32 {
    let pairs = (words >> vec3<u32>(24u)) + ((words >> vec3<u32>(16u)) & vec3<u32>(0xffu));
    return pairs.x + pairs.y + pairs.z;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.width {
        return;
    }
    let index = id.y * params.width + id.x;
    if scan_map[index].x < 0.0 {
        return;
    }
    let words = hash3(vec3<i32>(i32(id.x), i32(id.y + params.first_row), i32(params.frame)), params.seed);
    let deviate = i32(upper_bytes(words) + upper_bytes(pcg3d(words))) - 1530;
    image[index] = clamp(image[index] + f32(deviate) * params.scale, 0.0, 255.0);
}
