// Cumulative phase per half beam width, and focusing by its curvature per scanline: one workgroup each, parallel prefix sums.
// Twin of src/imaging/effects/refraction.rs.
#import label_row

struct Params {
    lines: u32,
    samples: u32,
    reach: u32,
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
@group(0) @binding(3) var<storage, read_write> phases: array<f32>;

// Focusing pass.
@group(0) @binding(1) var<storage, read> phases_down: array<f32>;
@group(0) @binding(2) var<storage, read_write> amplitudes: array<f32>;

const THREADS = 256u;
const MAX = 1.4;

var<workgroup> partial: array<f32, THREADS>;

// Exclusive prefix sum over the workgroup, decaying by `fading` (log2) per thread.
fn exclusive(thread: u32, sum: f32, fading: f32) -> f32 {
    partial[thread] = sum;
    workgroupBarrier();
    for (var reach = 1u; reach < THREADS; reach *= 2u) {
        var before = 0.0;
        if thread >= reach {
            before = partial[thread - reach];
        }
        workgroupBarrier();
        partial[thread] += before * exp2(fading * f32(reach));
        workgroupBarrier();
    }
    if thread == 0u {
        return 0.0;
    }
    return partial[thread - 1u];
}

// Phase of a sample, summed over the scanlines of half a beam width.
fn across(half: u32, sample: u32) -> f32 {
    var sum = 0.0;
    for (var line = half * params.reach; line < (half + 1u) * params.reach; line++) {
        sum += f32(label_rows[labels[line * params.samples + sample]].phase);
    }
    return sum;
}

@compute @workgroup_size(256)
fn phase(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        sum += across(group.y, i);
    }
    var above = exclusive(thread, sum, 0.0);
    for (var i = start; i < end; i++) {
        above += across(group.y, i);
        phases[group.y * params.samples + i] = above;
    }
}

// Curvature of the phase at a sample, interpolated by `after` between two half beam widths, over their squared distance.
fn term(first: u32, after: f32, sample: u32) -> f32 {
    let a = phases_down[(first - 1u) * params.samples + sample];
    let b = phases_down[first * params.samples + sample];
    let c = phases_down[(first + 1u) * params.samples + sample];
    let d = phases_down[(first + 2u) * params.samples + sample];
    let apart = max(f32(params.reach) * (params.spacing + params.spreading * f32(sample)), params.least);
    let near = a - 2.0 * b + c;
    let far = b - 2.0 * c + d;
    return (near + after * (far - near)) * params.unit / (apart * apart);
}

@compute @workgroup_size(256)
fn spread(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    let place = (f32(group.y) + 0.5) / f32(params.reach) - 0.5;
    let first = clamp(i32(place), 1, i32(params.lines / params.reach) - 3);
    let after = clamp(place - f32(first), 0.0, 1.0);
    let left = exp2(params.fading);
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        sum = sum * left + term(u32(first), after, i);
    }
    var above = exclusive(thread, sum, params.fading * f32(each));
    for (var i = start; i < end; i++) {
        above = above * left + term(u32(first), after, i);
        amplitudes[line + i] *= min(1.0 / abs(1.0 + above), MAX);
    }
}
