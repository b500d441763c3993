// Twin of src/base/random.rs.
fn pcg3d(input: vec3<u32>) -> vec3<u32> {
    var v = input * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3<u32>(16u);
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

fn hash3(point: vec3<i32>, seed: vec2<u32>) -> vec3<u32> {
    let p = bitcast<vec3<u32>>(point);
    return pcg3d(vec3<u32>(p.x ^ seed.x, p.y + seed.y, p.z ^ ((seed.x << 16u) | (seed.x >> 16u))));
}
