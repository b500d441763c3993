// Loss down each scanline: one workgroup a scanline, a parallel prefix sum in saturating fixed point; down each ray of the aperture
// likewise, and the means over the rays. Then the mean over the beam of what that lets through. Twin of src/imaging/effects/shadow.rs,
// src/imaging/effects/shadow/aperture.rs, penumbra.rs, mirror.rs, reverberation.rs and b_lines.rs.
#import label_row
#import prefix_sum
#import scatterer

struct Params {
    lines: u32,
    samples: u32,
    reach: u32,
    opaque_units: u32,
    needle_units: f32,
    exponent: f32,
    reverberation: f32,
    spacing: f32,
    spreading: f32,
    mirror: f32,
    unfelt: f32,
    least_centre_at: f32,
    side: u32,
    to_next: u32,
    outermost: u32,
    neighbours: u32,
    seed: vec2<u32>,
    per_mm: f32,
    per_sample: f32,
    threshold: f32,
    steepness: f32,
    ring: f32,
    rise: u32,
    spread_per_sample: f32,
    apart: u32,
    unused_0: u32,
    unused_1: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_rows: array<LabelRow>;

// Of the losses.
@group(0) @binding(3) var<storage, read_write> through: array<f32>;
@group(0) @binding(4) var<storage, read_write> losses: array<u32>;
@group(0) @binding(5) var<storage, read> needle_mask: array<vec2<f32>>;

// Of the rays.
@group(0) @binding(3) var<storage, read> shifts: array<i32>;
@group(0) @binding(4) var<storage, read_write> of_rays: array<f32>;

// Of the aperture.
@group(0) @binding(1) var<storage, read> shifts_again: array<i32>;
@group(0) @binding(2) var<storage, read> let_through: array<f32>;

// Of the penumbra.
@group(0) @binding(3) var<storage, read> one_way: array<f32>;
@group(0) @binding(4) var<storage, read> weights: array<f32>;
@group(0) @binding(5) var<storage, read_write> amplitudes: array<f32>;

// Of the mirror image, the reverberation and B-lines.
@group(0) @binding(3) var<storage, read_write> found: array<u32>;
@group(0) @binding(1) var<storage, read> tops: array<u32>;
@group(0) @binding(2) var<storage, read> losses_down: array<u32>;
@group(0) @binding(3) var<storage, read> echoes_above: array<f32>;
@group(0) @binding(3) var<storage, read_write> echoes: array<f32>;
@group(0) @binding(4) var<storage, read> labels_below: array<u32>;
@group(0) @binding(5) var<storage, read> rows_below: array<LabelRow>;
@group(0) @binding(6) var<storage, read_write> mirrored: array<f32>;
@group(0) @binding(2) var<storage, read> left_of_average: array<f32>;
@group(0) @binding(6) var<storage, read> lost: array<u32>;
@group(0) @binding(7) var<storage, read> positions: array<vec4<f32>>;

// Losses of a sample: by attenuation, and others.
fn tissue_losses(index: u32) -> vec2<u32> {
    let row = label_rows[labels[index]];
    return vec2<u32>(row.attenuation, row.loss - row.attenuation);
}

fn tissue_and_needle_losses(index: u32) -> vec2<u32> {
    return tissue_losses(index) + vec2<u32>(0u, u32(needle_mask[index].y * params.needle_units));
}

fn together(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return min(a + b, vec2<u32>(MAX_UNITS));
}

// Sums before those of a thread.
fn exclusive_losses(thread: u32, sums: vec2<u32>) -> vec2<u32> {
    let first = exclusive(thread, sums.x);
    return vec2<u32>(first, exclusive(thread, sums.y));
}

// What a pulse feels of losses.
fn felt(sums: vec2<u32>) -> u32 {
    let units = f32(sums.x);
    let shifting = min(units, params.least_centre_at);
    return min(sums.x - u32(params.unfelt * shifting * (units + units - shifting)) + sums.y, MAX_UNITS);
}

fn power(units: u32) -> f32 {
    return exp2(f32(units) * params.exponent);
}

@compute @workgroup_size(256)
fn tissue(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    var sums = vec2<u32>(0u);
    for (var i = start; i < end; i++) {
        sums = together(sums, tissue_losses(line + i));
    }
    var above = exclusive_losses(thread, sums);
    for (var i = start; i < end; i++) {
        let own = tissue_losses(line + i);
        let down_to = felt(together(above, own / 2u));
        losses[line + i] = down_to;
        through[line + i] = power(down_to);
        above = together(above, own);
    }
}

@compute @workgroup_size(256)
fn tissue_and_needle(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let line = group.y * params.samples;
    var sums = vec2<u32>(0u);
    for (var i = start; i < end; i++) {
        sums = together(sums, tissue_and_needle_losses(line + i));
    }
    var above = exclusive_losses(thread, sums);
    for (var i = start; i < end; i++) {
        let own = tissue_and_needle_losses(line + i);
        let down_to = felt(together(above, own / 2u));
        losses[line + i] = down_to;
        through[line + i] = power(down_to);
        above = together(above, own);
    }
}

// Row of a ray in tables by distance from a middle one.
fn from_middle(ray: u32, middle: u32) -> u32 {
    return max(ray, middle) - min(ray, middle);
}

// Index of the place on the ray of an element at a sample; beside the image of the next in it.
fn ray_index(ray: u32, element: u32, sample: u32) -> u32 {
    let shift = shifts[from_middle(ray, params.outermost) * params.samples + sample];
    let line = clamp(i32(element) + select(shift, -shift, ray < params.outermost), 0, i32(params.lines) - 1);
    return u32(line) * params.samples + sample;
}

@compute @workgroup_size(256)
fn rays(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let row = (group.z * params.lines + group.y) * params.samples;
    var sums = vec2<u32>(0u);
    for (var i = start; i < end; i++) {
        sums = together(sums, tissue_losses(ray_index(group.z, group.y, i)));
    }
    var above = exclusive_losses(thread, sums);
    for (var i = start; i < end; i++) {
        let own = tissue_losses(ray_index(group.z, group.y, i));
        of_rays[row + i] = power(felt(together(above, own / 2u)));
        above = together(above, own);
    }
}

@compute @workgroup_size(256)
fn rays_and_needle(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let each = (params.samples + THREADS - 1u) / THREADS;
    let start = min(thread * each, params.samples);
    let end = min(start + each, params.samples);
    let row = (group.z * params.lines + group.y) * params.samples;
    var sums = vec2<u32>(0u);
    for (var i = start; i < end; i++) {
        sums = together(sums, tissue_and_needle_losses(ray_index(group.z, group.y, i)));
    }
    var above = exclusive_losses(thread, sums);
    for (var i = start; i < end; i++) {
        let own = tissue_and_needle_losses(ray_index(group.z, group.y, i));
        of_rays[row + i] = power(felt(together(above, own / 2u)));
        above = together(above, own);
    }
}

// The root of the product of the means, on the way there and back, of what the rays of a look to a sample let through.
fn mean_of_rays(middle: u32, line: u32, sample: u32) -> f32 {
    var sums = vec2<f32>(0.0);
    var missing = vec2<f32>(0.0);
    for (var ray = middle - params.side; ray <= middle + params.side; ray++) {
        let shift = shifts_again[from_middle(ray, params.outermost) * params.samples + sample];
        let element = i32(line) - select(shift, -shift, ray < params.outermost);
        let row = from_middle(ray, middle);
        let both = vec2<f32>(weights[2u * row * params.samples + sample], weights[(2u * row + 1u) * params.samples + sample]);
        if element >= 0 && element < i32(params.lines) {
            sums += both * let_through[(ray * params.lines + u32(element)) * params.samples + sample];
        } else {
            missing += both;
        }
    }
    let present = 1.0 - missing;
    return sqrt(sums.x * sums.y / max(present.x * present.y, 1e-12));
}

@compute @workgroup_size(64)
fn aperture(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        through[id.y * params.samples + id.x] = mean_of_rays(params.outermost, id.y, id.x);
    }
}

// Look by look, first to the left, then to the right, and farther out.
@compute @workgroup_size(64)
fn aperture_of_looks(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < params.samples {
        let look = id.y / params.lines;
        let away = (look / 2u + 1u) * params.to_next;
        let middle = select(params.outermost - away, params.outermost + away, (look & 1u) == 1u);
        through[id.y * params.samples + id.x] = mean_of_rays(middle, id.y % params.lines, id.x);
    }
}

// Attenuates each echo by the two-way transmittance, averaged over the beam.
@compute @workgroup_size(64)
fn penumbra(@builtin(global_invocation_id) id: vec3<u32>) {
    let sample = id.x;
    let line = id.y;
    if sample >= params.samples {
        return;
    }
    let index = line * params.samples + sample;
    let reach = u32(weights[sample]);
    let first = line - min(line, reach);
    let last = min(line + reach, params.lines - 1u);
    var sum = 0.0;
    var norm = 0.0;
    for (var other = first; other <= last; other++) {
        let weight = weights[(1u + other + params.reach - line) * params.samples + sample];
        sum += weight * one_way[other * params.samples + sample];
        norm += weight;
    }
    if last - first == 2u * reach {
        norm = 1.0;
    }
    var left = sum / norm;
    if label_rows[labels[index]].loss >= params.opaque_units {
        left = min(left, one_way[index]);
    }
    amplitudes[index] *= left * left;
}

var<workgroup> shallowest: atomic<u32>;

// The first opaque sample of each scanline below others.
@compute @workgroup_size(256)
fn reflectors(@builtin(local_invocation_index) thread: u32, @builtin(workgroup_id) group: vec3<u32>) {
    if thread == 0u {
        atomicStore(&shallowest, params.samples);
    }
    workgroupBarrier();
    for (var i = thread; i < params.samples; i += THREADS) {
        if label_rows[labels[group.y * params.samples + i]].loss >= params.opaque_units {
            atomicMin(&shallowest, i);
            break;
        }
    }
    workgroupBarrier();
    if thread == 0u {
        let top = atomicLoad(&shallowest);
        found[group.y] = select(top, params.samples, top == 0u);
    }
}

// Whether the reflector of another scanline continues that of one.
fn continues(line: u32, other: u32) -> bool {
    let apart = max(tops[line], tops[other]) - min(tops[line], tops[other]);
    return tops[other] < params.samples && apart <= params.rise;
}

// Number of scanlines of a stretch, of those that continue the surface, and samples from an echo to its repeat.
fn stretch(line: u32) -> vec3<u32> {
    let side = min(params.neighbours, min(line, params.lines - 1u - line) / params.apart);
    var sum = 0u;
    var count = 0u;
    for (var read = 0u; read <= 2u * side; read++) {
        let other = line + read * params.apart - side * params.apart;
        if continues(line, other) {
            sum += tops[other];
            count++;
        }
    }
    return vec3<u32>(2u * side + 1u, count, max(sum / count, 1u));
}

// Tangent of the tilt of a reflector.
fn tilt(line: u32, top: u32) -> f32 {
    let side = params.neighbours * params.apart;
    var first = line - min(line, side);
    var last = min(line + side, params.lines - 1u);
    first = select(line, first, continues(line, first));
    last = select(line, last, continues(line, last));
    if first == last {
        return 0.0;
    }
    let across = f32(last - first) * (params.spacing + params.spreading * f32(top));
    return (f32(tops[last]) - f32(tops[first])) / across;
}

// Echo above the surfaces.
fn echo_at(line: i32, sample: i32) -> f32 {
    if line < 0 || line >= i32(params.lines) || sample < 0 || sample >= i32(tops[line]) {
        return 0.0;
    }
    return echoes_above[u32(line) * params.samples + u32(sample)];
}

const GAS_MRAYL = 1.0;

// Echoes with the mirror image beyond gas or lung, of what is above the surfaces.
@compute @workgroup_size(64)
fn mirror(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.samples {
        return;
    }
    let top = tops[id.y];
    let row = id.y * params.samples;
    let own = echoes_above[row + id.x];
    mirrored[row + id.x] = own;
    if id.x < top || rows_below[labels_below[row + top]].impedance >= GAS_MRAYL {
        return;
    }
    let slope = tilt(id.y, top);
    let depth = f32(id.x) + 0.5;
    let beyond = depth - f32(top);
    let cos2 = 1.0 / (1.0 + slope * slope);
    let across = beyond * 2.0 * slope * cos2;
    let down = f32(top) + beyond * (1.0 - 2.0 * cos2);
    var place = vec2<f32>(across / params.spacing, down);
    if params.spreading > 0.0 {
        let apex = params.spacing / params.spreading;
        let ahead = apex + down;
        let radius = sqrt(across * across + ahead * ahead);
        let tangent = across / max(radius + ahead, 1e-6);
        let square = tangent * tangent;
        let angle = 2.0 * tangent * (15.0 + 4.0 * square) / (15.0 + 9.0 * square);
        place = vec2<f32>(angle / params.spreading, radius - apex);
    }
    let longer = max(depth - place.y, 0.0);
    place = vec2<f32>(f32(id.y) + place.x, place.y - 0.5);
    let size = vec2<f32>(f32(params.lines), f32(params.samples));
    if !(all(place > vec2<f32>(-1.0)) && all(place < size)) {
        return;
    }
    let first = vec2<i32>(place + 1.0) - 1;
    let share = place - vec2<f32>(first);
    let near = (1.0 - share.y) * echo_at(first.x, first.y) + share.y * echo_at(first.x, first.y + 1);
    let far = (1.0 - share.y) * echo_at(first.x + 1, first.y) + share.y * echo_at(first.x + 1, first.y + 1);
    let rate = f32(losses_down[row + top - 1u]) * 2.0 * params.exponent / f32(top);
    let image = params.mirror * exp2(rate * longer) * ((1.0 - share.x) * near + share.x * far);
    mirrored[row + id.x] = sqrt(own * own + image * image);
}

// What a repeat leaves for the tilt of the reflector.
fn directivity(line: u32, top: u32) -> f32 {
    let slope = tilt(line, top);
    let square = slope * slope;
    let cos2 = 1.0 / (1.0 + square);
    let twice = max((1.0 - square) * cos2, 0.0);
    return cos2 * cos2 * twice * twice * twice * twice;
}

// Each invocation has the samples that are repeats of each other.
@compute @workgroup_size(64)
fn reverberation(@builtin(global_invocation_id) id: vec3<u32>) {
    let top = tops[id.y];
    if top >= params.samples {
        return;
    }
    let stretch = stretch(id.y);
    let step = stretch.z;
    if id.x >= step {
        return;
    }
    let row = id.y * params.samples;
    let near = rows_below[labels_below[row + top - 1u]];
    let far = rows_below[labels_below[row + top]];
    let between = near.impedance + far.impedance;
    let reflected = max(abs(near.impedance - far.impedance) / max(between, 1e-30), abs(near.capsule - far.capsule));
    let spread = 1.0 + select(params.spread_per_sample * f32(top), 0.0, far.impedance < GAS_MRAYL);
    let met = f32(stretch.y) / f32(stretch.x);
    let gain = params.reverberation * reflected / spread * (met * met) * directivity(id.y, top);
    var echo = echoes[row + id.x];
    for (var sample = id.x + step; sample < params.samples; sample += step) {
        let own = echoes[row + sample];
        if sample < top {
            echo = own;
            continue;
        }
        let again = gain * (left_of_average[sample] / left_of_average[sample - step]) * echo;
        echo = sqrt(own * own + again * again);
        echoes[row + sample] = echo;
    }
}

// Stripes that ring down from the surface of gas or lung.
@compute @workgroup_size(64)
fn b_lines(@builtin(global_invocation_id) id: vec3<u32>) {
    let top = tops[id.y];
    if id.x >= params.samples || id.x < top {
        return;
    }
    let row = id.y * params.samples;
    if rows_below[labels_below[row + top]].impedance >= GAS_MRAYL {
        return;
    }
    let place = positions[row + top].xyz * params.per_mm;
    let rough = scatterer(place, params.seed);
    let strength = clamp((dot(rough, rough) - params.threshold) * params.steepness, 0.0, 1.0);
    if strength == 0.0 {
        return;
    }
    let above = exp2(f32(lost[row + top - 1u]) * 2.0 * params.exponent);
    let along = vec3<f32>(f32(id.x - top) * params.per_sample, 0.0, 0.0);
    let ripple = scatterer(place + along, params.seed);
    let size = params.ring * strength * above / left_of_average[top];
    let stripe = size * left_of_average[id.x] * sqrt(dot(ripple, ripple));
    let echo = echoes[row + id.x] * (1.0 - strength);
    echoes[row + id.x] = sqrt(echo * echo + stripe * stripe);
}
