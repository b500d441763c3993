// Cumulative phase per half beam width, and focusing by its curvature per scanline, or per ray of a look and then per sample.
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
    steered: u32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;

// Phase pass.
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(3) var<storage, read_write> phases: array<u32>;

// Straight beams.
@group(0) @binding(1) var<storage, read> phases_down: array<u32>;
@group(0) @binding(2) var<storage, read_write> amplitudes: array<f32>;

// Rays of looks, and their mean.
@group(0) @binding(2) var<storage, read> shifts: array<i32>;
@group(0) @binding(3) var<storage, read_write> curvatures: array<f32>;
@group(0) @binding(1) var<storage, read> curvatures_down: array<f32>;
@group(0) @binding(3) var<storage, read_write> mean_amplitudes: array<f32>;

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

fn second_difference(a: u32, b: u32, c: u32) -> i32 {
    return (i32(a) - i32(b)) - (i32(b) - i32(c));
}

// Term of the sum per unit of curvature.
fn scale(sample: u32) -> f32 {
    let lines = f32(params.half) / f32(SCANLINE);
    let apart = max(lines * (params.spacing + params.spreading * f32(sample)), params.least);
    return params.unit / (apart * apart);
}

fn gain(sum: f32) -> f32 {
    return min(1.0 / abs(1.0 + sum), MAX);
}

// Position of a scanline among the half beam widths.
fn place(line: i32) -> f32 {
    let half = f32(params.half) / f32(SCANLINE);
    return (f32(line) - 0.5 * f32(params.lines - 1u)) / half + 0.5 * f32(halves() - 1u);
}

// Curvature of the phase at a sample, interpolated by `after` between two half beam widths, over their squared distance.
fn term(first: u32, after: f32, sample: u32) -> f32 {
    let a = phases_down[(first - 1u) * params.samples + sample];
    let b = phases_down[first * params.samples + sample];
    let c = phases_down[(first + 1u) * params.samples + sample];
    let d = phases_down[(first + 2u) * params.samples + sample];
    let near = f32(second_difference(a, b, c));
    let far = f32(second_difference(b, c, d));
    return (near + after * (far - near)) * scale(sample);
}

@compute @workgroup_size(256)
fn straight(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    let position = place(i32(group.y));
    let first = clamp(i32(position), 1, i32(halves()) - 3);
    let after = clamp(position - f32(first), 0.0, 1.0);
    let left = exp2(params.fading);
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        sum = sum * left + term(u32(first), after, i);
    }
    var above = decaying_sum(thread, sum, params.fading * f32(each));
    for (var i = start; i < end; i++) {
        above = above * left + term(u32(first), after, i);
        amplitudes[line + i] *= gain(above);
    }
}

// Phase of a sample itself.
fn increment(half: i32, sample: u32) -> u32 {
    let at = u32(half) * params.samples + sample;
    if sample == 0u {
        return phases_down[at];
    }
    return phases_down[at] - phases_down[at - 1u];
}

// Scanlines to a sample from the element of a look, the middle one first.
fn shift(look: u32, sample: u32) -> i32 {
    if look == 0u {
        return 0;
    }
    let aside = shifts[(look + 1u) / 2u * params.samples + sample];
    return select(aside, -aside, (look & 1u) == 1u);
}

// Curvature of a sample's own phase where a ray of a half beam width crosses it.
fn own_curvature(look: u32, half: u32, sample: u32) -> i32 {
    let position = i32(half * PARTS) + shift(look, sample) * i32(SCANLINE) / i32(params.half / PARTS);
    let first = clamp(position >> 4u, 1, i32(halves()) - 3);
    let after = clamp(position - first * i32(PARTS), 0, i32(PARTS));
    let b = increment(first, sample);
    let c = increment(first + 1, sample);
    let near = second_difference(increment(first - 1, sample), b, c);
    let far = second_difference(b, c, increment(first + 2, sample));
    return near + ((far - near) >> 4u) * after;
}

@compute @workgroup_size(256)
fn rays(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let look = group.y / halves();
    let half = group.y % halves();
    // One way and the other: prefix sums are those of numbers that are not negative.
    var each_way = vec2<u32>();
    for (var i = start; i < end; i++) {
        let here = own_curvature(look, half, i);
        each_way += vec2<u32>(u32(max(here, 0)), u32(max(-here, 0)));
    }
    let down_above = i32(exclusive(thread, each_way.x)) - i32(exclusive(thread, each_way.y));
    let left = exp2(params.fading);
    var down = down_above;
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        down += own_curvature(look, half, i);
        sum = sum * left + f32(down) * scale(i);
    }
    var above = decaying_sum(thread, sum, params.fading * f32(each));
    down = down_above;
    for (var i = start; i < end; i++) {
        down += own_curvature(look, half, i);
        above = above * left + f32(down) * scale(i);
        curvatures[group.y * params.samples + i] = above;
    }
}

@compute @workgroup_size(64)
fn mean(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    var sum = 0.0;
    var count = 0.0;
    for (var look = 0u; look <= params.steered; look++) {
        let element = i32(id.y) - shift(look, id.x);
        if element >= 0 && element < i32(params.lines) {
            let position = place(element);
            let first = clamp(i32(position), 1, i32(halves()) - 3);
            let after = clamp(position - f32(first), 0.0, 1.0);
            let at = (look * halves() + u32(first)) * params.samples + id.x;
            let near = curvatures_down[at];
            sum += gain(near + after * (curvatures_down[at + params.samples] - near));
            count += 1.0;
        }
    }
    mean_amplitudes[id.y * params.samples + id.x] *= sum / count;
}
