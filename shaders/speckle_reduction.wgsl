// Edge-keeping smoother, oriented by the evenness of lines through a sample.
// Twin of src/imaging/effects/speckle_reduction.rs.
struct Params {
    lines: u32,
    samples: u32,
    strength: f32,
    unused: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> amplitudes: array<f32>;
// Per sample depth: offsets of the taps across scanlines, then along them.
@group(0) @binding(2) var<storage, read> offsets: array<u32>;
@group(0) @binding(3) var<storage, read_write> smoothed: array<f32>;

const TAPS = 5u;
const INNER = 2u;
const COUNT = 11.0;
const INNER_COUNT = 5.0;
// Inverse of the squared coefficient of variation of fully developed speckle, 4 / pi - 1.
const EVENNESS = 3.659792366325487;
const LEAST = 1e-30;

// Beyond the first and last scanlines and samples those repeat.
fn amplitude(line: i32, sample: i32) -> f32 {
    let nearest = vec2<u32>(clamp(
        vec2<i32>(line, sample),
        vec2<i32>(0),
        vec2<i32>(vec2<u32>(params.lines, params.samples)) - 1,
    ));
    return amplitudes[nearest.x * params.samples + nearest.y];
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let sample = i32(id.x);
    let line = i32(id.y);
    if id.x >= params.samples {
        return;
    }
    let middle = amplitude(line, sample);
    var weighted = middle;
    var total = 1.0;
    for (var direction = 0u; direction < 4u; direction++) {
        // Across, along, and the diagonals.
        let across = select(1, 0, direction == 1u);
        let along = select(select(1, -1, direction == 3u), 0, direction == 0u);
        var sum = middle;
        var squares = middle * middle;
        var inner = middle;
        for (var tap = 0u; tap < TAPS; tap++) {
            let at = id.x * 2u * TAPS + tap;
            let lines = across * i32(offsets[at]);
            let samples = along * i32(offsets[at + TAPS]);
            let before = amplitude(line + lines, sample + samples);
            let after = amplitude(line - lines, sample - samples);
            sum = (sum + before) + after;
            squares = (squares + before * before) + after * after;
            if tap + 1u == INNER {
                inner = sum;
            }
        }
        let square = max(sum * sum, LEAST);
        let variation = (COUNT * squares / square - 1.0) * EVENNESS;
        let power = variation * variation;
        let weight = 1.0 / (1.0 + (power * power) * (power * power));
        total += weight;
        weighted += weight * (inner * (1.0 / INNER_COUNT));
    }
    smoothed[id.y * params.samples + id.x] = middle + params.strength * (weighted / total - middle);
}
