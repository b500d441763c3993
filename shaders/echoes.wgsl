// Radio-frequency echoes of point scatterers: each sample of each line gathers the pulses of the scatterers near it. The CPU counterpart is
// `src/imaging/rf/echoes.rs`.
//
// Scatterers lie in bins of 64 samples of depth by the first sample of their pulse, in each bin by line. For each bin and line `ranges` has the
// first scatterer whose beam may reach the line, and the one past the last. Sums have a fixed order: results do not depend on scheduling.

struct Params {
    lines: u32,
    samples: u32,
    // Samples of a pulse.
    length: u32,
    // Rows of the table of pulses.
    rows: u32,
    // Depth of the bins before sample 0, samples: a multiple of 64, at least as long as a pulse.
    ahead: u32,
    // Scatterers of a sample, counted over its bins, that this dispatch adds: the first, and how many.
    first: u32,
    count: u32,
}

struct Scatterer {
    // First sample of the pulse, and its row of the table, between two rows.
    start: i32,
    row: f32,
    line: f32,
    amplitude: f32,
    // Standard deviation of the lateral profile, lines.
    sigma: f32,
    // First line of the beam, and the last in the upper half.
    reach: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> scatterers: array<Scatterer>;
@group(0) @binding(2) var<storage, read> ranges: array<u32>;
// Rows of pulses at fractions of a sample, centre frequency by centre frequency.
@group(0) @binding(3) var<storage, read> pulse: array<f32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

const BIN = 64u;
// Samples that an invocation adds up.
const OWN = 8u;

@compute @workgroup_size(64)
fn echoes(@builtin(global_invocation_id) id: vec3<u32>) {
    let sample = id.x * OWN;
    let line = id.y;
    if sample >= params.samples {
        return;
    }
    let at = line * params.samples + sample;
    let own = min(OWN, params.samples - sample);
    var sums: array<f32, OWN>;
    if params.first > 0u {
        for (var j = 0u; j < own; j++) {
            sums[j] = out[at + j];
        }
    }
    var seen = 0u;
    let first_bin = (sample + params.ahead + 1u - params.length) / BIN;
    let last_bin = (sample + params.ahead) / BIN;
    for (var bin = first_bin; bin <= last_bin; bin++) {
        let place = 2u * (bin * params.lines + line);
        let begin = ranges[place];
        let next = seen + ranges[place + 1u] - begin;
        let end = begin + clamp(params.first + params.count, seen, next) - seen;
        for (var k = begin + clamp(params.first, seen, next) - seen; k < end; k++) {
            let it = scatterers[k];
            let along = i32(sample) - it.start;
            let reached = line >= (it.reach & 0xffffu) && line <= (it.reach >> 16u);
            if !reached || along <= -i32(OWN) || along >= i32(params.length) {
                continue;
            }
            let away = (f32(line) - it.line) / it.sigma;
            let weight = it.amplitude * exp(-0.5 * away * away);
            let low = min(u32(it.row), params.rows - 2u);
            let share = it.row - f32(low);
            for (var j = 0u; j < OWN; j++) {
                let k = along + i32(j);
                if k >= 0 && k < i32(params.length) {
                    let row = low * params.length + u32(k);
                    sums[j] += weight * (pulse[row] + share * (pulse[row + params.length] - pulse[row]));
                }
            }
        }
        seen = next;
    }
    for (var j = 0u; j < own; j++) {
        out[at + j] = sums[j];
    }
}
