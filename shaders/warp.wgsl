// World to reference position of every sample, through the tetrahedron it lies in.
// The walk, its margins and the tie rule are those of the CPU locator, argued there.

struct Grid {
    origin: vec3<f32>,
    per_mm: f32,
    low: vec3<f32>,
    starts_at: u32,
    high: vec3<f32>,
    lists_at: u32,
    cells: vec3<u32>,
    frames_at: u32,
}

struct WarpParams {
    lines: u32,
    samples: u32,
    planes: u32,
    elements: u32,
    carries_at: u32,
    tangled: u32,
    deformed: Grid,
    reference: Grid,
}

struct Hit {
    element: u32,
    folded: bool,
}

const NONE: u32 = 0xffffffffu;
const TANGLED: u32 = 0x80000000u;
const MAX_WALK: u32 = 16u;
const MAPPED: f32 = 0.0;
const BACKGROUND: f32 = 1.0;
const FOLDED: f32 = 2.0;
const OUTSIDE: f32 = 3.0;

@group(0) @binding(0) var<storage, read> params: WarpParams;
@group(0) @binding(1) var<storage, read_write> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> last_elements: array<u32>;
@group(0) @binding(3) var<storage, read> frames: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> neighbours: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> starts: array<u32>;
@group(0) @binding(6) var<storage, read> lists: array<u32>;

fn is_finite(p: vec3<f32>) -> bool {
    return all((bitcast<vec3<u32>>(p) & vec3<u32>(0x7f800000u)) != vec3<u32>(0x7f800000u));
}

fn barycentric(frame: u32, p: vec3<f32>) -> vec4<f32> {
    let d = p - frames[frame].xyz;
    let r1 = frames[frame + 1u];
    let r2 = frames[frame + 2u];
    let r3 = frames[frame + 3u];
    let b1 = r1.x * d.x + r1.y * d.y + r1.z * d.z;
    let b2 = r2.x * d.x + r2.y * d.y + r2.z * d.z;
    let b3 = r3.x * d.x + r3.y * d.y + r3.z * d.z;
    return vec4<f32>(1.0 - b1 - b2 - b3, b1, b2, b3);
}

fn least(b: vec4<f32>) -> f32 {
    return min(min(b.x, b.y), min(b.z, b.w));
}

// The first place that holds the least coordinate.
fn least_place(b: vec4<f32>) -> u32 {
    let value = least(b);
    return select(select(select(3u, 2u, b.z == value), 1u, b.y == value), 0u, b.x == value);
}

fn in_bounds(grid: Grid, p: vec3<f32>) -> bool {
    return all(p >= grid.low) && all(p <= grid.high);
}

// Where the start of the list of the cell of p is kept.
fn cell_at(grid: Grid, p: vec3<f32>) -> u32 {
    let place = clamp((p - grid.origin) * grid.per_mm, vec3<f32>(0.0), vec3<f32>(grid.cells - vec3<u32>(1u)));
    let cell = vec3<u32>(place);
    return grid.starts_at + cell.x + grid.cells.x * (cell.y + grid.cells.y * cell.z);
}

// The lowest element that holds p, and whether an inverted one does.
fn scan(grid: Grid, p: vec3<f32>) -> Hit {
    var hit = Hit(NONE, false);
    if !in_bounds(grid, p) {
        return hit;
    }
    let at = cell_at(grid, p);
    let start = starts[at];
    let tangled = (start & TANGLED) != 0u;
    let end = starts[at + 1u] & ~TANGLED;
    for (var i = start & ~TANGLED; i < end; i++) {
        let element = lists[grid.lists_at + i];
        let frame = grid.frames_at + 4u * element;
        if least(barycentric(frame, p)) >= -frames[frame].w {
            if hit.element == NONE {
                hit.element = element;
            }
            hit.folded = hit.folded || frames[frame + 2u].w != 0.0;
            if !tangled || hit.folded {
                break;
            }
        }
    }
    return hit;
}

// An element that holds p and that no other start would change, or NONE.
fn walk(p: vec3<f32>, start: u32) -> u32 {
    var element = start;
    for (var step = 0u; step < MAX_WALK; step++) {
        if element >= params.elements {
            return NONE;
        }
        let frame = params.deformed.frames_at + 4u * element;
        let b = barycentric(frame, p);
        let slack = frames[frame].w;
        if least(b) >= -abs(slack) {
            let alone = least(b) > frames[frame + 1u].w && slack > 0.0;
            if !alone {
                return NONE;
            }
            if params.tangled != 0u && in_bounds(params.deformed, p) &&
                (starts[cell_at(params.deformed, p)] & TANGLED) != 0u {
                return NONE;
            }
            return element;
        }
        element = neighbours[element][least_place(b)];
    }
    return NONE;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let sample = id.x + id.y * groups.x * 64u;
    if sample >= params.lines * params.samples * params.planes {
        return;
    }
    let p = positions[sample].xyz;
    if !is_finite(p) {
        last_elements[sample] = NONE;
        positions[sample].w = OUTSIDE;
        return;
    }
    var hit = Hit(walk(p, last_elements[sample]), false);
    if hit.element == NONE {
        hit = scan(params.deformed, p);
    }
    last_elements[sample] = hit.element;
    if hit.element == NONE {
        positions[sample].w = select(BACKGROUND, OUTSIDE, scan(params.reference, p).element == NONE);
        return;
    }
    let d = p - frames[params.deformed.frames_at + 4u * hit.element].xyz;
    let carry = params.carries_at + 3u * hit.element;
    let x = frames[carry];
    let y = frames[carry + 1u];
    let z = frames[carry + 2u];
    positions[sample] = vec4<f32>(
        x.w + (x.x * d.x + x.y * d.y + x.z * d.z),
        y.w + (y.x * d.x + y.y * d.y + y.z * d.z),
        z.w + (z.x * d.x + z.y * d.y + z.z * d.z),
        select(MAPPED, FOLDED, hit.folded),
    );
}
