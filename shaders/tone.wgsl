// Gain and log compression to grey levels, and the automatic gain of each band of depth. Twin of src/imaging/effects/tone.rs and
// src/imaging/effects/tone/auto_gain.rs.
#import power

struct Params {
    samples: u32,
    lines: u32,
    compress: u32,
    per_octave: f32,
    middle: f32,
    bend: f32,
    gamma: f32,
    scale: f32,
    share: f32,
    ceiling: f32,
    unused_a: u32,
    unused_b: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> gain: array<f32>;

// Of the tone.
@group(0) @binding(2) var<storage, read_write> amplitudes: array<f32>;
@group(0) @binding(3) var<storage, read> octaves: array<f32>;

// Of the automatic gain.
@group(0) @binding(2) var<storage, read> echoes: array<f32>;
@group(0) @binding(3) var<storage, read_write> measured: array<f32>;
@group(0) @binding(4) var<storage, read> tops: array<u32>;

const BANDS = 16u;
const SILENT = 0.1;
const HEARD = 0.3;
const MAX = 16.0;
const PRIOR = 0.03;
const NEAR = 64u;
const THREADS = 256u;

var<workgroup> partial: array<vec2<f32>, THREADS>;

fn grey(amplitude: f32, lifted: f32) -> f32 {
    if params.compress == 0u {
        return clamp(amplitude * 255.0, 0.0, 255.0);
    }
    let g = clamp(params.middle + params.per_octave * (log2(max(amplitude, 1e-10)) + lifted), 0.0, 1.0);
    let share = g - params.bend * (g * (1.0 - g) * (1.0 - (g + g)));
    if params.gamma == 1.0 {
        return 255.0 * share;
    }
    return 255.0 * power(share, params.gamma);
}

@compute @workgroup_size(64)
fn by_hand(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    amplitudes[index] = grey(amplitudes[index] * gain[id.x], 0.0);
}

@compute @workgroup_size(64)
fn automatic(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let per_sample = f32(BANDS) / f32(params.samples);
    let place = clamp((f32(id.x) + 0.5) * per_sample - 0.5, 0.0, f32(BANDS - 1u));
    let band = min(u32(place), BANDS - 2u);
    let lifted = octaves[band] + (place - f32(band)) * (octaves[band + 1u] - octaves[band]);
    let index = id.y * params.samples + id.x;
    amplitudes[index] = grey(amplitudes[index] * gain[id.x], lifted);
}

// First and last sample of a band, and their number on all scanlines.
fn span(band: u32) -> vec3<u32> {
    let end = (band + 1u) * params.samples / BANDS;
    let start = min(max(band * params.samples / BANDS, params.samples / NEAR), end);
    return vec3<u32>(start, end, (end - start) * params.lines);
}

// Scanline and sample of an element of a band.
fn element(span: vec3<u32>, i: u32) -> vec2<u32> {
    let width = span.y - span.x;
    let line = i / width;
    return vec2<u32>(line, span.x + i - line * width);
}

// Weight of an echo, and weight times amplitude.
fn counted(at: vec2<u32>) -> vec2<f32> {
    let echo = echoes[at.x * params.samples + at.y] * gain[at.y] * params.scale;
    let weight = clamp((echo - SILENT) * (1.0 / (HEARD - SILENT)), 0.0, 1.0);
    return vec2<f32>(weight, weight * min(echo, MAX));
}

// Sums of all threads to the gain of a band.
fn measure(thread: u32, band: u32, count: u32, sum: vec2<f32>) {
    partial[thread] = sum;
    for (var half = THREADS / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half {
            partial[thread] += partial[thread + half];
        }
    }
    if thread == 0u {
        let prior = PRIOR * (f32(count) + 1.0);
        let level = (partial[0].y + prior) / (partial[0].x + prior);
        let middle = min((2u * band + 1u) * params.samples / (2u * BANDS), params.samples - 1u);
        let room = max(params.ceiling - log2(gain[middle]), 0.0);
        measured[band] = min(-params.share * log2(level), room);
    }
}

// A workgroup a band.
@compute @workgroup_size(256)
fn auto_gain(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let span = span(group.y);
    var sum = vec2<f32>(0.0);
    for (var i = thread; i < span.z; i += THREADS) {
        sum += counted(element(span, i));
    }
    measure(thread, group.y, span.z, sum);
}

// Without what lies behind bone, gas and lung.
@compute @workgroup_size(256)
fn auto_gain_above(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let span = span(group.y);
    var sum = vec2<f32>(0.0);
    for (var i = thread; i < span.z; i += THREADS) {
        let at = element(span, i);
        if at.y < tops[at.x] {
            sum += counted(at);
        }
    }
    measure(thread, group.y, span.z, sum);
}
