// World to reference position of every sample, through the tetrahedron it lies in. Twin of src/imaging/effects/warp.rs.
struct Params {
    lines: u32,
    samples: u32,
    unused: u32,
    deformed: u32,
    reference: u32,
    reference_at: u32,
    frames_at: u32,
    carries_at: u32,
}

const NONE: u32 = 0xffffffffu;
const GROUPS: u32 = 4096u;
// Samples that an invocation reads at once.
const TOGETHER: u32 = 4u;
const MAPPED: f32 = 0.0;
const BACKGROUND: f32 = 1.0;
const FOLDED: f32 = 2.0;
const OUTSIDE: f32 = 3.0;
// Flags of a hit: in an inverted element, in an element of the reference state.
const INVERTED: u32 = 1u;
const AT_REST: u32 = 2u;
const EPSILON: f32 = 1.1920929e-7;

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(2) var<storage, read> frames: array<vec4<f32>>;

// raster
@group(0) @binding(1) var<storage, read> world: array<vec4<f32>>;
// Of each sample the complement of the lowest slot, and the flags; cleared before every frame.
@group(0) @binding(3) var<storage, read_write> hits: array<atomic<u32>>;

// main
@group(0) @binding(1) var<storage, read_write> positions: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> found: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read_write> elements: array<u32>;

// Map to the barycentric coordinates of an element.
struct Element {
    origin: vec3<f32>,
    slack: f32,
    rows: array<vec3<f32>, 3>,
}

fn element(frame: u32) -> Element {
    let origin = frames[frame];
    return Element(
        origin.xyz,
        origin.w,
        array<vec3<f32>, 3>(frames[frame + 1u].xyz, frames[frame + 2u].xyz, frames[frame + 3u].xyz),
    );
}

fn barycentric(e: Element, p: vec3<f32>) -> vec4<f32> {
    let d = p - e.origin;
    let b1 = e.rows[0].x * d.x + e.rows[0].y * d.y + e.rows[0].z * d.z;
    let b2 = e.rows[1].x * d.x + e.rows[1].y * d.y + e.rows[1].z * d.z;
    let b3 = e.rows[2].x * d.x + e.rows[2].y * d.y + e.rows[2].z * d.z;
    return vec4<f32>(1.0 - b1 - b2 - b3, b1, b2, b3);
}

fn least(b: vec4<f32>) -> f32 {
    return min(min(b.x, b.y), min(b.z, b.w));
}

// Share of the way from the first sample of a scanline to its last that lies behind a sample.
fn along(sample: u32, first: u32, way: vec3<f32>) -> f32 {
    return dot(world[first + sample].xyz - world[first].xyz, way) / dot(way, way);
}

// First sample of a scanline that may lie in an element, and the one past the last: between the sign changes of its coordinates.
fn candidates(e: Element, first: u32) -> vec2<u32> {
    let last = params.samples - 1u;
    let ends = array<vec3<f32>, 2>(world[first].xyz, world[first + last].xyz);
    let steepest = length(e.rows[0]) + length(e.rows[1]) + length(e.rows[2]);
    let farthest = max(distance(ends[0], e.origin), distance(ends[1], e.origin));
    let allowed = 16.0 * (e.slack + EPSILON * steepest * farthest);
    let a = barycentric(e, ends[0]) + allowed;
    let b = barycentric(e, ends[1]) + allowed;
    if any((a < vec4<f32>(0.0)) & (b < vec4<f32>(0.0))) {
        return vec2<u32>(0u);
    }
    let crossing = a / (a - b);
    let from_each = select(vec4<f32>(0.0), crossing, (a < vec4<f32>(0.0)) & (b >= vec4<f32>(0.0)));
    let to_each = select(vec4<f32>(1.0), crossing, (a >= vec4<f32>(0.0)) & (b < vec4<f32>(0.0)));
    let start_at = max(max(from_each.x, from_each.y), max(from_each.z, from_each.w));
    let end_at = least(to_each);
    if start_at > end_at {
        return vec2<u32>(0u);
    }
    let way = ends[1] - ends[0];
    var start = u32(start_at * f32(last));
    while start > 0u && along(start, first, way) >= start_at {
        start--;
    }
    while start < last && along(start + 1u, first, way) < start_at {
        start++;
    }
    var end = min(u32(end_at * f32(last)) + 1u, last);
    while end < last && along(end, first, way) <= end_at {
        end++;
    }
    while end > start && along(end - 1u, first, way) > end_at {
        end--;
    }
    return vec2<u32>(start, end + 1u);
}

@compute @workgroup_size(64)
fn raster(@builtin(local_invocation_index) own: u32, @builtin(workgroup_id) group: vec3<u32>) {
    for (var at = group.x; at < params.deformed + params.reference; at += GROUPS) {
        let is_deformed = at < params.deformed;
        let slot = select(at - params.deformed, at, is_deformed);
        let frame = 4u * slot + select(params.reference_at, params.frames_at, is_deformed);
        let e = element(frame);
        let first_line = u32(frames[frame + 1u].w);
        let lines = u32(frames[frame + 3u].w) - first_line;
        let inverted = frames[frame + 2u].w != 0.0;
        for (var i = own; i < lines; i += 64u) {
            let first = (first_line + i) * params.samples;
            let near = candidates(e, first);
            let end = first + near.y;
            for (var at_once = first + near.x; at_once < end; at_once += TOGETHER) {
                // Read before they are tested, so that no read waits for a test.
                var points: array<vec3<f32>, TOGETHER>;
                for (var k = 0u; k < TOGETHER; k++) {
                    points[k] = world[min(at_once + k, end - 1u)].xyz;
                }
                for (var k = 0u; k < TOGETHER; k++) {
                    let sample = at_once + k;
                    if sample >= end || !(least(barycentric(e, points[k])) >= -e.slack) {
                        continue;
                    }
                    if !is_deformed {
                        atomicOr(&hits[2u * sample + 1u], AT_REST);
                        continue;
                    }
                    atomicMax(&hits[2u * sample], ~slot);
                    if inverted {
                        atomicOr(&hits[2u * sample + 1u], INVERTED);
                    }
                }
            }
        }
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let sample = id.y * params.samples + id.x;
    let hit = found[sample];
    let slot = ~hit.x;
    elements[sample] = slot;
    if slot == NONE {
        positions[sample].w = select(OUTSIDE, BACKGROUND, (hit.y & AT_REST) != 0u);
        return;
    }
    let d = positions[sample].xyz - frames[params.frames_at + 4u * slot].xyz;
    let carry = params.carries_at + 3u * slot;
    let x = frames[carry];
    let y = frames[carry + 1u];
    let z = frames[carry + 2u];
    positions[sample] = vec4<f32>(
        x.w + (x.x * d.x + x.y * d.y + x.z * d.z),
        y.w + (y.x * d.x + y.y * d.y + y.z * d.z),
        z.w + (z.x * d.x + z.y * d.y + z.z * d.z),
        select(MAPPED, FOLDED, (hit.y & INVERTED) != 0u),
    );
}
