// Haze of other paths than the beam. Twin of src/imaging/effects/haze.rs.
#import decaying_sum
#import label_row
#import prefix_sum

struct Params {
    lines: u32,
    samples: u32,
    columns: u32,
    level: f32,
    fading: f32,
    share: f32,
    behind: f32,
    behind_fading: f32,
    per_unit: f32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
}

const SOFT_MRAYL = 1.7;

@group(0) @binding(0) var<storage, read> params: Params;

// What occluding tissue throws back, per scanline; labels for the sum with the echoes, too.
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(3) var<storage, read_write> reflected: array<f32>;

// Means of columns: one workgroup each, a parallel sum along the beam.
@group(0) @binding(1) var<storage, read> echoes: array<f32>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read> gains: array<f32>;
@group(0) @binding(4) var<storage, read_write> means: array<f32>;
@group(0) @binding(5) var<storage, read> reflectors_down: array<f32>;

// Sum with the echoes.
@group(0) @binding(2) var<storage, read> pattern: array<f32>;
@group(0) @binding(3) var<storage, read> means_around_columns: array<f32>;
@group(0) @binding(4) var<storage, read_write> amplitudes: array<f32>;

// Loss to occlusion of a sample, units.
fn occluded(index: u32) -> u32 {
    let row = label_rows[labels[index]];
    return row.loss - row.attenuation;
}

// Share that an occluding tissue throws back.
fn thrown_back(impedance: f32) -> f32 {
    if impedance <= SOFT_MRAYL {
        return 1.0;
    }
    let ratio = (impedance - SOFT_MRAYL) / (impedance + SOFT_MRAYL);
    return (ratio * ratio) * (ratio * ratio);
}

@compute @workgroup_size(256)
fn reflectors(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    var units = 0u;
    for (var i = start; i < end; i++) {
        units = min(units + occluded(line + i), MAX_UNITS);
    }
    units = exclusive(thread, units);
    for (var i = start; i < end; i++) {
        let before = exp2(f32(units) * params.per_unit);
        units = min(units + occluded(line + i), MAX_UNITS);
        let left = exp2(f32(units) * params.per_unit);
        reflected[line + i] = thrown_back(label_rows[labels[line + i]].impedance) * (before - left);
    }
}

// Mean share of the power that is reflected at a sample.
fn thrown_back_across(column: u32, sample: u32) -> f32 {
    var sum = 0.0;
    for (var line = 0u; line < params.lines; line++) {
        sum += weights[column * params.lines + line] * reflectors_down[line * params.samples + sample];
    }
    return sum;
}

// Mean power at a sample.
fn across(column: u32, sample: u32) -> f32 {
    var sum = 0.0;
    for (var line = 0u; line < params.lines; line++) {
        let echo = echoes[line * params.samples + sample];
        sum += weights[column * params.lines + line] * (echo * echo);
    }
    return sum;
}

@compute @workgroup_size(256)
fn means_around(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + LANES - 1u) / LANES;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let row = group.y * params.samples;
    let left = exp2(params.fading);
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        let mean = across(group.y, i) * params.share * gains[i];
        means[row + i] = mean;
        sum = sum * left + mean;
    }
    var above = decaying_sum(thread, sum, params.fading * f32(each));
    let behind_left = exp2(params.behind_fading);
    sum = 0.0;
    for (var i = start; i < end; i++) {
        above = above * left + means[row + i];
        means[row + i] = above;
        sum = sum * behind_left + thrown_back_across(group.y, i) * min(above, 1.0);
    }
    var reverberant = decaying_sum(thread, sum, params.behind_fading * f32(each));
    for (var i = start; i < end; i++) {
        above = means[row + i];
        reverberant = reverberant * behind_left + thrown_back_across(group.y, i) * min(above, 1.0);
        means[row + i] = (above + params.behind * reverberant) / gains[i];
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    if labels[index] == 0u {
        return;
    }
    let place = (f32(id.y) + 0.5) * f32(params.columns) / f32(params.lines) - 0.5;
    let first = clamp(i32(place), 0, i32(params.columns) - 1);
    let after = clamp(place - f32(first), 0.0, 1.0);
    let second = min(u32(first) + 1u, params.columns - 1u);
    let near = means_around_columns[u32(first) * params.samples + id.x];
    let far = means_around_columns[second * params.samples + id.x];
    let haze = pattern[index] * (params.level * (1.0 - after) * near + params.level * after * far);
    let echo = amplitudes[index];
    amplitudes[index] = sqrt(echo * echo + haze);
}
