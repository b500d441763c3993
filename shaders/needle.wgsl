// Echo of needle and seeds in the thickened scan plane. Twin of src/effects/needle.rs.
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
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

// From start to end, with the radius behind the one and the thickness of the plane behind the other.
struct Segment {
    start: vec4<f32>,
    end: vec4<f32>,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> rays: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> segments: array<Segment>;
@group(0) @binding(3) var<storage, read_write> mask: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> amplitudes: array<f32>;

const PARALLEL = 1e-7;

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

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let index = id.y * params.samples + id.x;
    let ray = rays[id.y];
    let depth = (f32(id.x) + 0.5) * params.sample_mm;
    var filled = 0.0;
    var shaded = 0.0;
    var sum = 0.0;
    for (var segment = 0u; segment < params.segments; segment++) {
        let start = segments[segment].start.xyz;
        let radius = segments[segment].start.w;
        let thickness = segments[segment].end.w;
        let span = segments[segment].end.xyz - start;
        let len = length(span);
        let u = span / max(len, 1e-9);
        let cosine = dot(ray.zw, u.xy);
        let square = power(sqrt(max(1.0 - cosine * cosine, 0.0)), params.directivity);
        var echo = params.echo * square;
        for (var repetition = 0u; repetition <= params.reverberations; repetition++) {
            let shifted = depth - f32(repetition) * params.reverberation_mm;
            let part = share(start, u, len, radius, thickness, ray.xy + ray.zw * shifted);
            if repetition == 0u {
                let more = min(filled + part, 1.0);
                shaded += (more - filled) * min(thickness * params.beams_per_mm, 1.0);
                filled = more;
            }
            sum += echo * part;
            echo *= params.reverberation;
        }
    }
    mask[index] = vec2<f32>(filled, shaded);
    amplitudes[index] += sum;
}
