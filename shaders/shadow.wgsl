// Loss down each scanline: one workgroup a scanline, a parallel prefix sum in saturating fixed point. Then the mean over the
// beam of what that lets through. Twin of src/effects/shadow.rs and src/effects/shadow/penumbra.rs.
struct Params {
    lines: u32,
    samples: u32,
    reach: u32,
    opaque_units: u32,
    needle_units: f32,
    exponent: f32,
    unused_a: u32,
    unused_b: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_rows: array<LabelRow>;

// Of the losses.
@group(0) @binding(3) var<storage, read_write> through: array<f32>;
@group(0) @binding(4) var<storage, read_write> losses: array<u32>;
@group(0) @binding(5) var<storage, read> needle_mask: array<vec2<f32>>;

// Of the penumbra.
@group(0) @binding(3) var<storage, read> one_way: array<f32>;
@group(0) @binding(4) var<storage, read> weights: array<f32>;
@group(0) @binding(5) var<storage, read_write> amplitudes: array<f32>;

const MOST_UNITS = 0x7fffffffu;
const THREADS = 256u;

var<workgroup> partial: array<u32, THREADS>;

fn tissue_loss(index: u32) -> u32 {
    return label_rows[labels[index]].loss;
}

fn tissue_and_needle_loss(index: u32) -> u32 {
    return tissue_loss(index) + u32(needle_mask[index].y * params.needle_units);
}

// Exclusive prefix over the workgroup of each thread's sum; saturating addition of non-negative numbers is associative.
fn exclusive(thread: u32, sum: u32) -> u32 {
    partial[thread] = sum;
    workgroupBarrier();
    for (var reach = 1u; reach < THREADS; reach *= 2u) {
        var before = 0u;
        if thread >= reach {
            before = partial[thread - reach];
        }
        workgroupBarrier();
        partial[thread] = min(partial[thread] + before, MOST_UNITS);
        workgroupBarrier();
    }
    if thread == 0u {
        return 0u;
    }
    return partial[thread - 1u];
}

fn leave(index: u32, units: u32) {
    losses[index] = units;
    through[index] = exp2(f32(units) * params.exponent);
}

@compute @workgroup_size(256)
fn tissue(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    var sum = 0u;
    for (var i = start; i < end; i++) {
        sum = min(sum + tissue_loss(line + i), MOST_UNITS);
    }
    var above = exclusive(thread, sum);
    for (var i = start; i < end; i++) {
        let own = tissue_loss(line + i);
        leave(line + i, min(above + own / 2u, MOST_UNITS));
        above = min(above + own, MOST_UNITS);
    }
}

@compute @workgroup_size(256)
fn tissue_and_needle(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    var sum = 0u;
    for (var i = start; i < end; i++) {
        sum = min(sum + tissue_and_needle_loss(line + i), MOST_UNITS);
    }
    var above = exclusive(thread, sum);
    for (var i = start; i < end; i++) {
        let own = tissue_and_needle_loss(line + i);
        leave(line + i, min(above + own / 2u, MOST_UNITS));
        above = min(above + own, MOST_UNITS);
    }
}

// There and back through the mean over the beam.
@compute @workgroup_size(64)
fn penumbra(@builtin(global_invocation_id) id: vec3<u32>) {
    let sample = id.x;
    let line = id.y;
    if sample >= params.samples {
        return;
    }
    let index = line * params.samples + sample;
    let first = line - min(line, params.reach);
    let last = min(line + params.reach, params.lines - 1u);
    var sum = 0.0;
    var norm = 0.0;
    for (var other = first; other <= last; other++) {
        let weight = weights[(other + params.reach - line) * params.samples + sample];
        sum += weight * one_way[other * params.samples + sample];
        norm += weight;
    }
    if last - first == 2u * params.reach {
        norm = 1.0;
    }
    var left = sum / norm;
    if tissue_loss(index) >= params.opaque_units {
        left = min(left, one_way[index]);
    }
    amplitudes[index] *= left * left;
}
