// Specular echoes at steps of impedance. Twin of src/effects/interface.rs.
struct Params {
    lines: u32,
    samples: u32,
    sample_mm: f32,
    mirror: f32,
    directivity: f32,
    unused_a: u32,
    unused_b: u32,
    unused_c: u32,
}

@group(0) @binding(0) var<storage, read> params: Params;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> label_rows: array<LabelRow>;
@group(0) @binding(3) var<storage, read> line_spacing: array<f32>;
@group(0) @binding(4) var<storage, read_write> amplitudes: array<f32>;

fn column(line: u32, sample: u32) -> vec3<f32> {
    let at = line * params.samples + sample;
    return vec3<f32>(
        label_rows[labels[at - 1u]].impedance,
        label_rows[labels[at]].impedance,
        label_rows[labels[at + 1u]].impedance,
    );
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let sample = id.x;
    let line = id.y;
    if sample < 1u || sample + 1u >= params.samples {
        return;
    }
    let a = column(line - min(line, 1u), sample);
    let b = column(line, sample);
    let c = column(min(line + 1u, params.lines - 1u), sample);
    let along = 0.25 * a + 0.5 * b + 0.25 * c;
    let lateral_step = 0.25 * (c.x - a.x) + 0.5 * (c.y - a.y) + 0.25 * (c.z - a.z);
    let line_mm = line_spacing[sample];
    let axial = (along.z - along.x) / (params.sample_mm + params.sample_mm);
    let lateral = lateral_step / (line_mm + line_mm);
    let steepness = sqrt(axial * axial + lateral * lateral);
    let total = along.x + along.z;
    if axial == 0.0 || total <= 0.0 {
        return;
    }
    let cosine = abs(axial) / steepness;
    let share = 0.5 * abs(along.z - along.x) / total * power(cosine, params.directivity);
    amplitudes[line * params.samples + sample] += params.mirror * share;
}
