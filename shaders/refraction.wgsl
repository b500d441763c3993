// Phase down each scanline, and what its curvature across the scanlines leaves of an echo: one workgroup a scanline, parallel prefix sums.
// Twin of src/effects/refraction.rs.
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

// Of the phases.
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(3) var<storage, read_write> phases: array<f32>;

// Of the spreading.
@group(0) @binding(1) var<storage, read> phases_down: array<f32>;
@group(0) @binding(2) var<storage, read_write> amplitudes: array<f32>;

const THREADS = 256u;
const MOST = 1.4;

var<workgroup> partial: array<f32, THREADS>;

// Exclusive prefix over the workgroup of each thread's sum, of which `fading` (log2) remains from thread to thread.
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

@compute @workgroup_size(256)
fn phase(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        sum += f32(label_rows[labels[line + i]].phase);
    }
    var above = exclusive(thread, sum, 0.0);
    for (var i = start; i < end; i++) {
        above += f32(label_rows[labels[line + i]].phase);
        phases[line + i] = above;
    }
}

// Curvature of the phase across the scanlines around one at a sample, over the square of their distance.
fn term(middle: u32, sample: u32) -> f32 {
    let before = phases_down[(middle - params.reach) * params.samples + sample];
    let at = phases_down[middle * params.samples + sample];
    let after = phases_down[(middle + params.reach) * params.samples + sample];
    let apart = max(f32(params.reach) * (params.spacing + params.spreading * f32(sample)), params.least);
    return (before - 2.0 * at + after) * params.unit / (apart * apart);
}

@compute @workgroup_size(256)
fn spread(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    let middle = clamp(group.y, params.reach, params.lines - 1u - params.reach);
    let left = exp2(params.fading);
    var sum = 0.0;
    for (var i = start; i < end; i++) {
        sum = sum * left + term(middle, i);
    }
    var above = exclusive(thread, sum, params.fading * f32(each));
    for (var i = start; i < end; i++) {
        above = above * left + term(middle, i);
        amplitudes[line + i] *= min(1.0 / abs(1.0 + above), MOST);
    }
}
