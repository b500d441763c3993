// Cumulative phase per half beam width, and focusing by its curvature per scanline: one workgroup each, parallel prefix sums.
// Twin of src/imaging/effects/refraction.rs.
#import label_row
#import prefix_sum
#import decaying_sum

struct Params {
    lines: u32,
    samples: u32,
    half: u32,
    unit: f32,
    spacing: f32,
    spreading: f32,
    least: f32,
    fading: f32,
}

@group(0) @binding(0) var<storage, read> params: Params;

// Phase pass.
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(3) var<storage, read_write> phases: array<u32>;

// Focusing pass.
@group(0) @binding(1) var<storage, read> phases_down: array<u32>;
@group(0) @binding(2) var<storage, read_write> amplitudes: array<f32>;

const MAX = 1.4;
const SCANLINE = 65536u;
const PARTS = 16u;

// Half beam widths side by side.
fn halves() -> u32 {
    return params.lines * SCANLINE / (2u * params.half) * 2u;
}

// Edge between half beam widths, 16ths of a scanline.
fn edge(number: u32) -> u32 {
    let first = (params.lines * SCANLINE - halves() * params.half) / 2u;
    return (first + number * params.half + SCANLINE / PARTS / 2u) / (SCANLINE / PARTS);
}

// Phase of a sample, averaged over the scanlines of half a beam width.
fn across(half: u32, sample: u32) -> u32 {
    let start = edge(half);
    let end = edge(half + 1u);
    var sum = (end - start) / 2u;
    for (var line = start / PARTS; line * PARTS < end; line++) {
        let parts = min(end, (line + 1u) * PARTS) - max(start, line * PARTS);
        sum += parts * label_rows[labels[line * params.samples + sample]].phase;
    }
    return sum / (end - start);
}

@compute @workgroup_size(256)
fn phase(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    var sum = 0u;
    for (var i = start; i < end; i++) {
        sum += across(group.y, i);
    }
    var above = exclusive(thread, sum);
    for (var i = start; i < end; i++) {
        above += across(group.y, i);
        phases[group.y * params.samples + i] = above;
    }
}

fn curvature(a: u32, b: u32, c: u32) -> f32 {
    return f32((i32(a) - i32(b)) - (i32(b) - i32(c)));
}

// Curvature of the phase at a sample, interpolated by `after` between two half beam widths, over their squared distance.
fn term(first: u32, after: f32, sample: u32) -> f32 {
    let a = phases_down[(first - 1u) * params.samples + sample];
    let b = phases_down[first * params.samples + sample];
    let c = phases_down[(first + 1u) * params.samples + sample];
    let d = phases_down[(first + 2u) * params.samples + sample];
    let lines = f32(params.half) / f32(SCANLINE);
    let apart = max(lines * (params.spacing + params.spreading * f32(sample)), params.least);
    let near = curvature(a, b, c);
    let far = curvature(b, c, d);
    return (near + after * (far - near)) * (params.unit / (apart * apart));
}

@compute @workgroup_size(256)
fn spread(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    let half = f32(params.half) / f32(SCANLINE);
    let place = (f32(group.y) - 0.5 * f32(params.lines - 1u)) / half + 0.5 * f32(halves() - 1u);
    let first = clamp(i32(place), 1, i32(halves()) - 3);
    let after = clamp(place - f32(first), 0.0, 1.0);
    let left = exp2(params.fading);
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        sum = sum * left + term(u32(first), after, i);
    }
    var above = decaying_sum(thread, sum, params.fading * f32(each));
    for (var i = start; i < end; i++) {
        above = above * left + term(u32(first), after, i);
        amplitudes[line + i] *= min(1.0 / abs(1.0 + above), MAX);
    }
}
