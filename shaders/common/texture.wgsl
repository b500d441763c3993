// Solid textures: trilinear look-up in the atlas, periodic along each axis. The including shader declares
// `var<storage, read> atlas: array<f32>` and `var<storage, read> entries: array<TextureEntry>`.

struct TextureEntry {
    // Rows that take a world position in mm to a fractional voxel index; the fourth number pads.
    to_voxel_x: vec4<f32>,
    to_voxel_y: vec4<f32>,
    to_voxel_z: vec4<f32>,
    // Voxels along each axis.
    size: vec3<u32>,
    // Place of voxel (0, 0, 0) in the atlas.
    offset: u32,
}

fn row_times(row: vec4<f32>, position: vec3<f32>) -> f32 {
    return row.x * position.x + row.y * position.y + row.z * position.z;
}

fn lerp(a: f32, b: f32, t: f32) -> f32 {
    return a + t * (b - a);
}

// The amplitude multiplier at a world position, mm.
fn sample_texture(entry: TextureEntry, position: vec3<f32>) -> f32 {
    let index = vec3<f32>(
        row_times(entry.to_voxel_x, position),
        row_times(entry.to_voxel_y, position),
        row_times(entry.to_voxel_z, position),
    );
    let whole = floor(index);
    let share = index - whole;
    let size = vec3<i32>(entry.size);
    // The remainder keeps the sign of its dividend.
    let remainder = vec3<i32>(whole) % size;
    let near = vec3<u32>(select(remainder, remainder + size, remainder < vec3<i32>(0)));
    let far = select(near + 1u, vec3<u32>(0u), near + 1u == entry.size);

    let row = entry.size.x;
    let slab = entry.size.x * entry.size.y;
    let j_near = entry.offset + near.y * row;
    let j_far = entry.offset + far.y * row;
    let k_near = near.z * slab;
    let k_far = far.z * slab;
    let near_near = lerp(atlas[near.x + j_near + k_near], atlas[far.x + j_near + k_near], share.x);
    let far_near = lerp(atlas[near.x + j_far + k_near], atlas[far.x + j_far + k_near], share.x);
    let near_far = lerp(atlas[near.x + j_near + k_far], atlas[far.x + j_near + k_far], share.x);
    let far_far = lerp(atlas[near.x + j_far + k_far], atlas[far.x + j_far + k_far], share.x);
    return lerp(lerp(near_near, far_near, share.y), lerp(near_far, far_far, share.y), share.z);
}
