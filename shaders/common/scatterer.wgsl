#import hash

// Complex values of unit mean power on a lattice.
fn centred(words: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(vec2<i32>(words >> vec2<u32>(16u)) - 32768) + 0.5;
}

// At a position in lattice units: the eight around it, linearly weighted, over the root of the sum of the squared weights.
fn scatterer(p: vec3<f32>, seed: vec2<u32>) -> vec2<f32> {
    let cut = vec3<i32>(p);
    let base = cut - select(vec3<i32>(0), vec3<i32>(1), p < vec3<f32>(cut));
    let f = p - vec3<f32>(base);
    let g = 1.0 - f;
    var sum = vec2<f32>(0.0);
    for (var corner = 0u; corner < 8u; corner++) {
        let bits = vec3<u32>(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        let side = select(g, f, bits == vec3<u32>(1u));
        sum += side.x * side.y * side.z * centred(hash3(base + vec3<i32>(bits), seed).xy);
    }
    let square = f * f + g * g;
    return sum * sqrt(6.0 / 65536.0 / 65536.0 / (square.x * square.y * square.z));
}
