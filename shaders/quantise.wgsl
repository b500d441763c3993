// Grey levels to bytes, four to a word, rows padded to whole copies. Twin of src/imaging/effects/quantise.rs.
struct Params {
    width: u32,
    words_per_row: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read_write> pixels: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.words_per_row {
        return;
    }
    var word = 0u;
    for (var byte = 0u; byte < 4u; byte++) {
        let column = id.x * 4u + byte;
        if column < params.width {
            word |= u32(clamp(image[id.y * params.width + column] + 0.5, 0.0, 255.0)) << (8u * byte);
        }
    }
    pixels[id.y * params.words_per_row + id.x] = word;
}
