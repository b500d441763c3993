// Speckle: scatterers of the reference state, then the point spread in the beam frame. Twin of src/imaging/effects/speckle.rs.
#import scatterer

const NONE: u32 = 0xffffffffu;

struct Params {
    elevation: vec4<f32>,
    planes: array<vec4<f32>, 2>,
    seed: vec2<u32>,
    lines: u32,
    samples: u32,
    oversampling: u32,
    plane_count: u32,
    plane_mm: f32,
    per_mm: f32,
    axial_reach: u32,
    lateral_reach: u32,
    carries_at: u32,
    bands: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;

// scatter_pass
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> amplitudes: array<f32>;
@group(0) @binding(3) var<storage, read_write> scatter: array<vec2<f32>>;

// warped_scatter_pass
@group(0) @binding(4) var<storage, read> elements: array<u32>;
@group(0) @binding(5) var<storage, read> element_maps: array<vec4<f32>>;

// specular_pass
@group(0) @binding(1) var<storage, read> specular: array<vec2<f32>>;

// specular_pass, axial_pass and lateral_pass
@group(0) @binding(1) var<storage, read> echoes: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read_write> spread: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read_write> envelope: array<f32>;

struct FineScanline {
    line: u32,
    next: u32,
    nearest: u32,
    part: f32,
}

fn fine_scanline(fine: u32) -> FineScanline {
    let line = fine / params.oversampling;
    let rest = fine % params.oversampling;
    let next = min(line + 1u, params.lines - 1u);
    let nearest = select(line, next, rest > 0u && 2u * rest >= params.oversampling);
    return FineScanline(line, next, nearest, f32(rest) / f32(params.oversampling));
}

// Echo of a sample of a fine scanline, with `step` (mm, reference state) from one sub-plane to the next.
fn echo(at: FineScanline, sample: u32, step: vec3<f32>) -> vec2<f32> {
    let a = positions[at.line * params.samples + sample].xyz;
    let b = positions[at.next * params.samples + sample].xyz;
    let middle = 0.5 * f32(params.plane_count - 1u);
    var sum = vec2<f32>(0.0);
    for (var plane = 0u; plane < params.plane_count; plane++) {
        let p = a + at.part * (b - a) + step * (f32(plane) - middle);
        sum += params.planes[plane >> 2u][plane & 3u] * scatterer(p * params.per_mm, params.seed);
    }
    return amplitudes[at.nearest * params.samples + sample] * sum;
}

@compute @workgroup_size(64)
fn scatter_pass(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    scatter[id.y * params.samples + id.x] = echo(fine_scanline(id.y), id.x, params.elevation.xyz * params.plane_mm);
}

// The sub-planes bend with the tissue: the elevation is carried to the reference state by the element of each sample.
@compute @workgroup_size(64)
fn warped_scatter_pass(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let at = fine_scanline(id.y);
    var step = params.elevation.xyz * params.plane_mm;
    let element = elements[at.nearest * params.samples + id.x];
    if element != NONE {
        let map = params.carries_at + 3u * element;
        step = vec3<f32>(
            dot(element_maps[map].xyz, step),
            dot(element_maps[map + 1u].xyz, step),
            dot(element_maps[map + 2u].xyz, step),
        );
    }
    scatter[id.y * params.samples + id.x] = echo(at, id.x, step);
}

// Number of weights of a band of depth.
fn axial_taps() -> u32 {
    return 2u * params.axial_reach + 1u;
}

// Echoes of surfaces and needles, linear between scanlines.
@compute @workgroup_size(64)
fn specular_pass(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let at = fine_scanline(id.y);
    let a = specular[at.line * params.samples + id.x];
    let b = specular[at.next * params.samples + id.x];
    // Behind the kernels and what makes up for their ends.
    let factor = weights[params.bands * axial_taps() + params.samples + id.x];
    scatter[id.y * params.samples + id.x] += factor * (a + at.part * (b - a));
}

@compute @workgroup_size(64)
fn axial_pass(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let reach = i32(params.axial_reach);
    let row = id.y * params.samples;
    let first = id.x * params.bands / params.samples * axial_taps();
    var sum = vec2<f32>(0.0);
    for (var tap = 0; tap <= 2 * reach; tap++) {
        let sample = i32(id.x) + tap - reach;
        if sample >= 0 && sample < i32(params.samples) {
            sum += weights[first + u32(tap)] * echoes[row + u32(sample)];
        }
    }
    // Behind the kernels: per sample, what makes up for the taps beyond an end.
    spread[row + id.x] = weights[params.bands * axial_taps() + id.x] * sum;
}

@compute @workgroup_size(64)
fn lateral_pass(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    // Of several looks one after another.
    let line = id.y % params.lines;
    let fine_lines = (params.lines - 1u) * params.oversampling + 1u;
    let look = id.y / params.lines * fine_lines * params.samples;
    // Rows over the samples: reach on each side, the weight of each tap, then the factors of the outermost scanlines.
    let reach = u32(weights[id.x]);
    let centre = line * params.oversampling;
    let first = centre - min(centre, reach);
    let last = min(centre + reach, fine_lines - 1u);
    var sum = vec2<f32>(0.0);
    for (var fine = first; fine <= last; fine++) {
        let weight = weights[(1u + fine + params.lateral_reach - centre) * params.samples + id.x];
        sum += weight * echoes[look + fine * params.samples + id.x];
    }
    var scale = 1.0;
    let from_side = min(line, params.lines - 1u - line);
    if from_side * params.oversampling < params.lateral_reach {
        // What makes up for the taps beyond the side.
        scale = weights[(2u * params.lateral_reach + 2u + from_side) * params.samples + id.x];
    }
    envelope[id.y * params.samples + id.x] = length(sum) * scale;
}
