// Echo of needle and seeds in the thickened scan plane. Twin of src/imaging/effects/needle.rs.
#import power
#import scatterer

struct Params {
    samples: u32,
    sample_mm: f32,
    segments: u32,
    beams_per_mm: f32,
    echo: f32,
    directivity: f32,
    reverberations: u32,
    reverberation_mm: f32,
    reverberation: f32,
    steady: f32,
    diffuse: f32,
    after_surfaces: u32,
    seed: vec2<u32>,
    unused: vec2<u32>,
}

// From start to end, with the radius behind the one and the thickness of the plane behind the other; then the distances of both
// from the tip, the number of the shaft, and the factor on its echo.
struct Segment {
    start: vec4<f32>,
    end: vec4<f32>,
    along: vec4<f32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> segments: array<Segment>;
@group(0) @binding(3) var<storage, read_write> mask: array<vec2<f32>>;

// main
@group(0) @binding(4) var<storage, read_write> amplitudes: array<f32>;

// before_speckle
@group(0) @binding(4) var<storage, read_write> specular: array<vec2<f32>>;

const PARALLEL = 1e-7;
const PER_GRAIN = 0.5;
const BEVEL_MM = 3.0;
const BEVEL = 2.0;

// Complex multiplier of the echo at a point of the plane.
fn grain(segment: u32, u: vec3<f32>, len: f32, point: vec2<f32>) -> vec2<f32> {
    let along = segments[segment].along;
    let share = clamp(dot(vec3<f32>(point, 0.0) - segments[segment].start.xyz, u) / max(len, 1e-9), 0.0, 1.0);
    let from_tip = along.x + share * (along.y - along.x);
    let rough = scatterer(vec3<f32>(from_tip * PER_GRAIN, along.z, 0.0), params.seed);
    let factor = select(along.w, BEVEL * along.w, along.z == 0.0 && from_tip < BEVEL_MM);
    return factor * (vec2<f32>(params.steady, 0.0) + params.diffuse * rough);
}

fn share(start: vec3<f32>, u: vec3<f32>, len: f32, radius: f32, thickness: f32, point: vec2<f32>) -> f32 {
    let q = vec3<f32>(point, 0.0) - start;
    let along = dot(q, u);
    let w = q - along * u;
    let a = 1.0 - u.z * u.z;
    let b = w.z;
    let c = dot(w, w) - radius * radius;
    var low = -0.5 * thickness;
    var high = 0.5 * thickness;
    if a > PARALLEL {
        let squared = b * b - a * c;
        if squared <= 0.0 {
            return 0.0;
        }
        let root = sqrt(squared);
        low = max(low, (-b - root) / a);
        high = min(high, (-b + root) / a);
    } else if c > 0.0 {
        return 0.0;
    }
    if abs(u.z) > PARALLEL {
        let z0 = -along / u.z;
        let z1 = (len - along) / u.z;
        low = max(low, min(z0, z1));
        high = min(high, max(z0, z1));
    } else if along < 0.0 || along > len {
        return 0.0;
    }
    return max(high - low, 0.0) / thickness;
}

// Echo of all segments at a sample. Without a point spread, the moduli of their echoes.
fn echo(line: u32, sample: u32, modulus: bool) -> vec2<f32> {
    let ray = rays[line];
    let depth = (f32(sample) + 0.5) * params.sample_mm;
    var filled = 0.0;
    var shaded = 0.0;
    var sum = vec2<f32>(0.0);
    for (var segment = 0u; segment < params.segments; segment++) {
        let start = segments[segment].start.xyz;
        let radius = segments[segment].start.w;
        let thickness = segments[segment].end.w;
        let span = segments[segment].end.xyz - start;
        let len = length(span);
        let u = span / max(len, 1e-9);
        let cosine = dot(ray.zw, u.xy);
        let square = power(sqrt(max(1.0 - cosine * cosine, 0.0)), params.directivity);
        var size = params.echo * square;
        for (var repetition = 0u; repetition <= params.reverberations; repetition++) {
            let shifted = depth - f32(repetition) * params.reverberation_mm;
            let point = ray.xy + ray.zw * shifted;
            let part = share(start, u, len, radius, thickness, point);
            if repetition == 0u {
                let more = min(filled + part, 1.0);
                shaded += (more - filled) * min(thickness * params.beams_per_mm, 1.0);
                filled = more;
            }
            if part > 0.0 {
                let one = size * part * grain(segment, u, len, point);
                sum += select(one, vec2<f32>(length(one), 0.0), modulus);
            }
            size *= params.reverberation;
        }
    }
    mask[line * params.samples + sample] = vec2<f32>(filled, shaded);
    return sum;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        amplitudes[id.y * params.samples + id.x] += echo(id.y, id.x, true).x;
    }
}

@compute @workgroup_size(64)
fn before_speckle(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        let index = id.y * params.samples + id.x;
        let before = select(vec2<f32>(0.0), specular[index], params.after_surfaces == 1u);
        specular[index] = before + echo(id.y, id.x, false);
    }
}
