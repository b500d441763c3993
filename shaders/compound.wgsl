// Steered looks: the scatterers that each meets, and the mean of the looks after detection. Twin of src/imaging/effects/compound.rs.
#import label_row

struct Params {
    lines: u32,
    samples: u32,
    steered: u32,
    oversampling: u32,
    specular_at: u32,
    reach: u32,
    opaque_units: u32,
    to_next: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;

// rotate, rotate_specular and rotate_surfaces
@group(0) @binding(1) var<storage, read> scatter: array<vec2<f32>>;
// Per look its gains, a row over the samples; then per look and fine scanline cosine and sine.
@group(0) @binding(2) var<storage, read> phasors: array<f32>;
@group(0) @binding(3) var<storage, read_write> looks: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> specular: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> axial_kernel: array<f32>;
@group(0) @binding(6) var<storage, read> look_specular: array<vec2<f32>>;

// shaded and unshaded
@group(0) @binding(1) var<storage, read> envelopes: array<f32>;
@group(0) @binding(2) var<storage, read> shifts: array<i32>;
@group(0) @binding(3) var<storage, read_write> amplitudes: array<f32>;
@group(0) @binding(4) var<storage, read> through: array<f32>;
@group(0) @binding(5) var<storage, read> beam: array<f32>;
@group(0) @binding(6) var<storage, read> labels: array<u32>;
@group(0) @binding(7) var<storage, read> label_rows: array<LabelRow>;

fn fine_lines() -> u32 {
    return (params.lines - 1u) * params.oversampling + 1u;
}

// Echo of the scatterers of a sample in the row of a look and a fine scanline.
fn rotated(row: u32, sample: u32) -> vec2<f32> {
    let gain = phasors[row / fine_lines() * params.samples + sample];
    let at = params.steered * params.samples + 2u * row;
    let phase = vec2<f32>(phasors[at], phasors[at + 1u]);
    let echo = scatter[row % fine_lines() * params.samples + sample];
    return gain * vec2<f32>(phase.x * echo.x - phase.y * echo.y, phase.y * echo.x + phase.x * echo.y);
}

@compute @workgroup_size(64)
fn rotate(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        looks[id.y * params.samples + id.x] = rotated(id.y, id.x);
    }
}

@compute @workgroup_size(64)
fn rotate_specular(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        looks[id.y * params.samples + id.x] = rotated(id.y, id.x) + specular_of(id.y, id.x);
    }
}

// Scanlines on either side of a fine one.
fn lines_beside(row: u32) -> vec2<u32> {
    let line = row % fine_lines() / params.oversampling;
    return vec2<u32>(line, min(line + 1u, params.lines - 1u));
}

// Echo on a fine scanline between those on either side.
fn between(row: u32, sample: u32, a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    let part = f32(row % fine_lines() % params.oversampling) / f32(params.oversampling);
    return axial_kernel[params.specular_at + sample] * (a + part * (b - a));
}

// Echo of surfaces and needles at a sample of a fine scanline.
fn specular_of(row: u32, sample: u32) -> vec2<f32> {
    let at = lines_beside(row) * params.samples + sample;
    return between(row, sample, specular[at.x], specular[at.y]);
}

@compute @workgroup_size(64)
fn rotate_surfaces(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let at = (lines_beside(id.y) * params.steered + id.y / fine_lines()) * params.samples + id.x;
    let more = between(id.y, id.x, look_specular[at.x], look_specular[at.y]);
    looks[id.y * params.samples + id.x] = rotated(id.y, id.x) + specular_of(id.y, id.x) + more;
}

// Whether the element of a look to a sample lies on the array.
fn is_present(look: u32, line: u32, sample: u32) -> bool {
    let shift = shifts[(look / 2u + 1u) * params.to_next * params.samples + sample];
    let element = i32(line) - select(-shift, shift, (look & 1u) == 1u);
    return element >= 0 && element < i32(params.lines);
}

// Two-way transmittance of a look, averaged over the beam.
fn left_of(look: u32, line: u32, sample: u32) -> f32 {
    let place = look * params.lines;
    let reach = u32(beam[sample]);
    let first = line - min(line, reach);
    let last = min(line + reach, params.lines - 1u);
    var sum = 0.0;
    var norm = 0.0;
    for (var other = first; other <= last; other++) {
        let weight = beam[(1u + other + params.reach - line) * params.samples + sample];
        sum += weight * through[(place + other) * params.samples + sample];
        norm += weight;
    }
    if last - first == 2u * reach {
        norm = 1.0;
    }
    let left = sum / norm;
    if label_rows[labels[line * params.samples + sample]].loss >= params.opaque_units {
        return min(left, through[(place + line) * params.samples + sample]);
    }
    return left;
}

@compute @workgroup_size(64)
fn shaded(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    var sum = amplitudes[index];
    var count = 1.0;
    for (var look = 0u; look < params.steered; look++) {
        if is_present(look, id.y, id.x) {
            let left = left_of(look, id.y, id.x);
            sum += envelopes[look * params.lines * params.samples + index] * left * left;
            count += 1.0;
        }
    }
    amplitudes[index] = sum / count;
}

@compute @workgroup_size(64)
fn unshaded(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    var sum = amplitudes[index];
    var count = 1.0;
    for (var look = 0u; look < params.steered; look++) {
        if is_present(look, id.y, id.x) {
            sum += envelopes[look * params.lines * params.samples + index];
            count += 1.0;
        }
    }
    amplitudes[index] = sum / count;
}
