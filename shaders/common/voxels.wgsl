// Labels of a volume. The including shader declares `var<storage, read> voxels: array<u32>`, four labels to a word.

fn label_of(index: u32) -> u32 {
    return (voxels[index >> 2u] >> (8u * (index & 3u))) & 0xffu;
}

// Label of the voxel of the volume that is nearest to a voxel.
fn voxel(at: vec3<i32>, size: vec3<u32>) -> u32 {
    let p = vec3<u32>(clamp(at, vec3<i32>(0), vec3<i32>(size) - 1));
    return label_of(p.x + size.x * (p.y + size.y * p.z));
}

// The place in the volume that stands for a place (voxels, from the corner of the first), and the axes along which it is mirrored.
struct Within {
    shifted: vec3<f32>,
    mirrored: vec3<bool>,
    known: bool,
}

fn holds(shifted: vec3<f32>, size: vec3<f32>) -> bool {
    return all(shifted >= vec3<f32>(0.0)) && all(shifted < size);
}

fn place_within(shifted: vec3<f32>, voxels_along: vec3<u32>, mirror: u32) -> Within {
    let size = vec3<f32>(voxels_along);
    if holds(shifted, size) {
        return Within(shifted, vec3<bool>(false), true);
    }
    if mirror == 0u || voxel(vec3<i32>(clamp(shifted, vec3<f32>(0.0), size - 1.0)), voxels_along) == 0u {
        return Within(shifted, vec3<bool>(false), false);
    }
    let below = shifted < vec3<f32>(0.0);
    let above = shifted >= size;
    let beyond = min(2.0 * size - shifted, size - 1e-3);
    let folded = select(select(shifted, beyond, above), -shifted, below);
    return Within(folded, below | above, holds(folded, size));
}
